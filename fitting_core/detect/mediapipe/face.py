"""A face's 468 points in a square, and the squares in which a face may be.

Kartynnik et al. 2019 (arXiv:1907.06724).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.detect.mediapipe import body as blaze
from fitting_core.detect.mediapipe.body import Body
from fitting_core.detect.mediapipe.networks import Network
from fitting_core.detect.mediapipe.single_shot import Found
from fitting_core.detect.mediapipe.squares import Image, Square, of_box, picture, turn_from

COUNT = 468
SURE = 0.5
"""Score from which there is a face."""
_SIZE = 192
_OUTER_LIDS = (33, 263)
"""Outer corners of the right and the left eye."""
_NOSE_AND_EYES = ([1, 1], [362, 263], [33, 133])
"""Tip of the nose, and corners of the left and the right eye."""
_AT_HEAD = 0.1
"""Mean distance of nose and eyes from the body's, in sides of the face's square, up to which a face is the body's. They
have 0.01 to 0.06 in 250 frames of two signers and of the demo; faces that were followed to a wrong place 0.16 to 0.42.
"""
_SMALLEST = 8
"""Pixels of a square in which a face can be found."""


@dataclass(frozen=True, kw_only=True)
class Face:
    """The face in a square of an image."""

    xy: Float[np.ndarray, "468 2"]
    """Pixels of the image."""
    score: float
    """That there is a face, 0 to 1."""

    @property
    def next_square(self) -> Square:
        """Where to look for the same face."""
        right, left = self.xy[list(_OUTER_LIDS)]
        return _about(self.xy, turn_from(right, left, should_be=0)).scaled(1.5)

    def is_at_head(self, body: Body) -> bool:
        """Whether its nose and eyes lie where the body's are."""
        own = np.stack([self.xy[points].mean(0) for points in _NOSE_AND_EYES])
        apart = np.linalg.norm(own - body.xy[[blaze.NOSE, blaze.LEFT_EYE, blaze.RIGHT_EYE]], axis=1).mean()
        return bool(apart <= _AT_HEAD * self.next_square.side)


class FaceNetwork:
    """Finds the points of a face."""

    def __init__(self, *, threads: int = 1) -> None:
        self._network = Network("face_landmark", threads=threads)

    def find(self, image: Image, squares: Sequence[Square]) -> Face | None:
        """The surest face in some squares of an RGB image; None where no square shows one."""
        squares = [square for square in squares if square.share_inside(image) > 0.3 and square.side > _SMALLEST]
        if not squares:
            return None
        points, logits = self._network(np.stack([picture(image, square, _SIZE) for square in squares]))
        scores = 1 / (1 + np.exp(-np.clip(logits.astype(float).ravel(), -60, 60)))
        best = int(scores.argmax())
        if scores[best] < SURE:
            return None
        xy = points[best].reshape(COUNT, 3)[:, :2].astype(float)
        return Face(xy=squares[best].to_image(xy, _SIZE), score=float(scores[best]))


def square_at_head(body: Body) -> Square:
    """Where the body's eyes, ears, nose and mouth say that a face is: wide."""
    turn = turn_from(body.xy[blaze.RIGHT_EYE], body.xy[blaze.LEFT_EYE], should_be=0)
    return _about(body.xy[: blaze.LEFT_SHOULDER], turn).scaled(3.0)


def square_of_found(found: Found) -> Square:
    """Around a face that the detector has found."""
    return _about(found.points, turn_from(found.points[0], found.points[1], should_be=0)).scaled(2.0, up=0.1)


def _about(points: Float[np.ndarray, "n 2"], angle: float) -> Square:
    return of_box(np.concatenate([points.min(0), points.max(0)]), angle)
