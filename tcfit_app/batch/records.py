"""What is known about each clip between two runs of a batch.

A clip is done if its result's summary.json names its current inputs. It appears together with the result. The folder
beside the list contains:

| file | |
|---|---|
| failed/<clip>.json | why a clip failed; deleted when it is done |
| first/<clip>/ | first phases of clips of a subject, to continue from if the subject's shape changes |
| subjects/<subject>/shape.json | the shape that a subject's clips share |
| log.jsonl | a line whenever a clip is started, fitted, recovered or fails |
| summary.csv, summary.json | the outcome of the last run, a row for each clip |
| batch.lock | held by the process that runs this batch |
"""

import hashlib
import os
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import regular_file
from fitting_core.io.result_files import SUMMARY_NAME, is_result
from tcfit_app.batch.inputs import FIRST_NAME, SHAPE_NAME, unchanged
from tcfit_app.batch.manifest import ClipTask, Form
from tcfit_app.project.storage.accessing import accessing
from tcfit_app.project.storage.database import is_project
from tcfit_app.project.storage.lock import ProjectLock, ProjectLocked

FOLDER_SUFFIX = ".batch"
LOG_NAME, FAILED = "log.jsonl", "failed"
Kind = TypeVar("Kind")
LogEvent = Literal["started", "fitted", "recovered", "failed"]


class ResultFigures(msgspec.Struct, frozen=True, kw_only=True):
    """Of a result, for the summary."""

    frames: int
    off: dict[str, float] = {}
    """How far body, hands and face are off in the last phase, as of `glance.off_by_part`."""
    jitter_mm: float | None = None
    """Per frame squared, in camera space."""
    notes: tuple[str, ...] = ()


class Record(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a clip; that of a finished one is `batch` in its summary.json."""

    state: Literal["done", "failed"]
    inputs: str
    """See `inputs_of`."""
    finished: float
    """Seconds since 1970."""
    seconds: float
    """That it took."""
    figures: ResultFigures | None = None
    reason: str = ""
    """Why it failed, for the user."""
    trace: str = ""
    """Where in the code, if that was not foreseen."""


def batch_folder(manifest: Path) -> Path:
    """Where the state of a list of clips lies."""
    return manifest.with_name(manifest.stem + FOLDER_SUFFIX)


class _Summary(msgspec.Struct, frozen=True):
    """What is read of a summary.json."""

    batch: Record | None = None


def _read(path: Path, kind: type[Kind]) -> Kind | None:
    try:
        return msgspec.json.decode(regular_file(path).read_bytes(), type=kind)
    except (OSError, ValueError):
        return None


def read_record(folder: Path) -> Record | None:
    """The record in a folder's summary.json; None if it is missing or unreadable: the clip is fitted again then."""
    found = _read(folder / SUMMARY_NAME, _Summary)
    return found and found.batch


def write_json(path: Path, content: object) -> None:
    """Write a record, or another JSON file, whole or not at all; it is on the disk when this returns.

    Raises OSError if it cannot be written.
    """
    with replacing(path) as draft:
        draft.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n")


def done_record(task: ClipTask) -> Record | None:
    """The record of a clip whose result is there, complete and up to date."""
    if not _THERE[task.form](task.out):
        return None
    record = read_record(task.out)
    return record if record and unchanged(record.inputs, task) else None


_THERE: dict[Form, Callable[[Path], bool]] = {
    "files": is_result,
    "project": is_project,
    "first": lambda out: (out / FIRST_NAME).is_file(),
    "shape": lambda out: (out / SHAPE_NAME).is_file(),
}
"""Whether a folder holds what a task makes."""


def failed_path(folder: Path, task: ClipTask) -> Path:
    """Where a clip's failure is noted."""
    return folder / FAILED / f"{own_name(task.out.name, str(task.out.resolve()))}.json"


def own_name(text: str, identity: str) -> str:
    """A readable file name that nothing else has, not even something that differs only in case or punctuation."""
    plain = re.sub(r"[^\w.-]", "_", text)[:60]
    return f"{plain}-{hashlib.sha256(identity.encode()).hexdigest()[:8]}"


def failed_record(folder: Path, task: ClipTask) -> Record | None:
    """The record of a clip that failed, and would fail again."""
    record = _read(failed_path(folder, task), Record)
    return record if record and unchanged(record.inputs, task) else None


def write_log(folder: Path, event: LogEvent, task: ClipTask, **details: Any) -> None:
    """Add a line to the batch's log."""
    entry = {"time": time.time(), "event": event, "clip": task.name, "process": os.getpid(), **details}
    descriptor = os.open(folder / LOG_NAME, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    try:
        os.write(descriptor, msgspec.json.encode(entry) + b"\n")  # One call, so that lines of processes do not mix.
    finally:
        os.close(descriptor)


_PAUSE = 0.1


def patient_lock(folder: Path, *, seconds: float, wanted: str) -> ProjectLock:
    """Take the lock of a folder, which is made if it does not exist. Raises InputError if another process keeps it, or
    the folder cannot be written.

    Args:
        folder: What only one process may work on.
        seconds: To wait for a process that has it.
        wanted: What the user wanted, for the message: "fit into ...".
    """
    until = time.monotonic() + seconds
    while True:
        try:
            with accessing(folder):
                folder.mkdir(parents=True, exist_ok=True)
                return ProjectLock(folder)
        except ProjectLocked as error:
            if time.monotonic() > until:
                raise InputError(
                    f"{folder}: another process is at work to {wanted}. Wait for it, or stop it. ({error})"
                ) from error
            time.sleep(_PAUSE)
