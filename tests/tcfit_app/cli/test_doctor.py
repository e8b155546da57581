"""`tcfit doctor`: what fails, what only warns, and that a crash or hang of OpenGL does not reach it."""

import os
import sys
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path

import av
import pytest

from fitting_core import shipped
from fitting_core.body.files import registry
from fitting_core.detect.known_models import model_path
from fitting_core.detect.mediapipe import networks
from fitting_core.fit.fused import ready
from fitting_core.render import renderer
from fitting_core.video import encoding
from tcfit_app.cli import doctor as report
from tcfit_app.cli.doctor import (
    Check,
    check_bodies,
    check_folders,
    check_python,
    check_rendering,
    check_torch,
    check_video,
    doctor,
)
from tests.samples.body_files import body_arrays, write_npz


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A free body in `free`, nothing in `data`, and no folder of the user's."""
    monkeypatch.setattr(registry, "user_folder", lambda: tmp_path / "data")
    monkeypatch.setattr(report, "user_folder", lambda: tmp_path / "data")
    monkeypatch.setattr(registry, "FREE_FOLDER", tmp_path / "free")
    monkeypatch.delenv(registry.ENVIRONMENT, raising=False)
    write_npz(tmp_path / "free" / "SMPLX_NEUTRAL.npz", body_arrays())
    return tmp_path


def _renders(monkeypatch: pytest.MonkeyPatch, **reasons: str | None) -> None:
    """Have the probes of these platforms end so; None: it works."""
    monkeypatch.setattr(renderer, "probe", reasons.__getitem__)


FAKE_RENDERER = """
import os, numpy as np
assert os.environ["PYOPENGL_PLATFORM"] == "egl"
class Any:
    def __init__(self, *a, **k): pass
    def add(self, *a, **k): pass
Primitive = Scene = Mesh = IntrinsicsCamera = Any
class OffscreenRenderer(Any):
    def render(self, scene):
        return None, np.full((16, 16), {depth})
"""


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        (FAKE_RENDERER.replace("{depth}", "2.0"), None),
        (FAKE_RENDERER.replace("{depth}", "0.0"), "AssertionError: 0.0"),
        ("import os; os.abort()", "exit status -6"),
        ("raise ImportError('Unable to load EGL library')", "ImportError: Unable to load EGL library"),
    ],
)
def test_rendering_probe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, expected: str | None):
    (tmp_path / "pyrender.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    reason = renderer.probe("egl")
    assert "PYOPENGL_PLATFORM" not in os.environ, "a probe leaves the environment alone"
    assert reason is None if expected is None else expected in (reason or "")


def test_exit_code_is_0_if_only_rendering_and_video_are_missing(
    places: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    gone = "cannot open shared object file"
    _renders(monkeypatch, egl=gone, osmesa=gone)
    monkeypatch.setattr(encoding, "CODEC", "none")
    assert doctor() == 0
    out = capsys.readouterr().out
    for part in (
        *report.CHECKS,
        "libegl1",
        "libosmesa6",
        "reinstall av",
        "Everything that tcfit fit needs works.",
    ):
        assert part in out
    assert "failed" not in out


def test_exit_code_is_1_without_a_body(
    places: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    (places / "free" / "SMPLX_NEUTRAL.npz").unlink()
    _renders(monkeypatch, egl=None)
    assert doctor() == 1
    out = capsys.readouterr().out
    assert "failed  No neutral SMPL-X body" in out and "tcfit fit cannot run" in out


def test_damaged_body_fails_only_if_it_would_be_used(places: Path):
    (places / "data").mkdir()
    (places / "data" / "SMPLX_MALE.npz").write_bytes(b"x")
    assert [check.status for check in check_bodies()] == ["warning", "ok"]
    (places / "data" / "SMPLX_NEUTRAL.npz").write_bytes(b"x")
    assert [check.status for check in check_bodies()] == ["failed", "warning", "ok"]


def test_wrong_environment_variable_fails(places: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(registry.ENVIRONMENT, str(places / "nowhere"))
    [check] = check_bodies()
    assert check.status == "failed" and registry.ENVIRONMENT in check.found


def test_advice_on_rendering(monkeypatch: pytest.MonkeyPatch):
    for egl, osmesa, *advice in (
        ("ModuleNotFoundError: No module named 'pyrender'", "x", "pip install pyrender"),
        ("ImportError: Unable to load EGL library", "did not answer within 60 s", "libegl1 libgl1", "libosmesa6"),
    ):
        _renders(monkeypatch, egl=egl, osmesa=osmesa)
        checks = list(check_rendering())
        assert all(words in check.advice for words, check in zip(advice, checks, strict=False))
        assert {check.status for check in checks} == {"warning"}
    _renders(monkeypatch, egl="x", osmesa=None)
    assert [check.status for check in check_rendering()] == ["warning", "ok"]


def test_a_check_that_raises_is_a_failed_line(places: Path, monkeypatch: pytest.MonkeyPatch):
    """A package is missing, its interface has changed (PyAV 19 refused an argument that earlier versions took), or a
    file that comes with tcfit is damaged."""

    def failed(check: Callable[[], Iterator[Check]]) -> str:
        (line,) = report._lines(check)
        assert line.status == "failed" and "-c constraints.txt" in line.advice
        return line.found

    def opened(file: str, mode: str) -> None:
        raise AssertionError("called with other arguments")

    def missing(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    with monkeypatch.context() as patch:
        patch.setattr(metadata, "version", missing)
        assert "No package metadata was found for numpy" in [line.found for line in report._lines(check_python)][-1]
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "fitting_core.video.encoding", None)
        assert "cannot be checked" in failed(check_video)
    with monkeypatch.context() as patch:
        patch.setattr(av, "open", opened)
        assert "TypeError" in failed(check_video)
    (places / "lifter.npz").write_bytes(b"x")
    monkeypatch.setattr(shipped, "LIFTER", places / "lifter.npz")
    assert "lifter.npz" in failed(report.check_networks)


def test_networks_that_cannot_be_opened_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The checksum of MediaPipe's is right; the downloaded one is no model."""
    monkeypatch.setenv("TCFIT_DETECTORS", str(tmp_path))
    place = networks.folder()
    place.mkdir()
    networks.onnx_path("face_landmark", place).write_bytes(b"not ONNX")
    networks.write_list(place)
    model_path("dwpose-l").write_bytes(b"neither")
    opened, missing, downloaded = report.check_detector()
    assert {check.status for check in (opened, missing, downloaded)} == {"warning"}
    assert opened.advice == "tcfit models add mediapipe" and "cannot find keypoints" in missing.found
    assert "dwpose-l" in downloaded.found


def test_torch_that_cannot_be_imported_fails(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    [check] = check_torch()
    assert check.status == "failed" and "pip install" in check.advice


def test_folder_that_cannot_be_written_warns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(report, "user_folder", lambda: tmp_path / "file" / "bodies")
    monkeypatch.setattr(report.platformdirs, "user_cache_path", lambda name, appauthor: tmp_path / "new" / "cache")
    statuses = [check.status for check in check_folders()]
    assert statuses == ["warning", "ok", "ok"]
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("problem", "status", "found"),
    [
        ("", "ok", "are compiled"),
        (ready.NOT_YET, "ok", "the first fit does that"),
        ("the kernels are turned off", "warning", "not used: the kernels are turned off"),
    ],
)
def test_kernels_that_the_first_fit_compiles_are_no_reason_to_warn(
    problem: str, status: str, found: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(ready, "problem", lambda: problem)
    check = list(check_torch())[1]
    assert check.status == status and found in check.found
