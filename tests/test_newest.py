"""The newest versions that pyproject.toml allows: a clip is detected, fitted, shown and exported with them.

`make test-newest PYTHON=python3.13` installs tcfit without constraints into build/newest, and runs this.
"""

import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fitting_core.clips.demo import demo_clip
from fitting_core.detect.mediapipe import networks
from tests.drivers.raw_tab import admitted, raw_tab

pytestmark = pytest.mark.newest
FORMATS = "glb npz bvh smplifyx mixamo unreal vrm vrma joints trc c3d angles mot obj".split()
NEEDED = {"av", "numpy", "torch", "viser", "onnxruntime"}


@pytest.fixture(scope="module")
def bin_folder() -> Path:
    """Of the environment with the newest versions."""
    if not (given := os.environ.get("TCFIT_NEWEST")):
        pytest.skip("TCFIT_NEWEST names no environment: run this by make test-newest")
    return Path(given).resolve() / "bin"


@pytest.fixture(scope="module")
def fitted(bin_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fit of the demo clip."""
    folder, demo = tmp_path_factory.mktemp("fitted") / "demo", demo_clip()
    given = [demo.video, "--keypoints", demo.keypoints, "--focal-length", f"{demo.camera.focal[0]}"]
    run(bin_folder, folder.parent, "fit", *given, "--out", folder)
    return folder


def run(bin_folder: Path, folder: Path, *arguments: str | Path) -> str:
    """The standard output of a command that must end well, run away from this checkout's packages."""
    done = subprocess.run(
        [bin_folder / "tcfit", *arguments], cwd=folder, env=environment(), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


def environment() -> dict[str, str]:
    """Without the paths of the environment that runs the tests."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}


def test_doctor_finds_nothing_wrong(bin_folder: Path, tmp_path: Path) -> None:
    said = run(bin_folder, tmp_path, "doctor")
    print(said)
    assert "PyAV decodes the demo clip, 145 frames" in said and "tcfit_lifter.npz" in said
    assert not [line for line in said.splitlines() if line.startswith("  failed")]
    assert all(f"{name} " in said for name in NEEDED)


def test_the_demo_is_fitted_as_well_as_with_the_tested_versions(fitted: Path, bin_folder: Path, tmp_path: Path) -> None:
    assert {path.name for path in fitted.iterdir()} >= {"fit.npz", "summary.json", "overlay.mp4"}
    run(bin_folder, tmp_path, "evaluate", fitted, "--reference", demo_clip().truth, "--every", "50", "--out", tmp_path)
    last = json.loads((tmp_path / "metrics.json").read_bytes())["records"][-1]
    assert last["comparison"]["figures"]["mpjpe_mean"] < 40, "mm with the pelvis aligned"


def test_the_fit_is_exported(fitted: Path, bin_folder: Path, tmp_path: Path) -> None:
    said = run(bin_folder, tmp_path, "export", fitted, "--formats", *FORMATS, "--json")
    written = [event for line in said.splitlines() if (event := json.loads(line)).get("event") == "exported"]
    assert len(list(tmp_path.iterdir())) >= len(FORMATS), written


def test_keypoints_are_found_in_a_video(bin_folder: Path, tmp_path: Path) -> None:
    if networks.missing():
        pytest.skip("MediaPipe's networks are not on this computer")
    run(bin_folder, tmp_path, "detect", demo_clip().video, "--detector", "mediapipe-fast", "--out", tmp_path / "found")
    assert len(list((tmp_path / "found").rglob("*.json"))) == 145


@pytest.fixture
def served(bin_folder: Path, tmp_path: Path) -> Iterator[str]:
    """The link to the demo's review."""
    command = [bin_folder / "tcfit", "demo", "--port", "0", "--no-browser", "--out", tmp_path / "demo.tcfit"]
    with (tmp_path / "said.txt").open("w") as said:
        process = subprocess.Popen(command, cwd=tmp_path, env=environment(), stdout=said, stderr=said)
    try:
        until = time.monotonic() + 300
        while not (link := re.search(r"http://127\S+", (tmp_path / "said.txt").read_text())):
            assert process.poll() is None and time.monotonic() < until, (tmp_path / "said.txt").read_text()
            time.sleep(0.2)
        yield link[0]
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(60)


def test_the_page_answers(served: str) -> None:
    cookie = admitted(served)
    with raw_tab(re.match(r"http://[^/]+", served)[0], cookie) as tab:  # pyright: ignore[reportOptionalSubscript]
        tab.open()
        for frame in (100, 3):
            tab.seek(frame)
