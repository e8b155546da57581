"""A motion on the user's own rig: the rig as a target, by its rest pose and size; then feet and hands are corrected."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.animation.retargeting.feet import grounded
from fitting_core.animation.retargeting.rest_pose import ALONG, FINGERS, rest_turns
from fitting_core.animation.retargeting.retarget import Posed, RigMotion, turned
from fitting_core.animation.retargeting.target import Source, Target
from fitting_core.animation.retargeting.touch import touches, touching
from fitting_core.animation.rigs.mapping import Joints
from fitting_core.animation.rigs.parts import CHAINS, NEEDED, meant
from fitting_core.animation.rigs.skeleton import Skeleton
from fitting_core.body.geometry import SIDES
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.errors import InputError
from fitting_core.motion import Motion

_SHORT = 1e-6
"""Share of the rig's height: bones that are shorter have no direction."""
_APART = 0.05
"""How far the bases of fingers are apart at least, seen from the wrist, in radians: else a hand's roll is not known."""
_ASTRIDE, _INWARD = 45.0, 120.0
"""Degrees that bones of legs are off down, and of arms off outward, at most: A poses have legs 10 apart, and arms that
hang are at 90."""
_LOW = 0.12
"""Share of a leg up to which the lowest joint is above what the rig stands on; else it stands on that joint."""


def on_own(motion: Motion, skeleton: Skeleton, joints: Joints) -> RigMotion:
    """A motion on a rig with its own lengths, in its own world and unit. Raises InputError if the rest pose is not one
    that a body can have.

    Args:
        motion: In any axes.
        skeleton: The rig.
        joints: The mapping, checked.
    """
    upright = motion.in_axes("y-up").one_shape
    posed, body = Posed.of(upright), upright.shaped_body
    moving = grounded(turned(posed, own_target(skeleton, joints, body)), posed, upright)
    return touching(moving, posed, touches(upright), body.parents, upright.frame_rate)


def own_target(skeleton: Skeleton, joints: Joints, body: BodyModel) -> Target:
    """A rig of the user's as it is, with its own lengths. Raises InputError if the rest pose is not that of a body that
    stands, or its axes are scaled unevenly.

    Args:
        skeleton: The rig.
        joints: The mapping, checked.
        body: Its mean shape is the person's.
    """
    where = {part: skeleton.places[skeleton.index(names[0])] for part, names in joints.items()}
    facing = _facing(where, skeleton)
    _check_limbs(where, skeleton)
    _check_stands(where, facing, skeleton)
    length = _leg(where)
    upright = _upright(facing[:, 1])
    lowest = float((skeleton.places[list(_body_of(skeleton, joints))] @ upright[:, 1]).min())
    rest_joints = body.rest_joints
    person = _leg({part: rest_joints[JOINT[part]] for part in JOINT})
    return Target(
        names=skeleton.names,
        parents=skeleton.parents,
        places=skeleton.places,
        turns=skeleton.turns(skeleton.index(name) for names in joints.values() for name in names),
        sources=_sources(skeleton, joints),
        rest=_rest(where, facing, upright, body),
        upright=upright,
        scale=length / person,
        floor=0.0 if 0 <= lowest < _LOW * length else lowest,
        root=skeleton.index(joints["pelvis"][0]),
    )


def _body_of(skeleton: Skeleton, joints: Joints) -> set[int]:
    """The pelvis and its descendants."""
    root = skeleton.index(joints["pelvis"][0])
    return {k for k in range(len(skeleton)) if k == root or skeleton.is_below(k, root)}


def _leg(where: dict[str, np.ndarray]) -> float:
    """Mean length of thigh and shin together."""
    parts = [[where[f"{side}_{part}"] for part in ("hip", "knee", "ankle")] for side in SIDES]
    return float(np.mean([np.linalg.norm(k - h) + np.linalg.norm(a - k) for h, k, a in parts]))


def _facing(where: dict[str, np.ndarray], skeleton: Skeleton) -> Float[np.ndarray, "3 3"]:
    """The body's left, up and ahead by columns; up is the axis of the world that is nearest."""
    hips, shoulders = ((where[f"left_{part}"], where[f"right_{part}"]) for part in ("hip", "shoulder"))
    trunk = (shoulders[0] + shoulders[1] - hips[0] - hips[1]) / 2
    left = hips[0] - hips[1] + shoulders[0] - shoulders[1]
    axis = int(abs(trunk).argmax())
    up = np.zeros(3)
    up[axis] = np.sign(trunk[axis])
    left = left - (left @ up) * up
    if np.linalg.norm(trunk) < _SHORT or np.linalg.norm(left) < 0.1 * np.linalg.norm(trunk):
        raise InputError(
            f"{skeleton.source}: at rest its shoulders are not above its hips with left and right apart, as a body's "
            "that stands. Check which joints stand for them; the rig's rest pose must be standing, such as T or A."
        )
    left /= np.linalg.norm(left)
    return np.stack([left, up, np.cross(left, up)], 1)


def _check_limbs(where: dict[str, np.ndarray], skeleton: Skeleton) -> None:
    """Their bones have lengths, or nothing says how they bend."""
    for part in (part for part in NEEDED if ALONG.get(part) in NEEDED):
        end = ALONG[part]
        if np.linalg.norm(where[end] - where[part]) < _SHORT * _height(where):
            raise InputError(
                f"{skeleton.source}: at rest the joints of {part} ({meant(part)}) and {end} ({meant(end)}) are in one "
                "place; expected a bone between them. Check which joints stand for them."
            )


def _check_stands(where: dict[str, np.ndarray], facing: Float[np.ndarray, "3 3"], skeleton: Skeleton) -> None:
    """Legs hang down and arms do not cross the body: the turn from a T pose is long else, and its twist not known."""
    left, up, _ = facing.T
    for side, outward in zip(SIDES, (left, -left), strict=True):
        for part, direction, most in (
            *((part, -up, _ASTRIDE) for part in ("hip", "knee")),
            *((part, outward, _INWARD) for part in ("shoulder", "elbow")),
        ):
            name = f"{side}_{part}"
            bone = where[ALONG[name]] - where[name]
            off = np.degrees(np.arccos(np.clip(bone @ direction / np.linalg.norm(bone), -1.0, 1.0)))
            if off > most:
                wished = "down" if direction is not outward else "outward"
                raise InputError(
                    f"{skeleton.source}: at rest the bone of {name} ({meant(name)}) points {off:.0f} degrees off "
                    f"{wished}; expected a rig that stands when nothing moves, in a T pose, an A pose or between. Make "
                    "such a pose its rest pose (in Blender: Apply, Pose as Rest Pose), and export it again."
                )


def _height(where: dict[str, np.ndarray]) -> float:
    return float(np.ptp(np.stack(list(where.values())), axis=0).max())


def _upright(up: np.ndarray) -> Float[np.ndarray, "3 3"]:
    """The rotation by quarter turns that makes y up."""
    return np.round(Rotation.align_vectors(up[None], [[0.0, 1.0, 0.0]])[0].as_matrix()) if up[1] < 1 else np.eye(3)


def _rest(
    where: dict[str, np.ndarray], facing: np.ndarray, upright: np.ndarray, body: BodyModel
) -> Float[np.ndarray, "55 3 3"]:
    height = _height(where)
    directions = {
        joint: where[end] - where[joint]
        for joint, end in ALONG.items()
        if joint in where and end in where and np.linalg.norm(where[end] - where[joint]) > _SHORT * height
    }
    rest = body.rest_joints
    fixed = {}
    for side in SIDES:
        fixed |= _foot(side, where, facing, rest)
    first = rest_turns(rest, body.parents, directions, facing=facing, fixed=fixed)
    hands = {f"{side}_wrist": _hand(side, where, rest, first[JOINT[f"{side}_wrist"]]) for side in SIDES}
    return rest_turns(rest, body.parents, directions, facing=facing, fixed=fixed | hands)


def _foot(side: str, where: dict[str, np.ndarray], facing: np.ndarray, rest: np.ndarray) -> dict[str, np.ndarray]:
    """Both stand flat: a foot differs from SMPL-X's by where it points; its slope is the ankle's height alone."""
    turn = facing
    if f"{side}_foot" in where:
        points = where[f"{side}_foot"] - where[f"{side}_ankle"]
        own = facing @ (rest[JOINT[f"{side}_foot"]] - rest[JOINT[f"{side}_ankle"]])
        left, _, ahead = facing.T
        angle = np.arctan2(points @ left, points @ ahead) - np.arctan2(own @ left, own @ ahead)
        turn = Rotation.from_rotvec(angle * facing[:, 1]).as_matrix() @ facing
    return {f"{side}_ankle": turn, f"{side}_foot": turn}


def _hand(side: str, where: dict[str, np.ndarray], rest: np.ndarray, otherwise: np.ndarray) -> Float[np.ndarray, "3 3"]:
    """By the bases of the fingers, if there are two at least, apart; the thumb's is too far aside to count."""
    wrist = f"{side}_wrist"
    names = [f"{side}_{finger}1" for finger in FINGERS if finger != "thumb" and f"{side}_{finger}1" in where]
    if len(names) < 2:
        return otherwise
    ours = np.stack([rest[JOINT[name]] - rest[JOINT[wrist]] for name in names])
    theirs = np.stack([where[name] - where[wrist] for name in names])
    ours, theirs = (v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12) for v in (ours, theirs))
    if np.linalg.svd(theirs, compute_uv=False)[1] < _APART:
        return otherwise
    return Rotation.align_vectors(theirs, ours)[0].as_matrix()


def _sources(skeleton: Skeleton, joints: Joints) -> tuple[Source | None, ...]:
    found: list[Source | None] = [None] * len(skeleton)
    for part, names in joints.items():
        for place, name in enumerate(names):
            found[skeleton.index(name)] = _in_chain(part, place, len(names)) if part in CHAINS else Source(part)
    return tuple(found)


def _in_chain(part: str, place: int, count: int) -> Source:
    """Of a chain of any number of joints: the last one has the turn of SMPL-X's last, the others what is between."""
    below: Sequence[str] = {"spine": ("pelvis",), "neck": ("spine3",)}[part]
    chain = (*below, *CHAINS[part])
    along = (place + 1) / count * (len(chain) - 1)
    start = min(int(along + 1e-9), len(chain) - 2)
    share = along - start
    if share < 1e-9 or share > 1 - 1e-9:
        return Source(chain[start + round(share)])
    return Source(chain[start], chain[start + 1], share)
