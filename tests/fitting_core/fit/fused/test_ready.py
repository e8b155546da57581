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


MODULE = """'Kernels.'
C = 3
'Metres.'
def f(x, y="k"):
    'Add.'
    # for a reason
    if y == "one":
        return [g("z") for g in x if y in {"a", "b", "c"}]
    return lambda: "s"
"""
"""The text of a module."""


def run(code: str, *arguments: str, **environment: str) -> None:
    """In a process of its own, for what was imported stays."""
    command = [sys.executable, "-c", f"import sys, os\nos.environ |= {environment}\n{code}", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def parts(text: str) -> list[str]:
    from fitting_core.fit.compiled.jit import code_parts

    return list(code_parts(compile(text, "kernels.py", "exec")))


def test_comments_and_docstrings_do_not_compile_kernels_again():
    text = MODULE.replace("for a reason", "for\n    # another").replace("Add.", "Add all.").replace("Metres", "Feet")
    assert parts(text.replace("'Kernels.'", "'All kernels.'\n")) == parts(MODULE)


@pytest.mark.parametrize("before", ["= 3", '"k"', '"one"', '"z"', '"c"', '"s"', "[g", "y =="])
def test_changed_code_compiles_kernels_again(before: str):
    assert parts(MODULE.replace(before, before.translate(str.maketrans("3kozcsgy", "6lpadthx")))) != parts(MODULE)


def test_without_numba_everything_stays_in_torch():
    run(WITHOUT_NUMBA)


@pytest.mark.thorough
@pytest.mark.parametrize("possible", [True, False])
def test_another_folder(tmp_path: Path, possible: bool):
    """Also one that cannot be made."""
    folder = tmp_path / "folder"
    folder.mkdir() if possible else folder.touch()
    run(ELSEWHERE, str(folder), TCFIT_KERNELS=str(folder / "kernels"))


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
