"""The data that come with tcfit: the folder `assets` of a checkout, which is installed as `fitting_core.assets`."""

from importlib.resources import files
from pathlib import Path

_FOLDER = Path(str(files("fitting_core.assets")))

DEMO_FOLDER = _FOLDER / "demo"
"""The demo clip."""
FREE_FOLDER = _FOLDER / "bodies"
"""The free bodies, of SMPL-X's form: SMPLX_NEUTRAL.npz, SMPLX_MALE.npz, SMPLX_FEMALE.npz and SMPLX_CHILD.npz."""
LIFTER = _FOLDER / "lifter" / "tcfit_lifter.npz"
"""The network that tells how deep keypoints lie."""
POSE_PRIOR = _FOLDER / "pose_prior" / "tcfit_pose_prior.npz"
"""The pose prior."""
