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

    Of a project, any of its runs and its corrected keypoints; of a result of `tcfit fit`, its motion. Ctrl-C leaves
    nothing half-written.
    """

    path: Annotated[Positional[Path | None], arg(metavar="PROJECT|RESULT", help_behavior_hint="(required)")] = None
    """A project's folder, or a result's: its folder or fit.npz; or a folder of several people."""
    formats: Annotated[tuple[str, ...], shown("FORMAT ...", "glb npz bvh")] = ()
    """What to write; --formats list shows all of them."""
    out: Annotated[Path, shown("DIR", "this folder")] = Path()
    """Folder for the files, made if it does not exist."""
    run: RunName = None
    phase: Phase = None
    against: Annotated[str | None, shown("NAME", "phase 1 of the run")] = None
    """The run that is A in side-by-side: its name or number."""
    frames: Annotated[str | None, shown("FIRST:LAST", "all")] = None
    """Only these frames, by their numbers in the video; either may be left out."""
    axes: Annotated[
        Literal["camera", "y-up", "z-up", "world"] | None,
        shown("{camera,y-up,z-up,world}", "as readers of the format expect"),
    ] = None
    """World of motions and meshes. camera: x right, y down, z away, the camera at the origin. y-up and z-up are
    upright, with the floor at height 0, where that is known; or in the world of --camera. world: its own axes."""
    view: Annotated[tuple[Literal["camera", "side"], ...], shown("{camera,side} ...", "camera")] = ("camera",)
    """Views of picture, sheet, overlay and side-by-side; several are drawn beside each other. camera: over the video.
    side: upright, from the left of a person who faces the camera."""
    markers: Annotated[Path | None, shown("FILE", "as in Plug-in Gait")] = None
    """Markers of trc-markers and c3d: a TOML or JSON file of names and vertices of the body's mesh."""
    zip: bool = False
    """Write a zip where a format is a folder of files."""
    json: JsonLines = False
    overwrite: bool = False
    """Replace files of the same names. A folder that holds others is left as it is."""
    models: ModelsFolder = None
