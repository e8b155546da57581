"""Where kernels are kept, and what happens without them."""

import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from fitting_core.fit.fused import ready

pytest.importorskip("numba", reason="numba is not installed: pip install numba")
WITHOUT_NUMBA = """
import sys
sys.modules["numba"] = None
from fitting_core.fit.fused import ready
said = []
ready.prepare(said.append)
assert not said and "numba" in ready.problem(), ready.problem()
"""
ELSEWHERE = """
from fitting_core.fit.compiled import jit
from fitting_core.fit.fused import ready
assert ready.problem() == "the kernels are not compiled yet", ready.problem()
assert str(jit.kept_in()).startswith(sys.argv[1]), jit.kept_in()
"""


def run(code: str, *arguments: str, **environment: str) -> None:
    """In a process of its own, for what was imported stays."""
    command = [sys.executable, "-c", f"import sys, os\nos.environ |= {environment}\n{code}", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_without_numba_everything_stays_in_torch():
    run(WITHOUT_NUMBA)


def test_another_folder(tmp_path: Path):
    run(ELSEWHERE, str(tmp_path / "kernels"), TCFIT_KERNELS=str(tmp_path / "kernels"))


@pytest.mark.thorough
def test_a_folder_that_cannot_be_made(tmp_path: Path):
    (tmp_path / "file").touch()
    run(ELSEWHERE, str(tmp_path / "file"), TCFIT_KERNELS=str(tmp_path / "file" / "kernels"))


def test_a_folder_that_may_only_be_read_is_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from fitting_core.fit.compiled import jit

    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "kernel.nbi").write_text("made before")

    def refuse(**options: object) -> None:
        raise PermissionError

    monkeypatch.setattr(jit, "kept_in", lambda: tmp_path / "kept")
    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    copy = jit._folder.__wrapped__()
    assert copy != tmp_path / "kept" and (copy / "kernel.nbi").read_text() == "made before"


def test_what_cannot_be_compiled_is_told_and_fits_go_on(monkeypatch: pytest.MonkeyPatch):
    from fitting_core.fit.fused import frames

    def fail() -> None:
        raise ValueError("no such instruction")

    said: list[str] = []
    monkeypatch.setattr(frames, "compile_all", fail)
    monkeypatch.setattr(ready, "_compiled", lambda: False)
    ready.prepare(said.append)
    assert "no such instruction" in said[-1] and ready.problem() == "the kernels are turned off"
    ready.use(kernels=True)
