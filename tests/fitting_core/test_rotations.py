"""The rotation maps: axioms, another implementation, automatic differentiation, and what happens at zero and at pi."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from torch import Tensor

from fitting_core.body import rotations

IDENTITY = torch.eye(3, dtype=torch.float64)
_COMPONENT = st.floats(-1, 1, allow_nan=False)


@st.composite
def rotation_vectors(draw, *, longest: float = 12.0) -> Tensor:
    """Axis-angle vectors of every size: tiny, across the switch to the series, near pi, beyond a turn."""
    axis = np.array([draw(_COMPONENT) for _ in range(3)])
    axis = axis / np.linalg.norm(axis) if np.linalg.norm(axis) > 1e-3 else np.array([0.0, 0.0, 1.0])
    special = st.sampled_from([0.0, 1e-12, 1e-5, 0.00999, 0.01, 0.01001, math.pi - 1e-7, math.pi, math.pi + 1e-7])
    angle = draw(st.one_of(special, st.floats(0, longest)))
    return torch.as_tensor(min(angle, longest) * axis)


@given(rotation_vectors())
def test_exp_is_a_rotation_and_agrees_with_scipy(v: Tensor):
    matrix = rotations.exp(v)
    torch.testing.assert_close(matrix @ matrix.T, IDENTITY, rtol=0, atol=1e-11)
    assert float(torch.linalg.det(matrix)) == pytest.approx(1, abs=1e-11)
    torch.testing.assert_close(matrix, torch.as_tensor(Rotation.from_rotvec(v).as_matrix()), rtol=0, atol=1e-11)


@given(rotation_vectors(longest=math.pi - 1e-4))
def test_log_undoes_exp_below_pi(v: Tensor):
    torch.testing.assert_close(rotations.log(rotations.exp(v)), v, rtol=0, atol=1e-9)


@given(rotation_vectors())
def test_exp_undoes_log_everywhere(v: Tensor):
    matrix = rotations.exp(v)
    again = rotations.log(matrix)
    assert float(again.norm()) <= math.pi + 1e-9
    torch.testing.assert_close(rotations.exp(again), matrix, rtol=0, atol=1e-9)


@given(rotation_vectors())
def test_left_jacobian_is_the_derivative_of_exp(v: Tensor):
    matrix, left = rotations.exp(v), rotations.left_jacobian(v)
    derivative = torch.func.jacfwd(rotations.exp)(v)  # (3, 3, 3), the last axis by component of v
    for k in range(3):
        torch.testing.assert_close(derivative[..., k], rotations.hat(left[:, k]) @ matrix, rtol=0, atol=1e-9)


def _series(a: float, first: int) -> float:
    """sum over k of (-1)^k a^(2k) / (2k + first)!: sin(a)/a, (1 - cos a)/a^2 and (a - sin a)/a^3 for first 1, 2, 3."""
    return sum((-1) ** k * a ** (2 * k) / math.factorial(2 * k + first) for k in range(12))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.0099, 0.00999999, 0.01, 0.01000001, 0.02, 0.5])
def test_series_meets_the_closed_form(angle: float):
    v = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64) * angle
    k = rotations.hat(v)
    a, b, c = (_series(angle, first) for first in (1, 2, 3))
    matrix, left = rotations.exp(v), rotations.left_jacobian(v)
    torch.testing.assert_close(matrix, IDENTITY + a * k + b * k @ k, rtol=0, atol=1e-15)
    torch.testing.assert_close(left, IDENTITY + b * k + c * k @ k, rtol=0, atol=1e-14)


def test_differentiable_at_zero():
    zero = torch.zeros(3, dtype=torch.float64)
    first = torch.func.jacrev(rotations.exp)(zero)
    for k in range(3):
        torch.testing.assert_close(first[..., k], rotations.hat(IDENTITY[k]), rtol=0, atol=0)
    second = torch.func.jacfwd(torch.func.jacrev(rotations.exp))(zero)
    for j in range(3):  # exp(v) = 1 + K + K^2 / 2 + ...
        for k in range(3):
            a, b = rotations.hat(IDENTITY[j]), rotations.hat(IDENTITY[k])
            torch.testing.assert_close(second[..., j, k], (a @ b + b @ a) / 2, rtol=0, atol=1e-12)


def test_yaw_turns_x_towards_minus_z():
    like = torch.zeros(1, dtype=torch.float64)
    expected = torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]], dtype=torch.float64)
    torch.testing.assert_close(rotations.yaw(90.0, like), expected, rtol=0, atol=1e-15)
    assert rotations.yaw(90.0, like.float()).dtype == torch.float32


def random_columns(count: int = 50) -> Tensor:
    g = torch.Generator().manual_seed(1)
    return torch.randn(count, 3, 2, generator=g, dtype=torch.float64) * torch.rand(count, 1, 2, generator=g).double()


def test_orthonormalised_is_the_rotation_of_a_qr_decomposition():
    columns = random_columns()
    q, r = torch.linalg.qr(columns)
    q = q * r.diagonal(dim1=1, dim2=2).sign()[:, None]
    matrix = rotations.orthonormalised(columns)
    torch.testing.assert_close(matrix[..., :2], q, rtol=0, atol=1e-12)
    torch.testing.assert_close(torch.linalg.det(matrix), torch.ones(50, dtype=torch.float64), rtol=0, atol=1e-12)
    torch.testing.assert_close(rotations.orthonormalised(matrix[..., :2]), matrix, rtol=0, atol=1e-14)


def test_tangent_of_orthonormalised_is_its_derivative():
    columns = random_columns()
    matrix, tangent = rotations.orthonormalised_with_tangent(columns)
    derivative = torch.func.vmap(torch.func.jacfwd(rotations.orthonormalised))(columns).flatten(-2)
    turned = torch.einsum("bij,bjkn->bikn", matrix, rotations.hat(tangent.mT).permute(0, 2, 3, 1))
    torch.testing.assert_close(turned, derivative, rtol=1e-10, atol=1e-10)
