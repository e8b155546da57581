"""The options of `tcfit evaluate`. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from tcfit_app.options.fit import JsonLines, ModelsFolder, shown


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions:
    """Measure a fit against what is known to be true.

    Prints a table; the --out folder receives metrics.csv, metrics.json and, with tcfit[report], report.html.
    """

    fit: Annotated[Positional[Path], arg(metavar="FIT")]
    """A project, or a result: a folder or a fit.npz of tcfit, or what another program wrote, as for tcfit import."""
    reference: Annotated[Path | None, shown("PATH", "the project's, if it has one")] = None
    """3D points (npz, TRC, C3D), an AMASS-style npz, the truth.npz of a generated clip, or another fit.npz."""
    camera: Annotated[Path | None, shown("FILE.npz", "as the clip's camera is calibrated")] = None
    """The clip's camera in the reference's world: R and t, with x_camera = R x + t. Without, only form is compared."""
    reference_first_frame: Annotated[int | None, shown("N", "as it says, or 0")] = None
    """Number in the video of the reference's first frame, where it was cut and does not say so."""
    reference_offset: Annotated[str | None, shown("SECONDS|auto", "none")] = None
    """Second of the video at which the reference's first frame was taken, below 0 if that was before. auto: found by
    the movement of both, where their clocks differ."""
    markers: Annotated[Path | None, shown("FILE", "by their names")] = None
    """What the points of a TRC or C3D reference are: a TOML or JSON file of their names and vertices of the body's
    mesh, markers of the standard set, or joints."""
    run: Annotated[str | None, shown("NAME|N", "the latest")] = None
    """Which of a project's runs."""
    person: Annotated[int | None, shown("N", "who is in most frames; of SMPLify-X 0")] = None
    """Of several people in another program's result, as it numbers them."""
    body_model: Annotated[str | None, shown("{smplx,smplh,smpl}", "the result's")] = None
    """Another kind of body to pose with another program's result: joint angles are kept, the shape is not."""
    frame_rate: Annotated[float | None, shown("FPS", "as it says, the reference's, or 30")] = None
    """Frames per second of another program's result, which hardly any of them tells."""
    every: Annotated[int, arg(metavar="N")] = 1
    """Measure surfaces in every Nth frame, which is the slow part."""
    out: Annotated[Path | None, shown("DIR", "NAME-evaluation")] = None
    """Folder for tables and report; those that lie there are replaced."""
    json: JsonLines = False
    models: ModelsFolder = None
