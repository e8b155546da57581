"""What a project's fits are compared with, as options. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg


@dataclass(frozen=True, kw_only=True)
class ReferenceOptions:
    """What fits are compared with, where something is known; kept in the project."""

    reference: Annotated[Path | None, arg(metavar="PATH", help_behavior_hint="(default: none)")] = None
    """3D points (npz, or TRC of OpenSim), an AMASS-style npz, a truth.npz, or another fit.npz."""
    reference_camera: Annotated[Path | None, arg(metavar="FILE.npz", help_behavior_hint="(default: none)")] = None
    """The clip's camera in the reference's world: R and t, with x_camera = R x + t."""
    reference_first_frame: Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: as it says, or 0)")] = (
        None
    )
    """Number in the video of the reference's first frame, where it was cut and does not say so."""
