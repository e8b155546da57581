"""What each stage weighs and frees, against the method's table written out here once more."""

import weakref
from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.fit.variables.state import Free
from fitting_core.keypoints import Keypoints
from tests.samples.scenes import hidden, keypoints_of, random_params, stages_of

STAGES = (1, 2, 3, 4, 5)


@pytest.fixture(scope="module")
def detections(tiny_body: BodyModel) -> Keypoints:
    exact = keypoints_of(tiny_body, random_params(2))
    return replace(exact, confidence=0.5 * exact.confidence)


FREE_IN_PHASE_1 = {1: (False, False), 2: (False, False), 3: (False, False), 4: (True, False), 5: (True, True)}
"""Hands, face: free as soon as a stage looks at their keypoints."""


@pytest.mark.parametrize("stage", STAGES)
def test_what_is_free_when_all_is_seen(tiny_body: BodyModel, detections: Keypoints, stage: int):
    stages = stages_of(tiny_body, detections, PRESETS["paper"])
    hands, face = FREE_IN_PHASE_1[stage]
    assert stages.free(stage, betas=True, resting=True) == Free(hands=hands, face=face)
    assert stages.free(stage, betas=True) == Free()
    assert stages.free(stage, betas=False, translation=False) == Free(betas=False, translation=False)


@pytest.mark.parametrize("unseen", ["hands", "face"])
def test_what_the_clip_never_shows_does_not_move(tiny_body: BodyModel, detections: Keypoints, unseen: str):
    part = hidden(detections, kp.HANDS if unseen == "hands" else kp.FACE)
    stages = stages_of(tiny_body, part, PRESETS["paper"])
    assert stages.free(5, betas=True) == Free(hands=unseen != "hands", face=unseen != "face")


def test_observed_joints_have_a_keypoint_below_them(free_body: BodyModel):
    """Without legs: hips and what hangs on them are not observed, spine and arms are."""
    config = FitConfig()
    exact = keypoints_of(free_body, random_params(2, size=0.1))
    legs = [i for i, name in enumerate(kp.BODY_25) if any(w in name for w in ("knee", "ankle", "toe", "heel"))]
    stages = stages_of(free_body, hidden(exact, *legs, frames=slice(0, 1)), config)
    for side in ("left", "right"):
        below = [f"{side}_{n}" for n in ("hip", "knee", "ankle", "foot")]
        assert not stages.observed[0, [JOINT[n] for n in below]].any()
        assert stages.observed[1, [JOINT[n] for n in below]].all()
        assert stages.observed[0, [JOINT[f"{side}_{n}"] for n in ("collar", "shoulder", "elbow", "wrist")]].all()
    assert stages.observed[:, [JOINT[n] for n in ("pelvis", "spine1", "spine3", "neck", "head", "jaw")]].all()


def test_stages_are_freed_with_their_last_user(tiny_body: BodyModel, detections: Keypoints):
    """Without a look for cycles, which may not come for minutes: a long fit makes thousands of them."""
    stages = stages_of(tiny_body, detections, FitConfig())
    objective = stages.objective(5, stages.parametrisation.neutral(2), Free())
    known = weakref.ref(stages)
    del stages
    assert known() is None and len(objective.terms)


def test_a_part_of_a_clip_looks_at_what_the_whole_clip_decides(tiny_body: BodyModel, detections: Keypoints):
    """The first frame shows no hands, but they are seen later: in its part they are looked at and move too."""
    config = replace(PRESETS["paper"], weights=replace(PRESETS["paper"].weights, collision=(0,) * 5))
    confidence = detections.confidence.copy()
    confidence[0, kp.HANDS] = 0
    whole = stages_of(tiny_body, replace(detections, confidence=confidence), config)
    assert whole.observed[1].any()
    part = whole.within(range(0, 1))
    state = whole.parametrisation.neutral(2)
    assert part.has(kp.HANDS) and torch.equal(part.looked_at(5), whole.looked_at(5))
    one, both = (s.objective(5, state[: len(s.keypoints)], Free()) for s in (part, whole))
    np.testing.assert_allclose(one.cost(state[:1], part.all_frames), both.cost(state, whole.all_frames)[:1])
    assert (part.observed == whole.observed[:1]).all() and len(part.observed) == 1
