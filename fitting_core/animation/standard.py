"""The skeletons of Mixamo, Unreal's mannequin and VRM 1.0, with the bones of the fitted person.

Names, order and axes are those of the rigs, the rest pose is theirs, and lengths are the person's: so a joint is
exactly where the fit has it. Where the facts come from:

- Mixamo: names, tree and rest orientations of its X Bot as tools publish them that write Mixamo's FBX. T pose, x to the
  left, y up, z ahead. y runs along each bone. x is to the left in the spine and to the right in the legs; z points down
  in arms and fingers, up in the feet.
- Unreal: names and offsets of UE4's mannequin, of which plugins that drive it keep tables; the A pose and the axes of
  the mannequin of UE5 (UEFN) as engines list them that import it. x runs along the bone on the left arm, the spine and
  the right leg, against it on the right arm and the left leg; the right side is the left one mirrored and negated.
  Unreal's glTF importer (ConvertVec3, ConvertQuat) swaps y and z of every node to get its left-handed axes. So a node's
  y here is a bone's z there: to the right in trunk and legs, up in the arms, to the little finger in the hands.
- VRM: the specification of VRMC_vrm 1.0: names, T pose, +z ahead; axes are free there, and the world's here.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.animation.retargeting import Source, Target, axes_along, rest_turns
from fitting_core.body.model import JOINT, BodyModel

Vector = tuple[float, float, float]
LEFT, UP, AHEAD = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
RIGHT, DOWN, BACK = (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)
_MIRROR = np.diag([-1.0, 1.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class Bone:
    """A joint of a rig, of the middle or of the left side: then L, l or Left in braces become the right one's."""

    name: str
    parent: str
    source: Source | None
    """Of the left side; None: it stays with its parent."""
    along: Vector | str
    """The first of its axes at rest: a direction, "bone" to what hangs on it, "-bone" against that, or "parent": as the
    parent's."""
    hint: Vector
    """The second of its axes is as near to this as it can be."""
    order: str
    """Which axes these two are: "yx" and the like; "" where all are the world's."""
    place: str | tuple[str, str, float] = ""
    """Where it is, if not at its source: a point of the surface (the name of a keypoint, "top" of the head), or a share
    of the way between two of SMPL-X's joints."""


@dataclass(frozen=True, kw_only=True)
class Standard:
    """A rig that everybody knows."""

    title: str
    bones: tuple[Bone, ...]
    directions: Mapping[str, Vector]
    """Of bones of the left side at rest, by SMPL-X's joint."""
    hand: tuple[Vector, Vector] = (LEFT, BACK)
    """The left hand at rest: along the fingers, and towards the little finger."""
    negated: bool = False
    """The right side's axes are the left one's mirrored and negated; else they are found as the left one's are."""


def standard_target(standard: Standard, body: BodyModel) -> Target:
    """The rig with the bones of a body whose mean shape is the person's; it stands at the origin on the floor."""
    rest, joints = _rest(standard, body), body.rest_joints
    places = _posed(joints, body.parents, rest)
    skinned = bent(body, rest, places)
    places -= (places[0, 0], skinned[:, 1].min(), places[0, 2])
    bones = list(_both_sides(standard))
    names = tuple(bone.name for bone in bones)
    parents = np.array([names.index(bone.parent) if bone.parent else -1 for bone in bones])
    where = np.stack([_place(bone, body, rest, places) for bone in bones])
    return Target(
        names=names,
        parents=parents,
        places=where,
        turns=_axes(bones, parents, where),
        sources=tuple(bone.source for bone in bones),
        rest=rest,
        root=next(k for k, bone in enumerate(bones) if bone.source is not None and bone.source.joint == "pelvis"),
    )


def _rest(standard: Standard, body: BodyModel) -> Float[np.ndarray, "55 3 3"]:
    left = {joint: np.array(v) for joint, v in standard.directions.items()}
    right = {joint.replace("left", "right"): _MIRROR @ v for joint, v in left.items()}
    along, little = standard.hand
    hand = axes_along(np.array(along), np.array(little), "xz") @ np.array((LEFT, DOWN, BACK))  # its own inverse
    upright = {f"{side}_{part}": np.eye(3) for side in ("left", "right") for part in ("ankle", "foot")}
    fixed = upright | {"left_wrist": hand, "right_wrist": _MIRROR @ hand @ _MIRROR}
    return rest_turns(body.rest_joints, body.parents, left | right, fixed)


def _posed(joints: np.ndarray, parents: np.ndarray, turns: np.ndarray) -> Float[np.ndarray, "55 3"]:
    places = joints.copy()
    for j in range(1, len(joints)):
        places[j] = places[parents[j]] + turns[parents[j]] @ (joints[j] - joints[parents[j]])
    return places


def bent(
    body: BodyModel, turns: Float[np.ndarray, "55 3 3"], places: Float[np.ndarray, "55 3"]
) -> Float[np.ndarray, "V 3"]:
    """The mean shape's surface with joints turned and placed so, by linear skinning."""
    offsets = places - np.einsum("jab,jb->ja", turns, body.rest_joints)
    weights = body.skinning_weights
    return np.einsum("vj,jab,vb->va", weights, turns, body.template, optimize=True) + weights @ offsets


def _place(bone: Bone, body: BodyModel, rest: np.ndarray, places: np.ndarray) -> Float[np.ndarray, "3"]:
    if isinstance(bone.place, tuple):
        start, end, share = bone.place
        return (1 - share) * places[JOINT[start]] + share * places[JOINT[end]]
    if not bone.place:
        return np.zeros(3) if bone.source is None else places[JOINT[bone.source.joint]]
    at, _, point = bone.place.partition(" ")
    j = JOINT[at]
    if point == "top":
        surface = body.template[body.template[:, 1].argmax()] * (0, 1, 1)
    elif point in body.surface_keypoints:
        surface = body.template[body.surface_keypoints[point]]
    else:  # a body without that point: as far as the bone before
        surface = 2 * body.rest_joints[j] - body.rest_joints[body.parents[j]]
    return places[j] + rest[j] @ (surface - body.rest_joints[j])


def _axes(bones: list[Bone], parents: np.ndarray, places: np.ndarray) -> Float[np.ndarray, "K 3 3"]:
    turns = np.tile(np.eye(3), (len(bones), 1, 1))
    for k, bone in enumerate(bones):
        if not bone.order:
            continue
        if bone.along == "parent":
            turns[k] = turns[parents[k]]
            continue
        if isinstance(bone.along, str):
            child = int(np.flatnonzero(parents == k)[0])
            direction = (places[child] - places[k]) * (-1 if bone.along.startswith("-") else 1)
        else:
            direction = np.array(bone.along)
        turns[k] = axes_along(direction, np.array(bone.hint), bone.order)
    return turns


# --- both sides ---

_OTHER = {"{L}": ("L", "R"), "{l}": ("l", "r"), "{Left}": ("Left", "Right"), "{left}": ("left", "right")}


def _both_sides(standard: Standard) -> Iterator[Bone]:
    """All bones, those of the right side last."""
    sided = [bone for bone in standard.bones if any(mark in bone.name for mark in _OTHER)]
    for bone in standard.bones:
        yield _sided(bone, 0, negated=False) if bone in sided else bone
    for bone in sided:
        yield _sided(bone, 1, negated=standard.negated)


def _sided(bone: Bone, side: int, *, negated: bool) -> Bone:
    def named(text: str) -> str:
        for mark, sides in _OTHER.items():
            text = text.replace(mark, sides[side])
        return text.replace("left_", "right_") if side else text

    source, place = bone.source, bone.place
    return Bone(
        name=named(bone.name),
        parent=named(bone.parent),
        source=None if source is None else Source(named(source.joint), share=source.share),
        order=bone.order,
        along=_negated(bone.along) if negated else bone.along,
        hint=_opposite(bone.hint) if negated else bone.hint,
        place=(named(place[0]), named(place[1]), place[2]) if isinstance(place, tuple) else named(place),
    )


_NEGATED = {"bone": "-bone", "-bone": "bone", "parent": "parent"}


def _negated(along: Vector | str) -> Vector | str:
    return _NEGATED[along] if isinstance(along, str) else _opposite(along)


def _opposite(direction: Vector) -> Vector:
    """Of the other side, and the other way."""
    return (direction[0], -direction[1], -direction[2])
