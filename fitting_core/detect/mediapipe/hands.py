"""A hand's 21 points in a square, and the squares in which hands may be.

Zhang et al. 2020 (arXiv:2006.10214). Points are in OpenPose's order: the wrist, then thumb to little finger.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from fitting_core.detect.mediapipe import body as blaze
from fitting_core.detect.mediapipe.body import Body
from fitting_core.detect.mediapipe.networks import Network
from fitting_core.detect.mediapipe.single_shot import Found
from fitting_core.detect.mediapipe.squares import Image, Square, around, of_box, picture, turn_from
from fitting_core.keypoints import Side

COUNT = 21
WRISTS = {"left": blaze.LEFT_WRIST, "right": blaze.RIGHT_WRIST}

_SIZE, _WIDE = 224, 256
_FINGERS = {"left": (blaze.LEFT_PINKY, blaze.LEFT_INDEX), "right": (blaze.RIGHT_PINKY, blaze.RIGHT_INDEX)}
_PALM = [0, 1, 2, 3, 5, 6, 9, 10, 13, 14, 17, 18]
"""Wrist, thumb and the two lowest joints of the fingers, which move little against each other."""
_SMALLEST = 0.14
"""Of the body's square: a hand that points at the camera must not make its own tiny."""
_SAME = 0.15
"""Mean distance of their points, in sides of the square, up to which two are one hand."""
_AGREE = 0.5
"""Ratio of scores from which plain and mirrored picture are averaged; else the better one is taken."""


@dataclass(frozen=True, kw_only=True)
class Hand:
    """The hand in a square of an image."""

    xy: Float[np.ndarray, "21 2"]
    """Pixels of the image."""
    score: float
    """That there is a hand, 0 to 1."""
    right: float
    """How much it looks like a right hand, 0 to 1."""
    square: Square
    """The square of the image."""

    def looks(self, side: Side) -> float:
        """The score, less where it looks like a hand of the other side: then the fingers are often wrong, too."""
        return self.score * (0.5 + 0.5 * (self.right if side == "right" else 1 - self.right))

    @property
    def next_square(self) -> Square:
        """Where to look for the same hand."""
        towards = ((self.xy[5] + self.xy[13]) / 2 + self.xy[9]) / 2
        return around(self.xy[_PALM], turn_from(self.xy[0], towards, should_be=90)).scaled(2.0, up=0.1)


class HandNetwork:
    """Finds the points of hands in squares, and a nearer square in a wide one.

    Args:
        mirrored: Look at each hand mirrored as well, and take the mean.
        threads: Of onnxruntime.
    """

    def __init__(self, *, mirrored: bool, threads: int = 1) -> None:
        self._network = Network("hand_landmark_full", threads=threads)
        self._recrop = Network("hand_recrop", threads=threads)
        self._flips = (False, True) if mirrored else (False,)

    def find(self, image: Image, squares: Sequence[Square], *, least: float) -> list[Hand]:
        """The different hands in some squares of an RGB image with at least a score, each seen from its own square."""
        squares = [square for square in squares if square.share_inside(image) > 0.3]
        first = [hand for hand in self._seen(image, squares, (False,)) if hand.score >= least]
        return self.follow(image, [hand.next_square for hand in different(first)], least=least)

    def follow(self, image: Image, squares: Sequence[Square], *, least: float) -> list[Hand]:
        """The same where squares are hands' own."""
        squares = [square for square in squares if square.share_inside(image) > 0.3]
        found = self._seen(image, squares, self._flips)
        step = len(self._flips)
        hands = [_mean(found[start : start + step]) for start in range(0, len(found), step)]
        return different([hand for hand in hands if hand.score >= least])

    def nearer(self, image: Image, square: Square) -> Square:
        """A square about the hand that a wide one shows."""
        numbers = self._recrop(picture(image, square, _WIDE)[None])[0][0]
        middle, border = square.to_image(numbers.reshape(2, 2).astype(float), _WIDE)
        side, turn = 2 * float(np.linalg.norm(border - middle)), turn_from(middle, border, should_be=-90)
        return Square(float(middle[0]), float(middle[1]), side, turn).scaled(1.0, up=0.1)

    def _seen(self, image: Image, squares: Sequence[Square], flips: tuple[bool, ...]) -> list[Hand]:
        shown = [(square, flip) for square in squares for flip in flips]
        if not shown:
            return []
        points, scores, sides, _ = self._network(
            np.stack([picture(image, square, _SIZE)[:, :: -1 if flip else 1] for square, flip in shown])
        )
        hands = []
        for (square, flip), own, score, right in zip(shown, points, scores.ravel(), sides.ravel(), strict=True):
            xy = own.reshape(COUNT, 3)[:, :2].astype(float)
            xy = np.stack([_SIZE - xy[:, 0], xy[:, 1]], -1) if flip else xy
            is_right = float(1 - right if flip else right)
            hands.append(Hand(xy=square.to_image(xy, _SIZE), score=float(score), right=is_right, square=square))
        return hands


def different(hands: Sequence[Hand]) -> list[Hand]:
    """Of hands in one place only the one of the highest score."""
    kept: list[Hand] = []
    for hand in sorted(hands, key=lambda hand: -hand.score):
        apart = [np.linalg.norm(hand.xy - k.xy, axis=1).mean() / min(hand.square.side, k.square.side) for k in kept]
        if all(distance > _SAME for distance in apart):
            kept.append(hand)
    return kept


def _mean(found: Sequence[Hand]) -> Hand:
    """Of one hand, seen plainly and mirrored."""
    best = max(found, key=lambda hand: hand.score)
    if min(hand.score for hand in found) <= _AGREE * best.score:
        return best
    xy = np.mean([hand.xy for hand in found], 0)
    score, right = (float(np.mean([getattr(hand, name) for hand in found])) for name in ("score", "right"))
    return replace(best, xy=xy, score=score, right=right)


def square_at_wrist(body: Body, side: Side) -> Square:
    """Where the body's wrist and fingers say that a hand is: wide."""
    pinky, index = (body.xy[k] for k in _FINGERS[side])
    wrist, middle = body.xy[WRISTS[side]], (2 * index + pinky) / 3
    turn = turn_from(wrist, middle, should_be=90)
    square = Square(float(middle[0]), float(middle[1]), 2 * float(np.linalg.norm(middle - wrist)), turn)
    return square.scaled(2.7, up=0.1).at_least(_SMALLEST * body.square.side)


def square_of_palm(found: Found) -> Square:
    """Around the hand of a palm."""
    # Moved by half its height, then enlarged, as MediaPipe does it.
    return of_box(found.box, turn_from(found.points[0], found.points[2], should_be=90)).scaled(2.6, up=0.5)
