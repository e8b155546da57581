"""One person's box through a clip: from what a box model found, or from the points of the frame before."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from fitting_core.detect import simcc
from fitting_core.detect.boxes import Boxes, intersection_over_union
from fitting_core.errors import InputError
from fitting_core.video.frame_names import spans

MOST_MISSED = 30
"""Frames without a box that are bridged, a second of most videos; the person is not there in longer gaps."""
_OVERLAP = 0.3
"""Of boxes in consecutive frames, from which they surely are of the same person."""
_REACH, _REACH_GROWTH, _MOST_REACH = 0.5, 0.05, 1.5
"""How far a box without such an overlap can have gone, in sizes of the person: at once, more for each frame without it,
and at most."""
_ALIKE = 2.0
"""Ratio of the sizes of two boxes beyond which they are of different people."""
_VELOCITY_FRAMES = 5
"""A person who is not seen is taken to move on for so many frames, then to stand still."""
_RIVAL = 0.7
"""Share of the person's score from which another one is worth a warning."""
SURE = 0.3
"""Points of lower confidence say nothing about where the person is."""
_FEWEST_SURE = 6
"""With fewer sure points a person is lost, and looked for in the whole frame again."""


@dataclass(eq=False)
class _Track:
    """One person as followed so far."""

    frame: int
    box: Float[np.ndarray, "4"]
    velocity: Float[np.ndarray, "2"] = field(default_factory=lambda: np.zeros(2))
    boxes: dict[int, Float[np.ndarray, "4"]] = field(default_factory=dict)
    score: float = 0.0

    def expected(self, frame: int) -> Float[np.ndarray, "4"]:
        """Where the box should be by then, moving on as before."""
        return self.box + np.tile(self.velocity * min(frame - self.frame, _VELOCITY_FRAMES), 2)

    def add(self, frame: int, box: Float[np.ndarray, "4"], score: float) -> None:
        """Take a frame's box as this person's."""
        if self.boxes:
            self.velocity = 0.5 * (self.velocity + (_centre(box) - _centre(self.box)) / (frame - self.frame))
        self.frame, self.box = frame, box
        self.boxes[frame] = box
        self.score += _extent(box) * score


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
    tracks = sorted(_tracks(found), key=lambda track: track.score, reverse=True)
    if not tracks:
        return boxes, "Nobody was found in any frame."
    if person >= len(tracks):
        raise InputError(f"person={person}, but there are only {len(tracks)} people; expected 0 to {len(tracks) - 1}.")
    for frame, box in tracks[person].boxes.items():
        boxes[frame] = box
    boxes = bridged(boxes)
    return boxes, _note(tracks, person, [first_frame + int(t) for t in np.flatnonzero(np.isnan(boxes[:, 0]))])


def _tracks(found: Sequence[Boxes]) -> list[_Track]:
    tracks: list[_Track] = []
    for t, boxes in enumerate(found):
        matches = _match(tracks, boxes, t)
        for k in range(len(boxes)):
            if k not in matches:
                tracks.append(_Track(frame=t, box=boxes.corners[k]))
            (tracks[matches[k]] if k in matches else tracks[-1]).add(t, boxes.corners[k], float(boxes.scores[k]))
    return tracks


def _match(tracks: list[_Track], boxes: Boxes, frame: int) -> dict[int, int]:
    """By the place of a box: the place of the track that it continues. The surest match comes first, and stays.

    Not the assignment of least total distance: a false box beside a person took over that person's track there, and
    the person went to an old one, as this made two matches out of one.
    """
    pairs = [
        (price, k, i)
        for i, track in enumerate(tracks)
        for k in range(len(boxes))
        if (price := _price(track, boxes.corners[k], frame)) is not None
    ]
    matches: dict[int, int] = {}
    for _, k, i in sorted(pairs):
        if k not in matches and i not in matches.values():
            matches[k] = i
    return matches


def _price(track: _Track, box: Float[np.ndarray, "4"], frame: int) -> float | None:
    """How unlikely it is that a box continues a track, 0 to 1 where they overlap; None: it does not."""
    expected, gap = track.expected(frame), frame - track.frame - 1
    overlap = float(intersection_over_union(expected, box[None])[0])
    if gap == 0 and overlap >= _OVERLAP:
        return 1 - overlap
    sizes = sorted((_extent(track.box), _extent(box)))
    distance = float(np.linalg.norm(_centre(box) - _centre(expected))) / sizes[1]
    reach = min(_REACH + _REACH_GROWTH * gap, _MOST_REACH)
    return 1 + distance + _REACH_GROWTH * gap if distance <= reach and sizes[1] <= _ALIKE * sizes[0] else None


def _centre(box: Float[np.ndarray, "4"]) -> Float[np.ndarray, "2"]:
    return (box[:2] + box[2:]) / 2


def _extent(box: Float[np.ndarray, "4"]) -> float:
    """Half the diagonal, which changes less than width and height do when somebody moves."""
    return float(np.linalg.norm(box[2:] - box[:2])) / 2


def _note(tracks: list[_Track], person: int, missing: list[int]) -> str:
    sentences = []
    if missing:
        sentences.append(f"The person was not found in {len(missing)} frames: {spans(missing)}.")
    others = [track for k, track in enumerate(tracks) if k != person]
    if person == 0 and others and others[0].score > _RIVAL * tracks[0].score:
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
        points: Of this frame, as `PoseModel.points` gives them.
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
