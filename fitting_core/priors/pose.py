"""Pose priors: the solver's pose parameters and the prior over them."""

from collections.abc import Callable
from typing import Protocol

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body.model import JOINT
from fitting_core.files.regular import at_home
from fitting_core.priors.files.registry import read_prior, registered_vposer
from fitting_core.priors.latent import LatentPrior
from fitting_core.shipped import POSE_PRIOR


class PosePrior(Protocol):
    """A space of poses in which the squared distance to `neutral` is the penalty.

    L2 on axis-angle is the identity; a latent prior (VPoser's interface) decodes its latent to 63 numbers.
    """

    title: str
    """Its description in the record of a fit."""
    size: int
    neutral: Float[Tensor, "size"]
    """The most likely pose, where fits start and unseen limbs rest."""

    def to(self, *, dtype: torch.dtype, device: torch.device | str) -> "PosePrior":
        """The same prior in another type and on another device."""
        ...

    def decode(self, z: Float[Tensor, "B size"]) -> Float[Tensor, "B 63"]:
        """Axis-angle of the 21 body joints."""
        ...

    def encode(self, body_pose: Float[Tensor, "B 63"], *, rough: bool = False) -> Float[Tensor, "B size"]:
        """The z whose decoded pose is nearest; `rough`: near enough for a descent to go on from."""
        ...


class AxisAnglePrior:
    """L2 on the axis-angle of the 21 body joints, around a mean pose."""

    size = 63

    def __init__(self, mean: Float[Tensor, "63"] | None = None, *, title: str = "axis_angle") -> None:
        self.title = title
        self.neutral = torch.zeros(63, dtype=torch.float64) if mean is None else mean

    def to(self, *, dtype: torch.dtype, device: torch.device | str) -> "AxisAnglePrior":
        """The same prior in another type and on another device."""
        return AxisAnglePrior(self.neutral.to(dtype=dtype, device=device), title=self.title)

    def decode(self, z: Tensor) -> Tensor:
        """The pose itself."""
        return z

    def encode(self, body_pose: Tensor, *, rough: bool = False) -> Tensor:
        """The pose itself."""
        return body_pose


def relaxed_pose() -> Float[Tensor, "63"]:
    """Standing at ease, knees soft, forearms a little forward: where unseen limbs rest, instead of in the T-pose.

    Forearms that start before the body also find their way to hands in front of it: from arms hanging straight, every
    second forearm of a signer ended behind the back, at the same reprojection error.
    """
    pose = torch.zeros(21, 3, dtype=torch.float64)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        pose[JOINT[f"{side}_shoulder"] - 1] = torch.tensor([0.1, -0.25 * sign, -1.15 * sign])
        pose[JOINT[f"{side}_elbow"] - 1] = torch.tensor([0.0, -0.9 * sign, 0.0])
        pose[JOINT[f"{side}_hip"] - 1, 0] = -0.12
        pose[JOINT[f"{side}_knee"] - 1, 0] = 0.24
        pose[JOINT[f"{side}_ankle"] - 1, 0] = -0.12
    return pose.flatten()


PRIORS: dict[str, Callable[[], PosePrior]] = {
    "axis_angle": AxisAnglePrior,
    "relaxed": lambda: AxisAnglePrior(relaxed_pose(), title="relaxed"),
    "tcfit": lambda: LatentPrior(read_prior(POSE_PRIOR)),
    "vposer": lambda: LatentPrior(read_prior(registered_vposer())),
}
"""Pose priors by the name that a configuration gives; `config.POSE_PRIORS` tells the names without loading torch."""


def make_prior(choice: str, *, dtype: torch.dtype, device: torch.device | str) -> PosePrior:
    """The pose prior that a configuration names. Raises InputError if there is no such file, or it is not a pose prior.

    Args:
        choice: A name in PRIORS, or the path of VPoser or of a pose prior's npz.
        dtype: Of the computation.
        device: Where to compute.
    """
    prior = PRIORS[choice]() if choice in PRIORS else LatentPrior(read_prior(at_home(choice)))
    return prior.to(dtype=dtype, device=device)
