"""A second look at some frames: for the person, a hand or the face, in a rectangle or where they should be."""

from collections.abc import Callable, Sequence
from typing import get_args

import numpy as np
from jaxtyping import Float

from fitting_core.detect.mediapipe import body as blaze
from fitting_core.detect.mediapipe.body import Body
from fitting_core.detect.mediapipe.detector import MediaPipe
from fitting_core.detect.mediapipe.face import Face, square_at_head
from fitting_core.detect.mediapipe.hands import Hand
from fitting_core.detect.mediapipe.hands_and_face import SeenParts, worth_of
from fitting_core.detect.mediapipe.openpose_points import points_of
from fitting_core.detect.mediapipe.squares import Image, Square, of_box
from fitting_core.errors import InputError
from fitting_core.keypoints import BODY, COUNT, PARTS, SIDES, PartOfPerson, Side
from fitting_core.video.frames import FrameSource

_LEAST_PERSON, _LEAST_BODY, _LEAST_HAND = 0.2, 0.3, 0.05
"""Scores that suffice where the user says that a person or a part is there."""
_AROUND = 1.3
"""How much larger than what is known of a person the square is in which the person is looked for."""


def look_again(
    source: FrameSource,
    frames: Sequence[int],
    *,
    part: PartOfPerson,
    region: tuple[float, float, float, float] | None = None,
    near: Float[np.ndarray, "n 137 3"] | None = None,
    tell: Callable[[int], None] = lambda done: None,
) -> Float[np.ndarray, "n 137 3"]:
    """Search for a person or part again, with lower thresholds because the user says that it is there.

    Args:
        source: Of the frames.
        frames: Their numbers.
        part: What is looked for.
        region: Left, top, right and bottom of the rectangle in which it is; pixels. None: wherever the person is.
        near: What is known of the person in each of the frames, x, y and confidence.
        tell: Is called after each frame with how many are done; what it raises ends the search.

    Returns:
        x, y in pixels and confidence of the part's points; 0 where it was not found, and for all others.

    Raises:
        InputError: There is no such part, the rectangle is empty, or the networks are not on this computer.
    """
    if part not in get_args(PartOfPerson):
        raise InputError(f"part is {part!r}; expected one of {', '.join(get_args(PartOfPerson))}.")
    if region is not None and not (region[2] - region[0] >= 2 and region[3] - region[1] >= 2):
        raise InputError(f"The rectangle {region} is empty; expected left, top, right and bottom in pixels.")
    look = _SecondLook(part, None if region is None else of_box(np.array(region, float)), source.size)
    found = np.zeros((len(frames), COUNT, 3))
    for k, frame in enumerate(frames):
        found[k] = look.at(source.frame(frame), None if near is None else near[k])
        tell(k + 1)
    return found


class _SecondLook:
    def __init__(self, part: PartOfPerson, room: Square | None, size: tuple[int, int]) -> None:
        self._part, self._room, self._size = part, room, size
        self._points = PARTS[part]
        self._detector = MediaPipe("mediapipe", thorough=True)
        self._finder = self._detector.parts_finder

    def at(self, image: Image, near: Float[np.ndarray, "137 3"] | None) -> Float[np.ndarray, "137 3"]:
        """The part's points in a frame."""
        body = self._body(image, near)
        if self._part == "person":
            if body is None:
                return np.zeros((COUNT, 3))
            seen = self._finder.find(image, body, None, 0)
        elif self._part == "face":
            seen = SeenParts(face=self._face(image, body))
        else:
            asked = self._part.removesuffix("_hand")
            seen = SeenParts(hands={s: self._hand(image, body, s) if s == asked else None for s in SIDES})
        points = points_of(body, seen.hands, seen.face, self._size)
        points[: self._points.start] = points[self._points.stop :] = 0
        return points

    def _body(self, image: Image, near: Float[np.ndarray, "137 3"] | None) -> Body | None:
        """The person in the rectangle or near the known keypoints; the most certain one without either."""
        known = None if near is None else near[BODY][near[BODY, 2] > 0.2, :2]
        room = self._room if self._part == "person" else None
        if room is None and known is not None and len(known) > 2:
            room = of_box(np.concatenate([known.min(0), known.max(0)])).scaled(_AROUND)
        squares = self._detector.people_in(image, room, threshold=_LEAST_PERSON)
        squares += [] if room is None else [room]
        found = [self._detector.body_in(image, square) for square in squares]
        found += [self._detector.body_in(image, body.next_square) for body in found if body.score > _LEAST_BODY]
        sure = [body for body in found if body.score > _LEAST_BODY]
        if known is None or len(known) < 3 or self._room is not None:
            return max(sure, key=lambda body: body.score, default=None)
        middle = known.mean(0)
        return min(sure, key=lambda body: np.linalg.norm(body.xy[: blaze.LEFT_KNEE].mean(0) - middle), default=None)

    def _hand(self, image: Image, body: Body | None, side: Side) -> Hand | None:
        if self._room is not None:
            hands = self._finder.hands_in(image, self._room.scaled(_AROUND), least=_LEAST_HAND)
            return max(hands, key=lambda hand: hand.score, default=None)
        if body is None:
            return None
        squares = self._finder.candidates(image, body, side)
        hands = self._finder.hands_at(image, squares, least=_LEAST_HAND)
        best = max(hands, key=lambda hand: worth_of(hand, side, body), default=None)
        return best if best is not None and worth_of(best, side, body) > 0 else None

    def _face(self, image: Image, body: Body | None) -> Face | None:
        if self._room is not None:
            return self._finder.face_in(image, self._room)
        return None if body is None else self._finder.face_in(image, square_at_head(body))
