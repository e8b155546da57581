"""The few rotation maps in use: exponential map and logarithm with their Jacobians, two columns made orthonormal."""

import torch
from jaxtyping import Float
from torch import Tensor


def hat(v: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3 3"]:
    """Cross-product matrix: hat(v) @ u = v x u."""
    x, y, z = v.unbind(-1)
    o = torch.zeros_like(x)
    return torch.stack([o, -z, y, z, o, -x, -y, x, o], -1).reshape(*v.shape[:-1], 3, 3)


def _coefficients(v: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """sin(a)/a, (1 - cos a)/a^2, (a - sin a)/a^3 for a = |v|, by their series below a^2 = 1e-4 (error < 1e-12)."""
    squared = (v * v).sum(-1)
    small = squared < 1e-4
    safe = torch.where(small, torch.ones_like(squared), squared)  # no 0/0 in the branch not taken: autograd stays clean
    angle = safe.sqrt()
    sin, cos = angle.sin(), angle.cos()
    a = torch.where(small, 1 - squared / 6 + squared**2 / 120, sin / angle)
    b = torch.where(small, 0.5 - squared / 24 + squared**2 / 720, (1 - cos) / safe)
    c = torch.where(small, 1 / 6 - squared / 120 + squared**2 / 5040, (angle - sin) / (safe * angle))
    return a[..., None, None], b[..., None, None], c[..., None, None]


def exp(v: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3 3"]:
    """Rotation matrix of an axis-angle vector in radians (Rodrigues); differentiable at zero."""
    a, b, _ = _coefficients(v)
    k = hat(v)
    return torch.eye(3, dtype=v.dtype, device=v.device) + a * k + b * (k @ k)


def left_jacobian(v: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3 3"]:
    """L with exp(v + dv) = exp(L dv) exp(v) to first order."""
    _, b, c = _coefficients(v)
    k = hat(v)
    return torch.eye(3, dtype=v.dtype, device=v.device) + b * k + c * (k @ k)


def by_axis_angle(matrix: Float[Tensor, "*b 3 3"], v: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3 9"]:
    """d R / d v_k = hat(column k of L) R, row by row, of a rotation R = exp(v) and its left Jacobian L."""
    return (hat(left_jacobian(v).mT) @ matrix[..., None, :, :]).flatten(-2)


def log(matrix: Float[Tensor, "*b 3 3"]) -> Float[Tensor, "*b 3"]:
    """Axis-angle of a rotation matrix, exact near zero and pi too; of a length of pi at most.

    Through the unit quaternion q, of which the matrix gives 4 q_k q for each k: the one with the largest q_k is taken
    (Shepperd 1978). As quick as roma's, whose package loads torch's compiler: 1.9 s before the first fit or drag.
    """
    a, b, c, d, e, f, g, h, i = matrix.flatten(-2).unbind(-1)
    wx, wy, wz, xy, xz, yz = h - f, c - g, d - b, b + d, c + g, f + h
    ww, xx, yy, zz = 1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i
    rows = torch.stack([ww, wx, wy, wz, wx, xx, xy, xz, wy, xy, yy, yz, wz, xz, yz, zz], -1).unflatten(-1, (4, 4))
    largest = rows.diagonal(dim1=-2, dim2=-1).argmax(-1)[..., None, None]
    q = torch.nn.functional.normalize(rows.take_along_dim(largest, -2)[..., 0, :], dim=-1)
    cos, sines = torch.where(q[..., :1] < 0, -q, q).split([1, 3], -1)  # of half the angle
    squared = (sines * sines).sum(-1, keepdim=True)
    small = squared < 1e-6
    sin = torch.where(small, torch.ones_like(squared), squared).sqrt()
    return torch.where(small, 2 + squared / 3, 2 * torch.atan2(sin, cos) / sin) * sines


def orthonormalised(columns: Float[Tensor, "*b 3 2"]) -> Float[Tensor, "*b 3 3"]:
    """Rotation matrix of the 6D representation by Gram-Schmidt (Zhou et al. 2019, eq. 15).

    The first column is made a unit, the second orthogonal to it, the third is their cross product.
    """
    return _gram_schmidt(columns)[0]


def orthonormalised_with_tangent(
    columns: Float[Tensor, "*b 3 2"],
) -> tuple[Float[Tensor, "*b 3 3"], Float[Tensor, "*b 3 6"]]:
    """R of `orthonormalised` and G: R turns to R exp(G d) to first order when d is added to the row-major columns.

    With b_i the columns of R, b_i . db_j are the components of the turn about R's own axes, and b_3 . b_1 = 0 leaves
    of each derivative a multiple of b_2 or b_3.
    """
    matrix, along, first, second = _gram_schmidt(columns)
    _, b2, b3 = matrix.unbind(-1)
    zero = torch.zeros_like(b2)
    by_first = torch.stack([-along / (first * second) * b3, -b3 / first, b2 / first], -2)
    by_second = torch.stack([b3 / second, zero, zero], -2)
    return matrix, torch.stack([by_first, by_second], -1).flatten(-2)


def _gram_schmidt(columns: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The rotation, b1 . a2, and the lengths that the first and the orthogonal part of the second column have."""
    a1, a2 = columns.unbind(-1)
    first = _length(a1)
    b1 = a1 / first
    along = (b1 * a2).sum(-1, keepdim=True)
    across = a2 - along * b1
    second = _length(across)
    b2 = across / second
    return torch.stack([b1, b2, torch.linalg.cross(b1, b2)], -1), along, first, second


def _length(v: Tensor) -> Tensor:
    """|v|, kept from 0 so that what is divided by it stays finite."""
    return torch.linalg.vector_norm(v, dim=-1, keepdim=True).clamp_min(1e-12)


def yaw(degrees: float, like: Tensor) -> Float[Tensor, "3 3"]:
    """Rotation about the y axis, in the type and on the device of `like`."""
    return exp(like.new_tensor([0.0, degrees, 0.0]).deg2rad())
