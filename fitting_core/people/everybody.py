"""All people of a clip, each with their keypoints and the frames in which their identity is uncertain."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting_core.detections import Detections
from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.people.following import Sighting, Track, apart, sightings, tracks_of
from fitting_core.people.returning import FollowedPerson, rejoined
from fitting_core.video.frame_names import runs, spans

_MOST = 100
"""Maximum number of people tracked in a frame: the largest and surest."""
_SAME = 0.2
"""In sizes: two detections nearer to each other than this are of one person."""
_SHORTEST_SECONDS, _SHORTEST_FRAMES = 0.25, 5
"""Anything seen for less at a stretch is a false detection."""
_BETWEEN = 0.2
"""Seconds: uncertain frames nearer to each other are one stretch."""


@dataclass(frozen=True, kw_only=True)
class FoundPerson:
    """One of the people of a clip."""

    keypoints: Keypoints
    """For every frame of the clip; confidence 0 everywhere where the person was not found."""
    entries: tuple[int | None, ...]
    """Per frame, the person's index in the frame's list of people; None if not found."""
    uncertain: tuple[range, ...]
    """Stretches of frames after which this may be another person, counted from the clip's first as 0."""

    prominence: float
    """Sum of size times confidence over all frames."""

    @property
    def frames(self) -> range:
        """From the first frame in which the person was found to the last, counted from the clip's first as 0."""
        found = [t for t, entry in enumerate(self.entries) if entry is not None]
        return range(found[0], found[-1] + 1)


def find_all_people(
    detections: Detections, *, frame_rate: float, first_frame: int = 0, most: int = _MOST
) -> tuple[list[FoundPerson], str]:
    """All people of a clip, in the order in which they appear, those who appear together from left to right; and a note
    for the user on omitted detections. Raises InputError if no person is visible for a quarter of a second.

    Args:
        detections: In pixels.
        frame_rate: Frames per second.
        first_frame: Number of the first frame, for the note.
        most: Most people to keep: the largest and surest over the clip.
    """
    tracked = track(detections, frame_rate)
    crowded = [first_frame + t for t, frame in enumerate(detections.frames) if len(frame) > _MOST]
    shortest = _shortest(frame_rate)
    if not tracked.people:
        raise InputError(
            f"Nobody is found for {shortest} frames in {detections.source}, which is the shortest that counts. "
            "Check that the detector ran on the right video, and lower its threshold if it did."
        )
    everybody = tracked.people
    people = sorted(everybody[:most], key=lambda person: _order(person, frame_rate))
    short = sorted({first_frame + t for one in tracked.short for t in one.sightings})
    notes = []
    if short:
        notes.append(
            f"Anybody seen for fewer than {shortest} frames at a stretch was left out as a false detection, in "
            f"frames {spans(short)}."
        )
    if crowded:
        notes.append(f"In frames {spans(crowded)} more than {_MOST} people are detected; the largest were followed.")
    if len(everybody) > most:
        notes.append(f"{len(everybody)} people are found; the {most} largest and surest were taken.")
    return [found_person(person, detections, tracked, frame_rate) for person in people], " ".join(notes)


@dataclass(frozen=True, kw_only=True)
class Tracked:
    """People as tracked through a clip."""

    people: list[FollowedPerson]
    """Those visible long enough, the most prominent first."""
    short: list[Track]
    """Tracks that are too short, probably false detections."""
    frame_rate: float

    @property
    def everyone(self) -> list[FollowedPerson]:
        """With the short tracks, last. In a clip with nothing longer, they are joined like people who return."""
        short = [FollowedPerson([one]) for one in self.short] if self.people else rejoined(self.short, self.frame_rate)
        return [*self.people, *sorted(short, key=lambda one: -one.prominence)]


def track(detections: Detections, frame_rate: float) -> Tracked:
    """Track all people of a clip, from frame to frame and through absences.

    Args:
        detections: In pixels.
        frame_rate: Frames per second.
    """
    seen = [sorted(sightings(frame), key=lambda one: -one.prominence)[:_MOST] for frame in detections.frames]
    followed = tracks_of([without_doubles(people) for people in seen], frame_rate)
    long = [one for one in followed if len(one.sightings) >= _shortest(frame_rate)]
    people = sorted(rejoined(long, frame_rate), key=lambda person: -person.prominence)
    short = [one for one in followed if len(one.sightings) < _shortest(frame_rate)]
    return Tracked(people=people, short=short, frame_rate=frame_rate)


def _shortest(frame_rate: float) -> int:
    return max(_SHORTEST_FRAMES, round(_SHORTEST_SECONDS * frame_rate))


def without_doubles(people: Sequence[Sighting]) -> list[Sighting]:
    """People of one frame, with only the surest detection of each.

    Args:
        people: The largest and surest first.
    """
    if len(people) < 2:
        return list(people)
    far, _ = apart(people, people, np.zeros((len(people), 2)))
    kept: list[int] = []
    for k in range(len(people)):
        if all(far[k, other] > _SAME for other in kept):
            kept.append(k)
    return [people[k] for k in kept]


def _order(person: FollowedPerson, frame_rate: float) -> tuple[int, float]:
    """By time of appearance, to a quarter of a second; then from left to right."""
    first = person.parts[0].first
    return int(first / max(_SHORTEST_SECONDS * frame_rate, 1)), float(person.parts[0].sightings[first].centre[0])


def found_person(person: FollowedPerson, detections: Detections, tracked: Tracked, frame_rate: float) -> FoundPerson:
    """A tracked person's keypoints, and where the tracking is uncertain.

    Args:
        person: One of `tracked`.
        detections: Of the clip.
        tracked: All people of the clip.
        frame_rate: Frames per second.
    """
    entries: list[int | None] = [None] * len(detections)
    points = np.zeros((len(detections), COUNT, 3))
    for t, seen in person.sightings.items():
        entries[t] = seen.entry
        points[t] = detections.frames[t][seen.entry]
    kept = frozenset(part for one in tracked.people for part in one.parts)
    return FoundPerson(
        keypoints=Keypoints(xy=points[..., :2], confidence=points[..., 2]),
        entries=tuple(entries),
        uncertain=_uncertain(person, kept, frame_rate),
        prominence=person.prominence,
    )


def _uncertain(person: FollowedPerson, kept: frozenset[Track], frame_rate: float) -> tuple[range, ...]:
    """Frames after which it could be another person: near others, and across absences."""
    frames: set[int] = set()
    own = set(person.parts)
    for part in person.parts:
        for other, doubtful in part.doubts.items():
            if other in kept and other not in own:
                frames |= doubtful
    for before, after in zip(person.parts, person.parts[1:], strict=False):
        frames |= set(range(before.last, after.first + 1))
    bridged = set(frames)
    for one, two in zip(sorted(frames), sorted(frames)[1:], strict=False):
        if two - one <= max(_BETWEEN * frame_rate, 1):
            bridged |= set(range(one, two))
    first, last = person.parts[0].first, person.last
    return tuple(runs(t for t in sorted(bridged) if first <= t <= last))
