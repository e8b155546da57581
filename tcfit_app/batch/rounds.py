"""The order in which a list is worked through: rounds of tasks that do not depend on each other.

A clip without a subject is one task. The clips of a subject share one shape, so each takes three: its first phase, the
shape from the first phases of all of them, and the rest. Results of tasks are cached one by one, so only changed tasks
are repeated.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from fitting_core.config.schema import ShapeSample, Temporal
from tcfit_app.batch.inputs import SHAPE_NAME
from tcfit_app.batch.manifest import ClipTask
from tcfit_app.batch.records import Record, done_record, failed_record, own_name
from tcfit_app.options.fit import FitOptions

FIRST, SUBJECTS = "first", "subjects"
"""Folders in the batch's."""
MOST_CLIPS = 40
"""Number of a subject's first clips that determine its shape; later clips do not affect it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Round:
    """Tasks that do not depend on each other, and what is known of each."""

    what: str
    """For the user: what the tasks are."""
    tasks: Sequence[ClipTask]
    before: frozenset[int]
    """Those that an earlier run has done, or that failed in it."""
    records: dict[int, Record]
    """Of those, and of each other one as soon as it has ended."""

    @staticmethod
    def of(what: str, tasks: Sequence[ClipTask], folder: Path, *, retry: bool) -> "Round":
        """Looks at what is there in the batch's folder; with `retry`, failures do not count."""
        found = ((i, done_record(t) or (None if retry else failed_record(folder, t))) for i, t in enumerate(tasks))
        records = {index: record for index, record in found if record}
        return Round(what=what, tasks=tasks, before=frozenset(records), records=records)

    @property
    def to_do(self) -> list[int]:
        """Places of the tasks that have not ended."""
        return [index for index in range(len(self.tasks)) if index not in self.records]


class Course:
    """How all clips of a list get done. With `retry` those that have failed are fitted again."""

    def __init__(self, tasks: Sequence[ClipTask], folder: Path, *, retry: bool) -> None:
        self.tasks, self.folder, self.retry = tasks, folder, retry
        self.subjects: dict[str, list[int]] = {}
        """Places of each subject's clips."""
        for place, task in enumerate(tasks):
            if task.subject:
                self.subjects.setdefault(task.subject, []).append(place)
        begun = [first_phase(task, folder) if task.subject else task for task in tasks]
        what = "First phases, and clips without a subject" if self.subjects else "Clips"
        self.first = Round.of(what, begun, folder, retry=retry)
        self._steps: list[list[tuple[Round, int]]] = [[(self.first, place)] for place in range(len(tasks))]

    def waiting(self) -> Iterator[ClipTask]:
        """Clips whose first phase is done already, and that may be fitted with another shape in a later round."""
        return (
            self.tasks[place] for places in self.subjects.values() for place in places if place in self.first.before
        )

    def later(self) -> Iterator[Round]:
        """The rounds after the first, each when the one before it is done."""
        if self.subjects:
            yield self._shapes()
            yield self._rest()

    def _shapes(self) -> Round:
        names, tasks = [], []
        for name, places in self.subjects.items():
            records = ((place, self.first.records.get(place)) for place in places)
            members = [self.first.tasks[place] for place, record in records if record and record.state == "done"]
            if members:
                names.append(name)
                tasks.append(shape_of(self.tasks[places[0]], tuple(members[:MOST_CLIPS]), self.folder))
        shapes = Round.of("Shapes of subjects", tasks, self.folder, retry=self.retry)
        for index, name in enumerate(names):
            for place in self.subjects[name]:
                if "failed" not in self._states(place):
                    self._steps[place].append((shapes, index))
        return shapes

    def _rest(self) -> Round:
        places = [place for own in self.subjects.values() for place in own if self._states(place) == ["done", "done"]]
        tasks = [with_shape(self.tasks[place], self.folder) for place in places]
        rest = Round.of("Clips of subjects", tasks, self.folder, retry=self.retry)
        for index, place in enumerate(places):
            self._steps[place].append((rest, index))
        return rest

    def _states(self, place: int) -> list[str | None]:
        """How the steps of a clip ended, as far as it has come."""
        records = [step.records.get(index) for step, index in self._steps[place]]
        return [record and record.state for record in records]

    def outcome(self, place: int) -> tuple[Record | None, bool]:
        """How a clip went, and whether in an earlier run; None: it has not ended."""
        for step, index in self._steps[place]:
            record = step.records.get(index)
            if record and record.state == "failed":
                return record, index in step.before
        step, index = self._steps[place][-1]
        record = step.records.get(index)
        if record is None or len(self._steps[place]) < (3 if self.tasks[place].subject else 1):
            return None, False
        if step is not self.first:  # What the shape took is no one clip's.
            record = msgspec.structs.replace(record, seconds=record.seconds + self.first.records[place].seconds)
        return record, index in step.before


def first_phase(task: ClipTask, folder: Path) -> ClipTask:
    """The first phase of a subject's clip."""
    # What only later phases look at changes nothing of it.
    config = replace(task.config, last_phase=1, temporal=Temporal(), shape_sample=ShapeSample())
    return replace(
        task,
        name=f"{task.name} (first phase)",
        fit=replace(task.fit, out=folder / FIRST / own_name(task.out.name, str(task.out.resolve()))),
        config=config,
        form="first",
    )


def shape_of(task: ClipTask, members: tuple[ClipTask, ...], folder: Path) -> ClipTask:
    """The shape of the subject of `task` from first phases of its clips."""
    return replace(
        task,
        name=f"{task.subject} (shape from {len(members)} clip{'s' * (len(members) > 1)})",
        config=replace(task.config, last_phase=2, temporal=Temporal()),
        fit=FitOptions(out=folder / SUBJECTS / own_name(task.subject, task.subject), body=task.fit.body),
        form="shape",
        members=members,
    )


def with_shape(task: ClipTask, folder: Path) -> ClipTask:
    """What is left of a subject's clip after its first phase, with the subject's shape."""
    shape = folder / SUBJECTS / own_name(task.subject, task.subject) / SHAPE_NAME
    return replace(task, fit=replace(task.fit, shape=shape), start=first_phase(task, folder).out)
