"""The search for other minima: which states go on, and whether it leads out of a wrong pose on a wrong shape."""

from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fitting_core.body.model import BodyModel
from fitting_core.fit.phases.search import many_starts as search
from fitting_core.fit.phases.search.fresh_starts import FreshStarts
from fitting_core.fit.phases.search.limb_flips import LIMBS, LimbFlips
from fitting_core.fit.phases.search.many_starts import Pool, other_minima
from fitting_core.fit.stages import Stages
from fitting_core.fit.variables.state import State
from tests.fitting_core.fit.phases.test_fresh_starts import CONFIG
from tests.samples.scenes import arms_in_motion, finished, keypoints_of, stages_of


def pool_of(costs: list[float], owners: list[int]) -> Pool:
    """States that are told apart by their first number."""
    n = len(costs)
    vector = torch.arange(float(n), dtype=torch.float64)[:, None]
    state = State(torch.eye(3, dtype=torch.float64).expand(n, 3, 3), vector)
    return Pool(state, torch.tensor(owners), torch.tensor(costs, dtype=torch.float64))


@given(st.lists(st.tuples(st.integers(1, 9), st.integers(0, 2)), min_size=1, max_size=12), st.integers(1, 4))
def test_the_cheapest_of_each_owner_stay(rows: list[tuple[int, int]], count: int):
    """Sorted another way; equal costs are one minimum."""
    pool = pool_of([float(cost) for cost, _ in rows], [owner for _, owner in rows])
    best = pool.best(count)
    for owner in {owner for _, owner in rows}:
        expected = sorted({cost for cost, o in rows if o == owner})[:count]
        assert sorted(best.cost[best.owner == owner].tolist()) == expected
    assert torch.equal(best.cost, pool.cost[best.state.vector[:, 0].long()])


def test_what_has_no_cost_never_goes_on():
    pool = pool_of([float("inf"), 2.0, float("nan")], [0, 0, 0])
    assert pool.best(3).cost.tolist() == [2.0]


@pytest.fixture(scope="module")
def scene(free_body: BodyModel) -> tuple[Stages, State]:
    """Sharp stages of a person with bent arms and legs, and the truth."""
    params = replace(arms_in_motion(3, depth=3.5), betas=torch.zeros(3, 10, dtype=torch.float64))
    config = replace(CONFIG, pose_prior="relaxed")
    stages = stages_of(free_body, keypoints_of(free_body, params), config).sharpened(100.0)
    return stages, stages.parametrisation.from_params(params)


def test_a_wrong_arm_on_a_wrong_shape_is_set_right(scene: tuple[Stages, State], monkeypatch: pytest.MonkeyPatch):
    """One arm points away from the camera instead of to it, and the shape is another."""
    stages, truth = scene
    p, frame = stages.parametrisation, torch.tensor([1])
    wrong = LimbFlips(stages).flipped(truth, LIMBS["left_arm"], upper=True, lower=True)
    wrong = wrong.with_columns(p.columns.betas, torch.full((3, 10), 0.7, dtype=torch.float64))
    monkeypatch.setattr(search, "DRAWN", 2)
    found = finished(other_minima(stages, wrong, frame, seed=0))
    objective = FreshStarts(stages, truth, seed=0).objective
    assert all(frames.tolist() == [1] and not state.vector[:, p.columns.betas].any() for frames, state in found)
    best, right, stuck = (float(objective.cost(s, frame)[0]) for s in (found[0][1], truth[frame], wrong[frame]))
    assert best < 4 * right < 1e-4 * stuck


def test_frames_are_searched_in_portions(scene: tuple[Stages, State], monkeypatch: pytest.MonkeyPatch):
    """Every frame gets minima of its own."""
    stages, truth = scene
    for name, value in (("DRAWN", 1), ("TOGETHER", 2), ("_HALVING", ((1, 1),)), ("_ITERATIONS", 1)):
        monkeypatch.setattr(search, name, value)
    found = finished(other_minima(stages, truth, torch.tensor([0, 2, 1]), seed=0))
    assert sorted(found[0][0].tolist()) == [0, 1, 2]
    place = stages.parametrisation.columns.translation
    torch.testing.assert_close(found[0][1].vector[:, place], truth.vector[found[0][0], place], rtol=0, atol=0.05)
