"""Limbs mirrored in depth: the same pixels, the other depth, natural bends, and starts that free a mirrored limb."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.config.schema import SolverSettings
from fitting_core.fit.phases import independent
from fitting_core.fit.phases.frame_fits import FrameFits
from fitting_core.fit.phases.independent import _Frames, _LastStage
from fitting_core.fit.phases.limb_flips import FLIPS, LIMBS, LimbFlips
from fitting_core.fit.solvers import make_solver
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.variables.state import State
from fitting_core.keypoints import Keypoints
from fitting_core.results.provenance import Start
from tests.samples.scenes import QUICK, arms_in_motion, finished, hidden, keypoints_of, stages_of

CONFIG = replace(QUICK, weights=replace(QUICK.weights, limits=(100.0,) * 5), settings=SolverSettings(iterations=20))
FRAMES = torch.arange(3)


@pytest.fixture(scope="module")
def scene(free_body: BodyModel) -> tuple[Stages, State]:
    """Stages of a person with bent arms and legs before the camera, and the truth."""
    params = arms_in_motion(3, depth=3.5)
    keypoints: Keypoints = hidden(keypoints_of(free_body, params), kp.HANDS, kp.FACE)
    stages = stages_of(free_body, keypoints, CONFIG)
    return stages, stages.parametrisation.from_params(params)


def flipped(stages: Stages, state: State, limb: str, *, upper: bool, lower: bool) -> State:
    pose = LimbFlips(stages).flipped(state, LIMBS[limb], upper=upper, lower=lower)
    p = stages.parametrisation
    return state.with_columns(p.columns.body, p.prior.encode(pose))


@pytest.mark.parametrize("limb", LIMBS)
@pytest.mark.parametrize(("upper", "lower"), FLIPS)
def test_flipped_limbs_look_the_same(scene: tuple[Stages, State], limb: str, upper: bool, lower: bool):
    """Joints stay on their rays and bones keep their lengths; what was mirrored turns from the camera or to it."""
    stages, truth = scene
    flips = LimbFlips(stages)
    before, after = (
        flips.positions(s).numpy() for s in (truth, flipped(stages, truth, limb, upper=upper, lower=lower))
    )
    rays = [a / np.linalg.norm(a, axis=-1, keepdims=True) for a in (before, after)]
    chain = [JOINT[name] for name in LIMBS[limb].joints]
    np.testing.assert_allclose(rays[1][:, chain], rays[0][:, chain], atol=1e-9)
    untouched = [j for j in range(22) if j not in chain and not _below(stages.body, j, chain[0])]
    np.testing.assert_allclose(after[:, untouched], before[:, untouched], atol=1e-9)
    for start, end, mirrored in ((*chain[:2], upper), (*chain[1:], lower)):
        bones = [a[:, end] - a[:, start] for a in (before, after)]
        np.testing.assert_allclose(*(np.linalg.norm(b, axis=-1) for b in bones), atol=1e-9)
        depths = [(bone * ray[:, end]).sum(-1) for bone, ray in zip(bones, rays, strict=True)]
        assert ((np.sign(depths[0]) != np.sign(depths[1])) == mirrored).all()


def _below(body: BodyModel, joint: int, ancestor: int) -> bool:
    while joint > 0:
        joint = int(body.parents[joint])
        if joint == ancestor:
            return True
    return False


@pytest.mark.parametrize("limb", LIMBS)
@pytest.mark.parametrize(("upper", "lower"), FLIPS)
def test_elbows_and_knees_stay_hinges(scene: tuple[Stages, State], limb: str, upper: bool, lower: bool):
    """The middle joint turns about its hinge in the natural sense, but for the forearm's twist."""
    stages, truth = scene
    mirrored = flipped(stages, truth, limb, upper=upper, lower=lower)
    pose = stages.parametrisation.body_pose(mirrored).view(-1, 21, 3)[:, JOINT[LIMBS[limb].joints[1]] - 1].numpy()
    hinge = np.array(LIMBS[limb].hinge)
    assert (pose @ hinge > -0.1).all()  # a nearly straight limb keeps the hinge that it had
    across = pose - (pose @ hinge)[:, None] * hinge
    assert np.linalg.norm(across, axis=1).max() < 0.15


def stuck_of(stages: Stages, truth: State) -> tuple[FrameFits, Tensor]:
    """Fits whose left forearm points away, and the lower cost where it points to the camera."""
    run = _Frames(stages, make_solver("lm", CONFIG.settings), FRAMES)
    objective = stages.objective(N_STAGES, truth, stages.free(N_STAGES, betas=True))
    right = finished(run._minimise(objective, FrameFits.at(truth, Start.UNKNOWN), "", (0, 1)))
    mirrored = flipped(stages, right.state, "left_arm", upper=False, lower=True)
    stuck = finished(run._minimise(objective, FrameFits.at(mirrored, Start.TURNED_0), "", (0, 1)))
    assert (stuck.cost > 1.05 * right.cost).all()  # else the descent alone finds back, and these tests show nothing
    return stuck, right.cost


def test_a_mirrored_limb_is_turned_back(scene: tuple[Stages, State], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(independent, "_FLIPPED_EVERY", 1)
    stages, truth = scene
    stuck, lowest = stuck_of(stages, truth)
    run = _Frames(stages, make_solver("lm", CONFIG.settings), FRAMES)
    objective = stages.objective(N_STAGES, truth, stages.free(N_STAGES, betas=True))
    freed = finished(run.flip_limbs(_LastStage(stages, truth), stuck))
    assert (freed.cost <= stuck.cost).all() and (freed.cost < 1.02 * lowest).all()
    torch.testing.assert_close(objective.cost(freed.state, FRAMES), freed.cost, rtol=1e-9, atol=0)
    mirrored = {start for limb in LIMBS.values() for start in (limb.start, limb.mirrored_hand) if start is not None}
    assert set(freed.start.tolist()) <= mirrored and Start.LEFT_ARM in freed.start


def test_only_limbs_in_doubt_are_mirrored(scene: tuple[Stages, State]):
    """The lifter knows the truth: nothing of that is mirrored, and of a body with a wrong forearm that arm is."""
    stages, truth = scene
    places = LimbFlips(stages).positions(truth)[:, [JOINT.get(name, 0) for name in kp.BODY_25]]
    known = stages.observations.relative_position.clone(), stages.observations.relative_position_deviation.clone()
    known[0][:, kp.BODY], known[1][:, kp.BODY] = places, 0.05
    observations = replace(stages.observations, relative_position=known[0], relative_position_deviation=known[1])
    flips = LimbFlips(replace(stages, observations=observations))
    assert not list(flips.every(truth, FRAMES))
    wrong = flipped(stages, truth, "left_arm", upper=False, lower=True)
    mixed = State.cat([truth[:1], wrong[1:]])
    found = list(flips.every(mixed, FRAMES))
    assert {start for start, *_ in found} == {Start.LEFT_ARM, Start.LEFT_HAND}
    assert all(rows.tolist() == [1, 2] and len(state) == 2 for _, rows, state in found)


@pytest.mark.parametrize("flips", [True, False])
def test_the_relay_carries_a_limb_that_was_turned_back(scene: tuple[Stages, State], flips: bool):
    """Of three frames the second is not mirrored, and all are freed; without mirrored limbs they stay."""
    stages, truth = scene
    config = replace(CONFIG, relay_rounds=2, limb_flips=flips)
    stuck, lowest = stuck_of(stages, truth)
    stages = Stages.of(stages.keypoints, stages.camera, stages.body, config)
    run = _Frames(stages, make_solver("lm", config.settings), FRAMES)
    freed = finished(run.relay(stuck, run)).cost
    assert (freed < 1.02 * lowest).all() if flips else (freed > 1.05 * lowest).all()
