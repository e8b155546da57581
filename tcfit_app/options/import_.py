"""The options of `tcfit import`. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from tcfit_app.options.fit import ModelsFolder, shown


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """Import another program's result into a project as a run to compare with, or ELAN's annotations as notes.

    SMPLify-X's output folder (or a zip of it), an npz of SMPL-X or AMASS, a fit.npz of tcfit, or a result of GVHMR,
    GEM, WHAM, PromptHMR, 4D-Humans or SAM 3D Body. The format is recognised. The body model of the result must be
    installed. Annotations of an .eaf file of ELAN become notes on their frames. Nothing is written if a part cannot be
    read.
    """

    project: Annotated[Positional[Path], arg(metavar="PROJECT")]
    """The project's folder."""
    path: Annotated[Positional[Path], arg(metavar="PATH")]
    """The result (a folder or a file), or an .eaf file."""
    name: Annotated[str, shown("TEXT", "the file's")] = ""
    """Name of the run."""
    first_frame: Annotated[int | None, shown("N", "from its file names, or the clip's first")] = None
    """Video frame at which the result begins."""
    person: Annotated[int | None, shown("N", "the person in most frames; for SMPLify-X, person 0")] = None
    """Person in the result, as numbered there; for SMPLify-X the number of the pickle (0: 000.pkl)."""
    gender: Annotated[str | None, shown("{neutral,male,female}", "as recorded, or neutral")] = None
    """Gender of the body."""
    body_model: Annotated[str | None, shown("{smplx,smplh,smpl}", "the result's")] = None
    """Pose another kind of body with the joint angles of the result. Its shape is not used."""
    models: ModelsFolder = None
    focal_length: Annotated[float | None, shown("PX", "as recorded; for SMPLify-X 5000")] = None
    """Focal length in pixels, if the result does not store it."""
    tiers: Annotated[tuple[str, ...], shown("NAME ...", "all except those of tcfit")] = ()
    """Tiers of an .eaf file that become notes."""
