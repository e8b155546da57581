"""The options of `tcfit render`. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from tcfit_app.options.fit import JsonLines, ModelsFolder, Phase, RunName, shown


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """Draw a fit: a picture, a sheet of pictures, or a video, over the video's frames or from any side.

    Needs OpenGL, but no screen: tcfit doctor says whether it is there.
    """

    path: Annotated[Positional[Path | None], arg(metavar="PROJECT|RESULT", help_behavior_hint="(required)")] = None
    """A project's folder, or a result's: its folder or fit.npz."""
    out: Annotated[Path, shown("FILE", "render.png")] = Path("render.png")
    """.png: a picture, or a sheet of several frames; .mp4: a video."""
    view: Annotated[
        tuple[Literal["picture", "front", "side", "back", "top", "orbit"], ...],
        shown("{picture,front,side,back,top,orbit} ...", "picture, or front where there is no video"),
    ] = ()
    """Several are drawn beside each other. picture: as the camera saw it; front: from the camera's side, upright;
    orbit: once around."""
    azimuth: Annotated[float | None, shown("DEGREES", "the view's")] = None
    """From where, instead: 0 is the camera's side, 90 the left of a person who faces it."""
    elevation: Annotated[float | None, shown("DEGREES", "the view's")] = None
    """Above the horizon, -90 to 90."""
    distance: Annotated[float | None, shown("METRES", "far away: lines stay parallel")] = None
    """From the eye to the middle of what is shown."""
    frames: Annotated[str | None, shown("FIRST:LAST", "the middle one; of a video all")] = None
    """By their numbers in the video; either may be left out. Of a picture, one number, or several for a sheet."""
    count: Annotated[int, shown("N", "12")] = 12
    """Most pictures of a sheet, evenly over the frames."""
    columns: Annotated[int, shown("N", "4")] = 4
    """Of a sheet."""
    size: Annotated[tuple[int, int], shown("W H", "720 720")] = (720, 720)
    """Pixels of each view; of the picture the height counts."""
    background: Annotated[str, arg(metavar="{white,grey,black,#RRGGBB}")] = "white"
    """Of all views but the picture."""
    floor: bool = True
    """Draw a floor of half-metre squares, but in the picture."""
    video: bool = True
    """Draw the video's frames in the picture; else the body alone."""
    video_file: Annotated[Path | None, shown("PATH", "the one that was fitted")] = None
    """The video or images, where they are not where they were."""
    run: RunName = None
    phase: Phase = None
    against: Annotated[str | None, shown("NAME", "nothing")] = None
    """Another fit beside it: a run of the project by name or number, or phase1, each frame on its own."""
    json: JsonLines = False
    overwrite: bool = False
    """Replace a file of that name."""
    models: ModelsFolder = None
