"""The tool that picks the motion suite's windows: what it refuses, when feet rest, and real motion."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from build_assets import motion_suite
from build_assets.motion_capture.retarget import MotionClip, load
from build_assets.motion_suite import Options, at_rest, main, picked
from evaluation.synthetic.motion_suite.windows import FRAME_RATE, read_windows, shipped_windows
from fitting_core.errors import InputError

pytestmark = pytest.mark.thorough


def clip(frames: int = 130, fps: float = 60.0) -> MotionClip:
    """Somebody who walks along +x without moving a joint, turned to there."""
    times = np.arange(frames) / fps
    pelvis = np.stack([times, np.full(frames, 0.8), np.full(frames, 3.0)], 1)
    facing = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    return MotionClip(
        name="walk",
        subject="deepmimic",
        source="deepmimic",
        fps=fps,
        body_pose=np.zeros((frames, 63)),
        orient=np.tile(facing, (frames, 1, 1)),
        pelvis=pelvis,
        feet=np.repeat(pelvis[:, None], 2, 1) * (1, 0, 1),
        leg=0.8,
        frames=np.arange(frames),
        dropped=0,
    )


@pytest.fixture
def plan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion_suite, "PLAN", {"climb": ("walk", "")})


def test_windows_are_turned_resampled_and_measured_in_legs(plan: None):
    (window,) = picked([clip()])
    assert 2 * FRAME_RATE <= len(window) <= 66 and window.half == "tuning" and not window.standing.any()
    np.testing.assert_allclose(window.pose[:, 0], 0, atol=1e-9)
    steps = np.diff(window.pelvis, axis=0)
    np.testing.assert_allclose(steps, np.tile([0, 0, 1 / FRAME_RATE / 0.8], (len(steps), 1)), atol=1e-9)
    np.testing.assert_allclose(window.pelvis.mean(0), [0, 1, 0], atol=1e-9)


def test_windows_do_not_bridge_dropped_frames(plan: None):
    gap = clip()
    frames = gap.frames + (np.arange(130) >= 60)
    with pytest.raises(InputError, match=r"longest stretch has 1\.\d s, expected 2"):
        picked([replace(gap, frames=frames)])


def test_feet_rest_that_hardly_move_for_some_frames():
    left = np.array([0.0] * 10 + [0.1] * 1 + [0.1] * 3 + list(0.1 + 0.02 * np.arange(1, 12)))
    feet = np.zeros((25, 2, 3))
    feet[:, 0, 0] = left
    found = at_rest(feet)
    assert found[:, 1].all() and found[:9, 0].all() and not found[9:, 0].any()


def test_real_motion_gives_the_shipped_windows(shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture):
    source = shared_data / "mocap"
    if not source.is_dir():
        pytest.skip(f"there is no motion capture at {source}")
    # DeepMimic's few files alone: all of CMU take half a minute to read.
    (tmp_path / "deepmimic").mkdir()
    for file in (source / "deepmimic").glob("humanoid3d_*.txt"):
        (tmp_path / "deepmimic" / file.name).write_bytes(file.read_bytes())
    own = {kind: halves for kind, halves in motion_suite.PLAN.items() if kind in ("floor", "acrobatics")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(motion_suite, "PLAN", own)
        assert len(load(tmp_path)) == 20
        main(Options(data=tmp_path, out=tmp_path / "made.npz"))
    assert "12 windows" in capsys.readouterr().out
    for name, window in read_windows(tmp_path / "made.npz").items():
        shipped = shipped_windows()[name]
        np.testing.assert_allclose(window.pelvis, shipped.pelvis, atol=1e-5)
        np.testing.assert_allclose(window.pose[:, 1:], shipped.pose[:, 1:], atol=2e-4)
        assert (window.half, window.kind) == (shipped.half, shipped.kind)
