"""Points in space from two views whose relation is known, and what counts where they disagree."""

from dataclasses import replace

import numpy as np
import pytest

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import body_keypoints_in_space
from fitting_core.camera import path_of
from fitting_core.clip import Clip, OtherView, Relation
from fitting_core.config.schema import PRESETS
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.stages import Stages
from fitting_core.fit.views.evidence import points_in_space
from fitting_core.ground.gravity import angles_to
from fitting_core.measure.limbs import limb_pa_mpjpe
from tests.samples.two_views import camera_at, motion, seen_from, without

AZIMUTHS = 10, 80
FRAMES = slice(0, 40)
WRIST, SHOULDER = kp.INDEX["right_wrist"], kp.INDEX["right_shoulder"]


def known_relation() -> Relation:
    one, two = (camera_at(azimuth) for azimuth in AZIMUTHS)
    turn = two.rotation @ one.rotation.T
    path = path_of(turn[None], (two.translation - turn @ one.translation)[None])
    return Relation(
        rotation=path.rotation[0],
        translation=path.translation[0],
        offset=0.0,
        rotation_deviation=0.0,
        direction_deviation=1.0,
        offset_deviation=0.0,
        disagreement=0.0,
        overlap=1.0,
        vertical_off=0.0,
    )


def pair(*, points: slice = kp.BODY, noise: float = 0.0) -> Clip:
    first, other = (seen_from(azimuth, frames=FRAMES, points=points, noise=noise) for azimuth in AZIMUTHS)
    return with_other(first, other)


def with_other(first: Clip, other: Clip) -> Clip:
    return replace(first, views=(OtherView(clip=other, relation=known_relation()),))


def true_points() -> np.ndarray:
    return camera_at(AZIMUTHS[0])(motion()[FRAMES])


def test_body_and_hands_are_where_they_are() -> None:
    clip, true = pair(points=slice(0, kp.HANDS.stop)), true_points()
    found = points_in_space(clip)
    located = np.asarray(np.isfinite(found.deviation).all(-1))
    assert located[:, kp.BODY].all() and located[:, kp.HANDS].any() and not located[:, kp.FACE].any()
    apart = found.points[:, : kp.HANDS.stop] - found.points[:, SHOULDER, None]
    off = apart - (true[:, : kp.HANDS.stop] - true[:, SHOULDER, None])
    assert abs(off[located[:, : kp.HANDS.stop]]).max() < 1e-3
    hips = found.points[:, [kp.INDEX["left_hip"], kp.INDEX["right_hip"]]].mean(1)
    assert np.linalg.norm(hips, axis=-1).max() < 0.15, "relative to the pelvis"
    assert not found.outvoted.any()


def test_deviations_are_larger_in_depth_for_views_at_an_acute_angle() -> None:
    deviation = points_in_space(pair()).deviation[:, SHOULDER]
    assert (deviation[:, 2] > deviation[:, 0]).all()
    assert ((deviation > 0.01) & (deviation < 0.05)).all()


def test_an_unsure_rotation_widens_deviations_with_the_distance_from_the_pelvis() -> None:
    clip = pair()
    view, known = clip.views[0], known_relation()
    unsure = replace(clip, views=(replace(view, relation=replace(known, rotation_deviation=10.0)),))
    before, after = points_in_space(clip), points_in_space(unsure)
    assert (after.points == before.points).all()
    there = np.isfinite(before.deviation).all(-1)
    away = np.linalg.norm(before.points, axis=-1)[there][:, None]
    more = np.square(after.deviation[there]) - np.square(before.deviation[there])
    assert more == pytest.approx(np.repeat(np.radians(10) ** 2 * away**2, 3, axis=1))


def test_up_is_nearer_to_the_truth_than_the_lifter_has_it(free_body: BodyModel) -> None:
    clip, up = pair(), camera_at(AZIMUTHS[0]).rotation @ [0.0, 1.0, 0.0]
    lifters = [Stages.of_clip(c, free_body, PRESETS["tcfit"]).lifter for c in (replace(clip, views=()), clip)]
    alone, both = (angles_to(one.lifted.up.mean(0), up) for one in lifters)
    assert both < 0.7 * alone


def test_frames_without_a_second_view_are_left_to_the_lifter() -> None:
    clip = pair()
    view = clip.views[0]
    gone = replace(view, clip=without(view.clip, slice(10, 20), slice(None)))
    found = points_in_space(replace(clip, views=(gone,)))
    assert np.isinf(found.deviation[10:20]).all()
    assert np.isfinite(found.deviation[:10, kp.BODY]).all() and np.isfinite(found.deviation[20:, kp.BODY]).all()


def test_what_only_the_second_view_shows_comes_from_its_lifter() -> None:
    clip = without(pair(), slice(10, 20), slice(WRIST, WRIST + 1))
    found, true = points_in_space(clip), true_points()
    apart = found.points[10:20, WRIST] - found.points[10:20, SHOULDER]
    assert np.isfinite(found.deviation[10:20, WRIST]).all()
    assert np.linalg.norm(apart - (true[10:20, WRIST] - true[10:20, SHOULDER]), axis=-1).max() < 0.2


@pytest.mark.parametrize(("confidence", "outvoted"), [(0.8, False), (0.3, True)])
def test_where_views_disagree_the_surer_one_counts(confidence: float, outvoted: bool) -> None:
    clip = pair()
    xy, sure = clip.keypoints.xy.copy(), clip.keypoints.confidence.copy()
    xy[5, WRIST] += (0, 300)
    sure[5, WRIST] = confidence
    found = points_in_space(replace(clip, keypoints=replace(clip.keypoints, xy=xy, confidence=sure)))
    assert bool(found.outvoted[5, WRIST]) == outvoted and found.outvoted.sum() == outvoted
    assert np.isfinite(found.deviation[5, WRIST]).all() == outvoted


def test_a_correction_in_the_second_view_counts() -> None:
    clip = pair()
    view = clip.views[0]
    x, y = view.clip.keypoints.xy[5, WRIST]
    corrected = replace(view, clip=view.clip.corrected(5, {"right_wrist": (x + 15, y)}))
    before, after = points_in_space(clip), points_in_space(replace(clip, views=(corrected,)))
    moved = np.linalg.norm(after.points - before.points, axis=-1)
    assert moved[5, WRIST] > 0.03 and np.delete(moved[:, WRIST], 5).max() < 1e-9
    assert (after.deviation[5, WRIST] < before.deviation[5, WRIST]).all()


def test_a_fit_takes_them_in_place_of_the_lifter(free_body: BodyModel) -> None:
    clip, config = pair(), PRESETS["tcfit"]
    depth = np.full(clip.keypoints.confidence.shape, np.nan)
    depth[5, WRIST] = 0.3
    clip = replace(clip, keypoints=replace(clip.keypoints, depth=depth))
    alone, both = (Stages.of_clip(c, free_body, config).observations for c in (replace(clip, views=()), clip))
    located = points_in_space(clip)
    np.testing.assert_allclose(both.relative_position[:, SHOULDER].numpy(), located.points[:, SHOULDER])
    assert np.isinf(alone.relative_position_deviation[:, SHOULDER, :2].numpy()).all()
    np.testing.assert_allclose(both.relative_position_deviation[:, SHOULDER].numpy(), located.deviation[:, SHOULDER])
    assert both.relative_position[5, WRIST, 2] == pytest.approx(0.3), "a person's statement of depth stays"


def test_kept_offsets_move_them_too(free_body: BodyModel) -> None:
    """By about half of what was stated, because they are located within 2 cm or so."""
    clip, located = pair(), points_in_space(pair())
    at = (5, 25)
    depths = {frame: located.points[frame, WRIST, 2] + 0.04 for frame in at}
    offset = kp.KeptOffset(keypoint=WRIST, frames=tuple(range(len(clip))), depths=depths)
    clip = replace(clip, keypoints=replace(clip.keypoints, kept=(offset,)))
    kept = Stages.of_clip(clip, free_body, PRESETS["tcfit"]).observations.relative_position.numpy()
    moved = kept - located.points
    assert (moved[:, WRIST, 2] > 0.01).all() and (moved[:, WRIST, 2] < 0.04).all()
    others = np.isfinite(located.deviation) & (np.arange(kp.COUNT) != WRIST)[:, None]
    assert np.abs(moved[others]).max() < 1e-6


def test_a_fit_without_the_lifter_says_that_views_do_not_count(free_body: BodyModel) -> None:
    clip, config = pair(), replace(PRESETS["tcfit"], last_phase=1, relay_rounds=0, limb_flips=False)
    clip = replace(clip, keypoints=clip.keypoints[:2])
    config = replace(config, weights=replace(config.weights, relative_position=(0.0,) * 5))
    assert any("Other views do not count" in note for note in fit_clip(clip, free_body, config).warnings)


@pytest.mark.thorough
def test_a_fit_of_two_views_is_nearer_to_the_truth(free_body: BodyModel) -> None:
    first, other = (seen_from(azimuth, seed=azimuth) for azimuth in AZIMUTHS)
    config = PRESETS["tcfit"]
    alone = fit_clip(first, free_body, config)
    both = fit_clip(first, free_body, config, views=[OtherView(clip=other)])
    true = camera_at(AZIMUTHS[0])(motion())[:, kp.LIMBS]
    errors = [
        limb_pa_mpjpe(body_keypoints_in_space(free_body, fit.last.params)[:, kp.LIMBS], true).mean()
        for fit in (alone, both)
    ]
    assert errors[1] < 0.75 * errors[0]
    assert any("from 80 is another view, 7" in note for note in both.warnings)
