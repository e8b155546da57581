"""A given start: placing bodies by their keypoints, what is held near it, and fits that begin with it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space
from fitting_core.fit.events import drained
from fitting_core.fit.evidence.given_start import (
    FOLLOWS,
    corrected_start,
    from_pelvis,
    given_start,
    place_by_keypoints,
    state_of,
    steadied,
)
from fitting_core.fit.fitting import fit_clip, rerun_events, shape_events
from fitting_core.fit.phase_figures import evaluate_objective, patched
from fitting_core.fit.stages import Stages
from fitting_core.keypoints import Keypoints
from fitting_core.metrics import point_error
from fitting_core.results.given_start import GivenStart, KnownShape, StartRecord
from fitting_core.results.provenance import Start
from tests.samples import scenes
from tests.samples.scenes import CAMERA, arms_in_motion, clip_of, hidden, keypoints_of
from tests.samples.told_twist import with_told_twist

QUICK = replace(scenes.QUICK, last_phase=1)
ABOUT = StartRecord(
    source="result.pt",
    format="TRAM result",
    person=None,
    frames=0,
    clip_frames=0,
    focal=CAMERA.focal,
    focal_source="told by the result",
    off=0.0,
)
ELBOW = kp.INDEX["left_elbow"]


def body_seen(body: BodyModel, params: BodyParams) -> Keypoints:
    return hidden(keypoints_of(body, params), kp.HANDS, kp.FACE)


def start_of(
    body: BodyModel, params: BodyParams, keypoints: Keypoints, *, there: list[bool] | None = None
) -> GivenStart:
    has = np.array(there or [True] * len(params))
    return given_start(params, has, keypoints, CAMERA, body, about=ABOUT)


def moved(params: BodyParams, metres: tuple[float, float, float]) -> BodyParams:
    return replace(params, camera_translation=params.camera_translation + torch.tensor(metres))


def test_bodies_are_placed_where_their_keypoints_are(free_body: BodyModel):
    """From a place that is far off, and with a detection that is."""
    truth = arms_in_motion(3)
    keypoints = body_seen(free_body, truth)
    wild = replace(keypoints, xy=keypoints.xy + np.where(np.arange(kp.COUNT)[:, None] == ELBOW, 150.0, 0.0))
    pelvis = joints_in_space(free_body, truth)[:, JOINT["pelvis"]]
    for seen, near in ((keypoints, 1e-5), (wild, 0.02)):
        found = place_by_keypoints(from_pelvis(free_body, truth), seen, CAMERA)
        assert np.abs(found.pelvis - pelvis).max() < near
        assert found.median_off.max() < near
    start = start_of(free_body, moved(truth, (0.5, -0.2, 1.5)), keypoints)
    assert float((start.params.camera_translation - truth.camera_translation).abs().max()) < 1e-5


def test_frames_with_too_few_keypoints_are_placed_between_others(free_body: BodyModel):
    """And where the fit is held near the start they count: nothing else tells of them."""
    truth = arms_in_motion(3)
    three = hidden(body_seen(free_body, truth), slice(3, kp.COUNT), frames=slice(1, 2))
    start = start_of(free_body, moved(truth, (0.4, 0.0, 1.0)), three)
    assert start.there.all() and np.isfinite(start.off).all()
    assert float((start.params.camera_translation - truth.camera_translation).abs().max()) < 0.05
    for deviation, given in ((None, [True, False, True]), (0.05, [True, True, True])):
        stages = Stages.of(three, CAMERA, free_body, replace(QUICK, start_deviation=deviation), start=start)
        assert stages.given.tolist() == given
    config = replace(QUICK, start_deviation=0.05)
    found = fit_clip(clip_of(three), free_body, config, start=start).last.params
    assert point_error(from_pelvis(free_body, found), from_pelvis(free_body, truth)).max() < 25
    nobody = hidden(three, slice(3, kp.COUNT))
    assert not start_of(free_body, truth, nobody).there.any()


def test_frames_that_do_not_follow_the_keypoints_are_left_out(free_body: BodyModel):
    truth = arms_in_motion(3)
    lying = truth.global_orient.clone()
    lying[1] = torch.tensor([0.0, 0.0, 1.5])
    start = start_of(free_body, replace(truth, global_orient=lying), body_seen(free_body, truth))
    assert start.there.tolist() == [True, False, True]
    assert start.about.frames == 2 and start.about.clip_frames == 3 and start.about.off < FOLLOWS


def test_hands_of_any_number_of_components_become_those_of_the_fit(free_body: BodyModel):
    truth = arms_in_motion(2)
    truth = replace(truth, left_hand_pose=truth.left_hand_pose + 0.3)
    start = start_of(free_body, truth, body_seen(free_body, truth))
    stages = Stages.of(body_seen(free_body, truth), CAMERA, free_body, QUICK, start=start)
    found = stages.parametrisation.to_params(state_of(start, stages.parametrisation))
    assert start.tells_hands and torch.allclose(found.left_hand_pose, truth.left_hand_pose, atol=1e-6)
    still = replace(truth, left_hand_pose=0 * truth.left_hand_pose, right_hand_pose=0 * truth.right_hand_pose)
    assert not start_of(free_body, still, body_seen(free_body, truth)).tells_hands


@pytest.mark.parametrize(("rate", "left"), [(25.0, 0.218), (60.0, 0.086), (5.0, 1.0)])
def test_what_trembles_is_not_held(free_body: BodyModel, rate: float, left: float):
    """White noise keeps that share of its second differences, by the filter's coefficients; what moves evenly, gaps and
    points that are not there stay as they are."""
    frames = 80
    start = start_of(free_body, arms_in_motion(frames), body_seen(free_body, arms_in_motion(frames)))
    seconds = np.arange(frames)[:, None, None] / rate
    even = np.broadcast_to(0.3 + 0.8 * seconds - 1.5 * seconds**2, start.points.shape)
    there = np.arange(frames) != 40
    points = np.where(np.isfinite(start.points), even, np.nan)
    steady = steadied(replace(start, points=points, there=there), rate).points
    assert np.allclose(steady, points, equal_nan=True)
    noise = np.random.default_rng(3).normal(0.0, 0.01, points.shape)
    trembling = steadied(replace(start, points=points + noise, there=there), rate).points
    assert np.array_equal(trembling[40], (points + noise)[40], equal_nan=True)
    second = [np.nanstd(np.diff(some[41:] - points[41:], 2, axis=0)) for some in (trembling, points + noise)]
    assert second[0] <= 1.1 * left * second[1]


def held(body: BodyModel, deviation: float | None, **weights: tuple[float, ...]) -> Stages:
    truth = arms_in_motion(2)
    keypoints = hidden(body_seen(body, truth), [ELBOW])
    config = replace(QUICK, start_deviation=deviation, weights=replace(QUICK.weights, **weights))
    return Stages.of(keypoints, CAMERA, body, config, start=start_of(body, truth, keypoints))


def test_held_points_count_where_no_stage_asks_the_lifter(free_body: BodyModel):
    stages = held(free_body, 0.1)
    assert not any(stages.config.weights.relative_position)
    assert stages.start is not None
    near = state_of(stages.start, stages.parametrisation)
    away = replace(near, vector=stages.parametrisation.neutral(2).vector)
    costs = []
    for state in (near, away):
        objective = stages.objective(5, state, stages.free(5, betas=True))
        costs.append(float(objective.costs(state, stages.all_frames)["relative_position"].sum()))
    assert costs[0] < 1 and costs[1] > 100


def test_lifter_and_start_are_averaged_by_variance_and_loosely_where_they_disagree(free_body: BodyModel):
    alone, own = held(free_body, None, relative_position=(6.0,) * 5), held(free_body, 0.1)
    both = held(free_body, 0.1, relative_position=(6.0,) * 5).observations
    wrist = kp.INDEX["right_wrist"]
    (p, s), (q, t), (found, spread) = (
        (o.relative_position[:, wrist, 2], o.relative_position_deviation[:, wrist, 2])
        for o in (alone.observations, own.observations, both)
    )
    assert torch.allclose(found, (p / s**2 + q / t**2) / (s**-2 + t**-2))
    scale = ((p - q) ** 2 / (s**2 + t**2)).clamp_min(1)
    assert torch.allclose(spread, (scale / (s**-2 + t**-2)).sqrt())


def test_phase_1_begins_with_the_start_and_searches_where_there_is_none(free_body: BodyModel):
    free_body = with_told_twist(free_body)
    truth = arms_in_motion(6)
    keypoints = body_seen(free_body, truth)
    off = replace(truth, body_pose=truth.body_pose + 0.05)
    start = start_of(free_body, off, keypoints, there=[True, True, False, False, True, True])
    first = fit_clip(clip_of(keypoints), free_body, QUICK, start=start).phases[0]
    assert first.provenance is not None
    given = first.provenance.start == Start.GIVEN
    assert given.tolist() == [True, True, False, False, True, True]
    alone = fit_clip(clip_of(keypoints), free_body, QUICK).phases[0]
    # One of the four is in another minimum than the search's, 6 % above it; the others are 4 to 7 % below.
    assert first.frame_cost[given].sum() < alone.frame_cost[given].sum()
    np.testing.assert_allclose(first.frame_cost[~given], alone.frame_cost[~given], rtol=1e-6)


def test_a_start_on_the_other_side_in_depth_is_kept_if_it_is_held(free_body: BodyModel):
    """An arm that reaches back looks the same as one that reaches forward: the start says which."""
    truth = reaching_back()
    keypoints = body_seen(free_body, truth)
    config = replace(QUICK, start_deviation=0.05, last_phase=3)
    fits = [
        fit_clip(clip_of(keypoints), free_body, config, start=start)
        for start in (start_of(free_body, truth, keypoints), None)
    ]
    wrist, pelvis = JOINT["left_wrist"], JOINT["pelvis"]
    true = joints_in_space(free_body, truth)
    errors = []
    for fit in fits:
        found = joints_in_space(free_body, fit.last.params)
        errors.append(point_error(found[:, [wrist]] - found[:, [pelvis]], true[:, [wrist]] - true[:, [pelvis]]).max())
    assert errors[0] < 30 and errors[0] < 0.5 * errors[1]


def test_a_fit_tells_its_start(free_body: BodyModel):
    truth = arms_in_motion(2)
    keypoints = body_seen(free_body, truth)
    config = replace(QUICK, start_deviation=0.08)
    start = start_of(free_body, truth, keypoints, there=[True, False])
    result = fit_clip(clip_of(keypoints), free_body, config, start=start)
    assert result.start is not None and result.start.about.frames == 1
    told = [warning for warning in result.warnings if "result.pt" in warning]
    assert (
        len(told) == 1 and "in 1 of 2 frames" in told[0] and told[0].endswith("held near it (start_deviation 0.08 m).")
    )
    assert fit_clip(clip_of(keypoints), free_body, config).start is None


def reaching_back() -> BodyParams:
    truth = arms_in_motion(3)
    pose = truth.body_pose.clone()
    pose[:, 3 * (JOINT["left_shoulder"] - 1) : 3 * JOINT["left_shoulder"]] = torch.tensor([0.0, 1.1, -0.3])
    return replace(truth, body_pose=pose)


@pytest.mark.thorough
def test_what_is_fitted_again_has_the_same_evidence(free_body: BodyModel):
    """Frames of a fit that was held near its start, and their figures."""
    truth = reaching_back()
    keypoints = body_seen(free_body, truth)
    clip, start = clip_of(keypoints), start_of(free_body, truth, keypoints)
    config = replace(QUICK, start_deviation=0.05, last_phase=3)
    fit = fit_clip(clip, free_body, config, start=start)
    away, window = fit_clip(clip, free_body, config).last.params, range(1, 3)
    wrist, pelvis = JOINT["left_wrist"], JOINT["pelvis"]
    true = joints_in_space(free_body, truth)
    off, held = [], fit.start
    for given in (held, None):
        found = drained(rerun_events(clip, free_body, config, away, window, start=given)).params
        joints = joints_in_space(free_body, found)
        off.append(point_error(joints[1:3, [wrist]] - joints[1:3, [pelvis]], true[1:3, [wrist]] - true[1:3, [pelvis]]))
    assert off[0].max() < 0.7 * off[1].min(), "it is drawn to the start from the wrong side in depth"
    costs = evaluate_objective(clip, free_body, config, away, start=held).frame_cost
    assert (costs > evaluate_objective(clip, free_body, config, away).frame_cost + 1).all()
    before = replace(fit.last, frame_cost=np.zeros(4))
    again = patched(before, Stages.of_clip(clip, free_body, config, start=held), away, [window], note="")
    np.testing.assert_allclose(again.frame_cost, [0, *costs[1:3], 0])


def test_a_start_gives_way_where_a_person_has_put_a_keypoint_elsewhere(free_body: BodyModel):
    truth = arms_in_motion(3)
    keypoints = body_seen(free_body, truth)
    start = start_of(free_body, truth, keypoints)
    assert corrected_start(start, keypoints, CAMERA) is start
    depth = joints_in_space(free_body, truth)[1, JOINT["left_elbow"], 2]
    xy, by_hand = keypoints.xy.copy(), keypoints.placed.copy()
    xy[1, ELBOW, 0] += 0.3 / depth * CAMERA.focal[0]
    by_hand[1, ELBOW] = True
    config = replace(QUICK, start_deviation=0.05)
    stages = Stages.of(replace(keypoints, xy=xy, by_hand=by_hand), CAMERA, free_body, config, start=start)
    spread = stages.observations.relative_position_deviation[:, ELBOW, 2]
    assert float(spread[1]) == pytest.approx(np.hypot(0.05, 0.3 / np.sqrt(2)), rel=0.05)
    assert float(spread[0]) == pytest.approx(0.05, rel=0.05)


def test_a_known_shape_is_taken(free_body: BodyModel):
    keypoints = body_seen(free_body, arms_in_motion(2))
    betas = np.linspace(-1, 1, 10)
    config = replace(QUICK, last_phase=2)
    fit = fit_clip(clip_of(keypoints), free_body, config, shape=KnownShape(betas=betas, source="her.npz"))
    assert np.allclose(fit.last.params.betas.numpy(), betas) and "shape as given from her.npz" in fit.warnings
    again = drained(shape_events(clip_of(keypoints), free_body, config, fit, shape=KnownShape(betas=-betas)))
    assert np.allclose(again.last.params.betas.numpy(), -betas) and "shape as given" in again.warnings
