"""Pictures and overlay videos: which fits, which frames, which background, and as which camera sees them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera, project
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.render.overlay import ImageOf, Shown
from fitting_core.results.fit_result import FitResult, PhaseResult
from tcfit_app.exports import pictures
from tcfit_app.exports.pictures import write_comparison
from tcfit_app.review.scene.poster import relief
from tests.samples.posters import pixels_of_world

FRAMES = 20
"""More than are computed together."""
CAMERA = Camera(focal=(80.0, 80.0), center=(32.0, 24.0), size=(64, 48))


def _phase(number: int, depth: float) -> PhaseResult:
    params = BodyParams.neutral(FRAMES)
    params.global_orient[:, 0] = torch.pi
    params.camera_translation[:, 2] = depth + 0.01 * torch.arange(FRAMES)
    return PhaseResult(phase=number, params=params, objective={"total": 0.0}, frame_cost=np.zeros(FRAMES), seconds=0.0)


def _fit(*phases: PhaseResult) -> FitResult:
    observed = np.ones((FRAMES, 55), bool)
    return FitResult(phases=phases, camera=CAMERA, config=FitConfig(), observed=observed)


@pytest.fixture
def clip() -> Clip:
    keypoints = Keypoints(xy=np.zeros((FRAMES, COUNT, 2)), confidence=np.zeros((FRAMES, COUNT)))
    return Clip(keypoints=keypoints, camera=CAMERA, frame_rate=25.0, name="x")


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The arguments of write_overlay, with the images of all frames."""
    asked: dict[str, Any] = {}

    def write(path: Path, shown: Sequence[Shown], *, image: ImageOf | None, **options: Any) -> None:
        made = [] if image is None else [image(i) for i in range(FRAMES)]
        asked.update(options, images=made, shown={one.label: one.motion for one in shown})

    monkeypatch.setattr(pictures, "write_overlay", write)
    return asked


def test_first_and_last_phase_side_by_side(clip: Clip, free_body: BodyModel, written: dict[str, Any], tmp_path: Path):
    fit = _fit(_phase(1, 4.0), _phase(2, 5.0), _phase(3, 6.0))
    write_comparison(tmp_path / "overlay.mp4", fit, clip, free_body)
    assert list(written["shown"]) == ["phase 1: frame by frame", "phase 3: final"]
    for motion, phase in zip(written["shown"].values(), (fit.phases[0], fit.last), strict=True):
        assert motion.params is phase.params


def test_frames_start_at_the_first_fitted_one_and_a_broken_one_is_grey(
    clip: Clip, free_body: BodyModel, written: dict[str, Any], tmp_path: Path
):
    (tmp_path / "images").mkdir()
    for i in range(FRAMES + 8):
        cv2.imwrite(str(tmp_path / "images" / f"{i:03d}.png"), np.full((48, 64, 3), 5 * i, np.uint8))
    (tmp_path / "images" / "004.png").write_bytes(b"")
    shown = replace(clip, source=tmp_path / "images", first_frame=3)
    write_comparison(tmp_path / "overlay.mp4", _fit(_phase(1, 4.0)), shown, free_body)
    assert list(written["shown"]) == ["phase 1: frame by frame"]
    levels = [int(frame[0, 0, 0]) for frame in written["images"]]
    assert levels == [96 if i == 4 else 5 * i for i in range(3, FRAMES + 3)]


@pytest.mark.thorough
@pytest.mark.usefixtures("off_screen_gl")
def test_video_over_a_plain_background(clip: Clip, free_body: BodyModel, tmp_path: Path):
    write_comparison(tmp_path / "overlay.mp4", _fit(_phase(1, 4.0), _phase(3, 4.0)), clip, free_body)
    video = cv2.VideoCapture(str(tmp_path / "overlay.mp4"))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == FRAMES
    frame = video.read()[1].astype(int)
    assert frame.shape[:2] == (48, 2 * 64 + 4)
    assert abs(frame[40, 2].mean() - 235) < 12, "grey where the body is not"
    red_over_blue = frame[..., 2] - frame[..., 0]
    assert red_over_blue[:, 68:].max() > 40 and red_over_blue[:, :64].min() < -25, "violet left, orange right"


CLIP = Camera(focal=(900.0, 940.0), center=(410.0, 395.0), size=(800, 780))
OWN = Camera(focal=(1300.0, 1250.0), center=(400.0, 401.0), size=(800, 780))
BODY = np.random.default_rng(0).uniform((-0.8, -0.9, 2.0), (0.8, 0.9, 4.0), (50, 3))


def _pixels(camera: Camera, vertices: np.ndarray) -> np.ndarray:
    return project(camera, torch.as_tensor(vertices)).numpy()


def test_posters_use_the_camera_of_each_body():
    one, other = relief([BODY, BODY], CLIP, [OWN, None])
    assert np.allclose(pixels_of_world(one[:, :2], CLIP.size), _pixels(OWN, BODY), atol=1e-3)
    assert np.allclose(pixels_of_world(other[:, :2], CLIP.size), _pixels(CLIP, BODY), atol=1e-3)
