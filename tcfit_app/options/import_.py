"""The options of `tcfit import`. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from tcfit_app.options.fit import ModelsFolder, shown


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """Put another program's result into a project as a run, to compare fits with; or ELAN's annotations as notes.

    SMPLify-X's output folder (or a zip of it), an npz of SMPL-X or AMASS, a fit.npz of tcfit, or a result of GVHMR,
    GEM, WHAM, PromptHMR, 4D-Humans or SAM 3D Body. The content tells which; the body model that it belongs to must be
    here. Of an .eaf file of ELAN, annotations become notes on their frames. Nothing is written unless all of it could
    be read.
    """

    project: Annotated[Positional[Path], arg(metavar="PROJECT")]
    """The project's folder."""
    path: Annotated[Positional[Path], arg(metavar="PATH")]
    """The result: a folder or a file; or an .eaf file."""
    name: Annotated[str, shown("TEXT", "the file's")] = ""
    """Of the run."""
    first_frame: Annotated[int | None, shown("N", "as its files are numbered, or the clip's first")] = None
    """Number in the video of the result's first frame."""
    person: Annotated[int | None, shown("N", "who is in most frames; of SMPLify-X 0")] = None
    """Of several people, as the result numbers them; of SMPLify-X the number of the pickle: 0 is 000.pkl."""
    gender: Annotated[str | None, shown("{neutral,male,female}", "as the file says, or neutral")] = None
    """Gender of the body."""
    body_model: Annotated[str | None, shown("{smplx,smplh,smpl}", "the result's")] = None
    """Another kind of body to pose: joint angles are kept, the shape is not."""
    models: ModelsFolder = None
    focal_length: Annotated[float | None, shown("PX", "the file's; for SMPLify-X 5000")] = None
    """Focal length in pixels, for a result that tells none."""
    vposer: Annotated[Path | None, shown("PATH", "the one that was added")] = None
    """The VPoser that SMPLify-X used."""
    tiers: Annotated[tuple[str, ...], shown("NAME ...", "all but those of tcfit")] = ()
    """Of an .eaf file: which tiers become notes."""
