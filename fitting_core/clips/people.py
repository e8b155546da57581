"""Read a clip of several people: one clip for each of them, of the same camera."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting_core.clip import Clip
from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.clips.reading import Shot, check_inside, read_shot
from fitting_core.detect.found import Tell
from fitting_core.detect.part import Detector
from fitting_core.errors import InputError
from fitting_core.files.regular import StrPath, legible
from fitting_core.io.people_file import LONGEST_NAME, MOST_PEOPLE, People, Person
from fitting_core.keypoints import Keypoints
from fitting_core.people.everybody import FoundPerson, find_all_people
from fitting_core.video.frame_names import spans


@dataclass(frozen=True, kw_only=True)
class PersonInClip:
    """One of the people of a clip, as a clip of their own."""

    about: Person
    """Name, folder, frames and uncertain frames, by number in the video."""
    clip: Clip
    """From the first frame in which the person is found to the last."""
    name: str
    """Of the clip of all of them."""


def read_people(
    video: StrPath | None,
    keypoints: StrPath | None = None,
    *,
    clip: ClipOptions = ClipOptions(),
    camera: CameraOptions = CameraOptions(),
    detector: Detector | None = None,
    tell: Tell | None = None,
) -> list[PersonInClip]:
    """Read everybody's keypoints in a clip, with one camera and one frame rate.

    People are numbered as they appear, those who appear together from left to right. Each clip runs from the first
    frame in which its person is found to the last. If two people may have been swapped, its notes say so. An estimated
    focal length is that of the largest and surest person, for all.

    Args and errors as in `read_clip`; a choice of one person is refused.
    """
    if clip.person is not None:
        raise InputError(f"`person` is {clip.person}; expected none when everybody is read.")
    shot = read_shot(video, keypoints, clip, camera, detector=detector, tell=tell)
    found, omitted = find_all_people(
        shot.detections, frame_rate=shot.frame_rate, first_frame=shot.first_frame, most=MOST_PEOPLE
    )
    of_places = check_inside(_together(found), shot.size)
    seen = shot.camera(max(found, key=lambda one: one.prominence).keypoints)
    people = []
    for number, one in enumerate(found, 1):
        about = _about(one, number, shot)
        notes = (_note(about, one, len(found)), *([omitted] if omitted else []), *of_places)
        whole = shot.clip(one.keypoints, seen, entries=one.entries, notes=notes)
        people.append(PersonInClip(about=about, clip=_part(whole, one.frames, about), name=shot.name))
    return people


def people_of(people: Sequence[PersonInClip]) -> People:
    """The content of people.json for people of one clip."""
    name = "".join(c if c.isprintable() else "?" for c in legible(people[0].name)).strip()[:LONGEST_NAME].strip()
    return People(name=name or "?", people=tuple(one.about for one in people))


def _together(people: list[FoundPerson]) -> Keypoints:
    return Keypoints(
        xy=np.concatenate([one.keypoints.xy for one in people]),
        confidence=np.concatenate([one.keypoints.confidence for one in people]),
    )


def _about(one: FoundPerson, number: int, shot: Shot) -> Person:
    def numbered(frames: range) -> tuple[int, int]:
        return shot.first_frame + frames[0], shot.first_frame + frames[-1]

    return Person(
        name=f"person {number}",
        folder=f"person-{number}",
        frames=numbered(one.frames),
        uncertain=tuple(numbered(frames) for frames in one.uncertain),
    )


def _note(about: Person, one: FoundPerson, count: int) -> str:
    first, last = about.frames
    missing = [
        first + k for k, entry in enumerate(one.entries[slice(one.frames.start, one.frames.stop)]) if entry is None
    ]
    sentences = [f"{about.name.capitalize()} of {count}, in frames {first} to {last}"]
    sentences[0] += f", not found in frames {spans(missing)}." if missing else "."
    if about.uncertain:
        doubtful = [frame for start, end in about.uncertain for frame in range(start, end + 1)]
        sentences.append(
            f"In frames {spans(doubtful, most=20)} this person may have been confused with "
            "another: check that it is the same person before and after."
        )
    return " ".join(sentences)


def _part(clip: Clip, frames: range, about: Person) -> Clip:
    """The frames of one person, under that person's name."""
    part = slice(frames.start, frames.stop)
    return replace(
        clip,
        keypoints=clip.keypoints[part],
        silhouettes=None if clip.silhouettes is None else clip.silhouettes[part],
        camera=clip.camera[part],
        first_frame=clip.first_frame + frames.start,
        name=f"{clip.name} {about.name}",
    )
