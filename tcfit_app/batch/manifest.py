"""The list of clips: a CSV file, read and checked completely before the first clip is fitted."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

from fitting_core.config.schema import FitConfig
from fitting_core.config.settings import changed
from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from tcfit_app.batch.columns import FOCAL, OF_CAMERA_FILE, Column, find, suggestion
from tcfit_app.batch.parts import parts_of
from tcfit_app.options.batch import BatchOptions
from tcfit_app.options.fit import FitOptions, MethodOptions, StartOptions, camera_for, fit_config

_SHOWN = 30
"""Maximum number of errors in a message."""
_DELIMITERS = ",;\t"


Form = Literal["files", "project", "first", "shape"]
"""What a task makes: a result as files or as a project; for a subject, before that, the first phase of a clip and the
shape that its clips share."""


@dataclass(frozen=True, kw_only=True)
class ClipTask:
    """A clip to fit, or an intermediate step."""

    line: int
    """Its line in the list, from 1."""
    name: str
    """Its `out`, as in the list."""
    fit: FitOptions
    config: FitConfig
    form: Form = "files"
    subject: str = ""
    """The person in the clip, if other clips show the same one; else empty."""
    start: Path | None = None
    """Folder of the first phase to continue from."""
    members: tuple["ClipTask", ...] = ()
    """For a shape: the first phases from which it is estimated."""
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
    configurations = _Configurations()
    configurations.of(options.method)  # raises for errors of the command line
    header, lines = _table(options.manifest)
    found = _columns(header, complaints)
    tasks = [
        task
        for line, cells in lines
        for task in _tasks(line, cells, found, options, command, complaints, configurations)
    ]
    _refuse_shared_folders(tasks, complaints)
    _check_shapes(tasks, complaints)
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


def _tasks(
    line: int,
    cells: list[str],
    columns: list[Column | None],
    options: BatchOptions,
    command: str,
    complaints: Complaints,
    configurations: "_Configurations",
) -> list[ClipTask]:
    """A clip, or its parts; none if there are errors."""
    before = len(complaints.found)
    if len(cells) != len(columns):
        complaints.add(line, f"has {len(cells)} cells; expected {len(columns)}, as many as there are columns.")
        return []
    given = _values(line, cells, columns, options.manifest.absolute().parent, complaints)
    files = {column.name: value for column, value in given.items() if column.group == "files"}
    if "out" not in files and any(column and column.name == "out" for column in columns):
        complaints.add(line, "is empty; expected the folder of the clip's result.", "out")
    if not {"video", "keypoints"} & files.keys():
        complaints.add(line, "has neither a video nor keypoints; expected at least one of them.")
    config = _config(line, given, options, complaints, configurations)
    fit = _fit_options(line, files, given, options, complaints) if "out" in files else None
    if config is None or fit is None or len(complaints.found) > before:
        return []
    name = next(cell for cell, column in zip(cells, columns, strict=True) if column and column.name == "out")
    own = {column.name: value for column, value in given.items() if column.group == "batch"}
    subject, minutes = own.get("subject", ""), own.get("part_minutes", options.part_minutes)
    form: Form = "project" if options.projects else "files"
    whole = ClipTask(line=line, name=name, fit=fit, config=config, form=form, subject=subject, command=command)
    try:
        return [whole] if minutes is None else _parts(whole, minutes)
    except InputError as error:
        complaints.add(line, str(error), "part_minutes")
        return []


def _parts(task: ClipTask, minutes: float) -> list[ClipTask]:
    """The parts of a clip, with one subject if its shape is estimated."""
    fits = parts_of(task.fit, minutes)
    if len(fits) == 1:
        return [task]
    subject = task.subject or (task.name if task.fit.shape is None and task.config.last_phase > 1 else "")
    return [replace(task, name=f"{task.name}/{fit.out.name}", fit=fit, subject=subject) for fit in fits]


def _values(
    line: int, cells: list[str], columns: list[Column | None], folder: Path, complaints: Complaints
) -> dict[Column, Any]:
    values: dict[Column, Any] = {}
    for column, text in zip(columns, cells, strict=True):
        if column is None or not text:
            continue
        try:
            values[column] = column.value(text, folder)
        except ValueError as error:
            complaints.add(line, f"is {error}.", column.name)
    return values


class _Configurations:
    """Cache of configurations: most clips share one, and each takes milliseconds."""

    def __init__(self) -> None:
        self.of = cache(fit_config)
        self.changed = cache(self._changed)

    @staticmethod
    def _changed(config: FitConfig, column: Column, text: str) -> FitConfig:
        return changed(config, {column.setting: text}, origin=column.name, texts=True)


def _config(
    line: int, given: dict[Column, Any], options: BatchOptions, complaints: Complaints, configurations: _Configurations
) -> FitConfig | None:
    """The command line's configuration with the settings of this clip."""
    config = configurations.of(_method(given, options))
    for column, text in given.items():
        if column.group != "setting":
            continue
        try:
            config = configurations.changed(config, column, text)
        except InputError as error:
            complaints.add(line, str(error))
    return config


def _method(given: dict[Column, Any], options: BatchOptions) -> MethodOptions:
    """The command line's method with the preset of this clip."""
    preset = next((value for column, value in given.items() if column.group == "preset"), options.method.preset)
    return replace(options.method, preset=preset)


def _fit_options(
    line: int, files: dict[str, Path], given: dict[Column, Any], options: BatchOptions, complaints: Complaints
) -> FitOptions | None:
    """The clip's options of `tcfit fit`."""
    of: dict[str, dict[str, Any]] = {"clip": {}, "camera": {}, "body": {}, "start": {}}
    for column, value in given.items():
        if column.group in of:
            of[column.group][column.name] = value
    focal = [name for name in FOCAL if name in of["camera"]]
    if len(focal) > 1:
        complaints.add(line, f"the focal length is given {len(focal)} times, by {', '.join(focal)}; give one of them.")
    if focal:  # It replaces the option of the command line.
        others = ("center",) if focal == ["camera"] else OF_CAMERA_FILE
        of["camera"] = dict.fromkeys((*FOCAL, *others)) | of["camera"]
    clip = replace(options.clip, **of["clip"])
    if clip.first_frame is not None and clip.last_frame is not None and clip.first_frame > clip.last_frame:
        complaints.add(line, f"first_frame {clip.first_frame} lies behind last_frame {clip.last_frame}.")
    if of["start"] and "start" not in of["start"]:
        complaints.add(line, f"{', '.join(of['start'])} without start; give the result.", "start")
    return FitOptions(
        video=files.get("video"),
        keypoints=files.get("keypoints"),
        out=files["out"],
        shape=files.get("shape"),
        overwrite=options.overwrite,
        overlay=options.overlay,
        clip=clip,
        camera=camera_for(replace(options.camera, **of["camera"]), _method(given, options)),
        body=replace(options.body, **of["body"]),
        begin=StartOptions(**of["start"]),
    )


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


def _check_shapes(tasks: list[ClipTask], complaints: Complaints) -> None:
    """Report shapes that are given twice, and subjects whose clips differ in body or settings."""
    first: dict[str, ClipTask] = {}
    for task in tasks:
        if task.fit.shape is not None and task.config.height is not None:
            complaints.add(task.line, "has both a known shape and a height; give one of them.")
        if not task.subject:
            continue
        if task.fit.shape is not None:
            complaints.add(
                task.line, "has both a subject, whose shape is estimated, and a known shape; give one of them."
            )
        if task.config.last_phase < 2:
            complaints.add(
                task.line,
                "has a subject, and last_phase is 1; expected 2 or 3, because phase 1 estimates no common shape.",
            )
        other = first.setdefault(task.subject, task)
        differing = [f.name for f in fields(FitConfig) if getattr(task.config, f.name) != getattr(other.config, f.name)]
        differing += [] if task.fit.body == other.fit.body else ["body"]
        if differing:
            complaints.add(
                task.line,
                f"{task.subject} has another {', '.join(differing)} here than in line {other.line}; expected the same "
                "body and settings in all clips of a subject.",
                "subject",
            )
