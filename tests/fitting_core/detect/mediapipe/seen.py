"""Bodies, hands and faces for tests, made from numbers alone."""

from dataclasses import replace

import numpy as np

from fitting_core.detect.mediapipe import body as blaze
from fitting_core.detect.mediapipe.body import Body
from fitting_core.detect.mediapipe.hands import Hand
from fitting_core.detect.mediapipe.squares import Square

STANDING = np.zeros((blaze.COUNT, 2))
"""A person who faces the camera, in shares of the body's square about its middle."""
for _names, _y, _out in (
    (("EYE", "EAR"), -0.42, (0.02, 0.04)),
    (("SHOULDER", "ELBOW", "WRIST"), (-0.3, -0.15, 0.0), (0.1, 0.13, 0.14)),
    (("PINKY", "INDEX"), 0.04, (0.15, 0.13)),
    (("HIP", "KNEE", "ANKLE", "HEEL", "TOE"), (0.0, 0.2, 0.4, 0.42, 0.43), (0.06, 0.06, 0.06, 0.06, 0.08)),
):
    for _k, _name in enumerate(_names):
        for _side, _sign in (("LEFT", 1), ("RIGHT", -1)):
            _row = _y[_k] if isinstance(_y, tuple) else _y
            STANDING[getattr(blaze, f"{_side}_{_name}")] = (_sign * _out[_k], _row)
STANDING[blaze.NOSE] = (0, -0.4)


def body_at(x: float, y: float, side: float, **changes: object) -> Body:
    """A standing person whose square is there."""
    square = Square(x, y, side)
    world = np.concatenate([STANDING * 2, np.zeros((blaze.COUNT, 1))], 1)
    world[[blaze.LEFT_TOE, blaze.RIGHT_TOE], 2] -= 0.15
    made = Body(
        xy=STANDING * side + [x, y],
        visible=np.ones(blaze.COUNT),
        heat=np.full(blaze.COUNT, 0.9),
        spread=np.zeros(blaze.COUNT),
        world=world,
        score=1.0,
        circle=np.array([[x, y], [x, y - side / (2 * blaze.SCALE)]]),
        square=square,
        silhouette=np.ones((256, 256), np.float32),
    )
    return replace(made, **changes)


def hand_at(x: float, y: float, *, score: float = 0.9, right: float = 0.9, size: float = 40.0) -> Hand:
    """A hand whose wrist is there."""
    fan = np.stack([np.tile(np.linspace(-0.5, 0.5, 5)[:, None], 4), np.tile(-np.linspace(0.4, 1, 4), (5, 1))], -1)
    xy = np.concatenate([[[0, 0]], fan.reshape(-1, 2)]) * size + [x, y]
    return Hand(xy=xy, score=score, right=right, square=Square(x, y, 2.5 * size))
