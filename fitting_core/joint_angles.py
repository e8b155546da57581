"""Anatomical angles of joints (swing and twist), and their derivatives by the axis-angle pose, in closed form."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.joint_ranges import JointRange
from fitting_core.body.model import JOINT

_NEARLY_OPPOSITE = 1e-6
"""Least squared cosine of half a swing: at 180 degrees, far beyond any range, the twist has no derivative."""


@dataclass(frozen=True, eq=False)
class AngleTable:
    """What the angles of n joints are made of.

    `frame` turns the quaternion (w, x, y, z) of a joint's rotation into (w, t, p, q): relative to the middle of the
    joint's range, with its vector part along the twisting axis and the two swing axes. These are right-handed where the
    twist comes first (a ball, R = C S T) and left-handed where it comes last (a hinge, R = F S, with the flexion as the
    "twist"): conjugation, which swaps the order, and a mirror image undo each other. So one formula serves both:
    twist 2 atan(t / w), swing along (p + iq)(w + it).
    """

    joint: Int[Tensor, "n"]
    """Their numbers among the 55."""
    frame: Float[Tensor, "n 4 4"]
    offset: Float[Tensor, "n 3"]
    """Radians, added to (swing, swing, twist): the angles of the middle. They lie within 180 degrees of the twist's."""
    order: Int[Tensor, "n 3"]
    """Places of flexion, side motion and twist in (swing, swing, twist)."""

    @staticmethod
    def of(ranges: Mapping[str, JointRange], like: Tensor) -> "AngleTable":
        """The table of these joints, in the type and on the device of `like`."""
        rows = [_frame(joint) for joint in ranges.values()]
        joint = torch.tensor([JOINT[name] for name in ranges], device=like.device)
        frame, offset = (like.new_tensor(np.array([row[i] for row in rows])) for i in (0, 1))
        return AngleTable(joint, frame, offset, torch.tensor([row[2] for row in rows], device=like.device))

    def __getitem__(self, which: Tensor) -> "AngleTable":
        return AngleTable(self.joint[which], self.frame[which], self.offset[which], self.order[which])

    def angles(self, pose: Float[Tensor, "B n 3"]) -> Float[Tensor, "B n 3"]:
        """Swing, swing and twist (radians) of rotations given as axis-angle."""
        w, t, p, q = (self.frame @ quaternion(pose)[..., None])[..., 0].unbind(-1)
        stretch = _stretch(1 - w * w - t * t)
        swings = stretch * (p * w - q * t), stretch * (p * t + q * w)
        return torch.stack([*swings, 2 * torch.atan(t / w)], -1) + self.offset

    def slopes(self, pose: Float[Tensor, "B n 3"]) -> Float[Tensor, "B n 3 3"]:
        """Derivative of `angles` (rows) by the axis-angle."""
        w, t, p, q = (self.frame @ quaternion(pose)[..., None])[..., 0].unbind(-1)
        squared = 1 - w * w - t * t
        h = _stretch(squared)
        rise = 2 * _stretch_slope(squared)
        first, second = (p * w - q * t) * rise, (p * t + q * w) * rise
        turn = 2 / (w * w + t * t).clamp(min=_NEARLY_OPPOSITE)
        o = torch.zeros_like(w)
        rows = [h * p, -h * q, h * w + first * p, -h * t + first * q]
        rows += [h * q, h * p, h * t + second * p, h * w + second * q]
        rows += [-turn * t, turn * w, o, o]
        return torch.stack(rows, -1).view(*w.shape, 3, 4) @ (self.frame @ quaternion_slope(pose))

    def named(self, angles: Float[Tensor, "B n 3"]) -> Float[Tensor, "B n 3"]:
        """Flexion, side motion and twist, from what `angles` gives."""
        return angles.gather(2, self.order.expand(len(angles), -1, -1))

    def ordered(self, named: Float[Tensor, "n 3 k"]) -> Float[Tensor, "n 3 k"]:
        """What is known of flexion, side motion and twist, in the order of `angles`."""
        return torch.zeros_like(named).scatter(1, self.order[..., None].expand_as(named), named)


def _frame(joint: JointRange) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "3"], list[int]]:
    """Frame, offset and order of one joint, see AngleTable."""
    axes, hinge = np.array(joint.axes), joint.kind == "hinge"
    main, swings = (0, [1, 2]) if hinge else (2, [0, 1])
    if (np.linalg.det(axes[[*swings, main]]) < 0) != hinge:
        swings.reverse()
    order = [*swings, main]
    turned = np.eye(4)
    turned[1:, 1:] = axes[[main, *swings]]
    x, y, z, w = joint.rotation(*joint.centre).inv().as_quat()
    centred = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    middle = np.radians(joint.bounds[main].mean())
    c, s = np.cos(middle / 2), np.sin(middle / 2)
    untwisted = np.array([[c, s, 0, 0], [-s, c, 0, 0], [0, 0, c, -s], [0, 0, s, c]])
    offset = np.radians([*joint.centre, 0.0])[order]
    offset[2] = middle
    return untwisted @ turned @ centred, offset, [order.index(i) for i in range(3)]


def _halves(v: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """cos(a/2), k = sin(a/2)/a and (dk/da)/a for a = |v|, by their series below a^2 = 1e-3 (error < 1e-13)."""
    squared = (v * v).sum(-1, keepdim=True)
    small = squared < 1e-3
    safe = torch.where(small, torch.ones_like(squared), squared)  # no 0/0 in the branch not taken
    angle = safe.sqrt()
    sine = torch.where(small, 0.5 - squared / 48 + squared**2 / 3840 - squared**3 / 645120, (angle / 2).sin() / angle)
    cosine = torch.where(small, 1 - squared / 8 + squared**2 / 384 - squared**3 / 46080, (angle / 2).cos())
    slope = torch.where(small, -1 / 24 + squared / 960 - squared**2 / 107520, (cosine / 2 - sine) / safe)
    return cosine, sine, slope


def quaternion(v: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 4"]:
    """(w, x, y, z) of an axis-angle vector in radians; w < 0 beyond 180 degrees, so that angles go on growing."""
    cosine, sine, _ = _halves(v)
    return torch.cat([cosine, sine * v], -1)


def quaternion_slope(v: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 4 3"]:
    """Derivative of `quaternion` by v."""
    _, sine, slope = _halves(v)
    vector = sine[..., None] * torch.eye(3, dtype=v.dtype, device=v.device)
    vector = vector + slope[..., None] * v[..., :, None] * v[..., None, :]
    return torch.cat([-0.5 * (sine * v)[..., None, :], vector], -2)


def _series(m: Tensor) -> tuple[Tensor, Tensor]:
    return (
        1 + m * (2 / 3 + m * (8 / 15 + m * (16 / 35 + m * 128 / 315))),
        2 / 3 + m * (16 / 15 + m * (48 / 35 + m * 512 / 315)),
    )


def _arc(m: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Where m is small; m elsewhere; and A(m) = arcsin(n) / (n cos(arcsin n)) for n^2 = m there."""
    small = m < 1e-3
    safe = torch.where(small, torch.full_like(m, 0.5), m).clamp(max=1 - _NEARLY_OPPOSITE)
    return small, safe, safe.sqrt().asin() / (safe * (1 - safe)).sqrt()


def _stretch(m: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
    """Swing angle / (sin cos of its half), by the squared sine m of its half."""
    small, _, arc = _arc(m)
    return 2 * torch.where(small, _series(m)[0], arc)


def _stretch_slope(m: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
    """Derivative of `_stretch`, from (1 - n^2) y' = n y + 1 for y = arcsin(n) / sqrt(1 - n^2)."""
    small, safe, arc = _arc(m)
    return 2 * torch.where(small, _series(m)[1], (1 + (2 * safe - 1) * arc) / (2 * safe * (1 - safe)))
