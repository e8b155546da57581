"""What each stage weighs and frees, against the method's table written out here once more."""

import weakref
from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.bending import Bending
from fitting_core.fit.terms.data import Data
from fitting_core.fit.terms.quadratic import Quadratic
from fitting_core.fit.variables.state import Free
from fitting_core.keypoints import Keypoints
from tests.samples.scenes import hidden, keypoints_of, random_params, stages_of

STAGES = (1, 2, 3, 4, 5)
TABLE = {
    "body_pose": (404, 404, 57.4, 4.78, 4.78),
    "hand_pose": (404, 404, 57.4, 4.78, 4.78),
    "shape": (100, 50, 10, 5, 5),
    "expression": (100, 50, 10, 5, 5),
    "bending": (35.8, 35.8, 13.5, 3.9, 3.9),
    "collision": (0, 0, 0, 0.1, 1),
    "hand_keypoints": (0, 0, 0, 0.1, 2),
    "face_keypoints": (0, 0, 0, 0, 2),
    "body_keypoints": (1, 1, 1, 1, 1),
}
JAW = {
    "paper": ((63.6, 201, 201), (63.6, 201, 201), (24, 75.7, 75.7), (6.9, 21.9, 21.9), (6.9, 21.9, 21.9)),
    "smplifyx": ((4040, 40400, 40400), (4040, 40400, 40400), (574, 5740, 5740), (47.8, 478, 478), (47.8, 478, 478)),
}


@pytest.fixture(scope="module")
def detections(tiny_body: BodyModel) -> Keypoints:
    exact = keypoints_of(tiny_body, random_params(2))
    return replace(exact, confidence=0.5 * exact.confidence)


def weights_of(stages: Stages, stage: int) -> tuple[dict, np.ndarray]:
    """Weights by term; and of each of the 137 keypoints, freed of confidence 0.5 and of 1000 / 800 pixels."""
    objective = stages.objective(stage, stages.parametrisation.neutral(2), Free())
    found, keypoints = {}, np.zeros(kp.COUNT)
    for term in objective.terms:
        if isinstance(term, Quadratic):
            found[term.name] = term.weight.tolist()
        elif isinstance(term, Data):
            used = ((stages._joint_weights(stage) > 0) & stages.fitted.known).nonzero()[:, 0].numpy()
            keypoints[used] = (term.weight[0] / 0.5 / (1000 / 800)).numpy()
        else:
            found[term.name] = term.weight if isinstance(term, Bending) else getattr(term, "weight", None)
    return found, keypoints


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize("preset", ["paper", "smplifyx"])
def test_weights_are_those_of_the_table(tiny_body: BodyModel, detections: Keypoints, preset: str, stage: int):
    config = replace(PRESETS[preset], weights=replace(PRESETS[preset].weights, collision=(0,) * 5))
    found, _ = weights_of(stages_of(tiny_body, detections, config), stage)
    row = {name: values[stage - 1] for name, values in TABLE.items()}
    for name, count in {"body_pose": 32, "hand_pose": 24, "shape": 10, "expression": 10}.items():
        assert found[name] == pytest.approx([row[name]] * count)
    assert found["jaw"] == pytest.approx(JAW[preset][stage - 1])
    assert found["bending"] == pytest.approx(row["bending"])
    assert set(found) == {"body_pose", "hand_pose", "shape", "expression", "jaw", "bending"}  # nothing beyond the paper


@pytest.mark.parametrize("preset", ["paper", "smplifyx"])
def test_collision_weights(preset: str):
    assert PRESETS[preset].weights.collision == TABLE["collision"]


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize("preset", ["paper", "smplifyx"])
def test_keypoint_weights(tiny_body: BodyModel, detections: Keypoints, preset: str, stage: int):
    """Neck and hips 0, other body 1, hands and face by the table; 51 + 17 face points, never the pupils."""
    config = replace(PRESETS[preset], weights=replace(PRESETS[preset].weights, collision=(0,) * 5))
    _, keypoints = weights_of(stages_of(tiny_body, detections, config), stage)
    body = np.full(25, 1.0)
    body[[1, 9, 12]] = 0
    expected = np.concatenate(
        [body, np.full(42, TABLE["hand_keypoints"][stage - 1]), np.full(70, TABLE["face_keypoints"][stage - 1])]
    )
    expected[135:] = 0
    np.testing.assert_allclose(keypoints, expected, rtol=1e-12)
    assert np.count_nonzero(keypoints[67:]) == (51 + 17 if stage == 5 else 0)


def test_a_body_without_contour_keeps_the_inner_landmarks(tiny_body: BodyModel, detections: Keypoints):
    bare = replace(
        tiny_body, contour_vertices=np.zeros((0, 17, 3), int), contour_weights=np.zeros((0, 17, 3))
    )  # fmt: skip
    config = replace(PRESETS["paper"], weights=replace(PRESETS["paper"].weights, collision=(0,) * 5))
    _, keypoints = weights_of(stages_of(bare, detections, config), 5)
    assert np.count_nonzero(keypoints[kp.CONTOUR]) == 0 and np.count_nonzero(keypoints[kp.FACE]) == 51


def test_robust_width_is_100_pixels_in_the_paper(tiny_body: BodyModel, detections: Keypoints):
    stages = stages_of(
        tiny_body, detections, replace(PRESETS["paper"], weights=replace(PRESETS["paper"].weights, collision=(0,) * 5))
    )
    data = stages.objective(5, stages.parametrisation.neutral(2), Free()).terms[0]
    assert isinstance(data, Data)
    assert data.rho.unique().tolist() == [100.0]
    assert float(data.side.abs().max()) == 0


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


def test_pupils_alone_free_no_face(tiny_body: BodyModel, detections: Keypoints):
    stages = stages_of(tiny_body, hidden(detections, slice(67, 135)), PRESETS["paper"])
    assert not stages.free(5, betas=True).face


def test_the_camera_step_moves_orientation_and_translation(tiny_body: BodyModel, detections: Keypoints):
    stages = stages_of(tiny_body, detections, PRESETS["paper"])
    objective = stages.camera_objective(torch.full((2,), 3.0, dtype=torch.float64))
    columns = stages.parametrisation.columns
    expected = [0, 1, 2, *range(columns.translation.start, columns.translation.stop)]
    assert objective.index.tolist() == expected


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


def test_usable_frames_show_four_body_keypoints(tiny_body: BodyModel, detections: Keypoints):
    part = hidden(detections, slice(3, 25), frames=slice(0, 1))
    part.confidence[0, 3], part.xy[0, 3] = 0.19, detections.xy[0, 3]  # not quite seen
    part.confidence[1, 4:25] = 0
    assert stages_of(tiny_body, part, FitConfig()).observations.usable.tolist() == [False, True]


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
