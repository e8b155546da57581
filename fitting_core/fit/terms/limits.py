"""The term of joint limits (beyond the paper): impossible angles cost, possible ones are free.

The angles that have limits are swing and twist of a joint.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.joint_ranges import JointRange, joint_ranges
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.fit.compiled.body import add_row, joint_row
from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import INTEGER, N_BODY, N_JOINTS, NUMBER
from fitting_core.fit.compiled.turns import quaternion_of_matrix
from fitting_core.fit.terms.context import TermContext, UsedKeypoints
from fitting_core.fit.terms.entry import Entry, Kernel
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate

_BODY = range(JOINT["left_hip"], JOINT["right_wrist"] + 1)
_FINGERS = range(JOINT["left_index1"], JOINT["right_thumb3"] + 1)
_NEARLY_OPPOSITE = 1e-6
"""Lower bound of the squared cosine of half a swing: at 180 degrees, far beyond any range, twist has no derivative."""
_TINY = 1e-30
"""Against 0 / 0 at the middle of the range."""


@dataclass(frozen=True, eq=False)
class JointLimits(Term):
    """weight x how far flexion, side motion and twist of a joint are beyond their range (see body/joint_ranges.py).

    Seen from the front, a thigh that points at the camera and one that points away look alike; only one is possible.
    Without limits a fit of sitting down bent the knees sideways by 75 degrees, on the keypoints.
    """

    weight: float
    table: "AngleTable"
    low: Float[Tensor, "n 3"]
    high: Float[Tensor, "n 3"]
    fingers: bool
    """Whether any of the joints is a finger's."""
    name: str = "limits"

    @staticmethod
    def of(weight: float, ranges: Mapping[str, JointRange], *, fingers: bool, like: Tensor) -> "JointLimits":
        """The term for these ranges, in the type and on the device of `like`; `fingers`: include them."""
        ranges = {name: joint for name, joint in ranges.items() if fingers or JOINT[name] in _BODY}
        table = AngleTable.of(ranges, like)
        bounds = torch.stack([like.new_tensor(joint.bounds) for joint in ranges.values()]).deg2rad()
        low, high = table.ordered(bounds).unbind(-1)
        return JointLimits(weight, table, low, high, any(JOINT[name] in _FINGERS for name in ranges))

    @cached_property
    def place(self) -> Int[Tensor, "n"]:
        """Of each joint among body joints and fingers."""
        joint = self.table.joint
        return torch.where(joint < _FINGERS.start, joint - _BODY.start, joint - _FINGERS.start + len(_BODY))

    def pose(self, e: Estimate) -> Float[Tensor, "B n 3"]:
        """Axis-angle of the limited joints, fingers decoded."""
        pose = e.body_pose
        if self.fingers:
            pose = torch.cat([pose, e.view.parametrisation.hands(e.state)], 1)
        return pose.view(len(pose), -1, 3)[:, self.place]

    def excess(self, pose: Float[Tensor, "B n 3"]) -> Float[Tensor, "B n 3"]:
        """Radians beyond the range, 0 inside it."""
        angles = self.table.angles(pose)
        return angles - angles.clamp(self.low, self.high)

    def residual(self, e: Estimate) -> Float[Tensor, "B 3n"]:
        """Weighted radians beyond the range, 0 inside it."""
        return self.weight * self.excess(self.pose(e)).flatten(1)


@dataclass(frozen=True, eq=False)
class AngleTable:
    """How the angles of n joints are computed.

    `frame` turns the quaternion (w, x, y, z) of a joint's rotation into (w, t, p, q): relative to the middle of the
    joint's range, with its vector part along the twisting axis and the two swing axes. These are right-handed where the
    twist comes first (a ball, R = C S T) and left-handed where it comes last (a hinge, R = F S, with the flexion as the
    "twist"): conjugation, which swaps the order, and a mirror image undo each other. So one formula serves both:
    twist 2 atan(t / w), swing along (p + iq)(w + it).
    """

    joint: Int[Tensor, "n"]
    """Indices among the 55."""
    frame: Float[Tensor, "n 4 4"]
    offset: Float[Tensor, "n 3"]
    """Radians, added to (swing, swing, twist): the angles of the middle. They lie within 180 degrees of the twist's."""
    order: Int[Tensor, "n 3"]
    """Indices of flexion, side motion and twist in (swing, swing, twist)."""

    @staticmethod
    def of(ranges: Mapping[str, JointRange], like: Tensor) -> "AngleTable":
        """The table of these joints, in the type and on the device of `like`."""
        rows = [_frame(joint) for joint in ranges.values()]
        joint = torch.tensor([JOINT[name] for name in ranges], device=like.device)
        frame, offset = (like.new_tensor(np.array([row[i] for row in rows])) for i in (0, 1))
        return AngleTable(joint, frame, offset, torch.tensor([row[2] for row in rows], device=like.device))

    def angles(self, pose: Float[Tensor, "B n 3"]) -> Float[Tensor, "B n 3"]:
        """Swing, swing and twist (radians) of rotations given as axis-angle."""
        w, t, p, q = (self.frame * quaternion_of_axis_angle(pose)[..., None, :]).sum(-1).unbind(-1)
        stretch = _stretch(p * p + q * q, w * w + t * t)
        return torch.stack([stretch * (p * w - q * t), stretch * (p * t + q * w), 2 * (t / w).atan()], -1) + self.offset

    def named(self, angles: Float[Tensor, "B n 3"]) -> Float[Tensor, "B n 3"]:
        """Flexion, side motion and twist, from the result of `angles`."""
        return angles.gather(2, self.order.expand(len(angles), -1, -1))

    def ordered(self, named: Float[Tensor, "n 3 k"]) -> Float[Tensor, "n 3 k"]:
        """Values for flexion, side motion and twist, in the order of `angles`."""
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


def quaternion_of_axis_angle(v: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 4"]:
    """(w, x, y, z) of an axis-angle vector in radians."""
    half = v.norm(dim=-1, keepdim=True) / 2
    return torch.cat([half.cos(), torch.sinc(half / torch.pi) / 2 * v], -1)


def _stretch(sine2: Float[Tensor, "*b"], cosine2: Float[Tensor, "*b"]) -> Float[Tensor, "*b"]:
    """Swing angle / (sine x cosine of its half), by the squares of these."""
    sine, cosine = (sine2 + _TINY).sqrt(), cosine2.clamp(min=_NEARLY_OPPOSITE).sqrt()
    return 2 * torch.atan2(sine, cosine) / (sine * cosine)


@helper
def _cost(c, frame, orient, x, s, derivatives):
    """As `AngleTable.angles`, joint by joint."""
    cost, clip = 0.0, c.clip
    weight = clip.limit_weight * clip.limit_weight
    for n in range(clip.limited):
        joint, turned = clip.limit_joint[n], clip.limit_frame[n]
        quaternion_of_matrix(s.local[joint], s.q)
        for k in range(4):
            s.u[k] = turned[k, 0] * s.q[0] + turned[k, 1] * s.q[1] + turned[k, 2] * s.q[2] + turned[k, 3] * s.q[3]
        w, t, p, q = s.u[0], s.u[1], s.u[2], s.u[3]
        sine2, cosine2 = p * p + q * q, max(w * w + t * t, _NEARLY_OPPOSITE)
        sine, cosine = math.sqrt(sine2 + _TINY), math.sqrt(cosine2)
        stretch = 2 * math.atan2(sine, cosine) / (sine * cosine)
        for angle in range(3):
            if angle == 0:
                value = stretch * (p * w - q * t)
            elif angle == 1:
                value = stretch * (p * t + q * w)
            else:
                value = 2 * math.atan(t / w)
            value += clip.limit_offset[n, angle]
            excess = value - min(max(value, clip.limit_low[n, angle]), clip.limit_high[n, angle])
            if excess == 0.0:
                continue
            cost += weight * excess * excess
            if derivatives and (clip.free_body if joint <= N_BODY else clip.free_hands):
                # Twice the slope of `stretch` by the squared sine. With x the sine of half the swing it is 2 y / x, for
                # y = arcsin(x) / sqrt(1 - x^2), and (1 - x^2) y' = x y + 1.
                rise = (2 + (2 * sine2 - 1) * stretch) / ((sine2 + _TINY) * cosine2)
                by_turn = _slope(angle, w, t, p, q, stretch, rise, 2 / cosine2, turned, s.q)
                first, count = joint_row(c, joint, by_turn, s)
                add_row(s, first, s.wide, count, weight, excess)
    return cost


@helper
def _slope(angle, w, t, p, q, stretch, rise, turn, frame, unit):
    """Derivative of an angle by the joint's rotation about its own axes: by its quaternion, dq = q (0, d) / 2."""
    if angle == 0:
        ahead = rise * (p * w - q * t)
        a0, a1, a2, a3 = stretch * p, -stretch * q, stretch * w + ahead * p, ahead * q - stretch * t
    elif angle == 1:
        aside = rise * (p * t + q * w)
        a0, a1, a2, a3 = stretch * q, stretch * p, stretch * t + aside * p, stretch * w + aside * q
    else:
        a0, a1, a2, a3 = -turn * t, turn * w, 0.0, 0.0
    b0 = a0 * frame[0, 0] + a1 * frame[1, 0] + a2 * frame[2, 0] + a3 * frame[3, 0]
    b1 = a0 * frame[0, 1] + a1 * frame[1, 1] + a2 * frame[2, 1] + a3 * frame[3, 1]
    b2 = a0 * frame[0, 2] + a1 * frame[1, 2] + a2 * frame[2, 2] + a3 * frame[3, 2]
    b3 = a0 * frame[0, 3] + a1 * frame[1, 3] + a2 * frame[2, 3] + a3 * frame[3, 3]
    return (
        0.5 * (-b0 * unit[1] + b1 * unit[0] + b2 * unit[3] - b3 * unit[2]),
        0.5 * (-b0 * unit[2] - b1 * unit[3] + b2 * unit[0] + b3 * unit[1]),
        0.5 * (-b0 * unit[3] + b1 * unit[2] - b2 * unit[1] + b3 * unit[0]),
    )


def _constants(term: JointLimits) -> Mapping[str, Any]:
    table = term.table
    return {
        "limited": len(term.low),
        "limit_weight": term.weight,
        "limit_joint": table.joint,
        "limit_frame": table.frame,
        "limit_offset": table.offset,
        "limit_low": term.low,
        "limit_high": term.high,
    }


def _make(context: TermContext, looked: UsedKeypoints, s: int) -> Term | None:
    weight, like = context.config.weights.limits[s], context.parametrisation.like
    if not weight:
        return None
    return replace(_of_weight_1(context.body, context.hands_shown, like.dtype, like.device), weight=weight)


@lru_cache(maxsize=4)
def _of_weight_1(body: BodyModel, fingers: bool, dtype: torch.dtype, device: torch.device) -> JointLimits:
    """Cached, as each stage and each drag of a keypoint would wait for it."""
    return JointLimits.of(1.0, joint_ranges(body), fingers=fingers, like=torch.zeros(0, dtype=dtype, device=device))


ENTRY = Entry(
    name="limits",
    kind=JointLimits,
    about="joints of body and fingers stay within their anatomical range",
    make=_make,
    weights=("limits",),
    kernel=Kernel(
        constants=_constants,
        clip=(
            ("limited", INTEGER),
            ("limit_weight", NUMBER),
            ("limit_joint", INTEGER, N_JOINTS),
            ("limit_frame", NUMBER, (N_JOINTS, 4, 4)),
            ("limit_offset", NUMBER, (N_JOINTS, 3)),
            ("limit_low", NUMBER, (N_JOINTS, 3)),
            ("limit_high", NUMBER, (N_JOINTS, 3)),
        ),
        cost=_cost,
    ),
)
