"""The demo clip at a sixth of its frame rate and half its size: motion, detections, files."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from evaluation.synthetic import demo_clip
from evaluation.synthetic.demo_clip import make_demo
from evaluation.synthetic.motions.demo_script import FAILURES, SECONDS
from evaluation.synthetic.studio.studio import CAMERA
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.clips.demo import DemoClip
from fitting_core.clips.demo import demo_clip as shipped_clip
from fitting_core.clips.reading import read_clip
from fitting_core.errors import InputError
from fitting_core.io.truth import Truth, read_truth
from fitting_core.keypoints import INDEX, LEFT_HAND, RIGHT_HAND, Keypoints
from fitting_core.render.renderer import scaled_camera
from fitting_core.shipped import FREE_FOLDER

pytestmark = pytest.mark.thorough

RATE = 4.0
SMALL = scaled_camera(CAMERA, 0.5)


@pytest.fixture(scope="module")
def body() -> BodyModel:
    return load_body(find_body(search=FREE_FOLDER))


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory, body: BodyModel) -> DemoClip:
    folder = tmp_path_factory.mktemp("demo")
    return make_demo(folder, frame_rate=RATE, camera=SMALL, body=body)


@pytest.fixture(scope="module")
def truth(demo: DemoClip) -> Truth:
    return read_truth(demo.truth)


@pytest.fixture(scope="module")
def detected(demo: DemoClip) -> Keypoints:
    return read_clip(demo.video, demo.keypoints).keypoints


def frames_of(kind: str, part: str) -> np.ndarray:
    """Frames in which a failure of that kind and part is to happen."""
    times = np.arange(round(SECONDS * RATE)) / RATE
    spans = [(f.start, f.stop) for f in FAILURES if f.kind == kind and part in f.groups]
    return np.flatnonzero([any(start <= t < stop for start, stop in spans) for t in times])


def usual(truth: Truth) -> np.ndarray:
    """Frames without a swap of sides."""
    return np.setdiff1d(np.arange(len(truth.joints)), frames_of("swapped", "arms"))


def test_the_video_has_a_frame_for_each_of_the_keypoints(demo: DemoClip, truth: Truth, detected: Keypoints) -> None:
    capture = cv2.VideoCapture(str(demo.video))
    assert (capture.get(cv2.CAP_PROP_FRAME_WIDTH), capture.get(cv2.CAP_PROP_FRAME_HEIGHT)) == SMALL.size
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(RATE)
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == len(detected) == len(truth.joints) == round(SECONDS * RATE)


def test_the_person_is_filmed_where_the_truth_says(demo: DemoClip, truth: Truth) -> None:
    """Skin where the nose is, the blue shirt between the shoulders."""
    _, image = cv2.VideoCapture(str(demo.video)).read()
    blue, _, red = (image[..., c].astype(int) for c in range(3))
    x, y = truth.keypoints[0, INDEX["nose"]].astype(int)
    assert red[y, x] > blue[y, x] + 20
    chest = truth.keypoints[0, [INDEX["neck"], INDEX["mid_hip"]]].mean(0).astype(int)
    assert blue[chest[1], chest[0]] > red[chest[1], chest[0]] + 20


def test_both_hands_are_dropped_for_a_while_and_found_otherwise(detected: Keypoints) -> None:
    for part, hand in (("left_hand", LEFT_HAND), ("right_hand", RIGHT_HAND)):
        lost = frames_of("dropped", part)
        assert len(lost) > 0
        assert (detected.confidence[lost, hand] == 0).all() and (detected.xy[lost, hand] == 0).all()
        found = np.setdiff1d(np.arange(len(detected)), lost)
        assert (detected.confidence[found, hand] > 0).mean() > 0.9


def test_arms_are_swapped_once(truth: Truth, detected: Keypoints) -> None:
    swapped = frames_of("swapped", "arms")
    assert len(swapped) > 0
    left, right = INDEX["left_elbow"], INDEX["right_elbow"]
    crossed = np.linalg.norm(detected.xy[:, left] - truth.keypoints[:, right], axis=1) < 8
    straight = np.linalg.norm(detected.xy[:, left] - truth.keypoints[:, left], axis=1) < 8
    assert crossed[swapped].all() and not straight[swapped].any()
    assert straight[usual(truth)].all() and not crossed[usual(truth)].any()


def test_the_truth_is_a_body_that_projects_to_its_keypoints(truth: Truth, body: BodyModel) -> None:
    joints = Mesh(body, dtype=torch.float64).joints(truth.params).numpy()
    np.testing.assert_allclose(joints, truth.joints, atol=1e-9)
    hip = truth.joints[:, JOINT["left_hip"]]
    pixels = hip[:, :2] / hip[:, 2:] * truth.camera.focal + truth.camera.center
    np.testing.assert_allclose(pixels, truth.keypoints[:, INDEX["left_hip"]], atol=1e-6)
    assert truth.camera.size == SMALL.size and truth.frame_rate == RATE and truth.body_hash == body.hash


def test_the_clip_that_comes_with_tcfit_is_up_to_date(
    body: BodyModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped = shipped_clip()
    truth = read_truth(shipped.truth)
    monkeypatch.setattr(demo_clip, "_film", lambda *_, **__: truth.visible)
    again = make_demo(tmp_path, body=body)
    made = read_truth(again.truth)
    assert truth.body_hash == made.body_hash and shipped.camera == CAMERA
    np.testing.assert_allclose(truth.joints, made.joints, atol=1e-9)
    clip, other = (read_clip(shipped.video, demo.keypoints) for demo in (shipped, again))
    np.testing.assert_allclose(clip.keypoints.xy, other.keypoints.xy)
    assert len(clip) == len(truth.joints) == 145 and clip.frame_rate == 25.0


def test_damaged_truth_is_explained(tmp_path: Path, demo: DemoClip) -> None:
    path = tmp_path / "truth.npz"
    path.write_bytes(demo.truth.read_bytes()[:1000])
    with pytest.raises(InputError, match="make it again"):
        read_truth(path)
    with pytest.raises(InputError, match="make it again"):
        read_truth(replace(demo, truth=tmp_path / "none.npz").truth)
