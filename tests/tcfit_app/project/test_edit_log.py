"""The log of edits: against working it out from scratch, undo and redo, which edits stood, and which changes count."""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting_core.errors import InputError
from fitting_core.keypoints import Keypoints
from fitting_core.results.fit_result import FitResult
from tcfit_app.project.edits import edit_log
from tcfit_app.project.edits.edit_log import EditHistory, LogAction, LogEntry, Redo, Undo
from tcfit_app.project.edits.kinds import Edit, MarkBad, MoveKeypoint
from tcfit_app.project.edits.standing import Standing
from tcfit_app.project.project import Project
from tcfit_app.project.storage.changes import Frames
from tests.samples.project_samples import (
    BODY,
    CONFIG,
    applied,
    assert_same_fit,
    edits,
    random_edit,
    same_keypoints,
    sample_clip,
    sample_fit,
    sample_keypoints,
)

NOW: Any = None
STEPS = st.lists(st.one_of(edits(), st.sampled_from(["undo", "redo"])), max_size=25)


def entry(number: int, action: LogAction) -> LogEntry:
    return LogEntry(id=number, time=NOW, author="a", action=action)


def from_scratch(detections: Keypoints, done: list[tuple[int, Edit]]) -> Keypoints:
    return applied(detections, [entry(number, edit) for number, edit in done])


@pytest.mark.parametrize("memory", [edit_log._MEMORY, 3000, 0])
def test_every_step_equals_the_edits_that_are_done_made_from_scratch(memory: int, monkeypatch: pytest.MonkeyPatch):
    """With little memory, undo makes all edits again."""
    monkeypatch.setattr(edit_log, "_MEMORY", memory)
    detections = sample_keypoints()
    copy = Keypoints(xy=detections.xy.copy(), confidence=detections.confidence.copy())

    @given(STEPS)
    @settings(max_examples=60)
    def holds(steps: list[Edit | str]) -> None:
        history, log = EditHistory(detections), []
        done: list[tuple[int, Edit]] = []
        undone: list[tuple[int, Edit]] = []
        for number, step in enumerate(steps, 1):
            if step == "undo":
                assert (history.undoable is None) == (not done)
                if not done:
                    continue
                undone.append(done.pop())
                action: LogAction = Undo(edit=undone[-1][0])
            elif step == "redo":
                assert (history.redoable is None) == (not undone)
                if not undone:
                    continue
                done.append(undone.pop())
                action = Redo(edit=done[-1][0])
            else:
                assert not isinstance(step, str)
                action = step
                done.append((number, step))
                undone.clear()
            history.check(action)
            history.add(entry(number, action))
            log.append(entry(number, action))
            assert same_keypoints(history.keypoints, from_scratch(detections, done))
        assert same_keypoints(applied(detections, log), history.keypoints)
        assert same_keypoints(detections, copy)

    holds()


@given(st.lists(edits(), max_size=12))
@settings(max_examples=60)
def test_undoing_everything_gives_the_detections_and_redoing_everything_the_corrections(made: list[Edit]):
    detections = sample_keypoints()
    log = [entry(number, edit) for number, edit in enumerate(made, 1)]
    history = EditHistory(detections, log)
    corrected = history.keypoints
    for number, last in enumerate(reversed(log), 100):
        history.add(entry(number, Undo(edit=last.id)))
    assert same_keypoints(history.keypoints, detections) and not history.corrected.edited.any()
    for number, first in enumerate(log, 200):
        history.add(entry(number, Redo(edit=first.id)))
    assert same_keypoints(history.keypoints, corrected)


def test_a_new_edit_ends_redo():
    history = EditHistory(sample_keypoints(), [entry(1, MarkBad(frames=(0,), joints=(0,))), entry(2, Undo(edit=1))])
    assert history.redoable and history.redoable.id == 1 and history.undoable is None
    history.add(entry(3, MarkBad(frames=(1,), joints=(0,))))
    assert history.redoable is None and history.undoable and history.undoable.id == 3
    with pytest.raises(InputError, match="Edit 1 cannot be redone now; nothing is next"):
        history.check(Redo(edit=1))


def test_undo_takes_back_the_last_edit_only():
    first, second = (MarkBad(frames=(t,), joints=(0,)) for t in (0, 1))
    history = EditHistory(sample_keypoints(), [entry(1, first), entry(2, second)])
    with pytest.raises(InputError, match="Edit 1 cannot be undone now; edit 2 is next"):
        history.check(Undo(edit=1))
    with pytest.raises(InputError, match="cannot be undone"):
        EditHistory(sample_keypoints(), [entry(1, Undo(edit=1))])


def test_what_was_handed_out_stays_as_it_was():
    history = EditHistory(sample_keypoints())
    before, marks = history.keypoints, history.corrected
    xy = before.xy.copy()
    history.add(entry(1, MoveKeypoint(frames=(0,), joints=(0,), xy=(((5.0, 5.0),),))))
    history.add(entry(2, MarkBad(frames=(0,), joints=(1,))))
    assert np.array_equal(before.xy, xy) and history.keypoints.xy[0, 0, 0] == 5
    assert marks.bad[0, 1] and history.marked("bad") == [0] == history.marked("touched"), "these follow"
    for array in (before.xy, before.confidence, marks.bad, history.keypoints.xy):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 0


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many cells each step writes."""
    written: list[int] = []
    put = edit_log.Corrected.put

    def counted(self: Any, frames: Any, joints: Any, values: Any) -> None:
        written.append(len(frames) * len(joints))
        put(self, frames, joints, values)

    monkeypatch.setattr(edit_log.Corrected, "put", counted)
    return written


def test_one_more_edit_does_not_look_at_the_whole_clip(written: list[int]):
    """For one edit and for one undo: as many as the edit touches."""
    history = EditHistory(sample_keypoints(400))
    for number in range(1, 21):
        history.add(entry(number, MarkBad(frames=(number,), joints=(0, 1))))
    history.add(entry(21, Undo(edit=20)))
    assert written == [2] * 21


def test_what_was_undone_takes_no_memory(written: list[int], monkeypatch: pytest.MonkeyPatch):
    """However often one edits and undoes, the next undo need not make all edits again."""
    edit = MarkBad(frames=(0,), joints=(0, 1))
    monkeypatch.setattr(edit_log, "_MEMORY", 3 * edit_log.Corrected.none(sample_keypoints()).at((0,), (0, 1)).nbytes)
    history = EditHistory(sample_keypoints(), [entry(1, edit)])
    for number in range(2, 42, 2):
        history.add(entry(number, edit))
        history.add(entry(number + 1, Undo(edit=number)))
    assert written == [2] * 41


def test_opening_makes_no_edit_that_was_undone(written: list[int]):
    undone = MarkBad(frames=(0, 1, 2), joints=(0, 1))
    log = [entry(1, MarkBad(frames=(3,), joints=(0,)))]
    for number in range(2, 22, 2):
        log += [entry(number, undone), entry(number + 1, Undo(edit=number))]
    assert not EditHistory(sample_keypoints(), log).corrected.bad[:3].any() and written == [1]


def test_undo_goes_back_behind_what_opening_has_kept(written: list[int], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(edit_log, "_UNDOABLE", 2)
    edits = [MarkBad(frames=(number % 6,), joints=(number,)) for number in range(6)]
    history = EditHistory(sample_keypoints(), [entry(n, edit) for n, edit in enumerate(edits, 1)])
    for number in range(6, 0, -1):
        history.add(entry(100 - number, Undo(edit=number)))
        assert history.corrected.bad.sum() == number - 1


# --- which edits stood ---


def replayed(steps: list[str]) -> tuple[Standing[int], list[tuple[int, ...]]]:
    """The standing entries after these steps, and those after each step (empty for long logs)."""
    standing: Standing[int] = Standing()
    done: list[int] = []
    undone: list[int] = []
    after: list[tuple[int, ...]] = [()]
    for number, step in enumerate(steps, 1):
        if step == "undo" and done:
            standing.undo(number)
            undone.append(done.pop())
        elif step == "redo" and undone:
            done.append(undone.pop())
            standing.redo(number, done[-1])
        else:
            standing.say(number, number, counts=step != "remark")
            done.append(number)
            undone.clear()
        after.append(tuple(done) if len(steps) < 100 else ())
    return standing, after


@given(st.lists(st.sampled_from(["say", "say", "remark", "undo", "undo", "redo"]), max_size=60))
@settings(max_examples=150)
def test_it_tells_what_a_replay_of_the_log_tells(steps: list[str]):
    standing, after = replayed(steps)
    now = set(after[-1])
    remarks = {number for number, step in enumerate(steps, 1) if step == "remark"}
    for seen, then in enumerate(map(set, after)):
        assert set(standing.changes(seen)) == now ^ then
        assert standing.differing(seen) == len((now ^ then) - remarks)
        edits = then - remarks
        assert standing.stood_by(seen) == (edits <= now) and standing.counted(seen) == len(edits)
        assert all(standing.stood_by(seen, k) == (edits <= set(after[k])) for k in range(seen, len(after)))
        assert bool(standing.stood(seen)) == (seen in now)
        assert all(bool(standing.stood(number, seen)) == (number in then) for number in range(len(after)))


def calls(work: Callable[[], Any]) -> int:
    """How many lines of Python it takes."""
    lines = 0

    def trace(frame: Any, event: str, argument: Any) -> Any:
        nonlocal lines
        lines += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
    return lines


def test_a_hundred_times_as_long_a_log_takes_hardly_longer():
    """Counted for runs that have seen all sorts of states of it: a replay would take a hundred times as many steps."""

    def asked(length: int) -> int:
        standing, after = replayed((["say"] * 9 + ["undo"]) * (length // 10))
        return calls(lambda: [standing.differing(seen) for seen in range(0, len(after), length // 20)])

    assert asked(50_000) < 4 * asked(500)


# --- changes of corrections ---


def changed(project: Project, fit: FitResult, window: range, seed: int) -> FitResult:
    """Change frames of the run 2 of corrections, which is made if it is missing; the fit with them."""
    seen = project.last_edit
    frames = Frames.of(sample_fit(seed), (window,), seen)

    def change(changes):
        changes.add(frames, seen=seen, edits={seen: True})

    if len(project.runs.all()) == 1:
        parent = project.runs.get(1)
        project.runs.start(
            fit.config, fit=fit, body=BODY, edits_seen=0, kind="corrections", parent=parent.id, change=change
        )
    else:
        project.runs.change(2, change)
    return frames.put_into(fit)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    Project.create(tmp_path / "walk.tcfit", sample_clip()).close()
    return tmp_path / "walk.tcfit"


def test_changes_that_a_killed_process_left_are_not_those_of_the_next_run(folder: Path):
    """A kill between the first change of a run of corrections and the run's row leaves the change alone."""
    with Project.open(folder) as project:
        project.runs.start(CONFIG, fit=sample_fit(0), body=BODY, edits_seen=0)
        project.append(random_edit(1))
        changed(project, sample_fit(0), range(0, 3), 1)
        shutil.copytree(folder / "runs" / "000002", folder / "runs" / "000003")
    with Project.open(folder) as project:
        run = project.runs.start(CONFIG, body=BODY, edits_seen=1)
        assert run.id == 3
        project.runs.finish(run.id, sample_fit(2))
        assert_same_fit(project.runs.load(run.id), sample_fit(2))


def test_the_log_says_which_changes_count(folder: Path):
    with Project.open(folder) as project:
        fits = [sample_fit(0)]
        project.runs.start(CONFIG, fit=fits[0], body=BODY, edits_seen=0)
        for number, window in enumerate((range(0, 3), range(2, 5), range(1, 2)), 1):
            project.append(random_edit(number))
            fits.append(changed(project, fits[-1], window, number))
    with Project.open(folder) as project:
        for left in (2, 1, 0):
            project.undo()
            assert_same_fit(project.runs.load(2), fits[left])
            assert project.runs.get(2).edits_seen == left and project.runs.get(2).emptied == (left == 0)
            assert [run.id for run in project.runs.all()] == ([1, 2] if left else [1])
        for left in (1, 2, 3):
            project.redo()
            assert_same_fit(project.runs.load(2), fits[left])
        assert_same_fit(project.runs.load(2, 1), fits[1])
        for _ in range(3):
            project.undo()
        project.append(random_edit(4))
        project.runs.changes(2).forget_undone()
    assert not list((folder / "runs" / "000002").iterdir())
