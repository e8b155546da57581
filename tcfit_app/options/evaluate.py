"""The options of `tcfit evaluate`. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from tcfit_app.options.fit import JsonLines, ModelsFolder, shown


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions:
    """Measure a fit against a reference.

    Prints a table. The --out folder receives metrics.csv, metrics.json and, with tcfit[report], report.html.
    """

    fit: Annotated[Positional[Path], arg(metavar="FIT")]
    """A project, or a result of tcfit (its folder or fit.npz)."""
    reference: Annotated[Path | None, shown("PATH", "that of the project")] = None
    """3D points (npz, TRC, C3D), an AMASS-style npz, the truth.npz of a generated clip, or another fit.npz."""
    camera: Annotated[Path | None, shown("FILE.npz", "that of the clip's calibration")] = None
    """The clip's camera in the reference's world: R and t, with x_camera = R x + t. Without it,
    positions and depth are not compared."""
    reference_first_frame: Annotated[int | None, shown("N", "as recorded, or 0")] = None
    """Video frame at which the reference begins, if the reference was trimmed and does not record it."""
    reference_offset: Annotated[str | None, shown("SECONDS|auto", "none")] = None
    """Time of the reference's first frame, in seconds of the video; negative if it is earlier. auto: estimated from the
    movement of both."""
    markers: Annotated[Path | None, shown("FILE", "by their names")] = None
    """Meaning of the points of a TRC or C3D reference: a TOML or JSON file that maps their names to vertices of the
    mesh, markers of the standard set, or joints."""
    run: Annotated[str | None, shown("NAME|N", "the latest")] = None
    """Run of the project."""
    every: Annotated[int, arg(metavar="N")] = 1
    """Measure surfaces only in every Nth frame: they are the slow part."""
    out: Annotated[Path | None, shown("DIR", "NAME-evaluation")] = None
    """Folder for tables and report. Existing ones are replaced."""
    json: JsonLines = False
    models: ModelsFolder = None
