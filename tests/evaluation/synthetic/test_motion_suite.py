"""The motion suite: what it is made of, how its cameras frame people, how its detector errs, and one whole clip."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from build_assets.motion_suite import slip
from evaluation.synthetic.motion_suite.clips import MotionClipMade, make_motion, motion_sequences
from evaluation.synthetic.motion_suite.framing import CUTS, Shot, view_of
from evaluation.synthetic.motion_suite.measured_detector import detected
from evaluation.synthetic.motion_suite.windows import (
    FRAME_RATE,
    HALVES,
    MOTION_SUITE,
    MotionWindow,
    acted,
    read_windows,
    shipped_windows,
    write_windows,
)
from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.errors import InputError
from fitting_core.keypoints import BODY, COUNT, INDEX

pytestmark = pytest.mark.thorough

AVERAGE = (0.0,) * 10
RATE = 30.0


def ankles(window: MotionWindow, body: BodyModel) -> np.ndarray:
    return joints_in_space(body, acted(window, body, AVERAGE))[:, [JOINT["left_ankle"], JOINT["right_ankle"]]]


# --- the windows ---


def test_the_halves_are_alike_and_share_no_clip():
    windows = list(shipped_windows().values())
    halves = {half: [w for w in windows if w.half == half] for half in HALVES}
    assert [len(own) for own in halves.values()] == [30, 30] and MOTION_SUITE.stat().st_size < 1e6
    assert not {w.clip for w in halves["tuning"]} & {w.clip for w in halves["untouched"]}
    tuning, untouched = (Counter(w.kind for w in own) for own in halves.values())
    assert tuning == untouched and len(tuning) == 8
    assert all(1.7 <= len(w) / FRAME_RATE <= 4 for w in windows)
    assert sum(w.kind in ("floor", "acrobatics") for w in windows) == 12


def test_windows_come_back_from_their_file(tmp_path: Path):
    windows = [shipped_windows()[name] for name in ("14_31_1", "crawl_2")]
    write_windows(tmp_path / "some.npz", windows)
    for before, after in zip(windows, read_windows(tmp_path / "some.npz").values(), strict=True):
        assert (before.name, before.half, before.kind) == (after.name, after.half, after.kind)
        np.testing.assert_allclose(after.pose, before.pose, atol=1e-4)
        np.testing.assert_array_equal(after.standing, before.standing)
    (tmp_path / "some.npz").write_bytes(b"no archive")
    with pytest.raises(InputError, match="Take that of the checkout"):
        read_windows(tmp_path / "some.npz")


@pytest.mark.parametrize("name", ["14_31_1", "05_09_1"])
def test_people_stand_on_the_ground_and_their_feet_stay(free_body: BodyModel, name: str):
    window = shipped_windows()[name]
    found = slip(ankles(window, free_body), window.standing, FRAME_RATE)
    assert found is not None and found < 40
    assert slip(np.zeros((4, 2, 3)), np.zeros((4, 2), bool), FRAME_RATE) is None
    lowest = shared_mesh(free_body)(acted(window, free_body, AVERAGE))[..., 1].min()
    assert abs(float(lowest)) < 1e-5


# --- the cameras ---


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("lens", [26.0, 135.0])
def test_the_lower_edge_goes_where_the_cut_says(free_body: BodyModel, cut: str, lens: float):
    window = shipped_windows()["14_05_1"]  # a man who stands and drinks
    points, _ = keypoints_in_space(free_body, acted(window, free_body, AVERAGE))
    shot = Shot(azimuth=100.0, elevation=10.0, lens=lens, size=(1280, 720), cut=cut, aside=0.1)
    placed = view_of(shot, points).pose()(points[:, BODY])
    xy = placed[..., :2] / placed[..., 2:] * shot.camera.focal + shot.camera.center
    assert placed[..., 2].min() > 1.1
    row = {name: np.median(xy[:, INDEX[name], 1]) for name in ("neck", "mid_hip", "right_knee", "right_ankle")}
    shown = {"whole": 4, "knee": 3, "hip": 2, "chest": 1}[cut]
    assert [value < 720 for value in row.values()] == [True] * shown + [False] * (4 - shown)
    assert row["neck"] > 0.1 * 720 and 0.5 < np.median(xy[:, INDEX["neck"], 0]) / 1280 < 0.75
    if cut == "whole":
        assert (xy > 0).all() and (xy < shot.size).all()


# --- the detector ---


@pytest.fixture(scope="module")
def errors_seen() -> np.ndarray:
    """Errors (metres) of 60 clips of 200 frames, all in view."""
    xy, view = np.full((200, COUNT, 2), 500.0), np.ones((200, COUNT), bool)
    clips = [
        detected(xy, view, view, np.full((200, COUNT), 100.0), frame_rate=RATE, rng=np.random.default_rng(seed)).xy
        for seed in range(60)
    ]
    return (np.stack(clips)[:, :, BODY] - 500) / 100


def test_errors_are_as_large_as_measured(errors_seen: np.ndarray):
    median = np.median(errors_seen, 1)  # of a clip: what lasts
    for name, lasting, changing in (
        ("right_shoulder", 0.012, 0.012),
        ("left_hip", 0.03, 0.02),
        ("left_knee", 0.012, 0.02),
        ("nose", 0.01, 0.012),
        ("left_big_toe", 0.03, 0.025),
    ):
        point = INDEX[name]
        assert np.sqrt((median[:, point] ** 2).mean()) == pytest.approx(lasting, rel=0.2), name
        assert (errors_seen[:, :, point] - median[:, None, point]).std() == pytest.approx(changing, rel=0.1), name


def test_what_is_hidden_is_doubted_or_lost():
    view = np.ones((400, COUNT), bool)
    hidden, inside = view.copy(), view.copy()
    hidden[:, [INDEX["nose"], INDEX["left_ear"], INDEX["left_wrist"]]] = False
    inside[:, INDEX["right_ankle"]] = False
    found = detected(
        np.zeros((400, COUNT, 2)),
        hidden,
        inside,
        np.full((400, COUNT), 100.0),
        frame_rate=RATE,
        rng=np.random.default_rng(3),
    )
    sure = found.confidence
    assert not sure[:, BODY.stop :].any() and not sure[:, INDEX["right_ankle"]].any()
    assert 0.6 < sure[:, INDEX["neck"]].mean() < 0.7
    assert 0.25 < sure[:, INDEX["left_wrist"]].mean() < 0.35
    ear, heel = sure[:, INDEX["left_ear"]], sure[:, INDEX["left_heel"]]
    assert ear.min() >= 0.1 and ear.max() <= 0.2 and heel.min() >= 0.4 and heel.max() <= 0.6
    assert 0.05 < (sure[:, INDEX["nose"]] == 0).mean() <= 1


# --- a whole clip ---


@pytest.fixture(scope="module")
def made() -> MotionClipMade:
    return make_motion(motion_sequences()["backflip_1"], cached=False)


def test_detections_lie_about_the_truth(made: MotionClipMade):
    found, true = made.clip.keypoints, made.truth
    seen = found.confidence[:, BODY] > 0
    off = np.linalg.norm(found.xy - true.keypoints, axis=-1)[:, BODY]
    metre = true.camera.focal[0] / true.joints[:, JOINT["pelvis"], 2]
    assert 0.015 < np.median((off / metre[:, None])[seen]) < 0.045
    assert made.inside[:, : JOINT["right_wrist"]].all() and made.clip.camera == true.camera
    assert len(made.directions) == len(made.clip) == len(made.window)
    joints = made.view.pose()(acted_joints(made))
    np.testing.assert_allclose(true.joints[:, :22], joints[:, :22], atol=1e-5)


def acted_joints(made: MotionClipMade) -> np.ndarray:
    return joints_in_space(made.body, acted(made.window, made.body, made.sequence.subject.betas))


def test_the_same_clip_is_made_again_with_another_focal_length(made: MotionClipMade, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("evaluation.synthetic.motion_suite.clips._truth", lambda *_: made.truth)
    again = make_motion(made.sequence, focal="default", cached=False)
    np.testing.assert_array_equal(again.clip.keypoints.xy, made.clip.keypoints.xy)
    assert again.clip.camera.focal[0] == pytest.approx(np.hypot(*made.clip.camera.size))
    assert again.truth.camera == made.clip.camera != again.clip.camera
    assert not again.clip.camera.calibrated
    with pytest.raises(InputError, match="true, default"):
        make_motion(made.sequence, focal="guessed")


def test_directions_follow_the_person(made: MotionClipMade):
    level = replace(made, sequence=replace(made.sequence, shot=replace(made.sequence.shot, elevation=0.0)))
    params = replace(made.truth.params, global_orient=made.truth.params.global_orient * 0)
    for degrees, name in ((180, "front"), (90, "side"), (0, "back")):
        # Upright in camera space (y down) is half a turn about x; then about the camera's y.
        turned = Rotation.from_euler("y", 180 - degrees, degrees=True) * Rotation.from_euler("x", 180, degrees=True)
        params.global_orient[:] = params.global_orient.new_tensor(turned.as_rotvec())
        assert set(replace(level, truth=replace(made.truth, params=params)).directions) == {name}
