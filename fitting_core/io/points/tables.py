"""Tables of a motion: intervals in which each foot stands, also as events, and positions of the joints."""

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from fitting_core.body.model import JOINTS
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.frame_runs import runs_where
from fitting_core.ground.contacts import Contacts
from fitting_core.io.points.c3d_file import Event
from fitting_core.keypoints import SIDES
from fitting_core.motion import Motion
from fitting_core.results import error_bars
from fitting_core.results.error_bars import DIRECTIONS, WIDER, ErrorBars

Begin = Literal["foot strike", "first frame", "comes into view"]
End = Literal["foot off", "last frame", "leaves the view"]
_HEADER = ("side", "first_frame", "last_frame", "begin_seconds", "end_seconds", "begins_with", "ends_with")


@dataclass(frozen=True, kw_only=True)
class Stand:
    """A foot that stands for a while."""

    side: str
    """left or right."""
    frames: range
    """Numbers in the video."""
    begins: Begin
    ends: End


def stands_of(motion: Motion) -> list[Stand]:
    """Ordered by start; from the contacts of the feet's own frames. Raises InputError if the contacts are not known."""
    contacts = motion.contacts
    if contacts is None:
        raise InputError(
            f"{motion.name}: it is not known which foot stands; expected a fit of tcfit's own, of a body with feet. "
            "Results of other programs and of older versions do not say it: fit the clip again."
        )
    found = []
    for foot, side in enumerate(SIDES):
        for run in runs_where(contacts.standing[:, foot]):
            frames = range(motion.first_frame + run.start, motion.first_frame + run.stop)
            begins, ends = _begins(contacts, foot, run.start), _ends(contacts, foot, run.stop)
            found.append(Stand(side=side, frames=frames, begins=begins, ends=ends))
    return sorted(found, key=lambda stand: (stand.frames.start, stand.side))


def _begins(contacts: Contacts, foot: int, start: int) -> Begin:
    if start == 0:
        return "first frame"
    return "foot strike" if contacts.seen[start - 1, foot] else "comes into view"


def _ends(contacts: Contacts, foot: int, stop: int) -> End:
    if stop == len(contacts.standing):
        return "last frame"
    return "foot off" if contacts.seen[stop, foot] else "leaves the view"


def events_of(motion: Motion) -> list[Event]:
    """Foot strikes, at the first frame of a stand, and foot offs, at the first frame after it.

    Ordered by time; empty if contacts are not known. Coming into view or leaving it is not an event.
    """
    if motion.contacts is None:
        return []
    found = []
    for stand in stands_of(motion):
        side = "Left" if stand.side == "left" else "Right"
        if stand.begins == "foot strike":
            found.append(Event(seconds=stand.frames.start / motion.frame_rate, side=side, label="Foot Strike"))
        if stand.ends == "foot off":
            found.append(Event(seconds=stand.frames.stop / motion.frame_rate, side=side, label="Foot Off"))
    return sorted(found, key=lambda event: event.seconds)


def write_contacts(path: Path, motion: Motion) -> None:
    """Write a CSV table with a line for each stand of a foot: frames by their numbers in the video, both included, and
    seconds of the video, from the start of the first frame to the end of the last.

    Raises:
        InputError: The contacts are not known.
        OSError: It cannot be written; nothing is left of it.
    """
    rate = motion.frame_rate
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(_HEADER)
        for stand in stands_of(motion):
            frames = stand.frames
            times = f"{frames.start / rate:.4f}", f"{frames.stop / rate:.4f}"
            table.writerow([stand.side, frames.start, frames[-1], *times, stand.begins, stand.ends])


def write_frames_csv(
    path: Path, motion: Motion, about: Iterable[str], columns: Mapping[str, Float[np.ndarray, "T"]], *, digits: int
) -> None:
    """Write a row for each frame: its number, seconds in the video, and the columns with `digits` decimals, empty for
    NaN. Lines of `about` come first, marked with #. Raises OSError as `write_contacts` does."""
    frames = motion.first_frame + np.arange(len(motion))
    with replacing(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {line}\n" for line in about)
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["frame", "time_s", *columns])
        for frame, row in zip(frames, np.stack(list(columns.values()), 1), strict=True):
            cells = ["" if np.isnan(value) else f"{value:.{digits}f}" for value in row]
            writer.writerow([frame, f"{frame / motion.frame_rate:.6f}", *cells])


def write_joints_csv(path: Path, motion: Motion) -> None:
    """A row for each frame: its number, seconds in the video, x, y and z of the 55 joints in the motion's axes, metres,
    and error bars of the joints that have them; unknown ones are empty. Lines that start with # explain this. Raises
    OSError if the file cannot be written; nothing is left of it."""
    names = [f"{joint}_{axis}" for joint in JOINTS for axis in "xyz"]
    bars = motion.error_bars or ErrorBars.unknown(len(motion))
    names += [f"{joint}_error_bar_{direction}" for joint in error_bars.JOINTS for direction in DIRECTIONS]
    values = np.concatenate([motion.joints().reshape(len(motion), -1), bars.joints.reshape(len(motion), -1)], 1)
    about = (
        f"Joints of {motion.name}, metres. World: {motion.axes_text}.",
        "error_bar: 68 % of errors relative to the pelvis lie within it, along the camera's ray through the joint or "
        f"across it, and 95 % within {WIDER:g} times as much; empty where it is not known.",
    )
    write_frames_csv(path, motion, about, dict(zip(names, values.T, strict=True)), digits=5)
