"""What a review reads ahead is what it would have read later, and what cannot be read fails there and not here."""

import gc
import platform
import subprocess
import sys
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from tcfit_app.cli.review_command import body_ahead
from tcfit_app.fitting.bodies import Bodies, record_of
from tcfit_app.project.project import Project
from tcfit_app.review.opening import load_app
from tests.samples.posed_clips import shipped_body
from tests.samples.sessions import QUICK, small_clip


@pytest.fixture
def project(tmp_path: Path, tiny_body: BodyModel) -> Path:
    folder = tmp_path / "a.tcfit"
    Project.create(folder, small_clip(tiny_body)).close()
    return folder


def add_run(folder: Path, body: BodyModel) -> None:
    with Project.open(folder) as project:
        project.runs.start(QUICK, body=record_of(body), edits_seen=0)


def test_the_newest_run_s_body_is_read_once(project: Path, monkeypatch: pytest.MonkeyPatch):
    add_run(project, shipped_body())
    ahead = body_ahead(project)
    body = ahead.result(10)
    assert body is not None and body.hash == shipped_body().hash
    monkeypatch.setattr("tcfit_app.fitting.bodies.load_body", lambda path: pytest.fail("it was there"))
    bodies = Bodies(ahead=ahead)
    assert bodies.of(record_of(shipped_body())) is body
    assert bodies.find() is body


def test_another_body_is_not_taken_for_it(project: Path):
    ahead: Future[BodyModel | None] = Future()
    ahead.set_result(replace(shipped_body(), hash="another", source=Path("elsewhere.npz")))
    found = Bodies(ahead=ahead).of(record_of(shipped_body()))
    assert found.hash == shipped_body().hash


@pytest.mark.parametrize("source", ["", "gone/SMPLX_NEUTRAL.npz"])
def test_a_body_that_is_not_there_is_left_to_who_needs_it(project: Path, source: str):
    add_run(project, replace(shipped_body(), source=Path(source) if source else None))
    ahead = body_ahead(project)
    assert ahead.result(10) is None
    assert Bodies(ahead=ahead).of(record_of(shipped_body())).hash == shipped_body().hash


def test_without_a_run_or_a_project_nothing_is_read(project: Path, tmp_path: Path):
    assert body_ahead(project).result(10) is None
    assert body_ahead(tmp_path).result(10) is None
    (project / "project.sqlite").write_bytes(b"no database at all, whatever its name says" * 100)
    assert body_ahead(project).result(10) is None
    with pytest.raises(InputError):
        Project.open(project)


def test_a_damaged_body_file_is_left_to_who_needs_it(project: Path, tmp_path: Path):
    broken = tmp_path / "SMPLX_NEUTRAL.npz"
    np.savez(broken, nothing=np.zeros(3))
    add_run(project, replace(shipped_body(), source=broken))
    assert body_ahead(project).result(10) is None


def test_garbage_is_collected_again_after_loading():
    load_app()
    assert gc.isenabled()


HEAPS = """
import ctypes, threading
from tcfit_app.review.opening import load_app
load_app()
libc = ctypes.CDLL(None)
libc.fdopen.restype, libc.fdopen.argtypes = ctypes.c_void_p, [ctypes.c_int, ctypes.c_char_p]
libc.malloc_info.argtypes, libc.fflush.argtypes = [ctypes.c_int, ctypes.c_void_p], [ctypes.c_void_p]
together = threading.Barrier(9)
def work():
    libc.malloc(5000)
    together.wait()
for _ in range(8):
    threading.Thread(target=work).start()
together.wait()
told = libc.fdopen(1, b"w")
libc.malloc_info(0, told)
libc.fflush(told)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="needs glibc's malloc")
def test_threads_share_heaps():
    """What a heap of its own keeps for each thread grows with every clip that is opened."""
    made = subprocess.run([sys.executable, "-c", HEAPS], capture_output=True, text=True, check=True)
    assert 1 <= made.stdout.count("<heap nr=") <= 2, made.stdout
