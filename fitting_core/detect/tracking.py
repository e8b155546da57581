"""One person's box through a clip: from what a box model found, or from the points of the frame before."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from fitting_core.detect import simcc
from fitting_core.detect.boxes import Boxes, intersection_over_union
from fitting_core.errors import InputError
from fitting_core.video import tracks
from fitting_core.video.frame_names import spans
from fitting_core.video.tracks import Track

MOST_MISSED = 30
"""Frames without a box that are bridged, a second of most videos; the person is not there in longer gaps."""
_OVERLAP = 0.3
"""Of boxes in consecutive frames, from which they surely are of the same person."""
_REACH, _REACH_GROWTH, _MOST_REACH = 0.5, 0.05, 1.5
"""How far a box without such an overlap can have gone, in sizes of the person: at once, more for each frame without it,
and at most."""
_ALIKE = 2.0
"""Ratio of the sizes of two boxes beyond which they are of different people."""
_RIVAL = 0.7
"""Share of the person's score from which another one is worth a warning."""
SURE = 0.3
"""Points of lower confidence say nothing about where the person is."""
_FEWEST_SURE = 6
"""With fewer sure points a person is lost, and looked for in the whole frame again."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """A box, with its score."""

    corners: Float[np.ndarray, "4"]
    score: float

    @property
    def prominence(self) -> float:
        """Size times score."""
        return _extent(self.corners) * self.score


_Track = Track[_Seen]


def follow(found: Sequence[Boxes], *, person: int = 0, first_frame: int = 0) -> tuple[Float[np.ndarray, "T 4"], str]:
    """One person's box in each frame, and a note for the user.

    Everybody is followed from frame to frame: first the boxes that overlap most, then those near where a person went
    out of sight. Gaps of up to MOST_MISSED frames are filled in between; a frame without the person has a box of NaN.

    Args:
        found: Of each frame.
        person: 0 for the most prominent, whose sum of size times score is the largest; 1 for the next.
        first_frame: Number of the first frame, for the note.

    Raises:
        InputError: There are not so many people.
    """
    assert person >= 0
    boxes = np.full((len(found), 4), np.nan)
    people = tracks.follow([_seen(those) for those in found], prices=_prices, offset=_offset)
    if not people:
        return boxes, "Nobody was found in any frame."
    if person >= len(people):
        raise InputError(f"person={person}, but there are only {len(people)} people; expected 0 to {len(people) - 1}.")
    for frame, seen in people[person].sightings.items():
        boxes[frame] = seen.corners
    boxes = bridged(boxes)
    return boxes, _note(people, person, [first_frame + int(t) for t in np.flatnonzero(np.isnan(boxes[:, 0]))])


def _seen(boxes: Boxes) -> list[_Seen]:
    return [
        _Seen(corners=corners, score=float(score)) for corners, score in zip(boxes.corners, boxes.scores, strict=True)
    ]


def _offset(before: _Seen, after: _Seen) -> Float[np.ndarray, "2"]:
    return _centre(after.corners) - _centre(before.corners)


def _prices(people: Sequence[_Seen], followed: Sequence[_Track], frame: int) -> Float[np.ndarray, "P T"]:
    return np.array([[_price(track, seen.corners, frame) for track in followed] for seen in people])


def _price(track: _Track, box: Float[np.ndarray, "4"], frame: int) -> float:
    """How unlikely it is that a box continues a track, 0 to 1 where they overlap; infinite: it does not."""
    before = track.seen.corners
    expected, gap = before + np.tile(track.shift(frame), 2), frame - track.frame - 1
    overlap = float(intersection_over_union(expected, box[None])[0])
    if gap == 0 and overlap >= _OVERLAP:
        return 1 - overlap
    sizes = sorted((_extent(before), _extent(box)))
    distance = float(np.linalg.norm(_centre(box) - _centre(expected))) / sizes[1]
    reach = min(_REACH + _REACH_GROWTH * gap, _MOST_REACH)
    continued = distance <= reach and sizes[1] <= _ALIKE * sizes[0]
    return 1 + distance + _REACH_GROWTH * gap if continued else np.inf


def _centre(box: Float[np.ndarray, "4"]) -> Float[np.ndarray, "2"]:
    return (box[:2] + box[2:]) / 2


def _extent(box: Float[np.ndarray, "4"]) -> float:
    """Half the diagonal, which changes less than width and height do when somebody moves."""
    return float(np.linalg.norm(box[2:] - box[:2])) / 2


def _note(people: list[_Track], person: int, missing: list[int]) -> str:
    sentences = []
    if missing:
        sentences.append(f"The person was not found in {len(missing)} frames: {spans(missing)}.")
    others = [track for k, track in enumerate(people) if k != person]
    if person == 0 and others and others[0].score > _RIVAL * people[0].score:
        sentences.append("Another person is nearly as prominent: person=1 follows that one.")
    return " ".join(sentences)


def bridged(boxes: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T 4"]:
    """Boxes with short gaps filled in between their ends."""
    there = np.flatnonzero(np.isfinite(boxes[:, 0]))
    boxes = boxes.copy()
    for start, end in pairwise(there):
        if 1 < end - start <= MOST_MISSED + 1:
            shares = np.arange(1, end - start)[:, None] / (end - start)
            boxes[start + 1 : end] = (1 - shares) * boxes[start] + shares * boxes[end]
    return boxes


def box_around(
    points: Float[np.ndarray, "133 3"], highest: float, size: tuple[int, int]
) -> Float[np.ndarray, "4"] | None:
    """The box in which to look for a person in the next frame; None if the person is lost.

    Args:
        points: Of this frame, as `SimCC.points` gives them.
        highest: Height of the highest peak of a point in all frames so far.
        size: Of the image.
    """
    confidence = simcc.confidence(points[:, 2], highest=max(highest, points[:, 2].max()))
    inside = ((points[:, :2] >= 0) & (points[:, :2] < size)).all(1)
    sure = points[(confidence >= SURE) & inside, :2]
    if len(sure) < _FEWEST_SURE:
        return None
    box = np.concatenate([sure.min(0), sure.max(0)])
    return box if (box[2:] - box[:2] > 1).all() else None


def whole(size: tuple[int, int]) -> Float[np.ndarray, "4"]:
    """The image as a box."""
    return np.array([0.0, 0.0, size[0], size[1]])
