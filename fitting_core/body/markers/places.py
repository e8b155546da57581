"""Where the markers of gait laboratories sit on a body: a rule for each, and the vertex that it gives.

The names are those of Vicon's Plug-in Gait for the whole body, and on the medial side those of CGM2 (KNM, MED, FMH,
VMH), with ELM for the elbow. A rule is a ray from between two joints of the rest pose to where it leaves the skin, so
it holds for any mesh of the SMPL family. A body model has no palpable bones; the rules place them by the usual shares
of the body's lengths.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from fitting_core.body.model import JOINT, JOINTS, BodyModel, other_side

Vector = tuple[float, float, float]
_TRUNK = ("pelvis", "spine1", "spine2", "spine3", "left_hip", "right_hip", "left_collar", "right_collar", "neck")
_HEAD = ("head", "neck", "jaw", "left_eye", "right_eye")
_SHOULDER = ("left_collar", "left_shoulder", "spine3", "neck")
_ARM = ("left_shoulder", "left_elbow", "left_wrist")
_HAND = ("left_wrist", *(joint for joint in JOINTS[25:40]))
_THIGH = ("left_hip", "left_knee", "pelvis")
_SHANK = ("left_knee", "left_ankle")
_FOOT = ("left_ankle", "left_foot", "left_knee")
_LEFT, _UP, _FRONT = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_RIGHT, _DOWN, _BACK = (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)
_TALL = 1.7
"""Metres from sole to crown of the body that offsets are stated for."""


@dataclass(frozen=True)
class Place:
    """A ray from between two points of the rest pose (x to the body's left, y up, z forward) through the skin."""

    text: str
    """Its place, in words for the user."""
    start: str
    """A joint, or a surface keypoint."""
    direction: Vector
    bones: tuple[str, ...]
    """Joints that carry the skin it may sit on."""
    end: str = ""
    """Empty: the start."""
    share: float = 0.0
    """Of the way from start to end at which the ray begins."""
    offset: Vector = (0.0, 0.0, 0.0)
    """Added to that: metres on a body of _TALL."""

    @property
    def mirrored(self) -> "Place":
        """The same on the other side."""
        return replace(
            self,
            start=other_side(self.start),
            direction=(-self.direction[0], *self.direction[1:]),
            bones=tuple(other_side(bone) for bone in self.bones),
            end=other_side(self.end),
            offset=(-self.offset[0], *self.offset[1:]),
        )


_MIDDLE = {
    "C7": Place("spine, at the base of the neck", "neck", _BACK, (*_TRUNK, *_HEAD)),
    "T10": Place("spine, at the tenth thoracic vertebra", "pelvis", _BACK, _TRUNK, "neck", 0.53),
    "CLAV": Place("notch above the breastbone", "pelvis", _FRONT, (*_TRUNK, *_HEAD), "neck", 0.88),
    "STRN": Place("lower end of the breastbone", "pelvis", _FRONT, _TRUNK, "neck", 0.48),
    "RBAK": Place(
        "right shoulder blade; without one on the left", "pelvis", _BACK, _TRUNK, "neck", 0.75, (-0.09, 0, 0)
    ),
    "SACR": Place(
        "between the two iliac spines at the back", "left_hip", _BACK, _TRUNK, "right_hip", 0.5, (0, 0.095, 0)
    ),
}
_SIDED = {
    "FHD": Place("temple", "head", (0.65, 0.0, 0.76), _HEAD, offset=(0, 0.075, 0)),
    "BHD": Place("back of the head, as high", "head", (0.65, 0.0, -0.76), _HEAD, offset=(0, 0.075, 0)),
    "SHO": Place("top of the shoulder", "left_shoulder", _UP, _SHOULDER, offset=(-0.015, 0, 0)),
    "UPA": Place("outside of the upper arm", "left_shoulder", _UP, _ARM, "left_elbow", 0.5),
    "ELB": Place("elbow, outer side", "left_elbow", _UP, _ARM),
    "ELM": Place("elbow, inner side", "left_elbow", _DOWN, _ARM),
    "FRM": Place("outside of the forearm", "left_elbow", _UP, _ARM, "left_wrist", 0.5),
    "WRA": Place("wrist, thumb's side", "left_wrist", _FRONT, (*_ARM, *_HAND)),
    "WRB": Place("wrist, little finger's side", "left_wrist", _BACK, (*_ARM, *_HAND)),
    "FIN": Place("back of the hand, below the forefinger's knuckle", "left_wrist", _UP, _HAND, "left_index", 0.5),
    "ASI": Place(
        "front end of the hip bone's crest", "left_hip", _FRONT, _TRUNK, "right_hip", 0.5, offset=(0.12, 0.085, 0)
    ),
    "PSI": Place("its end at the back", "left_hip", _BACK, _TRUNK, "right_hip", 0.5, offset=(0.045, 0.095, 0)),
    "THI": Place("outside of the thigh", "left_hip", _LEFT, _THIGH, "left_knee", 0.5),
    "KNE": Place("knee, outer side", "left_knee", _LEFT, (*_THIGH, *_SHANK)),
    "KNM": Place("knee, inner side", "left_knee", _RIGHT, (*_THIGH, *_SHANK)),
    "TIB": Place("outside of the shank", "left_knee", _LEFT, _SHANK, "left_ankle", 0.5),
    "ANK": Place("ankle, outer side", "left_ankle", _LEFT, _FOOT),
    "MED": Place("ankle, inner side", "left_ankle", _RIGHT, _FOOT),
    "HEE": Place("heel, as high as the toe's", "left_ankle", _BACK, _FOOT, offset=(0, -0.035, 0)),
    "TOE": Place("above the second toe's ball", "left_foot", _UP, _FOOT, offset=(-0.01, 0, 0)),
    "FMH": Place("ball of the big toe, inner side", "left_foot", _RIGHT, _FOOT),
    "VMH": Place("ball of the little toe, outer side", "left_foot", _LEFT, _FOOT, offset=(0, 0, -0.02)),
}
PLACES: dict[str, Place] = (
    {f"L{name}": place for name, place in _SIDED.items()}
    | {f"R{name}": place.mirrored for name, place in _SIDED.items()}
    | _MIDDLE
)
"""By name: the standard set."""


@lru_cache(maxsize=4)
def standard_vertices(body: BodyModel) -> dict[str, int]:
    """The vertex of each marker of PLACES on a body, by its mean shape."""
    return {name: _vertex(body, place) for name, place in PLACES.items()}


def _vertex(body: BodyModel, place: Place) -> int:
    """The vertex nearest to the point where the ray leaves the skin, or to the ray if it misses the skin."""
    if (found := skin_point(body, place)) is not None:
        corners, weights = found
        return int(corners[weights.argmax()])
    origin, direction, allowed = _ray(body, place)
    away = body.template - origin
    along = away @ direction
    across = np.linalg.norm(away - along[:, None] * direction, axis=1)
    return int(np.where(allowed & (along > 0), across, np.inf).argmin())


def skin_point(body: BodyModel, place: Place) -> tuple[Int[np.ndarray, "3"], Float[np.ndarray, "3"]] | None:
    """Where the ray leaves the skin of the mean shape at rest: corners of a triangle, and their weights; None if it
    misses the skin."""
    origin, direction, allowed = _ray(body, place)
    faces = body.faces[allowed[body.faces].all(1)]
    depths, triangles, weights = _hits(body.template[faces], origin, direction)
    if not len(depths):
        return None
    last = depths.argmax()
    return faces[triangles[last]], weights[last]


def _ray(body: BodyModel, place: Place) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], Bool[np.ndarray, "V"]]:
    """Origin and direction, and the vertices that the place's joints carry more than all others do."""
    tall = float(np.ptp(body.template[:, 1])) / _TALL
    start, end = _point(body, place.start), _point(body, place.end or place.start)
    origin = start + place.share * (end - start) + tall * np.array(place.offset)
    direction = np.array(place.direction) / np.linalg.norm(place.direction)
    return origin, direction, body.skinning_weights[:, [JOINT[bone] for bone in place.bones]].sum(1) > 0.5


def _point(body: BodyModel, name: str) -> Float[np.ndarray, "3"]:
    """A joint of the rest pose, or a surface keypoint; of a body without that, the wrist that its hand hangs on."""
    if name in body.surface_keypoints:
        return body.template[body.surface_keypoints[name]]
    return body.rest_joints[JOINT[name] if name in JOINT else JOINT[f"{name.split('_')[0]}_wrist"]]


def _hits(
    triangles: Float[np.ndarray, "F 3 3"], origin: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "n"], Int[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
    """Where a ray meets triangles (Möller and Trumbore, 1997): how far off, each one's number, its corners' weights."""
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across = np.cross(direction, ac)
    determinant = (ab * across).sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / determinant
        from_a = origin - a
        u = scale * (from_a * across).sum(1)
        turned = np.cross(from_a, ab)
        v = scale * (turned @ direction)
        depth = scale * (ac * turned).sum(1)
        met = np.flatnonzero((u >= 0) & (v >= 0) & (u + v <= 1) & (depth > 0) & np.isfinite(depth))
    return depth[met], met, np.stack([1 - u - v, u, v], 1)[met]
