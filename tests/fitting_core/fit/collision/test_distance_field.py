"""The conical distance field: its values, derivatives, and that following it separates bodies."""

import numpy as np
import pytest
import torch

from fitting_core.fit.collision.distance_field import (
    SIGMA,
    pair_vertices,
    penetration,
    residuals_with_jacobian,
)

UNIT = [[1.0, 0, 0], [0, 1, 0], [-1, 0, 0]]
"""Circumcentre at the origin, circumradius 1, normal +z."""
TWO_FACES = torch.arange(6).reshape(2, 3)
ONE_PAIR = torch.tensor([[0, 1]])


def field_of_unit(point, sigma):
    """Psi of the unit triangle at a point: the point is the first corner of a triangle far out of the other's cone."""
    vertices = torch.tensor([point, [100.0, 0, 50], [0, 100, 50], *UNIT], dtype=torch.float64)
    return float(penetration(vertices, TWO_FACES, ONE_PAIR, sigma=sigma)[0, 0])


@pytest.mark.parametrize(
    ("point", "sigma", "psi"),
    [
        # Phi = 0.5 / (1 + 2), Upsilon = 0.5 + 1 - 0.25
        ([0.5, 0, -0.5], 0.25, (5 / 6 * 1.25) ** 2),
        # At the surface Upsilon = (3 - 2 sigma) / 4
        ([0, 0.5, 0], 0.25, (0.5 * 0.625) ** 2),
        # Above it, within sigma: cone radius 0.5, Upsilon = -2 / 64 - 0.25 + 0.625
        ([0.15, -0.2, 0.125], 0.25, (0.5 * 0.34375) ** 2),
        # Where the branches meet, Upsilon = 1 and the cone's radius is 2
        ([0.5, 0, -0.25], 0.25, 0.75**2),
        # On the axis
        ([0, 0, -1], 0.5, 1.5**2),
        # At the apex, above it, and beside the cone
        ([0, 0, 0.25], 0.25, 0.0),
        ([0, 0, 0.3], 0.25, 0.0),
        ([1.5, 0, 0.3], 0.25, 0.0),
        ([3.01, 0, -0.5], 0.25, 0.0),
        ([1, 0, 0], 0.25, 0.0),
        # The default, one centimetre deep: Phi = 0.5 / 101
        ([0.5, 0, -0.01], 1e-4, ((1 - 0.5 / 101) * 1.0099) ** 2),
    ],
)
def test_field_values_by_hand(point, sigma, psi):
    assert field_of_unit(point, sigma) == pytest.approx(psi, abs=1e-14)


def test_residuals_are_ordered_by_corner_and_their_roles_exchange():
    vertices = torch.tensor([[0.1, 0.2, -0.1], [0.3, 0.1, 0.4], [-0.2, 0.3, 0.5], *UNIT], dtype=torch.float64)
    forth = penetration(vertices, TWO_FACES, ONE_PAIR, sigma=0.3)
    back = penetration(vertices, TWO_FACES, ONE_PAIR.flip(1), sigma=0.3)
    torch.testing.assert_close(forth, back.roll(3, dims=1))
    expected = [field_of_unit(corner, 0.3) for corner in vertices[:3].tolist()]
    np.testing.assert_allclose(forth[0, :3], expected, rtol=1e-13)
    assert expected[0] > 0 == expected[1]


def random_pairs(seed, count, scale):
    generator = torch.Generator().manual_seed(seed)
    vertices = scale * torch.randn(6 * count, 3, generator=generator, dtype=torch.float64)
    return vertices, torch.arange(6 * count).reshape(-1, 3), torch.arange(2 * count).reshape(-1, 2)


@pytest.mark.parametrize(("sigma", "scale"), [(0.5, 1.0), (0.05, 0.1), (1e-3, 0.01), (SIGMA, 0.01), (SIGMA, 1e-4)])
def test_jacobian_equals_automatic_differentiation(sigma, scale):
    vertices, faces, pairs = random_pairs(0, 40, scale)
    residuals, jacobian = residuals_with_jacobian(vertices, faces, pairs, sigma=sigma)
    full = torch.autograd.functional.jacobian(lambda v: penetration(v, faces, pairs, sigma=sigma), vertices)
    expected = full[torch.arange(40)[:, None, None], torch.arange(6)[:, None], pair_vertices(faces, pairs)[:, None]]
    assert (residuals > 0).sum() > 40
    torch.testing.assert_close(residuals, penetration(vertices, faces, pairs, sigma=sigma))
    torch.testing.assert_close(jacobian, expected, rtol=1e-9, atol=1e-9 * float(expected.abs().max()))


@pytest.mark.parametrize("points", ["on the axis", "no area"])
def test_degenerate_geometry_stays_finite(points):
    other = {
        "on the axis": [[0.0, 0, -0.1], [0, 0, -0.2], [0.1, 0, -0.1]],
        "no area": [[0.0, 0, 0], [1, 1, -1], [2, 2, -2]],
    }
    vertices = torch.tensor([*other[points], *UNIT], dtype=torch.float64, requires_grad=True)
    residuals, jacobian = residuals_with_jacobian(vertices, TWO_FACES, ONE_PAIR, sigma=0.3)
    (gradient,) = torch.autograd.grad(penetration(vertices, TWO_FACES, ONE_PAIR, sigma=0.3).sum(), vertices)
    assert residuals.isfinite().all() and jacobian.isfinite().all()
    torch.testing.assert_close(jacobian[0].sum(dim=0), gradient)
