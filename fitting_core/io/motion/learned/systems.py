"""Results of learned systems: which system wrote a file, which of its people to take, and their motion.

Each system is a line in `SYSTEMS`. The first that recognises the content reads it.
"""

import lzma
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fitting_core.errors import InputError, some_of
from fitting_core.files.regular import refusal
from fitting_core.files.torch_pickles import plain
from fitting_core.io.motion.imported_motion import ImportedMotion, PersonTrack, body_params
from fitting_core.io.motion.learned import per_image, whole_image
from fitting_core.io.motion.learned.opening import opened_result
from fitting_core.io.motion.learned.tracks import System, SystemMotion, is_mapping_with

SYSTEMS: tuple[System, ...] = (*whole_image.SYSTEMS, *per_image.SYSTEMS)
_FILES = ("hmr4d_results.pt", "wham_output.pkl", "results.pkl")
"""The systems' names for their results in the folder of a video."""
_SMPLIFYX = re.compile(r"\d+\.pkl")
_SMPLIFYX_KEYS = ("global_orient", "body_pose", "camera_translation")
_DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, EOFError, OSError, MemoryError),
    *(RuntimeError, NotImplementedError, ValueError, OverflowError),
)
"""Raised by zipfile and the others for malformed bytes."""
_MAX_SHOWN = 5


def people_in(path: Path) -> tuple[PersonTrack, ...]:
    """The people in a learned system's result, to choose one from; empty if it is not such a result. Raises InputError
    if it is damaged, or refers to what could run code."""
    with _checked(path), _content(path) as content:
        system = _system_of(content)
        return () if system is None else _people(system, content)


def read_learned(path: Path, *, person: int | None = None, gender: str | None = None) -> ImportedMotion | None:
    """Read a learned system's result; None if it is not one. Raises InputError if it is damaged, refers to what could
    run code, or lacks what the system writes.

    Args:
        path: Its file, or the folder that contains it.
        person: Number in the file; None: the person in most frames.
        gender: Of the body; None: neutral, which all these systems assume.
    """
    with _checked(path), _content(path) as content:
        system = _system_of(content)
        if system is None:
            return None
        people = _people(system, content)
        chosen = _chosen(people, person)
        track = system.track(content, chosen.number)
        return _motion(path, system, people, chosen, track, gender or "neutral")


def _motion(
    path: Path, system: System, people: tuple[PersonTrack, ...], chosen: PersonTrack, track: SystemMotion, gender: str
) -> ImportedMotion:
    frames = len(track.pose)
    order = np.arange(frames) if track.numbers is None else np.argsort(track.numbers, kind="stable")
    params = body_params(
        {
            "global_orient": track.pose[order, :3],
            "body_pose": track.pose[order, 3:],
            "betas": track.betas[order],
            "camera_translation": track.translation[order],
            **{name: values[order] for name, values in track.more.items()},
        },
        45,
    )
    notes = track.notes
    if len(people) > 1:
        shown = some_of((f"{one.number} ({len(one.numbers)} frames)" for one in people), most=_MAX_SHOWN)
        notes = (f"It has {len(people)} people: {shown}. Number {chosen.number} was taken.", *notes)
    numbers = range(frames) if track.numbers is None else track.numbers[order].tolist()
    if len(set(numbers)) < frames:
        raise InputError(f"has person {chosen.number} twice in a frame, expected each person once")
    return ImportedMotion(
        source=path,
        format=f"{system.title} result",
        kind=track.kind,
        gender=gender,
        params=params,
        points=track.points,
        whole_hands=track.flat_hands,
        turn=torch.eye(3, dtype=torch.float64).expand(frames, 3, 3),
        numbers=tuple(numbers),
        numbered=track.numbers is not None,
        stems=tuple(track.stems[t] for t in order) if track.stems else (),
        camera=track.camera,
        focal_rule=track.focal,
        people=people,
        notes=notes,
    )


def _system_of(content: Any) -> System | None:
    """The system that wrote it; None if it has no Python objects, or is a pickle of SMPLify-X. Raises InputError if it
    is of no known system."""
    found = next((system for system in SYSTEMS if system.holds(content)), None)
    if found is None and content is not None and not is_mapping_with(content, *_SMPLIFYX_KEYS):
        has = some_of(map(plain, content)) if isinstance(content, dict) else "nothing known"
        known = ", ".join(system.title for system in SYSTEMS)
        raise InputError(
            f"holds a {type(content).__name__} of {has}, no result of {known}. Save that of another system as an npz "
            "of SMPL-X"
        )
    return found


def _people(system: System, content: Any) -> tuple[PersonTrack, ...]:
    """The person in most frames first."""
    found: Mapping[int, Sequence[int]] = system.people(content)
    if not found:
        raise InputError(f"is a result of {system.title} without a person")
    people = (PersonTrack(number=number, numbers=tuple(sorted(frames))) for number, frames in found.items())
    return tuple(sorted(people, key=lambda one: (-len(one.numbers), one.number)))


def _chosen(people: tuple[PersonTrack, ...], number: int | None) -> PersonTrack:
    if number is None:
        return people[0]
    found = next((one for one in people if one.number == number), None)
    if found is None:
        there = some_of((one.number for one in people), most=_MAX_SHOWN)
        raise InputError(f"has no person {number}, only {there}; choose one of these")
    return found


@contextmanager
def _checked(path: Path) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        message = str(error).removeprefix(f"{path}: ").rstrip(".")
        advice = "Expected a learned system's result, unchanged; write it again"
        raise InputError(f"{path}: {message}. {advice}.") from error
    except _DAMAGED as error:
        raise InputError(f"{path}: is damaged or was cut off ({str(error)[:80]}). Write it again.") from error


@contextmanager
def _content(path: Path) -> Iterator[Any]:
    """The content of a file, or of a folder's; None if it is nothing of a learned system."""
    if path.is_dir():
        path = next((path / name for name in _FILES if (path / name).is_file()), path)
    if not path.is_file() or refusal(path) or _SMPLIFYX.fullmatch(path.name):
        yield None
    elif (arrays := per_image.of_file(path)) is not None:
        yield arrays
    else:
        with opened_result(path) as content:
            yield content or None
