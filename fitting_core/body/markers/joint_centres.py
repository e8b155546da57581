"""Anatomical joint centres of the limbs, as gait laboratories find them from landmarks on the skin.

They stand beside SMPL-X's joints, about which the body bends, and which lie where a file's makers put them: the hips of
the free body are 22 cm apart, those of public SMPL-X skeletons 14. Joint angles, MOT, TRC, C3D and comparisons with
markers use the centres.

- hip: a quarter of the way from one greater trochanter to the other (Weinhandl & O'Connor, J. Biomech. 43 (2010) 2633;
  against radiographs: Bennett et al., J. Biomech. 49 (2016) 3047). Regressions from the iliac spines (Bell 1990,
  Harrington 2007) need bone: on the skin of a body model they put hips 5 to 6 cm too far in front.
- knee, ankle, elbow, wrist: midway between the epicondyles of the femur, the malleoli, the epicondyles of the humerus,
  and the styloids.
- shoulder: SMPL-X's joint, for ISB's centre is that of the humerus' rotation (Wu et al., J. Biomech. 38 (2005) 981).

The landmarks are those of `places`: rays from the joints of the rest pose through the skin, so they need no
vertex numbers and hold for the free body as for the user's SMPL-X files. In each shape, a centre is the same weighted
sum of vertices at rest; the bone above the joint carries it rigidly.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.body.markers.places import PLACES, Place, skin_point
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.body_points import BodyPoints
from fitting_core.body.points.pairs import Carried
from fitting_core.body.points.positions import posed_points

_TROCHANTER = Place("greater trochanter", "left_hip", (1.0, 0.0, 0.0), ("left_hip", "left_knee", "pelvis"))


_BETWEEN: dict[str, tuple[Place, Place, float]] = {
    "hip": (_TROCHANTER, _TROCHANTER.mirrored, 0.25),
    "knee": (PLACES["LKNE"], PLACES["LKNM"], 0.5),
    "ankle": (PLACES["LANK"], PLACES["LMED"], 0.5),
    "elbow": (PLACES["LELB"], PLACES["LELM"], 0.5),
    "wrist": (PLACES["LWRA"], PLACES["LWRB"], 0.5),
}
"""By the part of the left side: two landmarks, and the share of the way from the first to the second."""
CENTRES: dict[str, str] = {
    f"{side[0]}{part[0]}JC".upper(): f"{side}_{part}" for side, part in (kp.NAMES[i].split("_") for i in kp.LIMBS)
}
"""SMPL-X's joint beside each centre, by its laboratory name (LHJC, LKJC, ...), in the order of `keypoints.LIMBS`."""


@lru_cache(maxsize=4)
def with_joint_centres(body: BodyModel) -> BodyModel:
    """The body with the centres in place of the limbs' joints, at rest. A joint whose landmark the skin lacks stays."""
    regressor = body.joint_regressor.copy()
    for name in CENTRES.values():
        if (row := _row(body, name)) is not None:
            regressor[JOINT[name]] = row
    return replace(body, joint_regressor=regressor)


def joint_centres_in_space(body: BodyModel, params: BodyParams) -> Float[np.ndarray, "T 12 3"]:
    """CENTRES of posed bodies in camera space, metres."""
    return posed_points(_points(body), body, params)


@lru_cache(maxsize=4)
def _points(body: BodyModel) -> BodyPoints:
    points, regressor = list[Carried](), with_joint_centres(body).joint_regressor
    for joint in map(JOINT.__getitem__, CENTRES.values()):
        vertices = np.flatnonzero(regressor[joint])
        weights = regressor[joint, vertices]
        points.append(Carried(tuple(vertices.tolist()), tuple(weights.tolist()), int(body.parents[joint])))
    return BodyPoints(body, points)


def _row(body: BodyModel, name: str) -> Float[np.ndarray, "V"] | None:
    """Weights of the vertices in a centre; None: it is the joint."""
    side, part = name.split("_")
    if part not in _BETWEEN:
        return None
    *places, share = _BETWEEN[part]
    row = np.zeros(len(body.template))
    for place, weight in zip(places, (1 - share, share), strict=True):
        found = skin_point(body, place if side == "left" else place.mirrored)
        if found is None:
            return None
        corners, weights = found
        row[corners] += weight * weights
    return row
