"""Where the 51 inner face landmarks (iBUG's points 17 to 67) lie on the body's face."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from build_assets.free_body.makehuman import Rig
from build_assets.free_body.skin.skinning import joints_of_bone
from build_assets.free_body.skin.surface import Surface
from build_assets.free_body.skin.surface_keypoints import nose_tip
from fitting_core.body.geometry import MIRROR

FIRST, LAST = 17, 67
_MIDLINE = 1e-4  # metres

_MIRRORED = {
    **{17: 26, 18: 25, 19: 24, 20: 23, 21: 22},
    **{36: 45, 37: 44, 38: 43, 39: 42, 40: 47, 41: 46},
    **{31: 35, 32: 34},
    **{48: 54, 49: 53, 50: 52, 58: 56, 59: 55, 60: 64, 61: 63, 67: 65},
}
"""Points of the body's right side by those of its left side that they mirror."""
_BROW = {22: (-0.25, 0.68), 23: (0.25, 0.78), 24: (0.70, 0.85), 25: (1.13, 0.78), 26: (1.52, 0.56)}
"""Across from the eye's inner corner and up from its middle, in widths of the eye."""
_UPPER_LID, _LOWER_LID = {43: 0.33, 44: 0.68}, {47: 0.36, 46: 0.68}
"""How far from the inner to the outer corner."""
_NOSTRILS = {33: 317, 34: 7076, 35: 7095}
"""Vertices of the base mesh under the nose."""
_TEAR_DUCT = 0.09  # the inner corner lies this far inward from the skin's opening, in widths of the eye


@dataclass(frozen=True, kw_only=True)
class _Mouth:
    """The points on one of the two outlines of the lips, left half; places as shares of half the mouth's width."""

    corner: int
    top: int
    bottom: int
    upper: dict[int, float]
    lower: dict[int, float]
    outward: int
    """1 for the outline of the lips' red, whose middle lies away from the mouth's slit; -1 for the slit itself."""


_LIPS = _Mouth(corner=54, top=51, bottom=57, upper={52: 0.22, 53: 0.60}, lower={56: 0.28, 55: 0.62}, outward=1)
_SLIT = _Mouth(corner=64, top=62, bottom=66, upper={63: 0.42}, lower={65: 0.42}, outward=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Face:
    """A typical body's face: where its points are looked for."""

    surface: Surface
    positions: Float[np.ndarray, "N 3"]
    """Of the base mesh's vertices, in the rest pose; symmetric."""
    in_jaw: Float[np.ndarray, "N"]
    """Skinning weight of the jaw, which tells the lower lip from the upper one."""

    def height_on_skin(self, x: float, y: float) -> Float[np.ndarray, "3"]:
        """The foremost point of the head's skin at x and y."""
        triangles = self.positions[self.surface.triangles[self.surface.triangles_of(self.surface.parts["head"])]]
        a, b, c = np.moveaxis(triangles[..., :2], 1, 0)
        (ux, uy), (vx, vy), (px, py) = (b - a).T, (c - a).T, (np.array([x, y]) - a).T
        area = ux * vy - uy * vx
        area = np.where(np.abs(area) < 1e-14, 1e-14, area)
        s, t = (px * vy - py * vx) / area, (ux * py - uy * px) / area
        inside = (s >= -1e-6) & (t >= -1e-6) & (s + t <= 1 + 1e-6)
        depths = (1 - s - t) * triangles[:, 0, 2] + s * triangles[:, 1, 2] + t * triangles[:, 2, 2]
        return np.array([x, y, depths[inside].max()])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Eye:
    """The opening of the left eyelids, as base vertices, and its measures."""

    inner: int
    outer: int
    upper: Int[np.ndarray, "n"]
    lower: Int[np.ndarray, "n"]
    width: float
    height: float
    """Of its middle."""


def face_of(surface: Surface, rig: Rig, positions: Float[np.ndarray, "N 3"]) -> Face:
    """The face of a typical body, given by positions of the base mesh's vertices."""
    jaw_bones = [i for i, bone in enumerate(rig.bones) if joints_of_bone(bone) == ("jaw",)]
    return Face(surface=surface, positions=positions, in_jaw=rig.weights[:, jaw_bones].sum(1))


def eye_height(face: Face) -> float:
    """The height of the middle of the eyes' openings, in metres."""
    return _eye(face).height


def landmark_points(face: Face) -> Float[np.ndarray, "51 3"]:
    """Points 17 to 67 in iBUG's order, in metres."""
    points = _brow_and_eye(face) | _nose(face) | _lips(face, _LIPS) | _lips(face, _SLIT)
    points |= {right: points[left] * MIRROR for right, left in _MIRRORED.items()}
    return np.stack([points[number] for number in range(FIRST, LAST + 1)])


def _eye(face: Face) -> _Eye:
    parts, positions = face.surface.parts, face.positions
    rim = face.surface.border(parts["eye_cavity.L"], parts["head"])
    x, y = positions[rim, 0], positions[rim, 1]
    inner, outer = int(rim[x.argmin()]), int(rim[x.argmax()])
    corners = positions[[inner, outer]]
    upper = rim[y > np.interp(x, corners[:, 0], corners[:, 1])]
    lower = np.setdiff1d(rim, [*upper, inner, outer])
    return _Eye(
        inner=inner,
        outer=outer,
        upper=upper,
        lower=lower,
        width=float(corners[1, 0] - corners[0, 0]),
        height=float((positions[upper, 1].max() + positions[lower, 1].min()) / 2),
    )


def _brow_and_eye(face: Face) -> dict[int, Float[np.ndarray, "3"]]:
    eye = _eye(face)
    x, y, _ = face.positions[eye.inner]
    points = {42: face.height_on_skin(x - _TEAR_DUCT * eye.width, y), 45: face.positions[eye.outer]}
    for lid, places in ((eye.upper, _UPPER_LID), (eye.lower, _LOWER_LID)):
        points |= {number: _nearest_across(face, lid, x + share * eye.width) for number, share in places.items()}
    for number, (across, up) in _BROW.items():
        points[number] = face.height_on_skin(x + across * eye.width, eye.height + up * eye.width)
    return points


def _nose(face: Face) -> dict[int, Float[np.ndarray, "3"]]:
    """Three points down the bridge, the tip, and the row below it."""
    top = eye_height(face)
    tip = face.positions[nose_tip(face.surface, face.positions, top)]
    bridge = {27 + k: face.height_on_skin(0.0, top + (tip[1] - top) * k / 3) for k in range(3)}
    return bridge | {30: tip} | {number: face.positions[vertex] for number, vertex in _NOSTRILS.items()}


def _lips(face: Face, mouth: _Mouth) -> dict[int, Float[np.ndarray, "3"]]:
    parts, positions = face.surface.parts, face.positions
    skin = parts["head"] & ~parts["lips"]
    inside, outside = (parts["lips"], skin) if mouth.outward > 0 else (parts["mouth_cavity"], parts["head"])
    loop = face.surface.border(inside, outside)
    loop = loop[positions[loop, 0] > -_MIDLINE]
    corner = loop[positions[loop, 0].argmax()]
    upper, lower = loop[face.in_jaw[loop] < 0.5], loop[face.in_jaw[loop] >= 0.5]
    points = {
        mouth.corner: positions[corner],
        mouth.top: _middle(face, upper, mouth.outward),
        mouth.bottom: _middle(face, lower, -mouth.outward),
    }
    width = positions[corner, 0]
    for lip, places in ((upper, mouth.upper), (lower, mouth.lower)):
        points |= {number: _nearest_across(face, lip, share * width) for number, share in places.items()}
    return points


def _middle(face: Face, lip: Int[np.ndarray, "n"], sign: int) -> Float[np.ndarray, "3"]:
    """The highest (sign 1) or lowest (-1) point of a lip on the face's middle line."""
    middle = face.positions[lip[np.abs(face.positions[lip, 0]) < _MIDLINE]]
    return middle[(sign * middle[:, 1]).argmax()]


def _nearest_across(face: Face, vertices: Int[np.ndarray, "n"], x: float) -> Float[np.ndarray, "3"]:
    return face.positions[vertices[np.abs(face.positions[vertices, 0] - x).argmin()]]
