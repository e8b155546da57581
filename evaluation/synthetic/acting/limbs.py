"""Poses a body by where its hands and feet are: two-bone inverse kinematics over all frames at once.

Everything here is in the world of the rest pose: x to the body's left, y up, z forward, metres.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.body.geometry import axis_angle, frame, shortest_rotation, twist, unit
from fitting_core.body.model import JOINT, N_JOINTS


@dataclass(frozen=True, kw_only=True)
class Limb:
    """Three joints in a row, and which way the middle one points when it is bent."""

    joints: tuple[str, str, str]
    rest_pole: tuple[float, float, float]
    """In the rest pose: backward for elbows, forward for knees."""
    twist_share: float
    """How much of the last joint's twist the middle joint takes: a forearm pronates along its whole length."""


LIMBS = {
    **{
        f"{side}_arm": Limb(
            joints=(f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist"),
            rest_pole=(0.0, 0.0, -1.0),
            twist_share=0.45,
        )
        for side in ("left", "right")
    },
    **{
        f"{side}_leg": Limb(
            joints=(f"{side}_hip", f"{side}_knee", f"{side}_ankle"), rest_pole=(0.0, 0.0, 1.0), twist_share=0.0
        )
        for side in ("left", "right")
    },
}


class Figure:
    """A body of one shape over T frames, posed joint by joint from the root outward.

    Args:
        rest: Joints of the rest pose, metres.
        parents: Parent of each joint, -1 for the root.
        root: Where the root joint is in each frame.
    """

    def __init__(self, rest: Float[np.ndarray, "55 3"], parents: np.ndarray, root: Float[np.ndarray, "T 3"]) -> None:
        self.rest, self.parents, self.root = rest, parents, root
        self.local = np.tile(np.eye(3), (len(root), N_JOINTS, 1, 1))

    def turn(self, joint: str, rotation: Float[np.ndarray, "T 3 3"]) -> None:
        """Set a joint's rotation relative to its parent."""
        self.local[:, JOINT[joint]] = rotation

    def world(self, joint: str) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3"]]:
        """Rotation and position of a joint, as its ancestors and it stand now."""
        chain = [JOINT[joint]]
        while self.parents[chain[-1]] >= 0:
            chain.append(int(self.parents[chain[-1]]))
        rotation, position = np.tile(np.eye(3), (len(self.root), 1, 1)), self.root
        for j in reversed(chain):
            if self.parents[j] >= 0:
                position = position + rotation @ (self.rest[j] - self.rest[self.parents[j]])
            rotation = rotation @ self.local[:, j]
        return rotation, position

    def reach(
        self,
        limb: Limb,
        target: Float[np.ndarray, "T 3"],
        pole: Float[np.ndarray, "T 3"],
        end: Float[np.ndarray, "T 3 3"],
    ) -> None:
        """Set the limb's three joints so that the last one is at `target`, turned as `end` in the world.

        The middle joint lies in the plane of the limb's ends and `pole`, on the pole's side. A target out of reach is
        approached up to 99.5 % of the limb's length, as a limb is seldom quite straight.
        """
        first, middle, last = (JOINT[name] for name in limb.joints)
        bones = self.rest[middle] - self.rest[first], self.rest[last] - self.rest[middle]
        origin, parent = self._socket(first)
        upper, lower = _two_bones(origin, target, pole, *(float(np.linalg.norm(b)) for b in bones))
        rest_frame = frame(bones[0], np.array(limb.rest_pole))
        first_world = frame(upper, _pole_of(upper, lower, pole)) @ np.swapaxes(rest_frame, -1, -2)
        middle_world = shortest_rotation(first_world @ bones[1], lower) @ first_world
        along = unit(bones[1])
        turned = twist(Rotation.from_matrix(np.swapaxes(middle_world, -1, -2) @ end), along)[:, None] * along
        middle_world = middle_world @ axis_angle(limb.twist_share * turned)
        self.local[:, first] = np.swapaxes(parent, -1, -2) @ first_world
        self.local[:, middle] = np.swapaxes(first_world, -1, -2) @ middle_world
        self.local[:, last] = np.swapaxes(middle_world, -1, -2) @ end

    def _socket(self, joint: int) -> tuple[np.ndarray, np.ndarray]:
        """Position of a joint and world rotation of its parent."""
        names = list(JOINT)
        parent, _ = self.world(names[self.parents[joint]])
        _, position = self.world(names[joint])
        return position, parent


def hand_rotation(
    fingers: Float[np.ndarray, "T 3"], palm: Float[np.ndarray, "T 3"], side: str
) -> Float[np.ndarray, "T 3 3"]:
    """World rotation of a hand whose fingers point along one direction and whose palm faces another.

    The palm's direction is made perpendicular to the fingers'. At rest fingers point sideways and palms face down.
    """
    rest = frame(np.array([1.0 if side == "left" else -1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0]))
    return frame(fingers, palm) @ rest.T


def _two_bones(
    origin: np.ndarray, target: np.ndarray, pole: np.ndarray, upper: float, lower: float
) -> tuple[np.ndarray, np.ndarray]:
    """Vectors (T, 3) of the two bones, by the law of cosines."""
    line = target - origin
    length = np.linalg.norm(line, axis=-1, keepdims=True)
    line = line / length
    distance = np.clip(length, abs(upper - lower) + 1e-3, 0.995 * (upper + lower))
    side = unit(pole - (pole * line).sum(-1, keepdims=True) * line)
    cosine = (upper**2 + distance**2 - lower**2) / (2 * upper * distance)
    first = upper * (cosine * line + np.sqrt(1 - cosine**2) * side)
    return first, distance * line - first


def _pole_of(upper: np.ndarray, lower: np.ndarray, pole: np.ndarray) -> np.ndarray:
    """The direction that the bent joint points to: in the limb's plane, on the side of the pole."""
    line = unit(upper + lower)
    return pole - (pole * line).sum(-1, keepdims=True) * line
