"""Terms of one frame: their costs, and what they add to the gradient and to the matrix in turn columns."""

import math

from fitting_core.fit.fused.body import joint_row
from fitting_core.fit.fused.constants import BODY, N_BODY
from fitting_core.fit.fused.jit import helper
from fitting_core.fit.fused.turns import inverse_chart, logarithm, quaternion

_NEARLY_OPPOSITE, _TINY = 1e-6, 1e-30
"""As in `terms.limits`."""
_NEAREST = 0.1
"""Metres, as in `variables.estimate`."""


@helper
def point_cost(c, frame, x, scratch):
    """Of the keypoints, in the image and in space; infinite where a point lies behind the camera. Leaves the errors in
    `scratch.error`."""
    cost, f, points, error = 0.0, c.fixed, scratch.points, scratch.error
    origin, at = scratch.frame.v, f.translation - f.shift
    for d in range(3):
        origin[d] = x[at + d] + f.pelvis[d]
    for i in range(len(points)):
        keypoint, depth = c.keypoints[frame, i], points[i, 2]
        if not depth > _NEAREST:
            return math.inf
        weight, squared = keypoint.weight * keypoint.weight, c.points[i].rho * c.points[i].rho
        for d in range(2):
            e = f.focal[d] * points[i, d] / depth + f.center[d] - keypoint.xy[d]
            if e * keypoint.side[d] > 0:
                e = 0.0
            error[i, d] = e
            cost += weight * squared * e * e / (e * e + squared)
        for d in range(3):
            if keypoint.place_weight[d] > 0.0:
                weight, rho = keypoint.place_weight[d], keypoint.place_rho[d]
                e = points[i, d] - origin[d] - keypoint.place[d]
                error[i, 2 + d] = e
                cost += weight * weight * rho * rho * e * e / (e * e + rho * rho)
            if keypoint.spot_weight[d] > 0.0:
                weight, rho = keypoint.spot_weight[d], keypoint.spot_rho[d]
                e = points[i, d] - keypoint.spot[d]
                error[i, 5 + d] = e
                cost += weight * weight * rho * rho * e * e / (e * e + rho * rho)
    return cost


@helper
def taller_by(c, x):
    """Weighted: how far the height is from what it is said to be; 0 where nothing is said."""
    f, away = c.fixed, -c.fixed.height
    for k in range(10):
        away += f.taller[k] * x[f.betas - f.shift + k]
    return away


@helper
def column_cost(c, frame, orient, x):
    """Of the quadratic terms, and of a root that leans or turns."""
    cost, f, held = 0.0, c.fixed, c.held[frame]
    for k in range(f.columns_held):
        away = f.weight[k] * (x[k] - held.target[k])
        cost += away * away
    missing = taller_by(c, x)
    cost += missing * missing
    if f.upright:
        cost += held.lean * held.lean * (orient[0, 1] * orient[0, 1] + orient[2, 1] * orient[2, 1])
        cost += held.turn * held.turn * orient[0, 2] * orient[0, 2]
    return cost


@helper
def add_upright(c, frame, orient, s):
    """Gradient and matrix: the root turns about the axes of camera space, d (R a) = d x (R a)."""
    held = c.held[frame]
    for row in range(3):
        weight, axis = (held.lean, 1) if row < 2 else (held.turn, 2)
        y0, y1, y2 = weight * orient[0, axis], weight * orient[1, axis], weight * orient[2, axis]
        if row == 1:
            value, s.v[0], s.v[1], s.v[2] = y2, y1, -y0, 0.0
        else:
            value, s.v[0], s.v[1], s.v[2] = y0, 0.0, y2, -y1
        _add_row(s, 0, s.v, 3, 1.0, value)


@helper
def _add_row(s, first, row, count, weight, value):
    """Adds a row, weighted, that depends on some columns in a row."""
    for a in range(count):
        s.gradient[first + a] += weight * value * row[a]
        for b in range(a + 1):
            s.matrix[first + a, first + b] += weight * row[a] * row[b]


@helper
def limit_cost(c, s, derivatives):
    """Cost of the joint limits; with `derivatives` they are added to gradient and matrix."""
    cost, f = 0.0, c.fixed
    weight = f.limit_weight * f.limit_weight
    for n in range(f.limited):
        limit = c.limits[n]
        joint, frame = limit.joint, limit.frame
        quaternion(s.local[joint], s.q)
        for k in range(4):
            s.u[k] = frame[k, 0] * s.q[0] + frame[k, 1] * s.q[1] + frame[k, 2] * s.q[2] + frame[k, 3] * s.q[3]
        w, t, p, q = s.u[0], s.u[1], s.u[2], s.u[3]
        sine2, cosine2 = p * p + q * q, max(w * w + t * t, _NEARLY_OPPOSITE)
        sine, cosine = math.sqrt(sine2 + _TINY), math.sqrt(cosine2)
        stretch = 2 * math.atan2(sine, cosine) / (sine * cosine)
        for angle in range(3):
            if angle == 0:
                value = stretch * (p * w - q * t)
            elif angle == 1:
                value = stretch * (p * t + q * w)
            else:
                value = 2 * math.atan(t / w)
            value += limit.offset[angle]
            excess = value - min(max(value, limit.low[angle]), limit.high[angle])
            if excess == 0.0:
                continue
            cost += weight * excess * excess
            if derivatives and (f.free_body if joint <= N_BODY else f.free_hands):
                rise = (2 + (2 * sine2 - 1) * stretch) / ((sine2 + _TINY) * cosine2)
                by_turn = _limit_slope(angle, w, t, p, q, stretch, rise, 2 / cosine2, frame, s.q)
                first, count = joint_row(c, joint, by_turn, s)
                _add_row(s, first, s.wide, count, weight, excess)
    return cost


@helper
def _limit_slope(angle, w, t, p, q, stretch, rise, turn, frame, unit):
    """How an angle changes as the joint turns about its own axes: by its quaternion, dq = q (0, d) / 2."""
    if angle == 0:
        ahead = rise * (p * w - q * t)
        a0, a1, a2, a3 = stretch * p, -stretch * q, stretch * w + ahead * p, ahead * q - stretch * t
    elif angle == 1:
        aside = rise * (p * t + q * w)
        a0, a1, a2, a3 = stretch * q, stretch * p, stretch * t + aside * p, stretch * w + aside * q
    else:
        a0, a1, a2, a3 = -turn * t, turn * w, 0.0, 0.0
    b0 = a0 * frame[0, 0] + a1 * frame[1, 0] + a2 * frame[2, 0] + a3 * frame[3, 0]
    b1 = a0 * frame[0, 1] + a1 * frame[1, 1] + a2 * frame[2, 1] + a3 * frame[3, 1]
    b2 = a0 * frame[0, 2] + a1 * frame[1, 2] + a2 * frame[2, 2] + a3 * frame[3, 2]
    b3 = a0 * frame[0, 3] + a1 * frame[1, 3] + a2 * frame[2, 3] + a3 * frame[3, 3]
    return (
        0.5 * (-b0 * unit[1] + b1 * unit[0] + b2 * unit[3] - b3 * unit[2]),
        0.5 * (-b0 * unit[2] - b1 * unit[3] + b2 * unit[0] + b3 * unit[1]),
        0.5 * (-b0 * unit[3] + b1 * unit[2] - b2 * unit[1] + b3 * unit[0]),
    )


@helper
def pose_cost(c, frame, x, s, derivatives):
    """Cost of the terms on the axis-angle of body joints, rest and bending; `derivatives` as in `limit_cost`."""
    f, held, cost = c.fixed, c.held[frame], 0.0
    if not f.held and f.bending == 0.0:
        return cost
    for j in range(N_BODY):
        rest, bent = held.rest[3 * j : 3 * j + 3], f.bent[3 * j : 3 * j + 3]
        bends = f.bending != 0.0 and (bent[0] != 0.0 or bent[1] != 0.0)
        if rest[0] == 0.0 and not bends:
            continue
        if len(c.layers):
            logarithm(s.local[j + 1], s.q, s.v)
            inverse_chart(s.v, s.m)
        else:
            for d in range(3):
                s.v[d] = x[BODY + 3 * j + d]
                for k in range(3):
                    s.m[d, k] = 1.0 if d == k else 0.0
        for d in range(3):
            away = s.v[d] - f.rest_pose[3 * j + d]
            cost += rest[d] * rest[d] * away * away
            if derivatives:
                _add_row(s, BODY + 3 * j, s.m[d], 3, rest[d] * rest[d], away)
            if bends and bent[d] != 0.0:
                value = f.bending * math.exp(bent[d] * s.v[d])
                cost += value * value
                if derivatives:
                    _add_row(s, BODY + 3 * j, s.m[d], 3, value * value, bent[d])
    return cost
