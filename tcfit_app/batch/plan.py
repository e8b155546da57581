"""What is left to do of a list of clips."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fitting_core.errors import InputError
from tcfit_app.batch.fingerprint import missing_input
from tcfit_app.batch.manifest import ClipTask, Complaints
from tcfit_app.batch.records import Record, done_record, failed_record
from tcfit_app.options.preparing import body_file, check_out, prepare_torch


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Clips to fit, and how the others went before; by place in the list."""

    tasks: Sequence[ClipTask]
    to_do: tuple[int, ...]
    before: dict[int, Record]


def plan(
    tasks: Sequence[ClipTask], folder: Path, complaints: Complaints, *, retry: bool = False, here: bool = True
) -> Plan:
    """Look at what is there of each clip; what stands in the way of one goes to `complaints`.

    Args:
        tasks: The list.
        folder: The batch's.
        complaints: Takes every error.
        retry: Fit those again that have failed.
        here: They are fitted on this computer: its devices count.
    """
    _check_bodies(tasks, complaints)
    complaints.raise_any()  # Without a body nothing can be compared.
    to_do: list[int] = []
    before: dict[int, Record] = {}
    for index, task in enumerate(tasks):
        record = done_record(task) or (None if retry else failed_record(folder, task))
        if record:
            before[index] = record
            continue
        to_do.append(index)
        for column, path in missing_input(task):
            complaints.add(task.line, f"{path} does not exist.", column)
        try:
            check_out(task.out, overwrite=task.fit.overwrite or task.project)
        except InputError as error:
            complaints.add(task.line, str(error).removeprefix("--out "), "out")
    if here:
        _check_devices([tasks[index] for index in to_do], complaints)
    return Plan(tasks=tasks, to_do=tuple(to_do), before=before)


def _check_bodies(tasks: Sequence[ClipTask], complaints: Complaints) -> None:
    """Each body model once, in the first line that asks for it."""
    first = {task.fit.body: task for task in reversed(tasks)}
    for options, task in first.items():
        try:
            body_file(options)
        except InputError as error:
            complaints.add(task.line, str(error))


def _check_devices(tasks: Sequence[ClipTask], complaints: Complaints) -> None:
    first = {(task.config.device, task.config.precision): task for task in reversed(tasks)}
    for task in first.values():
        try:
            prepare_torch(task.config, 1)
        except InputError as error:
            complaints.add(task.line, str(error))
