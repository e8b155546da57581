"""Fresh starts: what is drawn, which parts are taken from others, and which are varied."""

from dataclasses import replace

import pytest
import torch

from fitting_core import rotations
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.config.schema import FitConfig, SolverSettings, Weights
from fitting_core.fit.phases.search.fresh_starts import DRAWN_LIMBS, PARTS, TURNED_WRISTS, FreshStarts, drawn_poses
from fitting_core.fit.phases.search.limb_flips import FLIPS
from fitting_core.fit.stages import Stages
from fitting_core.fit.variables.state import State
from fitting_core.priors.latent import LatentPrior
from fitting_core.priors.loosened import Loosened
from tests.fitting_core.priors.networks import random_network
from tests.samples.scenes import arms_in_motion, keypoints_of, random_state, stages_of

CONFIG = FitConfig(
    pose_prior="axis_angle",
    weights=replace(Weights(), collision=(0.0,) * 5, limits=(100.0,) * 5),
    hip_weight=1.0,
    settings=SolverSettings(iterations=20),
)
NAMES = list(PARTS)


@pytest.fixture(scope="module")
def stages(free_body: BodyModel) -> Stages:
    return stages_of(free_body, keypoints_of(free_body, arms_in_motion(3, depth=3.5)), CONFIG).sharpened(100.0)


@pytest.fixture(scope="module")
def truth(stages: Stages) -> State:
    return stages.parametrisation.from_params(arms_in_motion(3, depth=3.5))


@pytest.fixture
def fresh(stages: Stages, truth: State) -> FreshStarts:
    return FreshStarts(stages, truth, seed=0)


def test_starts_are_drawn_where_the_states_are(fresh: FreshStarts):
    c = fresh.parametrisation.columns
    states = random_state(fresh.parametrisation, 2)
    drawn = fresh.drawn(states, 4)
    assert drawn.source.tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    torch.testing.assert_close(drawn.state.vector[:, c.translation], states.vector[drawn.source, c.translation])
    assert not drawn.state.vector[:, c.betas].any()
    assert len(drawn.state.vector[:, c.body].unique(dim=0)) == 8
    half = fresh.parametrisation.with_half_fists(states[:1]).vector[0, c.hands]
    assert [torch.equal(row, half) for row in drawn.state.vector[:, c.hands]] == 4 * [True, False]
    turns = rotations.log(drawn.state.orient @ states.orient[drawn.source].mT).norm(dim=1)
    assert [float(t) > 1.0 for t in turns] == 2 * [False, False, False, True]  # radians; every fourth is any rotation
    identity = drawn.state.orient @ drawn.state.orient.mT
    torch.testing.assert_close(identity, torch.eye(3, dtype=torch.float64).expand(8, 3, 3))


def test_a_seed_draws_the_same_again(stages: Stages, truth: State):
    first, second = (FreshStarts(stages, truth, seed=3).drawn(truth, 2).state.vector for _ in range(2))
    assert torch.equal(first, second)
    assert not torch.equal(first, FreshStarts(stages, truth, seed=4).drawn(truth, 2).state.vector)


def test_a_loosened_prior_draws_what_its_prior_holds():
    prior = Loosened(LatentPrior(random_network(size=9, hidden=16)), 0.05)
    normal = torch.randn(5, prior.size, dtype=torch.float64)
    drawn = drawn_poses(prior, normal)
    assert torch.equal(drawn[:, :9], normal[:, :9]) and not drawn[:, 9:].any()


@pytest.mark.parametrize("name", NAMES)
def test_a_part_is_taken_and_nothing_else(fresh: FreshStarts, name: str):
    p, part = fresh.parametrisation, PARTS[name]
    state, donor = random_state(p, 2, seed=1), random_state(p, 2, seed=5)
    taken = fresh.with_part(state, donor, part)
    pose, own, other = (p.body_pose(s).view(2, 21, 3) for s in (taken, state, donor))
    joints = torch.zeros(21, dtype=torch.bool)
    joints[[JOINT[j] - 1 for j in part.joints]] = True
    torch.testing.assert_close(pose[:, joints], other[:, joints])
    torch.testing.assert_close(pose[:, ~joints], own[:, ~joints])
    hands, own, other = (s.vector[:, p.columns.hands].view(2, 2, -1) for s in (taken, state, donor))
    for hand in (0, 1):
        torch.testing.assert_close(hands[:, hand], (other if part.hand == hand else own)[:, hand])
    assert torch.equal(taken.orient, state.orient)


def without(fresh: FreshStarts, state: State, joint: str, turn: float) -> State:
    """The states with one joint turned off."""
    pose = fresh.parametrisation.body_pose(state).clone()
    pose[:, 3 * (JOINT[joint] - 1) + 1] += turn
    return state.with_columns(fresh.parametrisation.columns.body, fresh.parametrisation.prior.encode(pose))


@pytest.mark.parametrize(
    ("joint", "wrong"), [("left_elbow", ("left_arm", "left_hand")), ("right_knee", ("right_leg",))]
)
def test_misfits_tell_the_part_that_is_off(fresh: FreshStarts, truth: State, joint: str, wrong: tuple[str, ...]):
    frames = torch.arange(3)
    assert float(fresh.misfits(truth, frames).max()) < 1e-6
    off = dict(zip(NAMES, fresh.misfits(without(fresh, truth, joint, 0.2), frames).T, strict=True))
    assert {name for name, values in off.items() if float(values.min()) > 1} == set(wrong)
    assert max(float(values.max()) for name, values in off.items() if name not in wrong) < 1e-6


def test_the_best_parts_of_two_make_the_truth(fresh: FreshStarts, truth: State):
    """One has its left arm off, the other a leg; each frame takes from its own states only."""
    one = truth[:1]
    pool = State.cat([without(fresh, one, "left_elbow", 0.3), without(fresh, one, "right_knee", 0.3), truth[1:2]])
    owner, frames = torch.tensor([0, 0, 1]), torch.tensor([0, 0, 1])
    misfit = fresh.misfits(pool, frames)
    donors, better = fresh.better_donors(misfit, torch.tensor([0, 2]), owner)
    assert [name for name, b in zip(NAMES, better[0].tolist(), strict=True) if b] == ["left_arm", "left_hand"]
    assert not better[1].any()
    made = fresh.crossed(pool[torch.tensor([0, 2])], donors, pool, better)
    assert made.source.tolist() == [0, 0, 0]  # arm, hand, both
    costs = fresh.objective.cost(made.state, torch.zeros(3, dtype=torch.long))
    torch.testing.assert_close(costs.min(), fresh.objective.cost(one, torch.tensor([0]))[0])


def test_only_what_does_not_fit_is_varied(fresh: FreshStarts, truth: State):
    misfit = torch.zeros(3, len(PARTS), dtype=torch.float64)
    assert fresh.varied(truth, misfit) is None
    misfit[1, NAMES.index("right_leg")] = 1
    misfit[2, NAMES.index("left_hand")] = 1
    made = fresh.varied(truth, misfit)
    assert made is not None
    assert made.source.tolist().count(1) == len(FLIPS) + DRAWN_LIMBS
    assert made.source.tolist().count(2) == 4 * len(TURNED_WRISTS)
    c = fresh.parametrisation.columns
    leg = fresh.parametrisation.body_pose(made.state[made.source == 1]).view(-1, 21, 3)
    arms = [JOINT[f"{side}_{joint}"] - 1 for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist")]
    torch.testing.assert_close(
        leg[:, arms], fresh.parametrisation.body_pose(truth).view(3, 21, 3)[[1], arms].expand_as(leg[:, arms])
    )
    hands = made.state[made.source == 2].vector[:, c.hands].view(-1, 2, c.hand)
    torch.testing.assert_close(hands[:, 1], truth.vector[2, c.hands].view(2, -1)[1].expand_as(hands[:, 1]))
