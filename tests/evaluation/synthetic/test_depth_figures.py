"""Figures of the third dimension, on fits that are wrong in a known way."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from evaluation.synthetic.motion_suite.clips import MotionClipMade, make_motion, motion_sequences
from evaluation.synthetic.motion_suite.depth_figures import (
    DEPTH_CURVES,
    PART_CURVES,
    DepthRecord,
    depth_figures,
    measured,
)
from fitting_core.body.model import JOINT
from fitting_core.keypoints import COUNT

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def made() -> MotionClipMade:
    """A clip whose truth was made without looking what is hidden, which no figure depends on."""
    with pytest.MonkeyPatch.context() as patch:
        everything = "evaluation.synthetic.motion_suite.clips.in_view"
        patch.setattr(everything, lambda body, params, camera: np.ones((len(params), COUNT), bool))
        return make_motion(motion_sequences()["14_05_1"], cached=False)


def row(made: MotionClipMade, joints: np.ndarray) -> dict[str, float | None]:
    record = measured(made, joints, method="x", seconds=0.0)
    return depth_figures([record], "")["all"] | depth_figures([record], "", PART_CURVES)["all"]


def test_the_truth_is_right(made: MotionClipMade):
    found = row(made, made.truth.joints)
    assert found["Slip, mm/s"] == found["True slip, mm/s"] and 0 < found.pop("Slip, mm/s") < 60
    found.pop("True slip, mm/s")
    assert len(found) == sum(len(c.statistics) for c in (DEPTH_CURVES | PART_CURVES).values()) - 2
    assert all(value == pytest.approx(0, abs=2e-3) for value in found.values())


def test_too_far_away_is_an_error_of_depth_alone(made: MotionClipMade):
    found = row(made, made.truth.joints + np.array([0, 0, 0.1]))
    assert found["Depth, mm"] == pytest.approx(100)
    mean = (10 / made.truth.joints[:, JOINT["pelvis"], 2]).mean()
    assert found["Depth, %"] == pytest.approx(mean)
    assert found["MPJPE, mm"] == pytest.approx(0, abs=1e-6) and found["Lean, °"] == pytest.approx(0, abs=2e-3)


def test_a_lean_is_what_pa_hides(made: MotionClipMade):
    pelvis = made.truth.joints[:, JOINT["pelvis"], None]
    towards = Rotation.from_rotvec([np.radians(10), 0, 0]).as_matrix()  # y down: the head, at -y, comes nearer
    found = row(made, (made.truth.joints - pelvis) @ towards.T + pelvis)
    assert found["PA-MPJPE, mm"] == pytest.approx(0, abs=1e-3) and found["MPJPE, mm"] > 20
    assert 8 < found["Lean, °"] <= 10.001
    assert found["Neck nearer, °"] == pytest.approx(found["Lean, °"], rel=0.1)


def test_feet_slip_that_move_where_the_true_ones_rest(made: MotionClipMade):
    seconds = np.arange(len(made.clip)) / made.clip.frame_rate
    found = row(made, made.truth.joints + seconds[:, None, None] * [0.5, 0, 0])
    assert found["Slip, mm/s"] == pytest.approx(500, rel=0.05)
    assert found["Acceleration, m/s²"] == pytest.approx(0, abs=1e-6)


def test_joints_out_of_the_image_count_for_the_whole_and_not_for_their_part(made: MotionClipMade):
    inside = made.inside.copy()
    inside[:, [JOINT["left_ankle"], JOINT["right_ankle"]]] = False
    wrong = made.truth.joints.copy()
    wrong[:, JOINT["left_ankle"], 2] += 0.3
    found = row(replace(made, inside=inside), wrong)
    assert found["Ankle, mm"] is None and found["Knee, mm"] == pytest.approx(0, abs=1e-6)
    assert found["PA-MPJPE, mm"] > 5 and found["PA-MPJPE in image, mm"] == pytest.approx(0, abs=1e-6)
    assert found["MPJPE, mm"] == pytest.approx(300 / 12)


def test_frames_are_pooled_by_label():
    def record(directions: tuple[str, ...], values: tuple[float | None, ...]) -> DepthRecord:
        curves = {name: values for name in DEPTH_CURVES}
        return DepthRecord(
            sequence="a", method="x", kind="dance", cut="hip", directions=directions, seconds=0.0, curves=curves
        )

    records = [record(("front", "side"), (1.0, 5.0)), record(("front", "front"), (3.0, None))]
    found = depth_figures(records, "view")
    assert found["front"]["MPJPE, mm"] == 2 and found["side"]["MPJPE, mm"] == 5
    assert found["front"]["PA-MPJPE p90, mm"] == pytest.approx(2.8)
    assert list(depth_figures(records, "cut")) == ["hip"] and list(depth_figures(records, "motion")) == ["dance"]
    assert depth_figures(records, "")["all"]["Lean, °"] == 3
