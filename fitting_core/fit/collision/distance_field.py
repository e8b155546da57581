"""How deep colliding triangles intrude on each other: the conical distance field.

Each triangle carries a cone: its axis is the triangle's normal n through the circumcentre o, its radius is the
circumradius r at the triangle, shrinks to zero at height sigma above it, and grows below it, inside the body. A point
at height x = n.(v - o) and distance rho from the axis has

    Phi = rho / (r (1 - x / sigma)),    Psi = ((1 - Phi) Upsilon(x))^2 where Phi < 1 and x < sigma, else 0.

The penalty of a colliding pair (s, t) is the sum of |-Psi_t(v) n_s|^2 over the corners v of s, and the same with the
roles exchanged: n is a unit vector, so the residuals are the six values of Psi. Sources: Ballan et al., "Motion capture
of hands in action using discriminative salient points", ECCV 2012; Tzionas et al., "Capturing hands in action using
discriminative salient points and physics simulation", IJCV 2016; used for bodies by Pavlakos et al., "Expressive body
capture" (SMPLify-X), CVPR 2019.

Upsilon adds a length to pure numbers, so the unit counts: here metres. At sigma = 1e-4 m it jumps from 0 to 1 within
0.2 mm of the surface and is 1 + depth below: a residual is nearly (1 - Phi)^2, the penalty nearly counts intruding
corners, and what moves them is the slope of Phi across the cone as much as the depth. A larger sigma gives a gentler
field that begins sigma above the surface.
"""

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

SIGMA = 1e-4
"""Metres. The usual setting for SMPL-X bodies (the "cone height" of configurations in the manner of SMPLify-X); Tzionas
et al. use 0.5 in their own unit.

No value is best for every solver: the cost is a staircase in which any of them can stop. A hand partly inside a thigh,
its depth held by a prior only, weight 1, two starts: at 1e-4 L-BFGS freed it twice, Levenberg-Marquardt never; at 1e-3
both freed it twice. From a third start, sunk in to the middle of the limb, none did at any sigma from 1e-4 to 1e-2. Two
balls 1-5 cm into each other, eight starts: Levenberg-Marquardt parted them six times at 1e-4, five times at 1e-3.
"""


class _Cones(NamedTuple):
    """The cones of N triangles, with a leading axis for broadcasting over points."""

    corners: Float[Tensor, "N 3 3"]
    normal: Float[Tensor, "N 3"]
    double_area: Float[Tensor, "N"]
    """1 for a triangle without area, so that nothing divides by zero; its radius is 0 and its field zero everywhere."""
    center: Float[Tensor, "N 3"]
    center_weights: Float[Tensor, "N 3"]
    """Barycentric coordinates of the circumcentre."""
    radius: Float[Tensor, "N"]


class _Heights(NamedTuple):
    """Where points lie in the cones."""

    height: Float[Tensor, "N P"]
    outward: Float[Tensor, "N P 3"]
    """From the axis to the point, perpendicular to the axis."""
    distance: Float[Tensor, "N P"]
    """Length of `outward`."""
    inside: Float[Tensor, "N P"]
    """Whether the point is within the cone (bool)."""
    phi: Float[Tensor, "N P"]
    """Phi within the cone, 1 elsewhere."""


def penetration(
    vertices: Float[Tensor, "V 3"], faces: Int[Tensor, "F 3"], pairs: Int[Tensor, "P 2"], *, sigma: float = SIGMA
) -> Float[Tensor, "P 6"]:
    """Residuals whose sum of squares is the intrusion penalty of these pairs of triangles.

    Args:
        vertices: Metres; gradients flow into them.
        faces: Corners of every triangle, counterclockwise seen from outside.
        pairs: Colliding triangles (s, t), held fixed.
        sigma: Metres, in (0, 0.5].

    Returns:
        For each pair the field of t at the three corners of s, then the field of s at the three corners of t.
    """
    assert 0 < sigma <= 0.5, sigma
    s, t = _corners(vertices, faces, pairs)
    return torch.cat([_field(s, t, sigma), _field(t, s, sigma)], dim=1)


def residuals_with_jacobian(
    vertices: Float[Tensor, "V 3"], faces: Int[Tensor, "F 3"], pairs: Int[Tensor, "P 2"], *, sigma: float = SIGMA
) -> tuple[Float[Tensor, "P 6"], Float[Tensor, "P 6 6 3"]]:
    """The residuals of `penetration`, and their derivatives with respect to the pair's six corners, in closed form.

    On a cone's axis, where Phi has a kink, the derivative of Phi's numerator is taken as zero.

    Args:
        vertices: Metres.
        faces: Corners of every triangle.
        pairs: Colliding triangles (s, t).
        sigma: Metres, in (0, 0.5].

    Returns:
        Residuals (pair, residual), and derivatives (pair, residual, corner, axis) per metre, where the corners are the
        three of s, then the three of t: the vertices `pair_vertices(faces, pairs)`.
    """
    assert 0 < sigma <= 0.5, sigma
    s, t = _corners(vertices.detach(), faces, pairs)
    jacobian = s.new_zeros(len(pairs), 6, 6, 3)
    residuals = []
    for points, triangles, own, other in ((s, t, slice(0, 3), slice(3, 6)), (t, s, slice(3, 6), slice(0, 3))):
        psi, by_point, by_corner = _field_with_derivatives(points, triangles, sigma)
        residuals.append(psi)
        jacobian[:, own, other] = by_corner
        torch.diagonal(jacobian[:, own, own], dim1=1, dim2=2).copy_(by_point.transpose(1, 2))
    return torch.cat(residuals, dim=1), jacobian


def pair_vertices(faces: Int[Tensor, "F 3"], pairs: Int[Tensor, "P 2"]) -> Int[Tensor, "P 6"]:
    """The six vertices of each pair of triangles: the corners of s, then of t."""
    return faces[pairs].reshape(len(pairs), 6)


def _corners(vertices: Tensor, faces: Tensor, pairs: Tensor) -> tuple[Tensor, Tensor]:
    corners = vertices[faces[pairs]]
    return corners[:, 0], corners[:, 1]


def _cones(triangles: Float[Tensor, "N 3 3"]) -> _Cones:
    """Circumcentre from its barycentric coordinates a^2 (b^2 + c^2 - a^2), a the edge opposite the corner."""
    opposite = triangles.roll(1, dims=1) - triangles.roll(-1, dims=1)
    cross = torch.linalg.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    squared_area = cross.square().sum(dim=1)
    flat = squared_area == 0
    double_area = torch.where(flat, 1.0, squared_area).sqrt()
    squares = opposite.square().sum(dim=2)
    weights = squares * (squares.sum(dim=1, keepdim=True) - 2 * squares) / (2 * double_area**2)[:, None] / 2
    offset = torch.einsum("nk,nkx->nx", weights[:, 1:], triangles[:, 1:] - triangles[:, :1])
    radius = torch.where(flat[:, None], 1.0, offset).square().sum(dim=1).sqrt()
    return _Cones(
        corners=triangles,
        normal=cross / double_area[:, None],
        double_area=double_area,
        center=triangles[:, 0] + offset,
        center_weights=weights,
        radius=torch.where(flat, 0.0, radius),
    )


def _place(points: Float[Tensor, "N P 3"], cones: _Cones, sigma: float) -> _Heights:
    normal = cones.normal[:, None]
    height = ((points - cones.corners[:, :1]) * normal).sum(dim=2)
    from_center = points - cones.center[:, None]
    outward = from_center - (from_center * normal).sum(dim=2, keepdim=True) * normal
    on_axis = (outward == 0).all(dim=2)
    distance = torch.where(on_axis[..., None], 1.0, outward).square().sum(dim=2).sqrt()
    distance = torch.where(on_axis, 0.0, distance)
    cone_radius = cones.radius[:, None] * (1 - height / sigma)
    inside = (height < sigma) & (distance < cone_radius)
    phi = torch.where(inside, distance, 1.0) / torch.where(inside, cone_radius, 1.0)
    return _Heights(height=height, outward=outward, distance=distance, inside=inside, phi=phi)


def _upsilon(height: Tensor, sigma: float) -> Tensor:
    """Falls with slope -1 below -sigma, then as a parabola to zero at sigma; zero above."""
    below = -height + 1 - sigma
    bend = -(1 - 2 * sigma) / (4 * sigma**2) * height**2 - height / (2 * sigma) + (3 - 2 * sigma) / 4
    return torch.where(height <= -sigma, below, torch.where(height < sigma, bend, 0.0))


def _upsilon_slope(height: Tensor, sigma: float) -> Tensor:
    bend = -(1 - 2 * sigma) / (2 * sigma**2) * height - 1 / (2 * sigma)
    return torch.where(height <= -sigma, -1.0, torch.where(height < sigma, bend, 0.0))


def _field(points: Float[Tensor, "N P 3"], triangles: Float[Tensor, "N 3 3"], sigma: float) -> Float[Tensor, "N P"]:
    """Psi of each triangle at its points."""
    placed = _place(points, _cones(triangles), sigma)
    return ((1 - placed.phi) * _upsilon(placed.height, sigma)).square()


def _field_with_derivatives(
    points: Float[Tensor, "N P 3"], triangles: Float[Tensor, "N 3 3"], sigma: float
) -> tuple[Float[Tensor, "N P"], Float[Tensor, "N P 3"], Float[Tensor, "N P 3 3"]]:
    """Psi, and its derivatives by the point and by the triangle's corners a_i.

    With w_i(p) the barycentric coordinates of the point's foot in the triangle's plane, w_i(o) those of the
    circumcentre, and u the vector from the axis to the point:

        dx         = n.dv - sum_i w_i(p) n.da_i
        r dr       = sum_i w_i(o) (a_i - o).da_i
        rho d rho  = u.dv - sum_i (w_i(p) - w_i(o)) (a_i - o - x n).da_i
    """
    cones = _cones(triangles)
    placed = _place(points, cones, sigma)
    normal, weights = cones.normal[:, None, :], _foot_weights(points, cones)
    height_by_corner = -weights[..., None] * normal[:, :, None]
    from_center = cones.corners - cones.center[:, None]
    lever = from_center[:, None] - (placed.height[..., None] * normal)[:, :, None]
    distance_by_corner = -(weights - cones.center_weights[:, None])[..., None] * lever
    radius_by_corner = cones.center_weights[..., None] * from_center

    upsilon = _upsilon(placed.height, sigma)
    factor = 2 * (1 - placed.phi) * upsilon * placed.inside
    upsilon_gain = factor * (1 - placed.phi) * _upsilon_slope(placed.height, sigma)
    phi_gain = factor * upsilon
    # d phi = phi (d rho / rho - dr / r + dx / (sigma - x)); the first is phi / rho^2 times rho d rho.
    height_gain = upsilon_gain - phi_gain * placed.phi / torch.where(placed.inside, sigma - placed.height, 1.0)
    apart = placed.inside & (placed.distance > 0)
    distance_gain = -phi_gain * placed.phi / torch.where(apart, placed.distance**2, 1.0)
    radius_gain = phi_gain * placed.phi / torch.where(cones.radius > 0, cones.radius**2, 1.0)[:, None]

    by_point = height_gain[..., None] * normal + distance_gain[..., None] * placed.outward
    by_corner = height_gain[..., None, None] * height_by_corner + distance_gain[..., None, None] * distance_by_corner
    by_corner = by_corner + radius_gain[..., None, None] * radius_by_corner[:, None]
    return ((1 - placed.phi) * upsilon).square(), by_point, by_corner


def _foot_weights(points: Float[Tensor, "N P 3"], cones: _Cones) -> Float[Tensor, "N P 3"]:
    """Barycentric coordinates of the points' feet in the triangles' planes."""
    from_first = points - cones.corners[:, :1]
    first_edge, second_edge = (cones.corners[:, k] - cones.corners[:, 0] for k in (1, 2))
    across = torch.stack(
        [torch.linalg.cross(second_edge, cones.normal), torch.linalg.cross(cones.normal, first_edge)], dim=1
    )
    second_and_third = torch.einsum("npx,nkx->npk", from_first, across) / cones.double_area[:, None, None]
    return torch.cat([1 - second_and_third.sum(dim=2, keepdim=True), second_and_third], dim=2)
