"""Batched L-BFGS: known optima, PyTorch's own L-BFGS, independence of rows, and costs that leave the finite."""

from collections.abc import Callable

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from fitting_core.fit.solvers.lbfgs import CostFunction, Limits, Reason, Result, lbfgs_steps
from tests.samples.scenes import finished

Cost = Callable[[Tensor, Tensor], Tensor]


def minimise_lbfgs(function: CostFunction, x0: Tensor, **limits: float) -> Result:
    """Where the steps end."""
    return finished(lbfgs_steps(function, x0, Limits(**limits)))  # pyright: ignore[reportArgumentType]


def with_gradient(cost: Cost) -> CostFunction:
    """cost(x, rows) -> (m,) together with its gradient by automatic differentiation."""

    def function(x: Tensor, rows: Tensor) -> tuple[Tensor, Tensor]:
        x = x.detach().requires_grad_()
        value = cost(x, rows)
        return value.detach(), torch.autograd.grad(value.sum(), x)[0]

    return function


def random(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def rosenbrock(x: Tensor, rows: Tensor) -> Tensor:
    return (100 * (x[:, 1:] - x[:, :-1].square()).square() + (1 - x[:, :-1]).square()).sum(-1)


def robust(x: Tensor, rows: Tensor) -> Tensor:
    """Geman-McClure of nonlinear residuals, another problem in every row: what keypoints look like to the solver."""
    matrix = random(24, x.shape[1]) + 0.3 * (rows[:, None, None] + 1) * random(24, x.shape[1], seed=1)
    squared = ((matrix @ x.sin()[:, :, None])[:, :, 0] - random(24, seed=2)).square()
    return (squared / (1 + 0.1 * squared)).sum(-1) + 0.01 * x.square().sum(-1)


def exponential(x: Tensor, rows: Tensor) -> Tensor:
    """Convex, with slopes from 1e-3 to 1e40 over the starts used."""
    return (x.exp() - 2 * x).sum(-1) + 1e-3 * (rows + 1) * x.square().sum(-1)


def rotated_powers(x: Tensor, rows: Tensor) -> Tensor:
    """Curvatures over six decades along rotated axes, with quartic parts."""
    axes = torch.linalg.qr(random(x.shape[1], x.shape[1], seed=3))[0]
    y = x @ axes - 1
    scales = torch.logspace(-3, 3, x.shape[1], dtype=x.dtype)
    return (scales * y.square() + 0.1 * (rows[:, None] + 1) * y.pow(4)).sum(-1)


COSTS: dict[str, Cost] = {
    "rosenbrock": rosenbrock,
    "robust": robust,
    "exponential": exponential,
    "rotated powers": rotated_powers,
}


def torch_lbfgs(cost: Cost, x0: Tensor, row: int, *, rounds: int = 30) -> tuple[float, int]:
    """Cost and evaluations of torch.optim.LBFGS by the same schedule, one row alone."""
    x = x0[row : row + 1].clone().requires_grad_()
    optimiser = torch.optim.LBFGS(
        [x],
        max_iter=30,
        history_size=100,
        line_search_fn="strong_wolfe",
        tolerance_grad=1e-9,
        tolerance_change=1e-12,
    )
    evaluations, last = 0, None

    def closure() -> Tensor:
        nonlocal evaluations
        evaluations += 1
        optimiser.zero_grad()
        value = cost(x, torch.tensor([row])).sum()
        value.backward()
        return value

    for _ in range(rounds):
        value = float(optimiser.step(closure).detach())
        if last is not None and abs(last - value) <= 1e-9 * max(abs(last), abs(value), 1):
            break
        last = value
    return float(cost(x.detach(), torch.tensor([row]))), evaluations


@pytest.mark.parametrize("name", COSTS)
def test_no_worse_than_pytorch(name: str):
    # "robust" has many minima: starts close to one another's basin, so that both solvers look for the same one.
    starts = (0.2 if name == "robust" else 2) * random(4, 12, seed=5)
    result = minimise_lbfgs(with_gradient(COSTS[name]), starts)
    theirs = [torch_lbfgs(COSTS[name], starts, row) for row in range(4)]
    for row, (cost, _) in enumerate(theirs):
        assert float(result.cost[row]) <= cost + 1e-6 * max(abs(cost), 1), row
    assert int(result.evaluations.sum()) <= 1.1 * sum(evaluations for _, evaluations in theirs)


@pytest.mark.parametrize("name", COSTS)
def test_rows_are_independent(name: str):
    starts = random(3, 8, seed=6)
    together = minimise_lbfgs(with_gradient(COSTS[name]), starts)
    for row in range(3):
        alone = minimise_lbfgs(
            with_gradient(lambda x, rows, row=row: COSTS[name](x, torch.full_like(rows, row))), starts[row : row + 1]
        )
        torch.testing.assert_close(alone.cost[0], together.cost[row], rtol=1e-12, atol=1e-12)
        torch.testing.assert_close(alone.x[0], together.x[row], rtol=1e-6, atol=1e-7)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**31), name=st.sampled_from(sorted(COSTS)), spread=st.floats(0.1, 3))
def test_never_above_the_start_and_always_the_best_point_seen(seed: int, name: str, spread: float):
    starts = spread * random(3, 5, seed=seed)
    best = torch.full((3,), torch.inf, dtype=torch.float64)

    def function(x: Tensor, rows: Tensor) -> tuple[Tensor, Tensor]:
        cost, gradient = with_gradient(COSTS[name])(x, rows)
        best[rows] = torch.minimum(best[rows], cost)
        return cost, gradient

    result = minimise_lbfgs(function, starts, rounds=3)
    assert torch.equal(result.cost, best)
    at_x, _ = with_gradient(COSTS[name])(result.x, torch.arange(3))
    torch.testing.assert_close(at_x, best, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("what", ["cost", "gradient"])
@pytest.mark.parametrize("outside", [torch.inf, -torch.inf, torch.nan])
def test_walls_of_cost_that_is_not_finite(outside: float, what: str):
    """Minimum of a linear cost with a logarithmic barrier: x = 1 / slope, and nothing finite at x <= 0."""
    slopes = torch.logspace(-1, 3, 6, dtype=torch.float64)[:, None] * torch.ones(3, dtype=torch.float64)

    def function(x: Tensor, rows: Tensor) -> tuple[Tensor, Tensor]:
        inside = (x > 0).all(-1)
        safe = x.clamp(min=1e-300)
        cost, gradient = (slopes[rows] * x - safe.log()).sum(-1), slopes[rows] - 1 / safe
        if what == "gradient":
            return cost, torch.where(inside[:, None], gradient, outside)
        return torch.where(inside, cost, outside), gradient

    result = minimise_lbfgs(function, torch.full((6, 3), 5.0, dtype=torch.float64), change_tolerance=1e-14)
    torch.testing.assert_close(result.x, 1 / slopes, rtol=1e-5, atol=0)
    assert bool(result.cost.isfinite().all())


def test_rows_that_start_at_nan_come_back_and_disturb_no_other():
    starts = random(4, 6)
    clean = minimise_lbfgs(with_gradient(rosenbrock), starts[[0, 2]])
    starts[1, 3], starts[3, 0] = torch.nan, torch.inf
    result = minimise_lbfgs(with_gradient(rosenbrock), starts)
    assert result.reasons[1] == result.reasons[3] == Reason.START_NOT_FINITE
    torch.testing.assert_close(result.x[[1, 3]], starts[[1, 3]], rtol=0, atol=0, equal_nan=True)
    assert result.evaluations[[1, 3]].tolist() == [1, 1] and bool(result.cost[[1, 3]].isinf().all())
    torch.testing.assert_close(result.cost[[0, 2]], clean.cost, rtol=1e-12, atol=1e-12)


def test_limits_hold():
    result = minimise_lbfgs(with_gradient(rosenbrock), -random(3, 10).abs(), rounds=2, iterations=3)
    assert result.reasons == (Reason.ROUNDS,) * 3 and result.iterations.tolist() == [6] * 3
    assert result.rounds.tolist() == [2] * 3
