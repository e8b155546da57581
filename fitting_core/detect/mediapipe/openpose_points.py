"""MediaPipe's points as tcfit's 137: which is which, what is made up from others, and how sure each is.

BlazePose has no small toes. With big toes alone the fits of 16 photographs bend the knees by 38 degrees, with small
toes 24 mm back and 40 mm out of the big ones by 14 (15.5 from OpenPose's points), so they are made up.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from fitting_core.detect.mediapipe import body as blaze
from fitting_core.detect.mediapipe.body import Body
from fitting_core.detect.mediapipe.face import Face
from fitting_core.detect.mediapipe.hands import Hand
from fitting_core.keypoints import BODY_25, COUNT, FACE, GROUPS, INDEX, SIDES, Side
from fitting_core.wholebody import FACE_MESH, MEANS

_BODY = {
    INDEX[name]: getattr(blaze, name.upper().replace("BIG_TOE", "TOE"))
    for name in BODY_25
    if name not in ("neck", "mid_hip") and "small_toe" not in name
}
"""Place among the 137 -> place among BlazePose's 33."""
_MEANS = {INDEX[name]: [getattr(blaze, part.upper()) for part in parts] for name, parts in MEANS.items()}
_FACE = list(FACE_MESH[:68])
_LIDS = (_FACE[36:42], _FACE[42:48])
"""Right and left: a pupil is put in their middle."""
_PUPIL = 0.5
"""Of the face's score: the gaze is not seen."""

LEAST = 0.05
"""Points of lower confidence are not reported, as with OpenPose."""
SURE_HAND = 0.6
"""Score of a hand from which it is believed; of one below, half."""
_LONE_HIP = 0.3
"""Most confidence of a hip whose knee is not seen: BlazePose puts hips that the picture cuts off inside it, and calls
them visible (0.98)."""
_KNEE_SEEN = 0.2
_BEYOND = 0.25
"""Confidence of a point that lies beyond the picture: it is put onto the border, as OpenPose does it."""
_NEAR, _SURE_BEYOND = 0.15, 0.3
"""Sides of the body's square up to which, and confidence from which, that is done."""

_TOES = {
    "left": (blaze.LEFT_KNEE, blaze.LEFT_ANKLE, blaze.LEFT_HEEL, blaze.LEFT_TOE, 1.0),
    "right": (blaze.RIGHT_KNEE, blaze.RIGHT_ANKLE, blaze.RIGHT_HEEL, blaze.RIGHT_TOE, -1.0),
}
_SMALL_TOE = np.array([-0.024, 0.001, 0.040])
"""Metres from the big toe: forwards along the foot, down the shank, outwards. Measured on the free body."""
_TRUNK, _LIMBS = slice(blaze.LEFT_SHOULDER, blaze.LEFT_KNEE), slice(blaze.LEFT_SHOULDER, blaze.LEFT_HEEL)


def points_of(
    body: Body | None, hands: Mapping[Side, Hand | None], face: Face | None, size: tuple[int, int]
) -> Float[np.ndarray, "137 3"]:
    """x, y in pixels and confidence of a person's points; (0, 0, 0) for what was not found.

    Args:
        body: Of the person; None where it was not found.
        hands: By side.
        face: Of the person.
        size: Width and height of the image.
    """
    points = np.zeros((COUNT, 3))
    if body is not None:
        _put_body(points, body, size)
    for side in SIDES:
        if (hand := hands[side]) is not None:
            place, sure = GROUPS[f"{side}_hand"], hand.looks(side)
            points[place, :2] = hand.xy
            points[place, 2] = sure * (1.0 if sure > SURE_HAND else 0.5) * inside(hand.xy, size)
    if face is not None:
        start = FACE.start
        points[start : start + len(_FACE)] = np.column_stack([face.xy[_FACE], np.full(len(_FACE), face.score)])
        for place, lids in zip(range(start + len(_FACE), FACE.stop), _LIDS, strict=True):
            points[place] = *face.xy[lids].mean(0), _PUPIL * face.score
        points[FACE, 2] *= inside(points[FACE, :2], size)
    points[(points[:, 2] < LEAST) | ~np.isfinite(points).all(1)] = 0
    return points


def _put_body(points: Float[np.ndarray, "137 3"], body: Body, size: tuple[int, int]) -> None:
    sure, within = confidence(body), inside(body.xy, size)
    for hip, knee in ((blaze.LEFT_HIP, blaze.LEFT_KNEE), (blaze.RIGHT_HIP, blaze.RIGHT_KNEE)):
        if sure[knee] < _KNEE_SEEN or not within[knee]:
            sure[hip] = min(sure[hip], _LONE_HIP)
    far = _NEAR * body.square.side
    near = ((body.xy > -far) & (body.xy < np.array(size) + far)).all(1)
    sure = np.where(within, sure, np.where(near & (sure > _SURE_BEYOND), _BEYOND, 0.0))
    xy = np.clip(body.xy, 0, np.array(size) - 1)
    for place, theirs in _BODY.items():
        points[place] = *xy[theirs], sure[theirs]
    for place, (a, b) in _MEANS.items():
        points[place] = *((xy[a] + xy[b]) / 2), min(sure[a], sure[b])
    for side, toe in small_toes(body).items():
        big = _TOES[side][3]
        if within[big] and inside(toe[None], size)[0]:
            points[INDEX[f"{side}_small_toe"]] = *toe, sure[big]


def confidence(body: Body) -> Float[np.ndarray, "33"]:
    """0 to 1, from the height of the heat map, what the network calls visible, and how far the mirrored picture's
    points lie apart.

    Visibility alone misleads: knees out of the picture have 0.34, and a heat map of 0.04. The median error is 1.3 to
    1.5 % of the body's square at heights above 0.7, 2.9 at 0.4 to 0.55, 5.4 at 0.2 to 0.4.
    """
    spread = 100 * body.spread / body.square.side
    agreement = np.clip(2 / np.maximum(spread, 1e-6), 0.25, 1)
    return np.clip((body.heat - 0.2) / 0.5, 0, 1) * (0.3 + 0.7 * body.visible) * agreement


def small_toes(body: Body) -> dict[str, Float[np.ndarray, "2"]]:
    """Where the small toes should be, in pixels, from the direction of foot and shank in space."""
    # Pixels for each metre: the limbs as the image has them, beside how long the network takes them to be.
    metres = body.world[_LIMBS, :2] - body.world[_TRUNK, :2].mean(0)
    pixels = body.xy[_LIMBS] - body.xy[_TRUNK].mean(0)
    scale = (metres * pixels).sum() / max((metres**2).sum(), 1e-9)
    toes = {}
    for side, (knee, ankle, heel, toe, outwards) in _TOES.items():
        foot, shank = _unit(body.world[toe] - body.world[heel]), _unit(body.world[ankle] - body.world[knee])
        axes = np.stack([foot, shank, outwards * _unit(np.cross(foot, shank))])
        toes[side] = body.xy[toe] + scale * (_SMALL_TOE @ axes)[:2]
    return toes


def inside(xy: Float[np.ndarray, "n 2"], size: tuple[int, int]) -> np.ndarray:
    """Which points the image holds."""
    return np.all((xy >= 0) & (xy < np.array(size)), axis=1)


def _unit(v: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    return v / max(float(np.linalg.norm(v)), 1e-9)
