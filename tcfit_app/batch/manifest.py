"""The list of clips: a CSV file, read and checked completely before the first clip is fitted."""

import csv
import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from fitting_core.clips.footage import Footage, locate
from fitting_core.clips.options import CameraOptions
from fitting_core.config.schema import FitConfig
from fitting_core.config.settings import changed
from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from fitting_core.frame_alignment import chosen
from tcfit_app.batch.columns import FOCAL, OF_CAMERA_FILE, Column, Group, find, suggestion
from tcfit_app.options.batch import BatchOptions
from tcfit_app.options.fit import FitOptions, MethodOptions, StartOptions, ViewOptions, camera_for, fit_config

_SHOWN = 30
"""Maximum number of errors in a message."""
_DELIMITERS = ",;\t"


@dataclass(frozen=True, kw_only=True)
class ClipTask:
    """A clip to fit."""

    line: int
    """Its line in the list, from 1."""
    name: str
    """Its `out`, as in the list."""
    fit: FitOptions
    config: FitConfig
    command: str = ""
    """For the record."""

    @property
    def out(self) -> Path:
        """The result's folder."""
        return self.fit.out


class Complaints:
    """Collects the errors of a list, to report all at once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.found: list[tuple[int, str]] = []

    def add(self, line: int, text: str, column: str = "") -> None:
        """Add an error in a line, from 1, and a column."""
        self.found.append((line, f"line {line}, column {column}: {text}" if column else f"line {line}: {text}"))

    def raise_any(self) -> None:
        """Raise one InputError with all errors, by line."""
        if not self.found:
            return
        lines = [text for _, text in sorted(self.found, key=lambda complaint: complaint[0])]
        more = [f"... and {len(lines) - _SHOWN} more"] if len(lines) > _SHOWN else []
        count = "an error" if len(lines) == 1 else f"{len(lines)} errors"
        listed = "\n  ".join([*lines[:_SHOWN], *more])
        raise InputError(f"{self.path} has {count}; nothing was started.\n  {listed}")


def read_manifest(options: BatchOptions, complaints: Complaints, *, command: str = "") -> tuple[ClipTask, ...]:
    """The clips of a list without errors; errors of the others go to `complaints`.

    Empty cells have the values of `options`. Missing videos and keypoints are not errors here: a finished clip does not
    need them any more.

    Raises:
        InputError: The list cannot be read, or the command line is wrong.
    """
    rows = _Rows(options, complaints, command)
    rows.configured(options.method)  # raises for errors of the command line
    header, lines = _table(options.manifest)
    columns = _columns(header, complaints)
    tasks = [task for line, cells in lines for task in rows.tasks(line, cells, columns)]
    _refuse_shared_folders(tasks, complaints)
    return tuple(tasks)


def _table(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """The header, and the other lines with their numbers, without empty ones."""
    try:
        with regular_file(path).open(newline="", encoding="utf-8-sig") as file:
            first = file.readline()
            file.seek(0)
            rows = list(_numbered(file, max(_DELIMITERS, key=first.count)))
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror or error}); expected a CSV file with a line for each clip."
        ) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: is not a CSV file in UTF-8 ({error}). Save it as CSV, encoded in UTF-8.") from error
    if len(rows) < 2:
        raise InputError(
            f"{path}: lists no clips; expected a first line with the names of the columns (video,keypoints,out) and a "
            "line for each clip."
        )
    return rows[0][1], rows[1:]


def _numbered(file: Any, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    reader = csv.reader(file, delimiter=delimiter, strict=True)
    line = 1
    for cells in reader:
        if any(cell.strip() for cell in cells):
            yield line, [cell.strip() for cell in cells]
        line = reader.line_num + 1


def _columns(header: list[str], complaints: Complaints) -> list[Column | None]:
    """The columns; None for unknown ones."""
    found = [find(cell) for cell in header]
    for cell, column in zip(header, found, strict=True):
        if column is None:
            complaints.add(1, f"{suggestion(cell)}." if cell else "a column has no name.")
    names = [column.name for column in found if column]
    for name in sorted({name for name in names if names.count(name) > 1}):
        complaints.add(1, f"the column {name} occurs {names.count(name)} times.")
    if "out" not in names:
        complaints.add(1, "the column out is missing; expected the folder of each clip's result.")
    if not {"video", "keypoints"} & set(names):
        complaints.add(1, "both columns video and keypoints are missing; expected at least one of them.")
    return found


Given = dict[Group, dict[str, Any]]
"""The cells of a line that are not empty, as values by column."""


class _Rows:
    """Reads lines of a list."""

    def __init__(self, options: BatchOptions, complaints: Complaints, command: str) -> None:
        self.options, self.complaints, self.command = options, complaints, command
        # Most clips share a configuration, and each takes milliseconds.
        self.configured, self._changed = cache(fit_config), cache(_changed)

    def tasks(self, line: int, cells: list[str], columns: list[Column | None]) -> list[ClipTask]:
        """A clip, or its parts; none if there are errors."""
        before, complain = len(self.complaints.found), partial(self.complaints.add, line)
        if len(cells) != len(columns):
            complain(f"has {len(cells)} cells; expected {len(columns)}, as many as there are columns.")
            return []
        given, name = self._given(line, cells, columns), ""
        for column, cell in zip(columns, cells, strict=True):
            if column and column.name == "out":
                name = cell
                if not cell:
                    complain("is empty; expected the folder of the clip's result.", "out")
        if not {"video", "keypoints"} & given["files"].keys():
            complain("has neither a video nor keypoints; expected at least one of them.")
        preset = given["preset"].get("preset", self.options.method.preset)
        method = replace(self.options.method, preset=preset)
        config = self.configured(method)
        for column, text in given["setting"].items():
            try:
                config = self._changed(config, column, text)
            except InputError as error:
                complain(str(error))
        fit = self._fit_options(given, method, config.height, complain) if name else None
        if fit is None or len(self.complaints.found) > before:
            return []
        whole = ClipTask(line=line, name=name, fit=fit, config=config, command=self.command)
        try:
            return _parts(whole, given["batch"].get("part_minutes", self.options.part_minutes))
        except InputError as error:
            complain(str(error), "part_minutes")
            return []

    def _given(self, line: int, cells: list[str], columns: list[Column | None]) -> Given:
        given: Given = {group: {} for group in get_args(Group)}
        folder = self.options.manifest.absolute().parent
        for column, text in zip(columns, cells, strict=True):
            if column is None or not text:
                continue
            try:
                given[column.group][column.name] = column.value(text, folder)
            except ValueError as error:
                self.complaints.add(line, f"is {error}.", column.name)
        return given

    def _fit_options(
        self, given: Given, method: MethodOptions, height: float | None, complain: Callable[..., None]
    ) -> FitOptions:
        """The clip's options of `tcfit fit`."""
        options, files, camera = self.options, given["files"], given["camera"]
        focal = [name for name in FOCAL if name in camera]
        if len(focal) > 1:
            complain(f"the focal length is given {len(focal)} times, by {', '.join(focal)}; give one of them.")
        if focal:  # It replaces the option of the command line.
            others = ("center",) if focal == ["camera"] else OF_CAMERA_FILE
            camera = dict.fromkeys((*FOCAL, *others)) | camera
        clip = replace(options.clip, **given["clip"])
        if clip.first_frame is not None and clip.last_frame is not None and clip.first_frame > clip.last_frame:
            complain(f"first_frame {clip.first_frame} lies behind last_frame {clip.last_frame}.")
        if "shape" in files and height is not None:
            complain("has both a known shape and a height; give one of them.")
        if given["start"] and "start" not in given["start"]:
            complain(f"{', '.join(given['start'])} without start; give the result.", "start")
        views, focal_of_preset = given["views"], camera_for(CameraOptions(), method).focal_length
        if views and "other_view" not in views:
            complain(f"{', '.join(views)} without other_view; give the other video.", "other_view")
        elif views and focal_of_preset is not None:
            views.setdefault("other_focal_length", focal_of_preset)
        return FitOptions(
            **files,
            overwrite=options.overwrite,
            overlay=options.overlay,
            clip=clip,
            camera=camera_for(replace(options.camera, **camera), method),
            views=ViewOptions(**{name: (value,) for name, value in views.items()}),
            body=replace(options.body, **given["body"]),
            begin=StartOptions(**given["start"]),
        )


def _changed(config: FitConfig, column: str, text: str) -> FitConfig:
    found = find(column)
    assert found is not None
    return changed(config, {found.setting: text}, origin=column, texts=True)


# --- parts of long videos ---


def _parts(task: ClipTask, minutes: float | None) -> list[ClipTask]:
    """Parts of equal length of a clip, named by their start in the video; or the clip itself, if it is not longer than
    a part (None: not divided). Raises InputError if there is no video, it cannot be read, or it has other frames."""
    if minutes is None:
        return [task]
    fit = task.fit
    images, _ = locate(fit.video, fit.keypoints)
    footage = Footage.of(images)
    if footage.timeline is None:
        raise InputError("needs a video; give it in the column video.")
    rate, _ = footage.known_rate(fit.clip.frame_rate, None)
    numbers = footage.timeline.numbers[chosen(footage.timeline, fit.clip.first_frame, fit.clip.last_frame)]
    count = math.ceil(len(numbers) / (60 * minutes * rate))
    if count < 2:
        return [task]
    borders = np.linspace(0, len(numbers), count + 1).round().astype(int).tolist()
    tasks = []
    for begin, end in itertools.pairwise(borders):
        minute, second = divmod(int(numbers[begin] / rate), 60)
        name = f"{minute // 60:02}-{minute % 60:02}-{second:02}"
        clip = replace(fit.clip, first_frame=numbers[begin], last_frame=numbers[end - 1])
        part = replace(fit, out=fit.out / name, clip=clip)
        tasks.append(replace(task, name=f"{task.name}/{name}", fit=part))
    return tasks


# --- the list as a whole ---


def _refuse_shared_folders(tasks: list[ClipTask], complaints: Complaints) -> None:
    """Report clips whose result folders are equal or inside each other."""
    owner: dict[Path, ClipTask] = {}
    for task in tasks:
        first = owner.setdefault(task.out.resolve(), task)
        if first is not task:
            complaints.add(task.line, f"{task.name} is already the folder of line {first.line}.", "out")
    for folder, task in owner.items():
        around = next((owner[parent] for parent in folder.parents if parent in owner), None)
        if around:
            complaints.add(task.line, f"{task.name} is inside the folder of line {around.line}.", "out")
