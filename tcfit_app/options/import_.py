"""The options of `tcfit import`. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg


def _shown(metavar: str, default: str) -> Any:
    """How an option that can be left out shows in the help."""
    return arg(metavar=metavar, help_behavior_hint=f"(default: {default})")


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """Put another program's result into a project as a run, to compare fits with.

    SMPLify-X's output folder (or a zip of it), an npz of SMPL-X or AMASS, or a fit.npz of tcfit. The content tells
    which; the body model that it belongs to must be here. Nothing is written unless all of it could be read.
    """

    project: Annotated[Positional[Path], arg(metavar="PROJECT")]
    """The project's folder."""
    path: Annotated[Positional[Path], arg(metavar="PATH")]
    """The result: a folder or a file."""
    name: Annotated[str, _shown("TEXT", "the file's")] = ""
    """Of the run."""
    first_frame: Annotated[int | None, _shown("N", "as its files are numbered, or the clip's first")] = None
    """Number in the video of the result's first frame."""
    person: int = 0
    """Of SMPLify-X results, the number of the pickle in each frame: 0 is 000.pkl."""
    gender: Annotated[str | None, _shown("{neutral,male,female}", "as the file says, or neutral")] = None
    """Gender of the body."""
    body_model: Annotated[str | None, _shown("{smplx,smplh,smpl}", "the result's")] = None
    """Another kind of body to pose: joint angles are kept, the shape is not."""
    models: Annotated[Path | None, _shown("DIR", "see tcfit models")] = None
    """Folder with body models, which alone is searched then."""
    focal_length: Annotated[float | None, _shown("PX", "the file's; for SMPLify-X 5000")] = None
    """Focal length in pixels, for a result that tells none."""
    vposer: Annotated[Path | None, _shown("PATH", "the one that was added")] = None
    """The VPoser that SMPLify-X used."""
