"""Joints that a person has locked as they are turned: what the fit makes of them, in every preset."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.model import JOINT
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS
from fitting_core.fit.fitting import rerun_events
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.locks import Locks
from fitting_core.fit.variables.state import Free
from tests.samples.posed_clips import clip_of, motion, shipped_body
from tests.samples.scenes import finished

pytestmark = pytest.mark.thorough

FRAMES = 9
LOCKED = range(2, 6)
ELBOW, NECK = kp.INDEX["left_elbow"], kp.INDEX["neck"]


def columns(joint: str) -> slice:
    return slice(3 * (JOINT[joint] - 1), 3 * JOINT[joint])


@pytest.fixture(scope="module")
def params() -> BodyParams:
    return motion(FRAMES)


@pytest.fixture(scope="module")
def clip(params: BodyParams) -> Clip:
    return clip_of(params, noise=0.5)


def locked(clip: Clip, keypoint: int, turn: torch.Tensor) -> Clip:
    turns = np.full((FRAMES, kp.COUNT, 3), np.nan)
    turns[LOCKED.start : LOCKED.stop, keypoint] = turn.numpy()
    return replace(clip, keypoints=replace(clip.keypoints, turn=turns))


def degrees_off(found: BodyParams, joint: str, turn: torch.Tensor) -> np.ndarray:
    away = rotations.exp(turn).T @ rotations.exp(found.body_pose[:, columns(joint)])
    return np.degrees(torch.linalg.vector_norm(rotations.log(away), dim=-1).numpy())


@pytest.mark.parametrize("preset", PRESETS)
def test_a_joint_is_turned_as_it_is_locked_in_every_preset(clip: Clip, params: BodyParams, preset: str):
    """About the forearm's own axis, of which keypoints of the body tell nothing, and 25 degrees away from the truth."""
    wrist = columns("left_wrist")
    turn = params.body_pose[3, wrist] + torch.tensor([0.44, 0.0, 0.0], dtype=torch.float64)
    config = PRESETS[preset]
    weights = replace(config.weights, collision=(0.0,) * 5)
    config = replace(config, solver="lm", weights=weights, temporal=replace(config.temporal, stages=(5,)))
    said = locked(clip, kp.INDEX["left_wrist"], turn)
    found = finished(rerun_events(said, shipped_body(), config, params, range(1, 8))).params
    off = degrees_off(found, "left_wrist", turn)
    assert off[LOCKED.start : LOCKED.stop].max() < 3
    assert torch.equal(found.body_pose[[0, 8]], params.body_pose[[0, 8]])


def test_where_nothing_is_locked_there_is_no_term(clip: Clip, params: BodyParams):
    def terms(part: Clip, frames: range) -> list:
        stages = Stages.of(part.keypoints, part.camera, shipped_body(), PRESETS["tcfit"]).within(frames)
        return [term for term in stages.objective(5, stages.parametrisation.neutral(len(frames)), Free()).terms]

    said = locked(clip, NECK, params.body_pose[3, columns("neck")])
    assert not any(isinstance(term, Locks) for term in terms(clip, range(FRAMES)))
    assert not any(isinstance(term, Locks) for term in terms(said, range(6, 9)))
    (term,) = (term for term in terms(said, range(4, 9)) if isinstance(term, Locks))
    assert term.joint.tolist() == [JOINT["neck"]] and (term.weight > 0)[:, 0].tolist() == [True] * 2 + [False] * 3
