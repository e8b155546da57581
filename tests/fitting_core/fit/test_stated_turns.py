"""Turns that a person stated, of hands and of locked joints: what the fit makes of them."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.handshapes import HANDSHAPES, finger_angles
from fitting_core.body.model import JOINT
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import project
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.fit.fitting import fit_clip, rerun_events
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.locks import Locks
from fitting_core.fit.variables.state import Free
from fitting_core.measure.hands.handshapes import HandshapeSet, finger_bones
from tests.samples.posed_clips import clip_of, motion, shipped_body
from tests.samples.scenes import finished

FRAMES = 9
STATED = slice(2, 6)
NEAR = 7.0
"""Degrees between finger bones: so near to each of the named shapes is what twelve numbers of a hand can say."""


def config_of(preset: str) -> FitConfig:
    config = PRESETS[preset]
    weights = replace(config.weights, collision=(0.0,) * 5)
    return replace(config, solver="lm", weights=weights, temporal=replace(config.temporal, stages=(5,)))


@pytest.fixture(scope="module")
def params() -> BodyParams:
    return motion(FRAMES)


@pytest.fixture(scope="module")
def clip(params: BodyParams) -> Clip:
    return clip_of(params, noise=0.5, groups=(kp.BODY, kp.HANDS))


@pytest.fixture(scope="module")
def without_hands(params: BodyParams) -> Clip:
    return clip_of(params, noise=0.5)


def with_shape(clip: Clip, name: str, side: kp.Side = "left") -> Clip:
    turn = np.full((FRAMES, kp.COUNT, 3), np.nan)
    turn[STATED, kp.FINGER_JOINTS[side]] = finger_angles(HANDSHAPES[name], side)
    return replace(clip, keypoints=replace(clip.keypoints, turn=turn))


def told(found: BodyParams, side: kp.Side, frames: slice) -> tuple[str, float]:
    """The named shape that a hand is nearest to, and how far from it, degrees."""
    points = keypoints_in_space(shipped_body(), found)[0][frames]
    nearest = HandshapeSet(shipped_body()).nearest(finger_bones(points, side))
    assert nearest is not None
    return nearest.name, nearest.degrees


@pytest.mark.parametrize("name", HANDSHAPES)
def test_the_hand_space_comes_near_to_every_named_shape(name: str):
    stages = Stages.of(clip_of(motion(1)).keypoints, clip_of(motion(1)).camera, shipped_body(), PRESETS["tcfit"])
    p = stages.parametrisation
    angles = torch.as_tensor(np.concatenate([finger_angles(HANDSHAPES[name], side) for side in kp.FINGER_JOINTS]))
    state = p.neutral(1).with_columns(p.columns.hands, p.nearest_hands(angles.flatten()))
    for side in kp.FINGER_JOINTS:
        shape, degrees = told(p.to_params(state), side, slice(None))
        assert shape == name and degrees < NEAR


@pytest.mark.parametrize(
    "preset", ["tcfit", *(pytest.param(p, marks=pytest.mark.thorough) for p in ("smplifyx", "paper"))]
)
def test_a_hand_has_its_shape_in_every_preset(clip: Clip, params: BodyParams, preset: str):
    seen, found = (
        finished(rerun_events(each, shipped_body(), config_of(preset), params, range(1, 8))).params
        for each in (clip, with_shape(clip, "fist"))
    )
    shape, degrees = told(found, "left", STATED)
    assert shape == "fist" and degrees < NEAR
    assert (found.right_hand_pose - seen.right_hand_pose).abs().max() < 0.1
    assert (found.left_hand_pose - seen.left_hand_pose)[STATED].abs().max() > 1
    assert torch.equal(found.left_hand_pose[[0, 8]], params.left_hand_pose[[0, 8]])


@pytest.mark.thorough
def test_a_whole_fit_has_it_and_wrists_stay_where_they_are_seen(clip: Clip):
    before = fit_clip(clip, shipped_body(), PRESETS["tcfit"]).last.params
    after = fit_clip(with_shape(clip, "horns", "right"), shipped_body(), PRESETS["tcfit"]).last.params
    assert told(before, "right", STATED)[0] != "horns" == told(after, "right", STATED)[0]
    wrists = [keypoints_in_space(shipped_body(), p)[0][:, kp.INDEX["right_wrist"]] for p in (before, after)]
    pixels = [project(clip.camera, torch.as_tensor(wrist)) for wrist in wrists]
    assert (pixels[1] - pixels[0]).abs().max() < 1


@pytest.mark.thorough
def test_hands_move_where_none_was_detected(without_hands: Clip):
    found = fit_clip(with_shape(without_hands, "fist"), shipped_body(), PRESETS["tcfit"]).last.params
    assert told(found, "left", STATED)[0] == "fist"


def test_keypoints_of_its_fingers_do_not_count_and_those_of_the_palm_do(clip: Clip):
    said = with_shape(clip, "fist")
    over = said.keypoints.overruled
    names = {kp.NAMES[j] for j in np.flatnonzero(over.any(0))}
    assert names == {f"left_{finger}{k}" for finger in kp.FINGERS for k in (2, 3, 4)}
    assert over.any(1).tolist() == [2 <= frame < 6 for frame in range(FRAMES)]
    stages = Stages.of(said.keypoints, said.camera, shipped_body(), PRESETS["tcfit"])
    assert not stages.observations.confidence[torch.as_tensor(over)].any()
    assert stages.observations.confidence[3, kp.INDEX["left_index1"]] > 0

    assert said.keypoints.turn is not None
    said.keypoints.turn[3, kp.INDEX["left_thumb2"]] = np.nan
    assert not said.keypoints.overruled[3].any(), "a hand without all of its joints has no stated shape"


# --- locked joints ---


def columns(joint: str) -> slice:
    return slice(3 * (JOINT[joint] - 1), 3 * JOINT[joint])


def locked(clip: Clip, keypoint: int, turn: torch.Tensor) -> Clip:
    turns = np.full((FRAMES, kp.COUNT, 3), np.nan)
    turns[STATED, keypoint] = turn.numpy()
    return replace(clip, keypoints=replace(clip.keypoints, turn=turns))


def degrees_off(found: BodyParams, joint: str, turn: torch.Tensor) -> np.ndarray:
    away = rotations.exp(turn).T @ rotations.exp(found.body_pose[:, columns(joint)])
    return np.degrees(torch.linalg.vector_norm(rotations.log(away), dim=-1).numpy())


@pytest.mark.thorough
@pytest.mark.parametrize("preset", PRESETS)
def test_a_joint_is_turned_as_it_is_locked_in_every_preset(without_hands: Clip, params: BodyParams, preset: str):
    """About the forearm's own axis, of which keypoints of the body tell nothing, and 25 degrees away from the truth."""
    wrist = columns("left_wrist")
    turn = params.body_pose[3, wrist] + torch.tensor([0.44, 0.0, 0.0], dtype=torch.float64)
    said = locked(without_hands, kp.INDEX["left_wrist"], turn)
    found = finished(rerun_events(said, shipped_body(), config_of(preset), params, range(1, 8))).params
    off = degrees_off(found, "left_wrist", turn)
    assert off[STATED].max() < 3
    assert torch.equal(found.body_pose[[0, 8]], params.body_pose[[0, 8]])


@pytest.mark.thorough
def test_where_nothing_is_locked_there_is_no_term(without_hands: Clip, params: BodyParams):
    def terms(part: Clip, frames: range) -> list:
        stages = Stages.of(part.keypoints, part.camera, shipped_body(), PRESETS["tcfit"]).within(frames)
        return [term for term in stages.objective(5, stages.parametrisation.neutral(len(frames)), Free()).terms]

    said = locked(without_hands, kp.INDEX["neck"], params.body_pose[3, columns("neck")])
    assert not any(isinstance(term, Locks) for term in terms(without_hands, range(FRAMES)))
    assert not any(isinstance(term, Locks) for term in terms(said, range(6, 9)))
    (term,) = (term for term in terms(said, range(4, 9)) if isinstance(term, Locks))
    assert term.joint.tolist() == [JOINT["neck"]] and (term.weight > 0)[:, 0].tolist() == [True] * 2 + [False] * 3
