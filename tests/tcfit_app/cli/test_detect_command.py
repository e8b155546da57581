"""`tcfit detect` from the command line: files, Ctrl-C, going on, and what it refuses."""

import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from fitting_core.detect import detecting, known_models
from fitting_core.detect.known_models import KNOWN_MODELS
from fitting_core.io.clip_reader import read_clip
from fitting_core.keypoints import INDEX
from fitting_core.video.frames import FrameSource
from tcfit_app.cli import detect_command
from tcfit_app.cli.main import main
from tests.drivers.processes import INTERRUPTIBLE
from tests.fitting_core.detect.onnx_files import brightest_model, constant_model, spots

FRAMES, SIZE = 70, (160, 120)


def place(t: int) -> tuple[float, float]:
    return 40 + 1.2 * t, 60 + 10 * np.sin(t / 9)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("video") / "walk.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25, SIZE)
    for t in range(FRAMES):
        x, y = place(t)
        writer.write(spots(SIZE, {0: (x, y - 20), 1: (x + 14, y), 2: (x - 14, y + 20)}, sigma=4.0)[..., ::-1])
    writer.release()
    return path


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return brightest_model(tmp_path_factory.mktemp("model") / "pose.onnx", size=(96, 128))


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_its_result_is_read_as_a_clip(video: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "kp"
    assert main(["detect", str(video), "--model", str(model), "--out", str(out), "--threads", "1"]) == 0
    assert "somebody in 70 of 70 frames" in capsys.readouterr().out
    assert len(names(out)) == FRAMES and names(out)[0] == "walk_000000000000_keypoints.json"
    clip = read_clip(video, out)
    assert clip.detector == "coco-wholebody" and not any("detector" in note for note in clip.notes)
    nose = clip.keypoints.xy[:, INDEX["nose"]]
    # The video is stored lossily: its brightest pixel moves.
    assert np.abs(nose - [(place(t)[0], place(t)[1] - 20) for t in range(FRAMES)]).max() < 1.5
    assert clip.keypoints.confidence[:, INDEX["nose"]].min() > 0.7


def test_a_part_of_the_clip_lies_where_it_was_seen(video: Path, model: Path, tmp_path: Path):
    out = tmp_path / "kp"
    given = ["--first-frame", "20", "--last-frame", "29", "--out", str(out), "--threads", "1"]
    assert main(["detect", str(video), "--model", str(model), *given]) == 0
    assert names(out)[0] == "walk_000000000020_keypoints.json" and len(names(out)) == 10
    clip = read_clip(video, out, first_frame=20, last_frame=29)
    assert abs(clip.keypoints.xy[3, INDEX["nose"], 0] - place(23)[0]) < 1.5


def test_a_folder_of_images(video: Path, model: Path, tmp_path: Path):
    images = tmp_path / "images"
    images.mkdir()
    with FrameSource(video) as source:
        for t in range(6):
            cv2.imwrite(str(images / f"{t + 5}.png"), source.frame(t)[..., ::-1])
    assert main(["detect", str(images), "--model", str(model), "--out", str(tmp_path / "kp"), "--threads", "1"]) == 0
    clip = read_clip(images, tmp_path / "kp")
    assert np.abs(clip.keypoints.xy[:, INDEX["nose"], 0] - [place(t)[0] for t in range(6)]).max() < 1.5


SLOW = """
import sys, time
from fitting_core.detect.topdown.simcc import SimCC
from tcfit_app.cli.main import main
plain = SimCC.points
def points(self, images, boxes):
    time.sleep(0.02)
    return plain(self, images, boxes)
SimCC.points = points
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is sent as a signal of POSIX")
def test_ctrl_c_leaves_finished_frames_and_the_same_command_goes_on(
    video: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "kp"
    command = ["detect", str(video), "--model", str(model), "--out", str(out), "--threads", "1"]
    running = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTIBLE + SLOW, *command], stderr=subprocess.PIPE, text=True
    )
    end = time.monotonic() + 60
    while not (out / ".detection" / "points-000000.npz").exists():
        assert time.monotonic() < end and running.poll() is None
        time.sleep(0.01)
    running.send_signal(signal.SIGINT)
    assert "32 of 70 frames are in" in running.communicate(timeout=60)[1]
    assert running.returncode == 130
    assert [name for name in names(out) if name.endswith(".json")] == [
        f"walk_{t:012}_keypoints.json" for t in range(detecting.PART)
    ]
    assert main(command) == 0
    assert "Going on after 32 of 70 frames" in capsys.readouterr().err
    assert len(names(out)) == FRAMES, "nothing else is left"


def test_another_model_does_not_go_on_with_it(
    video: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    out = tmp_path / "kp"
    other = brightest_model(tmp_path / "other.onnx", size=(48, 64))
    command = ["detect", str(video), "--out", str(out), "--threads", "1", "--model"]

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(detect_command, "shown", stop)
        assert main([*command, str(model)]) == 130
    assert main([*command, str(other)]) == 2
    assert "another pose model" in capsys.readouterr().err
    assert main([*command, str(other), "--restart"]) == 0


def test_what_it_refuses(video: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    boxes = {"dets": np.zeros((1, 4, 5)), "labels": np.zeros((1, 4), dtype=int)}
    box_model = str(constant_model(tmp_path / "boxes.onnx", boxes))
    (tmp_path / "file").write_text("")
    other = tmp_path / "other"
    other.mkdir()
    (other / "run_000000000000_keypoints.json").write_text('{"people": []}')
    base = ["detect", str(video), "--model", str(model), "--threads", "1"]
    cases = [
        (["detect"], "No video is given"),
        (["detect", str(video)], "No --model is given"),
        (["detect", str(video), "--model", box_model], "a detector of boxes"),
        (["detect", str(video), "--model", "dwpose-s"], "there is no such model file"),
        (["detect", str(tmp_path / "none.mp4"), "--model", str(model)], "does not exist"),
        ([*base, "--boxes", str(model)], "Expected a detector of people"),
        ([*base, "--out", str(tmp_path / "file")], "is a file"),
        ([*base, "--out", str(other)], "holds keypoints of other frames or another video, such as run_"),
        ([*base, "--first-frame", "50", "--last-frame", "40"], "Frames 50 to 40 were asked for"),
        ([*base, "--last-frame", "70"], "has 0 to 69"),
        ([*base, "--provider", "tpu"], "expected one of cpu, cuda"),
        ([*base, "--person", "1", "--out", str(tmp_path / "p")], "needs a box model"),
        (["detect", "--download", "nothing"], "expected one of dwpose-m"),
        (["detect", "--download", "dwpose-m"], "--yes"),
    ]
    for command, words in cases:
        assert main(command) == 2, command
        assert words in capsys.readouterr().err, command
    assert not list(tmp_path.glob("p*")) and names(other) == ["run_000000000000_keypoints.json"]


def test_the_list_of_models(capsys: pytest.CaptureFixture[str]):
    assert main(["detect", "--list"]) == 0
    said = capsys.readouterr().out
    assert all(name in said for name in KNOWN_MODELS) and "Apache-2.0" in said


def test_a_download_shows_what_it_is_and_then_the_model_has_its_name(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(known_models, "models_folder", lambda: tmp_path / "data")
    known = replace(KNOWN_MODELS["dwpose-m"], url=model.resolve().as_uri())
    monkeypatch.setitem(KNOWN_MODELS, "dwpose-m", known)
    assert main(["detect", "--download", "dwpose-m", "--yes"]) == 0
    said = capsys.readouterr().out
    assert (tmp_path / "data" / "dwpose-m.onnx").is_file()
    assert known.url in said and known.licence in said and "remembered for the next download" in said
    assert main(["detect", "--download", "dwpose-m", "--yes"]) == 0
    assert "(as expected)" in capsys.readouterr().out
