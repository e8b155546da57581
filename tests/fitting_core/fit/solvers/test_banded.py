"""The block-banded solver against dense algebra."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from fitting_core.fit.solvers.banded import solve_block_banded


def dense(diag: Tensor, off1: Tensor, off2: Tensor) -> Tensor:
    """The whole matrix, (n d, n d), from its blocks."""
    n, size = diag.shape[:2]
    matrix = diag.new_zeros(n, size, n, size)
    for distance, blocks in enumerate((diag, off1, off2)):
        for column, block in enumerate(blocks):
            matrix[column + distance, :, column] = block
            matrix[column, :, column + distance] = block.mT
    return matrix.reshape(n * size, n * size)


def system(n: int, size: int, seed: int = 0, damping: float = 0.1) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Normal equations J^T J + damping of residuals that couple three consecutive blocks, and a right side."""
    generator = torch.Generator().manual_seed(seed)
    jacobian = torch.randn(n + 2, size + 1, 3, size, generator=generator, dtype=torch.float64)
    diag = damping * torch.eye(size, dtype=torch.float64).repeat(n, 1, 1)
    off1, off2 = diag.new_zeros(max(n - 1, 0), size, size), diag.new_zeros(max(n - 2, 0), size, size)
    for first in range(-2, n):
        for a in range(3):
            for b in range(a + 1):
                row, column = first + a, first + b
                if column >= 0 and row < n:
                    block = jacobian[first + 2, :, a].mT @ jacobian[first + 2, :, b]
                    (diag, off1, off2)[row - column][column] += block
    return diag, off1, off2, torch.randn(n, size, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize("size", [1, 2, 7, 63])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 12])
def test_agrees_with_dense(n: int, size: int):
    diag, off1, off2, g = system(n, size)
    x = solve_block_banded(diag, off1, off2, g)
    assert x is not None and x.shape == (n, size)
    expected = torch.linalg.solve(dense(diag, off1, off2), g.flatten()).view(n, size)
    torch.testing.assert_close(x, expected, rtol=1e-9, atol=1e-10)


@settings(max_examples=60, deadline=None)
@given(n=st.integers(1, 9), size=st.integers(1, 6), seed=st.integers(0, 2**31), damping=st.sampled_from([1e-3, 1, 1e4]))
def test_solution_satisfies_the_system(n: int, size: int, seed: int, damping: float):
    diag, off1, off2, g = system(n, size, seed, damping)
    x = solve_block_banded(diag, off1, off2, g)
    assert x is not None
    matrix = dense(diag, off1, off2)
    # Backward stability of Cholesky: the residual is small relative to |H| |x|, whatever the condition number.
    residual = (matrix @ x.flatten() - g.flatten()).norm()
    assert residual <= 1e-13 * n * size * (matrix.norm() * x.norm() + g.norm())


@settings(max_examples=60, deadline=None)
@given(n=st.integers(1, 7), size=st.integers(1, 5), seed=st.integers(0, 2**31), shift=st.floats(-30.0, 30.0))
def test_none_exactly_where_an_eigenvalue_is_negative(n: int, size: int, seed: int, shift: float):
    diag, off1, off2, g = system(n, size, seed, damping=shift)
    smallest = float(torch.linalg.eigvalsh(dense(diag, off1, off2))[0])
    if abs(smallest) < 1e-9:
        return
    assert (solve_block_banded(diag, off1, off2, g) is None) == (smallest < 0)


@pytest.mark.parametrize("bad", [0, 1, 4])
def test_indefinite_block_gives_none_wherever_it_is(bad: int):
    diag, off1, off2, g = system(5, 4)
    diag[bad] -= 1e3 * torch.eye(4, dtype=torch.float64)
    assert solve_block_banded(diag, off1, off2, g) is None


@pytest.mark.parametrize("which", range(4))
@pytest.mark.parametrize("value", [float("nan"), float("-inf")])
def test_not_finite_gives_none(which: int, value: float):
    parts = system(5, 4)
    parts[which][1].view(-1)[0] = value
    assert solve_block_banded(*parts) is None


def test_reads_only_the_lower_triangle_of_the_diagonal():
    diag, off1, off2, g = system(4, 5)
    expected = solve_block_banded(diag, off1, off2, g)
    upper = torch.ones(5, 5, dtype=torch.bool).triu(1)
    x = solve_block_banded(diag.masked_fill(upper, 123.0), off1, off2, g)
    assert x is not None
    torch.testing.assert_close(x, expected, rtol=0, atol=0)


def test_float32_and_arguments_unchanged():
    parts = system(20, 30, damping=10.0)
    singles = tuple(part.float() for part in parts)
    copies = tuple(part.clone() for part in singles)
    x, expected = solve_block_banded(*singles), solve_block_banded(*parts)
    assert x is not None and expected is not None and x.dtype == torch.float32
    torch.testing.assert_close(x.double(), expected, rtol=0, atol=1e-4 * float(expected.abs().max()))
    assert all(torch.equal(part, copy) for part, copy in zip(singles, copies, strict=True))


def test_no_blocks():
    empty = torch.zeros(0, 3, 3)
    x = solve_block_banded(empty, empty, empty, torch.zeros(0, 3))
    assert x is not None and x.shape == (0, 3)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_cuda_agrees_with_cpu():
    parts = system(30, 20)
    x = solve_block_banded(*(part.cuda() for part in parts))
    expected = solve_block_banded(*parts)
    assert x is not None and expected is not None
    torch.testing.assert_close(x.cpu(), expected, rtol=1e-9, atol=1e-10)
    parts[0][3] -= 1e4 * torch.eye(20, dtype=torch.float64)
    assert solve_block_banded(*(part.cuda() for part in parts)) is None
