"""Where feet, hands and seat of a body meet the floor."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from evaluation.synthetic.acting.script import ArmKey, through
from fitting_core.body.model import JOINT, BodyModel

_SINK = 0.008
"""How deep the seat sinks into the floor, metres: flesh is soft."""
_BALL_LENGTH = 0.03
"""How far before and behind the toes' joint the outer ball of the foot is looked for, metres."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FootShape:
    """A foot of the rest pose, seen from its ankle: metres, x to the person's left, y up, z forward."""

    sole: Float[np.ndarray, "P 3"]
    """Points of the foot without its toes."""
    toes: Float[np.ndarray, "Q 3"]
    """Points of the toes, from the toes' joint."""
    toe_joint: Float[np.ndarray, "3"]
    ball: Float[np.ndarray, "3"]
    """The outer ball, on which the foot rolls."""

    @staticmethod
    def of(
        body: BodyModel, shaped: Float[np.ndarray, "V 3"], joints: Float[np.ndarray, "55 3"], side: str
    ) -> "FootShape":
        """The left or right foot of a shape.

        Args:
            body: For its skinning weights.
            shaped: Vertices of the shape in the rest pose.
            joints: Its joints.
            side: "left" or "right".
        """
        ankle, toe_joint = joints[JOINT[f"{side}_ankle"]], joints[JOINT[f"{side}_foot"]]
        weights = body.skinning_weights[:, [JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]]]
        foot = weights.sum(1) > 0.9
        toes = foot & (weights[:, 1] > 0.5)
        below = foot & (shaped[:, 1] < shaped[:, 1].min() + 0.025) & (abs(shaped[:, 2] - toe_joint[2]) < _BALL_LENGTH)
        ball = shaped[below][abs(shaped[below, 0]).argmax()]
        return FootShape(
            sole=shaped[foot & ~toes] - ankle,
            toes=shaped[toes] - toe_joint,
            toe_joint=toe_joint - ankle,
            ball=ball - ankle,
        )

    def ankle(
        self,
        place: Float[np.ndarray, "T 2"],
        foot: Float[np.ndarray, "T 3 3"],
        toes: Float[np.ndarray, "T 3 3"],
        lift: Float[np.ndarray, "T"],
    ) -> Float[np.ndarray, "T 3"]:
        """Where the ankle is when the outer ball is at a place (x, z) and the foot's lowest point at a height.

        Args:
            place: Of the outer ball, metres.
            foot: World rotation of the foot.
            toes: Rotation of the toes relative to the foot.
            lift: Of the foot's lowest point above the floor, metres.
        """
        ball = foot @ self.ball
        tips = (foot @ self.toe_joint)[:, 1] + lowest(self.toes, foot @ toes)
        bottom = np.minimum(lowest(self.sole, foot), tips)
        return np.stack([place[:, 0] - ball[:, 0], lift - bottom, place[:, 1] - ball[:, 2]], 1)


def hand_points(
    body: BodyModel, shaped: Float[np.ndarray, "V 3"], joints: Float[np.ndarray, "55 3"], side: str
) -> Float[np.ndarray, "P 3"]:
    """Points of the left or right hand of a shape in the rest pose, seen from its wrist; arguments as of FootShape."""
    first = 25 if side == "left" else 40
    weights = body.skinning_weights[:, [JOINT[f"{side}_wrist"], *range(first, first + 15)]].sum(1)
    return shaped[weights > 0.9] - joints[JOINT[f"{side}_wrist"]]


def seat_gap(body: BodyModel, vertices: Float[np.ndarray, "T V 3"]) -> Float[np.ndarray, "T"]:
    """How far the seat is above where it would rest on the floor (metres; negative: below)."""
    seat = body.skinning_weights[:, [JOINT["pelvis"], JOINT["left_hip"], JOINT["right_hip"]]].sum(1) > 0.6
    return vertices[:, seat, 1].min(1) + _SINK


def within_reach(
    keys: Sequence[ArmKey],
    times: Float[np.ndarray, "T"],
    wrist: Float[np.ndarray, "T 3"],
    shoulder: Float[np.ndarray, "T 3"],
    length: float,
) -> Float[np.ndarray, "T 3"]:
    """How far hands on the floor must be shifted, along it and towards the shoulder, so that the arm reaches them.

    Args:
        keys: Of the arm.
        times: Of the frames, seconds.
        wrist: Where the keys want the wrist, metres; only where the hand is on the floor or near it matters.
        shoulder: Where the shoulder is.
        length: How far the arm reaches.
    """
    floor = [key for key in keys if key.anchor == "floor"]
    down = [key.time for key in floor if key.wrist[1] == 0]
    # One stay of the hand on the floor is from one such key to the next.
    stays = [(start, stop) for start, stop in pairwise(down) if not any(start < k.time < stop for k in keys)]
    shifts = [_shift(wrist[f], shoulder[f], length) for f in ((times >= a) & (times <= b) for a, b in stays)]
    nearest = [min(range(len(stays)), key=lambda i: abs(np.mean(stays[i]) - key.time)) for key in floor]
    return through([(key.time, shifts[i]) for key, i in zip(floor, nearest, strict=True)], times)


def _shift(wrist: np.ndarray, shoulder: np.ndarray, length: float) -> Float[np.ndarray, "3"]:
    """The least of 21 shifts towards the mean place below the shoulder with which the arm reaches in all frames."""
    whole = ((shoulder - wrist) * [1.0, 0.0, 1.0]).mean(0) if len(wrist) else np.zeros(3)
    for share in np.linspace(0.0, 1.0, 21):
        if (np.linalg.norm(wrist + share * whole - shoulder, axis=1) <= length).all():
            return share * whole
    return whole


def lowest(points: Float[np.ndarray, "P 3"], rotation: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T"]:
    """Height of the lowest of some points after each rotation."""
    return (rotation[:, 1] @ points.T).min(1)
