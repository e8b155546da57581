"""SIGKILL, Ctrl-C and dying processes while many clips are fitted: nothing is lost, half-written or done twice."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tqdm import tqdm

from fitting_core.body.model import BodyModel
from fitting_core.io.result_files import read_fit
from tcfit_app.batch import clip_fit
from tcfit_app.cli.ending import CANCELLED
from tcfit_app.cli.main import main
from tcfit_app.fitting import process_queue
from tests.drivers.processes import needs_fork, succeeded
from tests.drivers.waiting import until
from tests.samples.batch_clips import CHEAP, broken_places, fitted, rows_of, write_batch

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
    """Every clip that is not broken has one whole result; every other one is reported."""
    bad = {f"fits/c{index:03}" for index in broken_places(clips, broken)}
    good = {f"fits/c{index:03}" for index in range(clips)} - bad
    assert {f"fits/{path.name}" for path in (folder / "fits").iterdir()} == good
    for name in good:
        assert {file.name for file in (folder / name).iterdir()} == {"fit.npz", "summary.json"}
        assert read_fit(folder / name).complete and json.loads((folder / name / "summary.json").read_text())["complete"]
    rows = rows_of(folder)
    assert {name for name, row in rows.items() if row["state"] == "failed" and row["reason"]} == bad
    assert len(rows) == clips and {name for name, row in rows.items() if row["state"].startswith("done")} == good


def killed_twice_and_resumed(folder: Path, body: BodyModel, start: Start, *, clips: int, broken: int) -> None:
    manifest = write_batch(folder, body, clips=clips, broken=broken)
    with running(start, manifest) as group:
        until(lambda: len(fitted(folder)) >= clips // 4)
        os.kill(group, signal.SIGKILL)  # The parent alone: the others have to end by themselves.
        until(lambda: not living(group), seconds=20)
    first = fitted(folder)
    with running(start, manifest) as group:
        until(lambda: len(fitted(folder)) > max(len(first), clips // 2))
        os.killpg(group, signal.SIGKILL)
    second = fitted(folder)
    assert clips // 4 <= len(first) < len(second) < clips - broken
    with running(start, manifest) as group:
        status = os.waitstatus_to_exitcode(_end_of(group))
    assert status == (1 if broken else 0), (folder / "output").read_text()
    check_results(folder, clips, broken)
    last = fitted(folder)
    assert all(last[name] == time for name, time in (first | second).items()), "a finished clip was fitted again"


def _end_of(group: int) -> int:
    """Waits for a process and leaves it to be asked about once more."""
    ended = os.waitid(os.P_PID, group, os.WEXITED | os.WNOWAIT)
    assert ended is not None
    return ended.si_status << 8 if ended.si_code == os.CLD_EXITED else ended.si_status


def test_a_batch_that_is_killed_twice_goes_on(tmp_path: Path, free_body: BodyModel):
    killed_twice_and_resumed(tmp_path, free_body, forked, clips=20, broken=2)


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
        until(lambda: not living(group), seconds=5)
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
    rows = rows_of(tmp_path)
    assert rows["fits/c000"]["state"] == "done"
    assert rows["fits/c002"]["state"] == "failed" and "by signal 9, 2 times" in rows["fits/c002"]["reason"]


def test_a_second_run_of_the_same_list_is_refused(tmp_path: Path, free_body: BodyModel, capsys):
    manifest = write_batch(tmp_path, free_body, clips=10)
    with running(forked, manifest):
        until(lambda: fitted(tmp_path))
        (tmp_path / "fits" / "c009").mkdir(exist_ok=True)
        (tmp_path / "fits" / "c009" / ".fit.npz.partial").touch()  # as while the first run writes there
        assert main(_command(manifest)) == 2
        assert "another process fits this list" in capsys.readouterr().err
