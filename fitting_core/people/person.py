"""Choose one person of a clip: track all people, and take the most prominent one."""

import numpy as np

from fitting_core.detections import Detections
from fitting_core.errors import InputError
from fitting_core.people.everybody import FoundPerson, found_person, track
from fitting_core.people.following import Sighting, apart
from fitting_core.people.returning import FollowedPerson
from fitting_core.video.frame_names import spans

_RIVAL = 0.7
"""Fraction of the chosen person's prominence above which another person is worth a warning."""


def choose_person(
    detections: Detections,
    *,
    person: int | None = None,
    seen: tuple[int, int] | None = None,
    first_frame: int = 0,
    frame_rate: float = 30.0,
) -> tuple[FoundPerson, str]:
    """One person over the clip, and the choice in words; empty if there was none to make.

    All people are tracked as in `find_all_people`. Without an option, the one with the largest sum of size times mean
    confidence is taken; others do not fill the gaps. Frames in which the person may be confused with another are noted.
    Raises InputError if there is no detection in the whole clip, or no frame with enough people.

    Args:
        detections: In pixels.
        person: Take the person with this index (from 0) in the first frame with enough people. Detectors do not keep
            their order, so others can have this index in other frames.
        seen: Take the person at an index (from 0) in the list of people of one of these frames.
        first_frame: Number of the first frame, for the note.
        frame_rate: Frames per second.
    """
    if not len(detections.detected_points()):
        raise InputError(
            f"No keypoint is detected in any of the {len(detections)} frames of {detections.source}. "
            "Check that the detector ran on the right video, and lower its threshold if it did."
        )
    tracked = track(detections, frame_rate)
    people = tracked.everyone
    if person is not None:
        start = _asked(detections, person)
        chosen = _at(people, detections, start, person)
        note = _describe_asked(chosen, len(detections), first_frame, person, start)
    elif seen is not None:
        chosen = _at(people, detections, *seen)
        note = f"Person: {_frames_found(chosen, len(detections), first_frame)}"
    else:
        chosen, note = people[0], _describe(people, detections, first_frame)
    found = found_person(chosen, detections, tracked, frame_rate)
    if len(people) > 1 and found.uncertain:
        frames = spans([first_frame + t for doubt in found.uncertain for t in doubt])
        note += f" Over frames {frames} the person may be confused with another: check that it is the same one."
    return found, note


def _at(people: list[FollowedPerson], detections: Detections, frame: int, entry: int) -> FollowedPerson:
    """The person with this index in a frame's list, or the nearest one if it is a second detection of a person."""
    seen = Sighting.of(entry, detections.frames[frame][entry])
    there = [one for one in people if frame in one.sightings]
    distances, _ = apart([seen], [one.sightings[frame] for one in there], np.zeros((len(there), 2)))
    return there[int(np.argmin(distances[0]))]


def _asked(detections: Detections, person: int) -> int:
    """The first frame with a person at the index that an option selects."""
    most = detections.most_people
    if not 0 <= person < most:
        people, expected = ("one person", "0") if most == 1 else (f"{most} people", f"0 to {most - 1}")
        raise InputError(
            f"person={person}, but no frame of {detections.source} has more than {people}; expected {expected}. Leave "
            "the option out to have the person followed."
        )
    start = _first_with(detections, person)
    if start is None:
        raise InputError(f"person={person} has no detected keypoint in any frame of {detections.source}.")
    return start


def _first_with(detections: Detections, place: int) -> int | None:
    """The first frame whose list has this index."""
    frames = enumerate(detections.frames)
    return next((t for t, people in frames if place < len(people) and (people[place, :, 2] > 0).any()), None)


def _frames_found(one: FollowedPerson, count: int, first_frame: int) -> str:
    missing = [first_frame + t for t in range(count) if t not in one.sightings]
    found = f"found in {len(one.sightings)} of {count} frames"
    return f"{found}, not in frames {spans(missing)}." if missing else f"{found}."


def _describe_asked(one: FollowedPerson, count: int, first_frame: int, person: int, start: int) -> str:
    asked = f"Person: the one at place {person} of the list of frame {first_frame + start}, as asked"
    elsewhere = sorted(first_frame + t for t, seen in one.sightings.items() if seen.entry != person)
    moved = f" In frames {spans(elsewhere)} the same person has another place." if elsewhere else ""
    return f"{asked}; {_frames_found(one, count, first_frame)}{moved}"


def _describe(people: list[FollowedPerson], detections: Detections, first_frame: int) -> str:
    chosen, others, count = people[0], people[1:], len(detections)
    if not others and len(chosen.sightings) == count:
        return ""
    sentences = [f"Person: {_frames_found(chosen, count, first_frame)}"]
    if others:
        frames = sorted({first_frame + t for one in others for t in one.sightings})
        sentences.append(
            f"The largest and surest of {len(people)} people (or false detections) was taken; the others appear in "
            f"frames {spans(frames)}."
        )
    if others and others[0].prominence > _RIVAL * chosen.prominence:
        start, seen = next(iter(others[0].sightings.items()))
        # If another person had that index before, the clip must begin later for it to mean this person.
        cut = "" if _first_with(detections, seen.entry) == start else f"first_frame={first_frame + start} and "
        sentences.append(
            f"Another person is nearly as prominent, in frame {first_frame + start} at place {seen.entry} of the list: "
            f"use {cut}person={seen.entry} if that is who you want."
        )
    return " ".join(sentences)
