"""Choose one person over a clip: follow everybody from frame to frame, and keep the most prominent track."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from fitting_core.errors import InputError
from fitting_core.io.detections import Detections
from fitting_core.keypoints import BODY, COUNT, Keypoints

# Distances are in units of a person's size, the weighted root mean square distance of the keypoints from their centre:
# about a quarter of the body height for somebody upright.
_REACH = 1.0
"""How far the same person's keypoints can lie from one frame to the next, on average."""
_REACH_GROWTH = 0.1
"""What every frame without a detection adds to it."""
_MOST_REACH = 2.5
_COMMON_POINTS = 3
"""With fewer keypoints in common, centres are compared instead."""
_VELOCITY_FRAMES = 5
"""A person who is not seen is taken to move on for so many frames, then to stand still."""
_UNMATCHABLE = 1e6
_RIVAL = 0.7
"""Share of the chosen track's score from which another person is worth a warning."""


@dataclass(frozen=True, kw_only=True)
class PersonChoice:
    """One person's keypoints, and how they were chosen."""

    keypoints: Keypoints
    """Of every frame; where the person was not found, everything has confidence 0."""
    entries: tuple[int | None, ...]
    """Per frame, the person's place in the frame's list of people; None where the person was not found."""
    note: str
    """The choice in words for the user; empty where there was none to make."""


@dataclass(eq=False)
class _Track:
    """One person as followed so far."""

    frame: int
    points: Float[np.ndarray, "K 3"]
    velocity: Float[np.ndarray, "2"] = field(default_factory=lambda: np.zeros(2))
    entries: dict[int, int] = field(default_factory=dict)
    score: float = 0.0

    def predicted(self, frame: int) -> Float[np.ndarray, "K 3"]:
        """Where the person's keypoints should be, moving on as before."""
        moved = self.points.copy()
        moved[:, :2] += self.velocity * min(frame - self.frame, _VELOCITY_FRAMES)
        return moved

    def add(self, frame: int, entry: int, points: Float[np.ndarray, "K 3"]) -> None:
        """Take a frame's detection as this person's."""
        if self.entries:
            step = _offset(points, self.points) / (frame - self.frame)
            self.velocity = 0.5 * self.velocity + 0.5 * step
        self.frame, self.points = frame, points
        self.entries[frame] = entry
        self.score += _prominence(points)


def choose_person(detections: Detections, *, person: int | None = None) -> PersonChoice:
    """Choose one person over the clip.

    Without an option, everybody is followed from frame to frame by the distances between keypoints relative to the
    person's size (one-to-one assignment of least total distance), also through frames without a detection; the track
    with the largest sum of size times mean confidence is taken. Nobody else fills its gaps.

    Args:
        detections: In pixels.
        person: Take this entry (from 0) of every frame's list of people instead.

    Raises:
        InputError: No detection in the whole clip, or no frame with so many people.
    """
    if not len(detections.detected_points()):
        raise InputError(
            f"No keypoint is detected in any of the {len(detections)} frames of {detections.source}. "
            "Check that the detector ran on the right video, and lower its threshold if it did."
        )
    if person is not None:
        return _nth_entry(detections, person)
    tracks = sorted(_follow(detections), key=lambda track: track.score, reverse=True)
    entries = tuple(tracks[0].entries.get(t) for t in range(len(detections)))
    return PersonChoice(keypoints=_keypoints(detections, entries), entries=entries, note=_describe(detections, tracks))


def _nth_entry(detections: Detections, person: int) -> PersonChoice:
    if not 0 <= person < detections.most_people:
        raise InputError(
            f"person={person}, but no frame of {detections.source} has more than {detections.most_people} people; "
            f"expected 0 to {detections.most_people - 1}. Leave the option out to have the person followed."
        )
    entries = tuple(person if person < len(people) else None for people in detections.frames)
    keypoints = _keypoints(detections, entries)
    found = sum(entry is not None for entry in entries)
    note = f"Person: entry {person} of each frame's list, as asked; {found} of {len(entries)} frames have it."
    return PersonChoice(keypoints=keypoints, entries=entries, note=note)


def _keypoints(detections: Detections, entries: tuple[int | None, ...]) -> Keypoints:
    points = np.zeros((len(entries), COUNT, 3))
    for t, entry in enumerate(entries):
        if entry is not None:
            points[t] = detections.frames[t][entry]
    return Keypoints(xy=points[..., :2], confidence=points[..., 2])


def _follow(detections: Detections) -> list[_Track]:
    tracks: list[_Track] = []
    for t, people in enumerate(detections.frames):
        seen = [(entry, points) for entry, points in enumerate(people) if (points[:, 2] > 0).any()]
        matches = _match(tracks, [points for _, points in seen], t)
        for k, (entry, points) in enumerate(seen):
            if k not in matches:
                tracks.append(_Track(frame=t, points=points))
            (tracks[matches[k]] if k in matches else tracks[-1]).add(t, entry, points)
    return tracks


def _match(tracks: list[_Track], people: list[np.ndarray], frame: int) -> dict[int, int]:
    """By the place in people: the place in tracks of the same person."""
    if not tracks or not people:
        return {}
    cost = np.full((len(people), len(tracks)), _UNMATCHABLE)
    for j, track in enumerate(tracks):
        reach = min(_REACH + _REACH_GROWTH * (frame - track.frame - 1), _MOST_REACH)
        predicted = track.predicted(frame)
        for i, points in enumerate(people):
            distance = _distance(points, predicted)
            if distance <= reach:
                cost[i, j] = distance
    rows, columns = linear_sum_assignment(cost)
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if cost[i, j] < _UNMATCHABLE}


def _body(points: Float[np.ndarray, "137 3"]) -> Float[np.ndarray, "K 3"]:
    """The body's points, or all where only hands or face were detected: 112 of 137 would outvote the body."""
    return points[BODY] if (points[BODY, 2] > 0).any() else points


def _centre(points: Float[np.ndarray, "K 3"]) -> Float[np.ndarray, "2"]:
    return np.average(points[:, :2], axis=0, weights=points[:, 2])


def _size(points: Float[np.ndarray, "137 3"]) -> float:
    body = _body(points)
    squares = ((body[:, :2] - _centre(body)) ** 2).sum(1)
    return float(np.sqrt(np.average(squares, weights=body[:, 2])))


def _prominence(points: Float[np.ndarray, "137 3"]) -> float:
    return _size(points) * float(_body(points)[:, 2].mean())


def _common(a: np.ndarray, b: np.ndarray) -> np.ndarray | None:
    """Weights of the body points that both have, None if those are too few."""
    weights = np.sqrt(a[BODY, 2] * b[BODY, 2])
    return weights if (weights > 0).sum() >= _COMMON_POINTS else None


def _offset(a: np.ndarray, b: np.ndarray) -> Float[np.ndarray, "2"]:
    """From b to a; (0, 0) where they have too little in common to say."""
    weights = _common(a, b)
    return np.zeros(2) if weights is None else np.average(a[BODY, :2] - b[BODY, :2], axis=0, weights=weights)


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    """Mean distance of common keypoints, in sizes of the larger of the two."""
    size = max(_size(a), _size(b), 1e-9)
    weights = _common(a, b)
    if weights is None:
        return float(np.linalg.norm(_centre(_body(a)) - _centre(_body(b)))) / size
    return float(np.average(np.linalg.norm(a[BODY, :2] - b[BODY, :2], axis=1), weights=weights)) / size


def _describe(detections: Detections, tracks: list[_Track]) -> str:
    chosen, others = tracks[0], tracks[1:]
    missing = [t for t in range(len(detections)) if t not in chosen.entries]
    if not others and not missing:
        return ""
    found = f"Person: found in {len(chosen.entries)} of {len(detections)} frames"
    sentences = [f"{found}, not in frames {spans(missing)}." if missing else f"{found}."]
    if others:
        frames = {t for track in others for t in track.entries}
        sentences.append(
            f"The largest and surest of {len(tracks)} people (or false detections) was taken; the others appear in "
            f"{len(frames)} frames ({spans(sorted(frames))})."
        )
    if others and others[0].score > _RIVAL * chosen.score:
        place = next(iter(others[0].entries.values()))
        sentences.append(
            f"Another person is nearly as prominent, from frame {min(others[0].entries)} on at place {place} of the "
            f"list: use person={place} if that is who you want."
        )
    return " ".join(sentences)


def spans(frames: list[int], most: int = 5) -> str:
    """Ascending frame numbers in words: ``3, 7-12``; after ``most`` spans, how many follow."""
    starts = [k for k, t in enumerate(frames) if k == 0 or t != frames[k - 1] + 1]
    ends = [*(k - 1 for k in starts[1:]), len(frames) - 1]
    words = [str(frames[a]) if a == b else f"{frames[a]}-{frames[b]}" for a, b in zip(starts, ends, strict=True)]
    return ", ".join(words[:most]) + (f" and {len(words) - most} more" if len(words) > most else "")
