"""Rotations of single joints; the same maps as `body.rotations`, where their sources stand."""

import math

from fitting_core.fit.compiled.jit import helper


@helper
def multiply(a, b, out):
    """out = a b, (3, 3) each."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@helper
def exponential(v, matrix, chart):
    """The rotation of an axis-angle vector, and how it turns about its own axes with it: R(v + d) = R exp(chart d)."""
    x, y, z = v[0], v[1], v[2]
    squared = x * x + y * y + z * z
    # Rodrigues: R = I + a hat(v) + b hat(v)^2. Right Jacobian: I - b hat(v) + c hat(v)^2. Taylor series below 0.01 rad.
    if squared < 1e-4:
        a = 1 - squared / 6 + squared * squared / 120
        b = 0.5 - squared / 24 + squared * squared / 720
        c = 1 / 6 - squared / 120 + squared * squared / 5040
    else:
        angle = math.sqrt(squared)
        sine = math.sin(angle)
        a, b, c = sine / angle, (1 - math.cos(angle)) / squared, (angle - sine) / (squared * angle)
    xx, yy, zz, xy, xz, yz = x * x - squared, y * y - squared, z * z - squared, x * y, x * z, y * z
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = 1 + b * xx, b * xy - a * z, b * xz + a * y
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = b * xy + a * z, 1 + b * yy, b * yz - a * x
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = b * xz - a * y, b * yz + a * x, 1 + b * zz
    chart[0, 0], chart[0, 1], chart[0, 2] = 1 + c * xx, c * xy + b * z, c * xz - b * y
    chart[1, 0], chart[1, 1], chart[1, 2] = c * xy - b * z, 1 + c * yy, c * yz + b * x
    chart[2, 0], chart[2, 1], chart[2, 2] = c * xz + b * y, c * yz - b * x, 1 + c * zz


@helper
def quaternion_of_matrix(m, q):
    """The unit quaternion (w, x, y, z) with w >= 0 of a rotation matrix."""
    # Shepperd (1978): 4 w^2, 4 x^2, ... from the diagonal; the largest of them is never a difference of near values.
    ww, xx = 1 + m[0, 0] + m[1, 1] + m[2, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2]
    yy, zz = 1 - m[0, 0] + m[1, 1] - m[2, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2]
    wx, wy, wz = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    if ww >= xx and ww >= yy and ww >= zz:
        q[0], q[1], q[2], q[3] = ww, wx, wy, wz
    elif xx >= yy and xx >= zz:
        q[0], q[1], q[2], q[3] = wx, xx, xy, xz
    elif yy >= zz:
        q[0], q[1], q[2], q[3] = wy, xy, yy, yz
    else:
        q[0], q[1], q[2], q[3] = wz, xz, yz, zz
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if q[0] < 0:
        length = -length
    for k in range(4):
        q[k] /= length


@helper
def logarithm(m, q, v):
    """The axis-angle vector of a rotation matrix; q is overwritten."""
    quaternion_of_matrix(m, q)
    squared = q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    # |v| / sin(|v| / 2), times (x, y, z) = axis x sin(|v| / 2). Taylor series near no rotation.
    factor = 2 + squared / 3
    if squared >= 1e-6:
        sine = math.sqrt(squared)
        factor = 2 * math.atan2(sine, q[0]) / sine
    for k in range(3):
        v[k] = factor * q[k + 1]


@helper
def inverse_chart(v, out):
    """How log R changes as R turns about its own axes: log(exp(v) exp(d)) = v + out d."""
    x, y, z = v[0], v[1], v[2]
    squared = x * x + y * y + z * z
    # Inverse of the right Jacobian: I + hat(v) / 2 + factor hat(v)^2. Taylor series below 0.03 rad.
    factor = 1 / 12 + squared / 720 + squared * squared / 30240 + squared * squared * squared / 1209600
    if squared >= 1e-3:
        half = math.sqrt(squared) / 2
        factor = (1 - half / math.tan(half)) / squared
    out[0, 0], out[0, 1], out[0, 2] = 1 + factor * (x * x - squared), factor * x * y - 0.5 * z, factor * x * z + 0.5 * y
    out[1, 0], out[1, 1], out[1, 2] = factor * x * y + 0.5 * z, 1 + factor * (y * y - squared), factor * y * z - 0.5 * x
    out[2, 0], out[2, 1], out[2, 2] = factor * x * z - 0.5 * y, factor * y * z + 0.5 * x, 1 + factor * (z * z - squared)
