"""SIGKILL, Ctrl-C and dying processes while many clips are fitted: nothing is lost, half-written or done twice."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tqdm import tqdm

from fitting_core.body.model import BodyModel
from fitting_core.io.result_files import read_fit
from tcfit_app.batch import clip_fit
from tcfit_app.batch.outcome import FAILURES
from tcfit_app.cli import batch_command
from tcfit_app.cli.ending import CANCELLED
from tcfit_app.cli.main import main
from tcfit_app.fitting import process_queue
from tests.drivers.processes import needs_fork, succeeded
from tests.samples.batch_clips import CHEAP, broken_places, events, write_batch

pytestmark = [
    pytest.mark.thorough,
    needs_fork,
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="this system does not list processes in /proc"),
]
JOBS = 2
Start = Callable[[Path], int]
"""Starts a batch in a process group of its own, and returns the group's number."""


def _command(manifest: Path, *more: str) -> list[str]:
    return ["batch", str(manifest), *CHEAP, "--jobs", str(JOBS), *more]


def forked(manifest: Path, *more: str) -> int:
    """A batch in a fork of this process, which has imported torch: seconds less than a new interpreter takes."""
    child = os.fork()
    if child:
        _joined(child)
        return child
    code = 99
    try:
        os.setsid()
        sink = os.open(manifest.with_name("output"), os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(sink, 1)
        os.dup2(sink, 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        process_queue.CONTEXT = multiprocessing.get_context("fork")  # pyright: ignore[reportAttributeAccessIssue]
        signal.signal(signal.SIGINT, signal.default_int_handler)
        code = main(_command(manifest, *more))
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def commanded(manifest: Path) -> int:
    """A batch as a user starts it."""
    with manifest.with_name("output").open("a") as output:
        command = [sys.executable, "-m", "tcfit_app", *_command(manifest)]
        return subprocess.Popen(command, stdout=output, stderr=output, start_new_session=True).pid


def _joined(child: int) -> None:
    """Waits until the child has a group of its own, to which signals can be sent."""
    while os.getpgid(child) != child:
        time.sleep(0.001)


def living(group: int) -> list[int]:
    """Processes of a group that run; not those that have ended and that nobody has asked about."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            state, _, of = (entry / "stat").read_text().rpartition(")")[2].split()[:3]
        except (OSError, ValueError):
            continue
        if entry.name.isdigit() and int(of) == group and state != "Z":
            found.append(int(entry.name))
    return found


def until(holds: Callable[[], object], seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def fitted(folder: Path) -> list[str]:
    return list(events(folder, "fitted")) if (folder / "clips.batch" / "log.jsonl").exists() else []


@contextmanager
def running(start: Start, manifest: Path) -> Iterator[int]:
    """A batch, none of whose processes stays."""
    group = start(manifest)
    try:
        yield group
    finally:
        if living(group):
            os.killpg(group, signal.SIGKILL)
        os.waitpid(group, 0)
        until(lambda: not living(group))


def check_results(folder: Path, clips: int, broken: int) -> None:
    """Every clip that is not broken has one whole result, which was made once; every other one is reported."""
    bad = {f"fits/c{index:03}" for index in broken_places(clips, broken)}
    good = {f"fits/c{index:03}" for index in range(clips)} - bad
    made = {f"fits/{path.name}" for path in (folder / "fits").iterdir()}
    assert made == good
    for name in good:
        assert {file.name for file in (folder / name).iterdir()} == {"fit.npz", "summary.json"}
        assert read_fit(folder / name).complete and json.loads((folder / name / "summary.json").read_text())["complete"]
    times = Counter(fitted(folder))
    assert set(times.values()) == {1}
    assert {name for name in [*times, *events(folder, "recovered")] if not name.endswith(")")} == good
    rows = json.loads((folder / "clips.batch" / "summary.json").read_text())["rows"]
    assert {row["clip"] for row in rows if row["state"] in FAILURES and row["reason"]} == bad
    assert len(rows) == clips and {row["clip"] for row in rows if row["state"].startswith("done")} == good


def killed_twice_and_resumed(
    folder: Path, body: BodyModel, start: Start, *, clips: int, broken: int, subjects: int = 0
) -> None:
    manifest = write_batch(folder, body, clips=clips, broken=broken, subjects=subjects)
    good = clips - broken
    steps = 2 * good + subjects if subjects else good
    with running(start, manifest) as group:
        until(lambda: len(fitted(folder)) >= clips // 4)
        os.kill(group, signal.SIGKILL)  # The parent alone: the others have to end by themselves.
        until(lambda: not living(group), 20)
    first = len(fitted(folder))
    with running(start, manifest) as group:
        until(lambda: len(fitted(folder)) >= max(first + 1, clips // 2 + steps - good))
        os.killpg(group, signal.SIGKILL)
    second = len(fitted(folder))
    assert clips // 4 <= first < second < steps
    with running(start, manifest) as group:
        status = os.waitstatus_to_exitcode(_end_of(group))
    assert status == 1, (folder / "output").read_text()
    check_results(folder, clips, broken)


def _end_of(group: int) -> int:
    """Waits for a process and leaves it to be asked about once more."""
    ended = os.waitid(os.P_PID, group, os.WEXITED | os.WNOWAIT)
    assert ended is not None
    return ended.si_status << 8 if ended.si_code == os.CLD_EXITED else ended.si_status


def test_a_batch_that_is_killed_twice_goes_on(tmp_path: Path, free_body: BodyModel):
    killed_twice_and_resumed(tmp_path, free_body, forked, clips=20, broken=2)


def test_clips_of_subjects_that_are_killed_twice_go_on(tmp_path: Path, free_body: BodyModel):
    """First among the first phases, then among the fits with the shapes."""
    killed_twice_and_resumed(tmp_path, free_body, forked, clips=12, broken=2, subjects=2)
    shapes = {f"fits/c{i:03}": read_fit(tmp_path / f"fits/c{i:03}").params.betas[0].tolist() for i in (2, 4, 6, 3, 5)}
    even, odd = (list(shapes.values())[part] for part in (slice(0, 3), slice(3, 5)))
    assert even[0] == even[1] == even[2] != odd[0] == odd[1]


def test_forks_do_not_share_the_lock_of_progress_bars():
    """One that is killed while it has it would stop all later ones."""
    shared = tqdm.get_lock()
    assert succeeded(lambda report: report(f"shared: {tqdm.get_lock() is shared}")) == ["shared: False"]


@pytest.mark.slow
def test_200_clips_killed_twice_on_the_way(tmp_path: Path, free_body: BodyModel):
    killed_twice_and_resumed(tmp_path, free_body, commanded, clips=200, broken=10)


def test_ctrl_c_stops_at_once_and_says_how_to_go_on(tmp_path: Path, free_body: BodyModel):
    manifest = write_batch(tmp_path, free_body, clips=16)
    with running(forked, manifest) as group:
        until(lambda: len(fitted(tmp_path)) >= 2)
        begin = time.monotonic()
        os.killpg(group, signal.SIGINT)  # as a terminal does
        assert os.waitstatus_to_exitcode(_end_of(group)) == CANCELLED
        assert time.monotonic() < begin + 5
        until(lambda: not living(group), 5)
    output = (tmp_path / "output").read_text()
    assert "The same command continues with the " in output and "not reached" in output and "Traceback" not in output
    with running(forked, manifest) as group:
        assert os.waitstatus_to_exitcode(_end_of(group)) == 0
    check_results(tmp_path, 16, 0)


def test_a_clip_whose_process_dies_is_tried_again_and_then_fails(tmp_path: Path, free_body: BodyModel, monkeypatch):
    manifest = write_batch(tmp_path, free_body, clips=4)

    def dying(task: clip_fit.ClipTask) -> str:
        if task.name == "fits/c002" or (task.name == "fits/c000" and not (tmp_path / "died").exists()):
            (tmp_path / "died").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return whole(task)

    whole = clip_fit.inputs_of
    monkeypatch.setattr(clip_fit, "inputs_of", dying)
    with running(forked, manifest) as group:
        assert os.waitstatus_to_exitcode(_end_of(group)) == 1
    rows = {row["clip"]: row for row in json.loads((tmp_path / "clips.batch" / "summary.json").read_text())["rows"]}
    assert rows["fits/c000"]["state"] == "done"
    assert rows["fits/c002"]["state"] == "failed" and "by signal 9, 2 times" in rows["fits/c002"]["reason"]


def test_a_second_run_of_the_same_list_is_refused(tmp_path: Path, free_body: BodyModel, monkeypatch, capsys):
    manifest = write_batch(tmp_path, free_body, clips=10)
    monkeypatch.setattr(batch_command, "_PATIENCE", 0.1)
    with running(forked, manifest):
        until(lambda: fitted(tmp_path))
        assert main(_command(manifest)) == 2
        assert "another process is at work to fit this list" in capsys.readouterr().err


@pytest.mark.parametrize("step", ["write_json", "write_log", "_put"])
def test_a_death_around_the_last_step_neither_loses_nor_repeats(
    tmp_path: Path, free_body: BodyModel, monkeypatch, step: str
):
    """Just before and just after each of the steps that make a draft the result."""
    manifest = write_batch(tmp_path, free_body, clips=1)
    for when in ("before", "after"):
        whole = getattr(clip_fit, step)

        def dying(*args: object, when: str = when, whole: Callable = whole, **kwargs: object) -> None:
            final = step != "write_log" or args[1] == "fitted"
            if not final or when == "after":
                whole(*args, **kwargs)
            if final:
                os.kill(os.getppid(), signal.SIGKILL)
                os.kill(os.getpid(), signal.SIGKILL)

        with monkeypatch.context() as patch:
            patch.setattr(clip_fit, step, dying)
            with running(forked, manifest) as group:
                code = os.waitstatus_to_exitcode(_end_of(group))
                assert code == -signal.SIGKILL or (when == "after" and code == 0)  # recovered, which logs no fit
    with running(forked, manifest) as group:
        assert os.waitstatus_to_exitcode(_end_of(group)) == 0
    made = len(fitted(tmp_path)) + len(list(events(tmp_path, "recovered")))
    assert len(fitted(tmp_path)) <= 1 and made >= 1
    assert read_fit(tmp_path / "fits" / "c000").complete
    assert not [path for path in (tmp_path / "fits").iterdir() if path.name.startswith(".")]
