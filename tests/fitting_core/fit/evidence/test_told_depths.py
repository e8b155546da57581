"""Depths that a person said of keypoints: what the fit makes of them, in every preset."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.fit.evidence.kept_offsets import STATED
from fitting_core.fit.fitting import rerun_events
from fitting_core.fit.phases.limb_flips import LIMBS, LimbFlips, mirrored_as_told
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.positions import RelativePosition
from fitting_core.fit.variables.state import Free
from fitting_core.keypoints import KeptOffset
from tests.samples.posed_clips import clip_of, motion, shipped_body
from tests.samples.scenes import finished, let_lift

FRAMES, FRAME = 9, 4
SHOULDER, ELBOW, WRIST = (kp.INDEX[f"right_{n}"] for n in ("shoulder", "elbow", "wrist"))


@pytest.fixture(scope="module")
def params() -> BodyParams:
    """The right arm reaches forward and bends."""
    made = motion(FRAMES)
    pose = made.body_pose.clone()
    shoulder, elbow = (slice(3 * n, 3 * n + 3) for n in (16, 18))
    pose[:, shoulder] = torch.tensor([0.0, 1.0, 0.5], dtype=torch.float64)
    pose[:, elbow] = torch.tensor([0.0, 0.5, 0.0], dtype=torch.float64)
    return replace(made, body_pose=pose)


@pytest.fixture(scope="module")
def clip(params: BodyParams) -> Clip:
    return clip_of(params, noise=0.5)


def depths(params: BodyParams) -> np.ndarray:
    """Behind the pelvis, metres, (T, 137)."""
    body = shipped_body()
    return keypoints_in_space(body, params)[0][..., 2] - joints_in_space(body, params)[:, :1, 2]


def told(clip: Clip, frames: list[int], joints: list[int], values: np.ndarray) -> Clip:
    depth = clip.keypoints.told_depth.copy()
    depth[np.ix_(frames, joints)] = values
    return replace(clip, keypoints=replace(clip.keypoints, depth=depth))


def config_of(preset: str) -> FitConfig:
    config = PRESETS[preset]
    weights = replace(config.weights, collision=(0.0,) * 5, held_position=(0.0,) * 5)
    temporal = replace(config.temporal, stages=(5,))
    return replace(config, pose_prior="relaxed", solver="lm", weights=weights, temporal=temporal)


def refitted(clip: Clip, params: BodyParams, preset: str, frames: range) -> np.ndarray:
    return depths(finished(rerun_events(clip, shipped_body(), config_of(preset), params, frames)).params)


def mirrored(params: BodyParams) -> np.ndarray:
    """The depths of elbow and wrist on the other side of the shoulder."""
    found = depths(params)
    return 2 * found[:, [SHOULDER]] - found[:, [ELBOW, WRIST]]


@pytest.mark.parametrize(
    "preset", ["tcfit", *(pytest.param(p, marks=pytest.mark.thorough) for p in ("smplifyx", "paper"))]
)
def test_the_fit_follows_a_depth_in_every_preset(clip: Clip, params: BodyParams, preset: str):
    """An arm goes to the other side of its shoulder, where the image shows it alike; its neighbours come along."""
    before, target = depths(params), mirrored(params)
    assert abs(target - before[:, [ELBOW, WRIST]]).min(0)[1] > 0.3
    one = refitted(told(clip, [FRAME], [ELBOW, WRIST], target[[FRAME]]), params, preset, range(1, 8))
    assert abs(one[FRAME, [ELBOW, WRIST]] - target[FRAME]).max() < 0.04
    way = (one - before)[:, WRIST] / (target - before[:, [ELBOW, WRIST]])[:, 1]
    assert way[FRAME - 1] > 0.3 < way[FRAME + 1] and not way[[0, 8]].any()
    every = list(range(1, 8))
    whole = refitted(told(clip, every, [ELBOW, WRIST], target[1:8]), params, preset, range(1, 8))
    assert abs(whole[2:7][:, [ELBOW, WRIST]] - target[2:7]).max() < 0.04


def test_a_person_overrides_the_lifter(clip: Clip, params: BodyParams, monkeypatch: pytest.MonkeyPatch):
    """In depth alone, and in the told cells alone; and its word counts however far off the limb is."""
    let_lift(monkeypatch, np.full((25, 3), 0.3))
    said, config = told(clip, [FRAME], [WRIST], np.array(-0.5)), config_of("tcfit")
    stages = Stages.of(said.keypoints, said.camera, shipped_body(), config)
    o = stages.observations
    assert o.relative_position[FRAME, WRIST, 2] == -0.5 and o.relative_position_deviation[FRAME, WRIST, 2] == STATED
    others = torch.ones(FRAMES, 25, dtype=torch.bool)
    others[FRAME, WRIST] = False
    assert bool((o.relative_position[:, kp.BODY, 2][others] == 0.3).all()) and int(o.depth_by_hand.sum()) == 1
    terms = stages.objective(5, stages.parametrisation.from_params(params), Free()).terms
    (term,) = (term for term in terms if isinstance(term, RelativePosition))
    column = stages.looked_at(5).tolist().index(WRIST)
    lifter = config.robust_deviations * o.relative_position_deviation[FRAME, ELBOW, 2]
    assert term.rho[FRAME, column, 2] >= 3.0 > 2 * lifter == 2 * term.rho[FRAME, column - 1, 2]


def test_a_fit_follows_a_kept_depth_in_all_frames(clip: Clip, params: BodyParams, monkeypatch: pytest.MonkeyPatch):
    """Where the depth of one frame alone changes its neighbours; a preset without the lifter ignores it."""
    points = keypoints_in_space(shipped_body(), params)[0][:, kp.BODY] - joints_in_space(shipped_body(), params)[:, :1]
    let_lift(monkeypatch, points)
    body, before, frame, by = shipped_body(), depths(params), 4, 0.1
    there = told(clip, [frame], [WRIST], before[frame, WRIST] + by)
    kept = KeptOffset(keypoint=WRIST, frames=tuple(range(len(clip))), depths={frame: before[frame, WRIST] + by})
    lasting = replace(there, keypoints=replace(there.keypoints, kept=(kept,)))

    def fitted(of: Clip, preset: str) -> np.ndarray:
        return depths(finished(rerun_events(of, body, config_of(preset), params, range(len(clip)))).params)[:, WRIST]

    alone, everywhere, plain = (fitted(one, "tcfit") for one in (there, lasting, clip))
    assert abs(alone - plain)[0] < 0.02 < 0.5 * (everywhere - plain)[0]
    np.testing.assert_array_equal(fitted(lasting, "paper"), fitted(there, "paper"))
    # Of a taller person, whose lifted points are farther from the pelvis, that depth is what the lifter says.
    agreed = replace(kept, depths={frame: 1.2 * points[frame, WRIST, 2]})
    tall = replace(clip, keypoints=replace(clip.keypoints, kept=(agreed,)))
    observed = Stages.of_clip(tall, body, config_of("tcfit"), size=1.2).observations.relative_position[:, WRIST]
    np.testing.assert_allclose(observed, 1.2 * points[:, WRIST])


def test_a_depth_of_a_frame_goes_before_the_offset(clip: Clip, params: BodyParams):
    kept = KeptOffset(keypoint=WRIST, frames=(3, 4), depths={4: 0.5})
    said = told(clip, [4], [WRIST], np.array(0.5))
    both = replace(said, keypoints=replace(said.keypoints, kept=(kept,)))
    of = [Stages.of_clip(one, shipped_body(), config_of("tcfit")).observations for one in (said, both)]
    names = "relative_position", "relative_position_deviation"
    z, deviation = (np.stack([getattr(o, name)[:, WRIST, 2].numpy() for o in of]) for name in names)
    assert z[1, 4] == 0.5 and (z[0] != z[1]).nonzero()[0].tolist() == [3]
    assert deviation[1, 3] < deviation[0, 3] and deviation[1, 4] == deviation[0, 4]


def test_without_a_word_nothing_changes(clip: Clip):
    """No term in presets that do not ask the lifter, and none where nothing is told."""
    stages = Stages.of(clip.keypoints, clip.camera, shipped_body(), config_of("paper"))
    objective = stages.objective(5, stages.parametrisation.neutral(FRAMES), Free())
    assert not any(isinstance(term, RelativePosition) for term in objective.terms)
    said = told(clip, [0], [WRIST], np.array(0.1))
    part = Stages.of(said.keypoints, said.camera, shipped_body(), config_of("paper")).within(range(2, 6))
    objective = part.objective(5, part.parametrisation.neutral(4), Free())
    assert not any(isinstance(term, RelativePosition) for term in objective.terms)


def test_a_limb_that_bends_the_other_way_is_found(clip: Clip, params: BodyParams):
    """The knee of a leg behind the body: from the front, a descent does not come through the straight leg."""
    pose = params.body_pose.clone()
    pose[:, 0:3] = torch.tensor([0.5, 0.0, 0.0], dtype=torch.float64)
    pose[:, 9:12] = torch.tensor([1.2, 0.0, 0.0], dtype=torch.float64)
    true = replace(params, body_pose=pose)
    seen, leg = clip_of(true, noise=0.5), [kp.INDEX["left_knee"], kp.INDEX["left_ankle"]]
    stages = Stages.of(seen.keypoints, seen.camera, shipped_body(), config_of("tcfit"))
    state = stages.parametrisation.from_params(true)
    flipped = LimbFlips(stages).flipped(state, LIMBS["left_leg"], upper=True, lower=True)
    wrong = replace(true, body_pose=flipped)
    target, every = depths(true)[:, leg], list(range(FRAMES))
    assert abs(depths(wrong)[:, leg] - target).max() > 0.3
    found = refitted(told(seen, every, leg, target), wrong, "tcfit", range(FRAMES))
    assert abs(found[:, leg] - target).max() < 0.05
    changed = mirrored_as_told(stages, state, stages.all_frames)
    assert torch.equal(changed.vector, state.vector), "nothing is told"
