"""What the normal equations say of joints and angles, beside chance and dense algebra; and error bars made of it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core.body.model import JOINT
from fitting_core.body.points.positions import joints_in_space
from fitting_core.config.schema import PRESETS, SolverSettings
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.solvers.sequence import Sequence
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.uncertainty import deviations as module
from fitting_core.fit.uncertainty.calibration import by_lens, calibrated, part_of
from fitting_core.fit.uncertainty.deviations import deviations
from fitting_core.fit.uncertainty.measured import LASTING, LIKE, OF_ANGLES, OF_JOINTS
from fitting_core.fit.variables.state import State
from fitting_core.keypoints import INDEX
from fitting_core.measure.angles.joint_angles import joint_angle
from fitting_core.motion import Motion
from fitting_core.results.error_bars import ANGLES, DIRECTIONS, JOINTS
from tests.fitting_core.fit.solvers.test_banded import dense
from tests.samples.posed_clips import CAMERA, clip_of, motion, shipped_body

pytestmark = pytest.mark.thorough

PRESET = PRESETS["tcfit"]
FRAMES, SAMPLES, SMALL = 4, 3000, 1e-3
ACROSS = DIRECTIONS.index("across")


@pytest.fixture(scope="module")
def known() -> tuple[Stages, State]:
    params = motion(FRAMES)
    stages = Stages.of_clip(clip_of(params), shipped_body(), PRESET)
    return stages, stages.parametrisation.from_params(params)


def test_deviations_are_those_of_chance(known: tuple[Stages, State]):
    """States drawn with the dense inverse as covariance, so near that everything is straight."""
    stages, state = known
    objective = stages.objective(N_STAGES, state, stages.free(N_STAGES, betas=False))
    _, _, *bands = Sequence(objective, state, range(FRAMES)).normal(state, torch.zeros(1, dtype=torch.long))
    root = torch.linalg.cholesky(torch.linalg.inv(dense([band[0] for band in bands])))
    draw = torch.randn(SAMPLES, len(root), generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    moves = (SMALL * draw @ root.T).view(SAMPLES, FRAMES, -1)
    frame, own = 1, state[1:2]
    drawn = State.cat([own.moved(objective.step(move[frame : frame + 1])) for move in moves])
    params = stages.parametrisation.to_params(drawn)
    found, body = deviations(stages, state), shipped_body()
    joints = joints_in_space(body, params)[:, : len(JOINTS)]
    relative, middle = joints - joints[:, :1], joints.mean(0)
    ray = middle / np.linalg.norm(middle, axis=-1, keepdims=True)
    along = (relative * ray).sum(-1).std(0)
    across = np.sqrt((relative.var(0).sum(-1) - along**2) / 2)
    np.testing.assert_allclose(found.joints[frame] * SMALL, np.stack([along, across], -1), rtol=0.06, atol=1e-9)
    moved = Motion(body=body, params=params, camera=CAMERA, frame_rate=30.0, name="drawn")
    angles = [joint_angle(moved, name).std() for name in ANGLES]
    np.testing.assert_allclose(found.angles[frame] * SMALL, angles, rtol=0.06)


def test_a_clip_in_parts_is_as_sure_as_in_one(monkeypatch: pytest.MonkeyPatch):
    params = motion(70)
    stages = Stages.of_clip(clip_of(params), shipped_body(), PRESET)
    state = stages.parametrisation.from_params(params)
    whole = deviations(stages, state)
    monkeypatch.setattr(module, "_PART", 40)
    parts = deviations(stages, state)
    np.testing.assert_allclose(parts.joints, whole.joints, rtol=2e-3, atol=1e-6)
    np.testing.assert_allclose(parts.angles, whole.angles, rtol=2e-3)


def test_every_joint_and_angle_is_calibrated_and_what_is_less_sure_stays_so(known: tuple[Stages, State]):
    assert {part_of(name) for name in JOINTS} == {"pelvis", *OF_JOINTS}
    assert {part_of(name) for name in ANGLES} == {*OF_ANGLES}
    assert all(len(rows) == len(DIRECTIONS) for rows in (*OF_JOINTS.values(), *LASTING.values()))
    assert {LIKE.get(part, part) for part in OF_JOINTS} == set(LASTING)
    found = deviations(*known)
    bars, wider = calibrated(found), calibrated(replace(found, joints=2 * found.joints, angles=2 * found.angles))
    assert (bars.joints[:, 0] == 0).all() and (bars.joints[:, 1:] > found.joints[:, 1:]).all()
    told = [OF_ANGLES[part_of(name)][0] > 0 for name in ANGLES]  # of others the deviations say nothing
    assert (wider.joints[:, 1:] > bars.joints[:, 1:]).all() and ((wider.angles > bars.angles) == told).all()
    assert sum(told) > len(ANGLES) / 2


def test_a_lens_that_is_off_turns_a_body_beside_the_axis():
    """Its pixels stay, so the ray through them turns, and the body with it."""
    joints = np.array([1.5, -0.8, 4.0]) + np.random.default_rng(0).uniform(-1, 1, (1, 9, 3)) * 0.5
    off = 0.01
    ray = joints[0, 0] / np.linalg.norm(joints[0, 0])
    other = ray * [np.exp(-off), np.exp(-off), 1.0]
    turn = Rotation.align_vectors(other[None] / np.linalg.norm(other), ray[None])[0]
    relative = joints[0] - joints[0, 0]
    moved = turn.apply(relative) - relative
    along = moved @ ray
    across = np.sqrt((np.square(moved).sum(1) - along**2) / 2)
    np.testing.assert_allclose(by_lens(joints, off)[0], np.stack([abs(along), across], 1), rtol=0.02, atol=1e-5)


def test_a_fit_has_error_bars_of_its_last_phase_and_wide_ones_of_what_is_not_seen():
    clip = clip_of(motion(6))
    confidence = clip.keypoints.confidence.copy()
    confidence[:, [INDEX["left_wrist"], INDEX["left_elbow"]]] = 0
    hidden = replace(clip, keypoints=replace(clip.keypoints, confidence=confidence))
    quick = replace(PRESET, relay_rounds=0, limb_flips=False, settings=SolverSettings(iterations=3))
    fit = fit_clip(hidden, shipped_body(), quick)
    assert [phase.error_bars is not None for phase in fit.phases] == [False, False, True]
    bars = fit.last.error_bars
    assert bars is not None and np.isfinite(bars.joints).all() and np.isfinite(bars.angles).all()
    hidden_wrist, seen_wrist = (bars.joints[:, JOINT[f"{side}_wrist"], ACROSS] for side in ("left", "right"))
    assert (hidden_wrist > 2 * seen_wrist).all()
    none = (0.0,) * N_STAGES
    without = replace(quick, weights=replace(quick.weights, relative_position=none, held_position=none))
    assert fit_clip(hidden, shipped_body(), without).last.error_bars is None


def test_one_usable_frame_in_six_has_error_bars_like_a_clip_of_its_own():
    """E_T alone holds the place of the others, which may drift evenly: their normal equations have no inverse."""
    clip = clip_of(motion(6))
    confidence = clip.keypoints.confidence.copy()
    confidence[1:] = 0
    quick = replace(PRESET, relay_rounds=0, limb_flips=False, settings=SolverSettings(iterations=3))
    lonely = replace(clip, keypoints=replace(clip.keypoints, confidence=confidence))
    bars = fit_clip(lonely, shipped_body(), quick).last.error_bars
    assert bars is not None and np.isfinite(bars.joints).all() and np.isfinite(bars.angles).all()
    assert (bars.joints[0, 1:] < 0.3).all() and bars.joints[0].max() <= bars.joints[1:].max()
