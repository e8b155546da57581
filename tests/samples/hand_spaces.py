"""How near the hands of a space come to given hands."""

import numpy as np
import torch
from jaxtyping import Float

from fitting_core.body.hand_skeleton import FINGERS, SIZE, HandSkeleton
from fitting_core.body.handshapes import HANDSHAPES, finger_angles

_STEPS = 30

Space = tuple[Float[np.ndarray, "45"], Float[np.ndarray, "45 45"]]
"""Mean and components in anatomical angles."""


def nearest(
    hand: HandSkeleton, angles: Float[np.ndarray, "n 45"], space: Space, size: int
) -> Float[np.ndarray, "n 5 4"]:
    """Millimetres between the joints and tips of hands and those of the nearest hands of a space."""
    mean, rows = torch.as_tensor(space[0]), torch.as_tensor(space[1][:size])

    def posed(one: torch.Tensor) -> torch.Tensor:
        return 1000 * hand.pose(one.view(len(FINGERS), 3, 3)).flatten()

    def residual(c: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
        return torch.cat([posed(mean + c @ rows) - target, 0.02 * c])  # the last part keeps the matrix regular

    target = torch.func.vmap(posed)(torch.as_tensor(angles))
    r_of, j_of = torch.func.vmap(residual), torch.func.vmap(torch.func.jacfwd(residual))
    c = (torch.as_tensor(angles) - mean) @ rows.T
    r, damping = r_of(c, target), torch.ones(len(c), 1, dtype=torch.float64)
    for _ in range(_STEPS):
        j = j_of(c, target)
        trial = c - torch.linalg.solve(j.mT @ j + torch.diag_embed(damping.expand_as(c)), (j.mT @ r[..., None])[..., 0])
        new = r_of(trial, target)
        better = (new.square().sum(1) < r.square().sum(1))[:, None]
        c, r = torch.where(better, trial, c), torch.where(better, new, r)
        damping = torch.where(better, damping / 4, damping * 8)
    return r[:, :60].view(-1, 5, 4, 3).norm(dim=-1).numpy()


def anatomical(axis_angle: Float[np.ndarray, "*n 45"], hand: HandSkeleton) -> Float[np.ndarray, "*n 45"]:
    split = axis_angle.reshape(*axis_angle.shape[:-1], 5, 3, 3)
    return np.einsum("...fjd,fad->...fja", split, hand.axes).reshape(axis_angle.shape)


def named_shapes(hand: HandSkeleton) -> Float[np.ndarray, "n 45"]:
    """The handshapes of the evaluation as anatomical angles."""
    return anatomical(np.stack([finger_angles(s, "left").reshape(SIZE) for s in HANDSHAPES.values()]), hand)
