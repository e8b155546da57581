"""The options of `tcfit export`. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from tcfit_app.options.fit import JsonLines, ModelsFolder, Phase, RunName, shown

LIST = "list"
"""In place of formats: show all of them."""


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Write a fit for other programs: Blender, Unity, three.js, AMASS tools, detectors' formats, video, tables.

    A project exports any of its runs and its corrected keypoints, a result of `tcfit fit` its motion. Ctrl-C leaves no
    incomplete file.
    """

    path: Annotated[Positional[Path | None], arg(metavar="PROJECT|RESULT", help_behavior_hint="(required)")] = None
    """A project, a result (its folder or fit.npz), or a folder of several people."""
    formats: Annotated[tuple[str, ...], shown("FORMAT ...", "glb npz bvh")] = ()
    """Formats to write; --formats list shows all."""
    out: Annotated[Path, shown("DIR", "this folder")] = Path()
    """Folder for the files; it is created if necessary."""
    run: RunName = None
    phase: Phase = None
    against: Annotated[str | None, shown("NAME", "phase 1 of the run")] = None
    """Run A of side-by-side: its name or number."""
    frames: Annotated[str | None, shown("FIRST:LAST", "all")] = None
    """Frame range, in numbers of the video. FIRST or LAST may be left out."""
    axes: Annotated[
        Literal["camera", "y-up", "z-up", "world"] | None,
        shown("{camera,y-up,z-up,world}", "as the format's readers expect"),
    ] = None
    """Axes of motions and meshes. camera: x right, y down, z forward, camera at the origin. y-up, z-up: upright, with
    the floor at height 0 if it is known, or in the world of --camera. world: axes of that world."""
    view: Annotated[tuple[Literal["camera", "side"], ...], shown("{camera,side} ...", "camera")] = ("camera",)
    """Views of picture, sheet, overlay and side-by-side; several are drawn beside each other. camera: over the video.
    side: upright, from the left of a person who faces the camera."""
    markers: Annotated[Path | None, shown("FILE", "as in Plug-in Gait")] = None
    """Markers of trc-markers and c3d: a TOML or JSON file of names and vertices of the body's mesh."""
    json: JsonLines = False
    overwrite: bool = False
    """Replace files of the same names. Other files of a folder are kept."""
    models: ModelsFolder = None
