"""`tcfit detect` from the command line: files, Ctrl-C, going on, and what it refuses."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fitting_core.clips.options import ClipOptions
from fitting_core.clips.people import read_people
from fitting_core.clips.reading import read_clip
from fitting_core.detect import known_models
from fitting_core.detect.detectors import DETECTORS
from fitting_core.keypoints import INDEX
from tcfit_app.cli.main import main
from tests.drivers.processes import INTERRUPTIBLE
from tests.drivers.waiting import until
from tests.fitting_core.detect.onnx_files import brightest_model, constant_model, spots
from tests.samples.fake_detector import FakeDetector, known, standing
from tests.samples.media import write_film

FRAMES, SIZE = 70, (160, 120)


def place(t: int) -> tuple[float, float]:
    return 40 + 1.2 * t, 60 + 10 * np.sin(t / 9)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    def image(x: float, y: float) -> np.ndarray:
        return spots(SIZE, {0: (x, y - 20), 1: (x + 14, y), 2: (x - 14, y + 20)}, sigma=4.0)[..., ::-1]

    path = tmp_path_factory.mktemp("video") / "walk.avi"
    return write_film(path, (image(*place(t)) for t in range(FRAMES)))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return brightest_model(tmp_path_factory.mktemp("model") / "pose.onnx", size=(96, 128))


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_its_result_is_read_as_a_clip(video: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "kp"
    assert main(["detect", str(video), "--detector", str(model), "--out", str(out), "--threads", "1"]) == 0
    said = capsys.readouterr()
    assert "people in 70 of 70 frames, by pose.onnx (version 1 " in said.out
    assert "Detecting keypoints in 70 frames ..." in said.err
    assert len(names(out)) == FRAMES and names(out)[0] == "walk_000000000000_keypoints.json"
    assert json.loads((out / names(out)[0]).read_text())["detector"] == "coco-wholebody"
    clip = read_clip(video, out)
    assert clip.detector == "coco-wholebody" and not any("detector" in note for note in clip.notes)
    nose = clip.keypoints.xy[:, INDEX["nose"]]
    # The video is stored lossily: its brightest pixel moves.
    assert np.abs(nose - [(place(t)[0], place(t)[1] - 20) for t in range(FRAMES)]).max() < 1.5
    assert clip.keypoints.confidence[:, INDEX["nose"]].min() > 0.7
    found = read_clip(video, clip=ClipOptions(detector=str(model)))
    assert np.array_equal(found.keypoints.xy, clip.keypoints.xy) and found.detector == clip.detector


def test_everybody_is_in_the_files(video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As the detector has found them: nobody is chosen."""
    people = standing((40, 60), (110, 60), height=50)
    detector = FakeDetector(lambda frame: people[: 1 if frame < 5 else 2])
    monkeypatch.setitem(DETECTORS, "mediapipe", known(detector))
    assert main(["detect", str(video), "--out", str(tmp_path / "kp"), "--last-frame", "19"]) == 0
    counts = [len(json.loads((tmp_path / "kp" / name).read_text())["people"]) for name in names(tmp_path / "kp")]
    assert counts == [1] * 5 + [2] * 15
    files = read_people(video, tmp_path / "kp", clip=ClipOptions(last_frame=19))
    found = read_people(video, clip=ClipOptions(last_frame=19))
    assert [one.about for one in files] == [one.about for one in found] and len(found) == 2
    assert np.array_equal(files[1].clip.keypoints.xy, found[1].clip.keypoints.xy)


def test_a_part_of_the_clip_lies_where_it_was_seen(video: Path, model: Path, tmp_path: Path):
    out = tmp_path / "kp"
    given = ["--first-frame", "20", "--last-frame", "29", "--out", str(out), "--threads", "1"]
    assert main(["detect", str(video), "--detector", str(model), *given]) == 0
    assert names(out)[0] == "walk_000000000020_keypoints.json" and len(names(out)) == 10
    clip = read_clip(video, out, clip=ClipOptions(first_frame=20, last_frame=29))
    assert abs(clip.keypoints.xy[3, INDEX["nose"], 0] - place(23)[0]) < 1.5


KEPT = 4 + 8 + 16
"""Frames of the first three parts."""
HELD = """
import sys, time
from pathlib import Path
from fitting_core.detect import stored
from fitting_core.detect.topdown.simcc import SimCC
from tcfit_app.cli.main import main
plain = SimCC.points
def points(self, images, boxes):
    if list(Path(sys.argv[1]).rglob("part-000002.npz")):
        Path(sys.argv[1] + " waits").touch()
        time.sleep(60)
    return plain(self, images, boxes)
SimCC.points = points
stored.users_folder = lambda: Path(sys.argv[1])
sys.exit(main(sys.argv[2:]))
"""
"""It waits in the fourth part."""


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is sent as a signal of POSIX")
def test_ctrl_c_keeps_what_was_found_and_the_same_command_goes_on(
    video: Path, model: Path, tmp_path: Path, keypoint_store: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "kp"
    command = ["detect", str(video), "--detector", str(model), "--out", str(out), "--threads", "1"]
    running = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTIBLE + HELD, str(keypoint_store), *command], stderr=subprocess.PIPE, text=True
    )
    until(Path(f"{keypoint_store} waits").exists)
    running.send_signal(signal.SIGINT)
    told = running.communicate(timeout=60)[1]
    assert f"The keypoints of {KEPT} of {FRAMES} frames are cached; the same command continues." in told
    assert running.returncode == 130 and not out.exists(), "a part of the files would read as a shorter clip"
    assert main(command) == 0
    assert f"Continuing after {KEPT} of {FRAMES} frames" in capsys.readouterr().err
    assert len(names(out)) == FRAMES
    assert main(command) == 0
    said = capsys.readouterr().err
    assert "Continuing" not in said and "Detecting" not in said, "all of it was found before"


def test_what_it_refuses(
    video: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(known_models, "models_folder", lambda: tmp_path / "data")
    boxes = {"dets": np.zeros((1, 4, 5)), "labels": np.zeros((1, 4), dtype=int)}
    box_model = str(constant_model(tmp_path / "boxes.onnx", boxes))
    (tmp_path / "file").write_text("")
    other = tmp_path / "other"
    other.mkdir()
    (other / "run_000000000000_keypoints.json").write_text('{"people": []}')
    base = ["detect", str(video), "--detector", str(model), "--threads", "1"]
    cases = [
        (["detect"], "No video given"),
        (["detect", str(video), "--detector", box_model], "a detector of boxes"),
        (["detect", str(video), "--detector", "dwpose-s"], "is not known; expected one of mediapipe"),
        (["detect", str(video), "--detector", "dwpose-l"], "tcfit models add dwpose-l"),
        (["detect", str(tmp_path / "none.mp4"), "--detector", str(model)], "does not exist"),
        ([*base, "--boxes", str(model)], "Expected a detector of people"),
        ([*base, "--out", str(tmp_path / "file")], "is a file"),
        ([*base, "--out", str(other)], "contains keypoints of other frames or another video, such as run_"),
        ([*base, "--first-frame", "50", "--last-frame", "40"], "frames 50–40 are not all in"),
        ([*base, "--last-frame", "70"], "which has frames 0–69"),
        ([*base, "--provider", "tpu"], "expected one of cpu, cuda"),
    ]
    for command, words in cases:
        assert main(command) == 2, command
        assert words in capsys.readouterr().err, command
    assert not list(tmp_path.glob("p*")) and names(other) == ["run_000000000000_keypoints.json"]
