"""The block-banded solver against dense algebra."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from fitting_core.fit.solvers.banded import diagonal_of_inverse, solve_block_banded


def dense(bands: list[Tensor]) -> Tensor:
    """The whole matrix, (n d, n d), from its blocks."""
    n, size = bands[0].shape[:2]
    matrix = bands[0].new_zeros(n, size, n, size)
    for distance, blocks in enumerate(bands):
        for column, block in enumerate(blocks):
            matrix[column + distance, :, column] = block
            matrix[column, :, column + distance] = block.mT
    return matrix.reshape(n * size, n * size)


def system(
    n: int, size: int, seed: int = 0, damping: float = 0.1, *, bandwidth: int = 2
) -> tuple[list[Tensor], Tensor]:
    """Normal equations J^T J + damping of residuals that couple consecutive blocks, and a right side."""
    generator = torch.Generator().manual_seed(seed)
    jacobian = torch.randn(n + bandwidth, size + 1, bandwidth + 1, size, generator=generator, dtype=torch.float64)
    bands = [torch.zeros(max(n - k, 0), size, size, dtype=torch.float64) for k in range(bandwidth + 1)]
    bands[0] += damping * torch.eye(size, dtype=torch.float64)
    for first in range(-bandwidth, n):
        for a in range(bandwidth + 1):
            for b in range(a + 1):
                row, column = first + a, first + b
                if column >= 0 and row < n:
                    block = jacobian[first + bandwidth, :, a].mT @ jacobian[first + bandwidth, :, b]
                    bands[row - column][column] += block
    return bands, torch.randn(n, size, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize(("size", "bandwidth"), [(1, 2), (63, 2), (7, 0), (7, 1), (7, 3), (7, 4)])
@pytest.mark.parametrize("n", [1, 2, 3, 5, 12])
def test_agrees_with_dense(n: int, size: int, bandwidth: int):
    bands, g = system(n, size, bandwidth=bandwidth)
    x = solve_block_banded(bands, g)
    assert x is not None and x.shape == (n, size)
    expected = torch.linalg.solve(dense(bands), g.flatten()).view(n, size)
    torch.testing.assert_close(x, expected, rtol=1e-9, atol=1e-10)


@settings(max_examples=60, deadline=None)
@given(n=st.integers(1, 7), size=st.integers(1, 5), seed=st.integers(0, 2**31), shift=st.floats(-30.0, 30.0))
def test_none_exactly_where_an_eigenvalue_is_negative(n: int, size: int, seed: int, shift: float):
    bands, g = system(n, size, seed, damping=shift)
    smallest = float(torch.linalg.eigvalsh(dense(bands))[0])
    if abs(smallest) < 1e-9:
        return
    assert (solve_block_banded(bands, g) is None) == (smallest < 0)


@pytest.mark.parametrize("which", range(4))
@pytest.mark.parametrize("value", [float("nan"), float("-inf")])
def test_not_finite_gives_none(which: int, value: float):
    bands, g = system(5, 4)
    [*bands, g][which][1].view(-1)[0] = value
    assert solve_block_banded(bands, g) is None


@pytest.mark.parametrize(("size", "bandwidth"), [(1, 2), (7, 2), (63, 2), (7, 0), (7, 1), (7, 4)])
@pytest.mark.parametrize("n", [1, 2, 3, 5, 12])
def test_the_diagonal_of_the_inverse_is_that_of_the_dense_one(n: int, size: int, bandwidth: int):
    bands, _ = system(n, size, bandwidth=bandwidth)
    inverse = torch.linalg.inv(dense(bands)).view(n, size, n, size)
    expected = torch.stack([inverse[i, :, i] for i in range(n)])
    found = diagonal_of_inverse(bands)
    assert found is not None
    torch.testing.assert_close(found, expected, rtol=1e-8, atol=1e-9)


def test_rounding_does_not_grow_from_frame_to_frame():
    """As E_T couples the frames of a long clip: to far more than each frame alone is known."""
    generator = torch.Generator().manual_seed(0)
    n, size = 120, 12
    second = torch.tensor([1.0, -2.0, 1.0], dtype=torch.float64)
    rows = 30 * torch.randn(n, 30, size, generator=generator, dtype=torch.float64)
    rows[1:] = rows[:1] + 0.3 * rows[1:]
    bands = [torch.zeros(n - k, size, size, dtype=torch.float64) for k in range(3)]
    bands[0] += torch.eye(size, dtype=torch.float64)
    for first in range(n - 2):
        for a in range(3):
            for b in range(a + 1):
                bands[a - b][first + b] += second[a] * second[b] * rows[first + a].mT @ rows[first + b]
    inverse = torch.linalg.inv(dense(bands)).view(n, size, n, size)
    found = diagonal_of_inverse(bands)
    assert found is not None
    torch.testing.assert_close(found, torch.stack([inverse[i, :, i] for i in range(n)]), rtol=1e-5, atol=1e-9)


def test_what_is_not_positive_definite_has_no_inverse():
    bands, _ = system(5, 3)
    bands[0][3, 1, 1] = -1.0
    assert diagonal_of_inverse(bands) is None
