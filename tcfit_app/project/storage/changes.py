"""What corrections have changed in a run: runs/<id>/<number>.npz, one file per change.

| key | shape | |
|---|---|---|
| phase3_... | (n, ...) | as in `run_files`, for the frames of `windows`, concatenated |
| gravity, ground, contacts, ... | | for the whole clip; see fitting_core/ground/arrays.py |
| about | () | JSON: see `ChangeAbout` |

A run of corrections is the fit in its own file with its changes put in. Each change belongs to a log entry, to whose
keypoints it was fitted, and counts as long as every edit that stood then still stands. That follows from the log, so an
undo or a redo writes nothing else, and restores the frames bit for bit.

A file that cannot be read is treated as missing: the fit then follows its edits like any others.
"""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz, write_npz
from fitting_core.ground.arrays import grounding_arrays, grounding_from
from fitting_core.ground.grounding import Grounding
from fitting_core.results.error_bars import ErrorBars
from fitting_core.results.fit_result import FitResult, PhaseResult
from fitting_core.results.provenance import Provenance
from tcfit_app.project.edits.standing import Standing
from tcfit_app.project.storage.accessing import accessing
from tcfit_app.project.storage.run_files import PhaseRecord, phase_arrays, phase_from

_MOST = 256 * 2**20
"""Bytes per run for its changes; beyond that, the oldest become part of its file, and cannot be undone exactly."""
_FORMAT, _EARLIER = "tcfit change 2", "tcfit change 1"
_log = logging.getLogger(__name__)
_Count = Annotated[int, msgspec.Meta(ge=0, le=2**48)]


Log = Callable[[], Standing[Any]]
"""What stands and stood after each entry of the project's log of edits, at present."""


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
    windows: tuple[tuple[_Count, _Count], ...]
    """First frames, and frames after the last."""
    frames: _Count
    """In the clip."""
    edits_seen: _Count
    """As in `Run`, of the run with this change."""
    phase: PhaseRecord
    taken_back: bool = True
    """False only in files of earlier versions, which had the change in the run's file until it was undone: these are
    the frames before it, which replace it when it no longer counts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Change:
    """A change on disk."""

    number: int
    about: ChangeAbout


class Changes:
    """The changes of one run. They are added and removed by one thread, and read by any.

    Args:
        folder: the run's; created with the first change.
        length: of the clip, in frames.
        log: the project's.
    """

    def __init__(self, folder: Path, length: int, log: Log) -> None:
        self._folder, self._length, self._log = folder, length, log
        self._frames: dict[int, Frames] = {}
        self._all = changes_in(folder)
        """Oldest first; replaced, never altered."""

    def __bool__(self) -> bool:
        return bool(self._all)

    def standing(self, at: int | None = None) -> list[Change]:
        """Those that count after a log entry; None: the last one."""
        return [change for change in self._all if self._log().stood_by(change.about.seen, at)]

    @property
    def hidden_earlier(self) -> bool:
        """Whether an earlier version has marked the run as deleted because all of its corrections were undone."""
        return bool(self._all) and all(c.about.format == _EARLIER and c.about.taken_back for c in self._all)

    def applied(self, at: int | None = None) -> list[Change]:
        """The changes to put into the run's file, in order, for what stood after a log entry."""
        standing = self.standing(at)
        undone = [change for change in reversed(self._all) if not change.about.taken_back and change not in standing]
        done = [change for change in standing if change.about.taken_back]
        # A change made again counts after those that were made while it was undone.
        return [*undone, *sorted(done, key=lambda c: self._log().counted(c.about.seen))]

    def edits_seen(self, before: int, at: int | None = None) -> int:
        """`Run.edits_seen` with the changes; `before`: without any."""
        return next((change.about.edits_seen for change in reversed(self.applied(at))), before)

    def put_into(self, fit: FitResult, changes: Iterable[Change]) -> FitResult:
        """The fit of the run's file, with changes."""
        for change in changes:
            if (frames := self._read(change)) is not None:
                fit = frames.put_into(fit)
        return fit

    def add(self, frames: Frames, *, seen: int, edits: dict[int, bool]) -> None:
        """Store frames as they are from now on. Raises InputError if that cannot be written.

        Args:
            frames: The frames.
            seen: The log entry to whose keypoints they were fitted.
            edits: As in `ChangeAbout`.
        """
        for change in self.standing():
            if self._log().stood_by(seen, change.about.seen):
                seen = change.about.seen  # the frames around were fitted to later edits
        about = ChangeAbout(
            format=_FORMAT,
            seen=seen,
            edits=edits,
            windows=tuple((window.start, window.stop) for window in frames.windows),
            frames=self._length,
            edits_seen=frames.edits_seen,
            phase=PhaseRecord.of(frames.phase),
        )
        change = Change(number=1 + max((change.number for change in self._all), default=0), about=about)
        arrays = phase_arrays(frames.phase) | grounding_arrays(frames.grounding)
        arrays["about"] = np.array(msgspec.json.encode(about).decode())
        with accessing(self._folder):
            self._folder.mkdir(exist_ok=True)
            write_npz(self._file(change), arrays)
        self._frames[change.number] = frames
        self._all = (*self._all, change)

    def forget_undone(self) -> None:
        """Delete the changes that are undone, once nothing can be redone."""
        standing = self.standing()
        self.forget(change for change in self._all if change.about.taken_back and change not in standing)

    def oldest(self) -> list[Change]:
        """Those that must become part of the run's file, because all together take too much room; usually none."""
        applied, oldest = self.applied(), []
        sizes = [self._file(change).stat().st_size for change in applied]
        while sum(sizes) > (_MOST // 2 if oldest else _MOST):
            oldest.append(applied[len(oldest)])
            del sizes[0]
        return oldest

    def forget(self, changes: Iterable[Change]) -> None:
        """Delete changes."""
        for change in tuple(changes):
            self._all = tuple(one for one in self._all if one is not change)
            self._frames.pop(change.number, None)
            with accessing(self._folder):
                self._file(change).unlink(missing_ok=True)

    def _read(self, change: Change) -> Frames | None:
        """The frames of a change; None, and it is left out from now on, if they cannot be read."""
        if change.number in self._frames:
            return self._frames[change.number]
        try:
            arrays, about = read_npz(self._file(change)), change.about
            phase, windows = phase_from(arrays, about.phase), tuple(range(*window) for window in about.windows)
            if len(phase.params) != sum(map(len, windows)) or any(window.stop > about.frames for window in windows):
                raise ValueError("its frames do not match its windows")
            grounding = grounding_from(arrays, about.frames)
        except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
            _log.warning("%s cannot be read (%s): the fit follows its edits like any others", self._file(change), error)
            self._all = tuple(one for one in self._all if one is not change)
            return None
        frames = Frames(windows=windows, phase=phase, grounding=grounding, edits_seen=about.edits_seen)
        self._frames[change.number] = frames
        return frames

    def _file(self, change: Change) -> Path:
        return self._folder / file_name(change.number)


def file_name(number: int) -> str:
    """The file name of a run's result, or of a change."""
    return f"{int(number):06d}.npz"


def changes_in(folder: Path) -> tuple[Change, ...]:
    """The changes in a run's folder that can be read, oldest first."""
    files = [file for file in sorted(folder.glob("*.npz")) if file.stem.isdigit()] if folder.is_dir() else []
    read = ((int(file.stem), _about(file)) for file in files)
    return tuple(Change(number=number, about=about) for number, about in read if about is not None)


def _about(file: Path) -> ChangeAbout | None:
    try:
        about = msgspec.json.decode(str(read_npz(file, ["about"])["about"]), type=ChangeAbout)
        if about.format not in (_FORMAT, _EARLIER):
            raise ValueError(f"it is a {about.format!r}, expected {_FORMAT!r}")
    except (OSError, ValueError, KeyError, InputError) as error:
        _log.warning("%s is left out (%s)", file, error)
        return None
    return about
