"""Feet are held where they stand, and never against what the image shows."""

from dataclasses import replace

import numpy as np
import pytest

from fitting_core import metrics
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.grounded import holding_feet
from fitting_core.fit.phase_figures import patched
from fitting_core.fit.stages import Stages
from tests.samples.carried import CARRIED, RATE, Carried, carried_clip, gesturing, pixel_errors

pytestmark = pytest.mark.thorough

FRAMES = 50
ANKLES = [7, 8]


def without_held_feet(config: FitConfig) -> FitConfig:
    return replace(config, weights=replace(config.weights, held_position=(0.0,) * 5))


@pytest.mark.parametrize("motion", [name for name in CARRIED if name != "standing"])
def test_feet_that_go_on_in_the_image_are_let_go(free_body: BodyModel, motion: str):
    clip = carried_clip(free_body, gesturing(CARRIED[motion], frames=FRAMES))
    fits = [fit_clip(clip, free_body, config) for config in (PRESETS["tcfit"], without_held_feet(PRESETS["tcfit"]))]
    held, free = (np.percentile(pixel_errors(free_body, fit.last.params, clip), 95) for fit in fits)
    assert held <= 1.2 * free
    grounding = fits[0].grounding
    assert grounding is not None and grounding.contacts.let_go.mean() > 0.9 and "goes on in the image" in grounding.text
    assert any("are not held: left 0-49, right 0-49" in warning for warning in fits[0].warnings)


def test_feet_that_stand_are_held(free_body: BodyModel):
    truth = gesturing(Carried(), frames=FRAMES)
    clip = carried_clip(free_body, truth)
    fits = [fit_clip(clip, free_body, config) for config in (PRESETS["tcfit"], without_held_feet(PRESETS["tcfit"]))]
    held, free = (joints_in_space(free_body, fit.last.params)[:, :22] for fit in fits)
    speeds = [np.linalg.norm(np.diff(joints[:, ANKLES], axis=0), axis=-1).mean() * RATE for joints in (held, free)]
    assert speeds[0] < 0.02 and speeds[0] < 0.3 * speeds[1]
    true = joints_in_space(free_body, truth)[:, :22]
    assert metrics.pa_mpjpe(held, true).mean() < metrics.pa_mpjpe(free, true).mean() + 0.5
    assert fits[0].grounding is not None
    assert not fits[0].grounding.contacts.let_go.any() and not any("not held" in w for w in fits[0].warnings)


def test_costs_of_frames_that_are_fitted_again_have_held_feet_in_them(free_body: BodyModel):
    """In the middle of a stand, of which they show a part alone: also where nothing has changed."""
    params, window = gesturing(Carried(), frames=FRAMES), range(20, 24)
    clip, config = carried_clip(free_body, params), PRESETS["tcfit"]
    fit = fit_clip(clip, free_body, config)
    inside = slice(window.start, window.stop)

    def costs(config: FitConfig, params: BodyParams) -> np.ndarray:
        stages = Stages.of_clip(clip, free_body, config)
        held = holding_feet(stages, params, fit.grounding) or stages
        return patched(fit.last, held, params, [window], note="").frame_cost[inside]

    np.testing.assert_allclose(costs(config, fit.last.params), fit.last.frame_cost[inside], rtol=0.02)
    pose = fit.last.params.body_pose.clone()
    pose[inside, 3] -= 0.1  # bends a knee: the foot leaves its place
    moved = replace(fit.last.params, body_pose=pose)

    def rise(config: FitConfig) -> np.ndarray:
        return costs(config, moved) - costs(config, fit.last.params)

    assert (rise(config) > rise(without_held_feet(config)) + 1).all()
