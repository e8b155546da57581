"""The few rotation maps in use: exponential map with its left Jacobian, logarithm, cross-product matrix."""

import roma
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


def exp_and_left_jacobian(v: Float[Tensor, "*b 3"]) -> tuple[Float[Tensor, "*b 3 3"], Float[Tensor, "*b 3 3"]]:
    """exp(v) and L with exp(v + dv) = exp(L dv) exp(v) to first order."""
    a, b, c = _coefficients(v)
    k = hat(v)
    k2 = k @ k
    identity = torch.eye(3, dtype=v.dtype, device=v.device)
    return identity + a * k + b * k2, identity + b * k + c * k2


def log(matrix: Float[Tensor, "*b 3 3"]) -> Float[Tensor, "*b 3"]:
    """Axis-angle of a rotation matrix, exact near pi too (through the quaternion)."""
    return roma.rotmat_to_rotvec(matrix)


def yaw(degrees: float, like: Tensor) -> Float[Tensor, "3 3"]:
    """Rotation about the y axis, in the type and on the device of `like`."""
    return exp(like.new_tensor([0.0, degrees, 0.0]).deg2rad())
