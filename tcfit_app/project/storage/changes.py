"""What corrections replaced in a run, for undo: runs/<id>/<number>.npz, one per change.

| key | shape | |
|---|---|---|
| phase3_... | (n, ...) | as in `run_files`, for the frames of `windows`, concatenated |
| gravity, ground, contacts, ... | | for the whole clip; see fitting_core/ground/arrays.py |
| about | () | JSON: see `ChangeAbout` |

An undone change holds its own result, so that redo can restore it. An unreadable file is treated as missing: the fit
then follows the edit like any other.
"""

import logging
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from fitting_core.errors import InputError
from fitting_core.files.atomic import sync
from fitting_core.files.npz import read_npz, write_npz
from fitting_core.ground.arrays import grounding_arrays, grounding_from
from fitting_core.ground.grounding import Grounding
from fitting_core.results.error_bars import ErrorBars
from fitting_core.results.fit_result import FitResult, PhaseResult
from fitting_core.results.provenance import Provenance
from tcfit_app.project.storage.accessing import accessing
from tcfit_app.project.storage.run_files import PhaseRecord, phase_arrays, phase_from

_MOST = 256 * 2**20
"""Bytes per run for its changes; beyond that, the oldest are deleted, and their edits cannot be undone exactly."""
_FORMAT = "tcfit change 1"
_log = logging.getLogger(__name__)
_Count = Annotated[int, msgspec.Meta(ge=0, le=2**48)]


@dataclass(frozen=True, kw_only=True)
class Frames:
    """Some frames of a fit's last phase, with related data."""

    windows: tuple[range, ...]
    phase: PhaseResult
    """The frames of the windows, concatenated."""
    grounding: Grounding | None
    """For the whole clip."""
    edits_seen: int
    """As in `Run`."""

    @staticmethod
    def of(fit: FitResult, windows: tuple[range, ...], edits_seen: int) -> "Frames":
        """Those of a fit."""
        last, chosen = fit.last, [frame for window in windows for frame in window]
        known = last.provenance
        phase = replace(
            last,
            params=last.params[chosen],
            frame_cost=last.frame_cost[chosen],
            provenance=None if known is None else Provenance(known.start[chosen], known.stopped[chosen]),
            error_bars=None if last.error_bars is None else last.error_bars[chosen],
        )
        return Frames(windows=windows, phase=phase, grounding=fit.grounding, edits_seen=edits_seen)

    def put_into(self, fit: FitResult) -> FitResult:
        """The fit with these frames replaced."""
        last, begin = fit.last, 0
        params, cost, known = (
            last.params,
            last.frame_cost.copy(),
            last.provenance or Provenance.unknown(len(last.params)),
        )
        bars, own_bars = last.error_bars, self.phase.error_bars
        for window in self.windows:
            part = slice(begin, begin + len(window))
            params = params.with_frames(window, self.phase.params[part])
            cost[window.start : window.stop] = self.phase.frame_cost[part]
            if self.phase.provenance is not None:
                known = known.with_frames(window, self.phase.provenance[part])
            if bars is not None:
                bars = bars.with_frames(window, ErrorBars.unknown(len(window)) if own_bars is None else own_bars[part])
            begin = part.stop
        provenance = None if self.phase.provenance is None else known
        phase = replace(self.phase, params=params, frame_cost=cost, provenance=provenance, error_bars=bars)
        return replace(fit, phases=(*fit.phases[:-1], phase), grounding=self.grounding)


class ChangeAbout(msgspec.Struct, frozen=True, kw_only=True):
    """The description of a change."""

    format: str
    seen: _Count
    """The last log entry included in the keypoints that these frames were fitted to."""
    edits: dict[_Count, bool]
    """The edits it followed, by id, and whether they stood: an undo is followed too."""
    taken_back: bool
    windows: tuple[tuple[_Count, _Count], ...]
    """First frames, and frames after the last."""
    frames: _Count
    """In the clip."""
    edits_seen: _Count
    phase: PhaseRecord


@dataclass(frozen=True, kw_only=True)
class Change:
    """A change on disk."""

    number: int
    about: ChangeAbout


@dataclass(frozen=True, kw_only=True)
class Turning:
    """Changes that are to be undone or redone, and what they are afterwards."""

    changes: list[Change]
    turned: list[Change]


class Changes:
    """The changes of one run, oldest first. For one thread at a time.

    Args:
        folder: the run's; created with the first change.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.made: list[Change] = []
        """The changes applied, in order."""
        self.taken_back: list[Change] = []
        """The changes undone, the last one undone first; it applies directly after those in `_made`."""
        files = sorted(folder.glob("*.npz")) if folder.is_dir() else []
        for file in [file for file in files if file.stem.isdigit()]:
            if (about := _about(file)) is not None:
                change = Change(number=int(file.stem), about=about)
                (self.taken_back if about.taken_back else self.made).append(change)

    def __bool__(self) -> bool:
        return bool(self.made or self.taken_back)

    def add(self, before: Frames, *, seen: int, edits: dict[int, bool], frames: int) -> None:
        """Store frames before they change. Raises InputError if it cannot be written.

        Args:
            before: the frames.
            seen: As in `ChangeAbout`, like the rest.
            edits: as in `ChangeAbout`.
            frames: as in `ChangeAbout`.
        """
        about = ChangeAbout(
            format=_FORMAT,
            seen=seen,
            edits=edits,
            taken_back=False,
            windows=tuple((window.start, window.stop) for window in before.windows),
            frames=frames,
            edits_seen=before.edits_seen,
            phase=PhaseRecord.of(before.phase),
        )
        number = 1 + max((change.number for change in (*self.made, *self.taken_back)), default=0)
        change = Change(number=number, about=about)
        self._write(change, before, self._file(change))
        self.made.append(change)
        self._make_room()

    def frames(self, change: Change) -> Frames | None:
        """What a change replaced, or what it had produced if it was undone; None if it cannot be read."""
        try:
            arrays, about = read_npz(self._file(change)), change.about
            phase, windows = phase_from(arrays, about.phase), tuple(range(*window) for window in about.windows)
            if len(phase.params) != sum(map(len, windows)) or any(window.stop > about.frames for window in windows):
                raise ValueError("its frames do not match its windows")
            grounding = grounding_from(arrays, about.frames)
        except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
            _log.warning("%s cannot be read (%s): the fit follows its edits like any others", self._file(change), error)
            return None
        return Frames(windows=windows, phase=phase, grounding=grounding, edits_seen=about.edits_seen)

    def turning(self, changes: list[Change], frames: list[Frames]) -> "Turning":
        """Prepare to undo the run's last changes, the last one first, or to redo the first ones that were undone.
        Everything that needs room on the disk is written when this returns. Raises InputError as `add`; nothing has
        changed then.

        Args:
            changes: Which.
            frames: For each, what it had produced, or what it replaces again.
        """
        free = 1 + max(change.number for change in (*self.made, *self.taken_back))
        turned = []
        for place, (change, other) in enumerate(zip(changes, frames, strict=True)):
            back = not change.about.taken_back
            about = _turned(change.about, other, taken_back=back)
            # A change made again is the last one, though others may have been made since it was undone.
            turned.append(Change(number=change.number if back else free + place, about=about))
            self._write(turned[-1], other, self._prepared(turned[-1]))
        return Turning(changes=changes, turned=turned)

    def turn(self, turning: "Turning") -> None:
        """Do what was prepared."""
        for change, turned in zip(turning.changes, turning.turned, strict=True):
            with accessing(self._folder):
                os.replace(self._prepared(turned), self._file(turned))
                sync(self._folder)
            if turned.about.taken_back:
                self.made.remove(change)
                self.taken_back.insert(0, turned)
            else:
                self.made.append(turned)
                self.forget([change])

    def _prepared(self, change: Change) -> Path:
        return self._file(change).with_suffix(".prepared.npz")

    def forget(self, changes: list[Change]) -> None:
        """Delete changes that will never be undone or redone."""
        for change in changes:
            (self.taken_back if change.about.taken_back else self.made).remove(change)
            with accessing(self._folder):
                self._file(change).unlink(missing_ok=True)

    def _make_room(self) -> None:
        sizes = [self._file(change).stat().st_size for change in self.made]
        while sum(sizes) > _MOST and len(sizes) > 1:
            sizes.pop(0)
            self.forget(self.made[:1])

    def _write(self, change: Change, frames: Frames, path: Path) -> None:
        arrays = phase_arrays(frames.phase) | grounding_arrays(frames.grounding)
        arrays["about"] = np.array(msgspec.json.encode(change.about).decode())
        with accessing(self._folder):
            self._folder.mkdir(exist_ok=True)
            write_npz(path, arrays)

    def _file(self, change: Change) -> Path:
        return self._folder / file_name(change.number)


def file_name(number: int) -> str:
    """The file name of a run's result, or of a change."""
    return f"{int(number):06d}.npz"


def _turned(about: ChangeAbout, frames: Frames, *, taken_back: bool) -> ChangeAbout:
    phase, seen = PhaseRecord.of(frames.phase), frames.edits_seen
    return msgspec.structs.replace(about, taken_back=taken_back, edits_seen=seen, phase=phase)


def _about(file: Path) -> ChangeAbout | None:
    try:
        about = msgspec.json.decode(str(read_npz(file, ["about"])["about"]), type=ChangeAbout)
        if about.format != _FORMAT:
            raise ValueError(f"it is a {about.format!r}, expected {_FORMAT!r}")
    except (OSError, ValueError, KeyError, InputError) as error:
        _log.warning("%s is left out (%s)", file, error)
        return None
    return about
