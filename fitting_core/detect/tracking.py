"""One person's box through a clip: from what a box model found, or from the points of the frame before."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fitting_core.detect import simcc
from fitting_core.detect.boxes import Boxes
from fitting_core.errors import InputError
from fitting_core.io.detections import Detections
from fitting_core.io.person import choose_person
from fitting_core.keypoints import COUNT

MOST_MISSED = 15
"""Frames without a box that are bridged, half a second of most videos; the person is not there in longer gaps."""
SURE = 0.3
"""Points of lower confidence say nothing about where the person is."""
_FEWEST_SURE = 6
"""With fewer sure points a person is lost, and looked for in the whole frame again."""
_CORNERS = ((0, 1), (2, 1), (2, 3), (0, 3))
"""Places in a box of the x and y of its corners."""


def follow(found: Sequence[Boxes], *, person: int = 0, first_frame: int = 0) -> tuple[Float[np.ndarray, "T 4"], str]:
    """One person's box in each frame, and a note for the user.

    People are followed by the distances of their boxes' corners relative to their size, as `io.person.choose_person`
    follows keypoints, through gaps too. Gaps of up to MOST_MISSED frames are filled in between; a frame without the
    person has a box of NaN.

    Args:
        found: Of each frame.
        person: 0 for the most prominent, whose sum of size times score is the largest; 1 for the next.
        first_frame: Number of the first frame, for the note.

    Raises:
        InputError: There are not so many people.
    """
    assert person >= 0
    frames = [_as_people(boxes) for boxes in found]
    boxes, note = np.full((len(found), 4), np.nan), ""
    for rank in range(person + 1):
        if not any(people.any() for people in frames):
            if rank == 0:
                return boxes, "Nobody was found in any frame."
            raise InputError(f"person={person}, but there are only {rank} people; expected 0 to {rank - 1}.")
        stems = tuple(str(first_frame + t) for t in range(len(found)))
        everybody = Detections(frames=tuple(frames), stems=stems, source=Path("video"))
        choice = choose_person(everybody, first_frame=first_frame)
        boxes[:] = np.nan
        for t, entry in enumerate(choice.entries):
            if entry is not None:
                boxes[t] = found[t].corners[entry]
                frames[t] = frames[t].copy()
                frames[t][entry] = 0.0
        note = choice.note
    rival, _, advised = note.partition("Another person is nearly as prominent")
    return bridged(boxes), rival.strip() + (f" Another is nearly as prominent: person={person + 1}." if advised else "")


def _as_people(boxes: Boxes) -> Float[np.ndarray, "n 137 3"]:
    """Boxes as if their corners were keypoints."""
    people = np.zeros((len(boxes), COUNT, 3))
    for joint, corner in enumerate(_CORNERS):
        people[:, joint, :2] = boxes.corners[:, list(corner)]
        people[:, joint, 2] = boxes.scores
    return people


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
    points: Float[np.ndarray, "133 3"], heights: Float[np.ndarray, "*n"], size: tuple[int, int]
) -> Float[np.ndarray, "4"] | None:
    """The box in which to look for a person in the next frame; None if the person is lost.

    Args:
        points: Of this frame, as `PoseModel.points` gives them.
        heights: Of the points' peaks in all frames so far.
        size: Of the image.
    """
    confidence = simcc.confidence(np.append(heights, points[:, 2]))[-len(points) :]
    inside = ((points[:, :2] >= 0) & (points[:, :2] < size)).all(1)
    sure = points[(confidence >= SURE) & inside, :2]
    if len(sure) < _FEWEST_SURE:
        return None
    box = np.concatenate([sure.min(0), sure.max(0)])
    return box if (box[2:] - box[:2] > 1).all() else None


def whole(size: tuple[int, int]) -> Float[np.ndarray, "4"]:
    """The image as a box."""
    return np.array([0.0, 0.0, size[0], size[1]])
