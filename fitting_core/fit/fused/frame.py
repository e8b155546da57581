"""The objective E_o of one frame: cost, gradient and Gauss-Newton matrix, as `objective.FrameObjective` has them."""

import math

from fitting_core.fit.fused.body import (
    add_through_correctives,
    move_by_coefficients,
    pose_points,
    pose_skeleton,
    turn_axes,
    turn_joints,
)
from fitting_core.fit.fused.constants import BODY, FIRST_FINGER, HANDS, JAW_JOINT, N_BODY
from fitting_core.fit.fused.jit import helper
from fitting_core.fit.fused.network import latent_gradient, turns_by_latent
from fitting_core.fit.fused.products import half_products, products
from fitting_core.fit.fused.scratch import LANES
from fitting_core.fit.fused.terms import add_upright, column_cost, limit_cost, point_cost, pose_cost, taller_by


@helper
def cost_of(c, frame, orient, x, scratch, everything):
    """Cost of a state (root's rotation, numbers); infinite where a point lies behind the camera.

    `everything`: more than what is free may differ from the state before.
    """
    s = scratch.frame
    turn_joints(c, orient, x, s, everything)
    pose_skeleton(c, x, s)
    pose_points(c, frame, x, scratch)
    cost = point_cost(c, frame, x, scratch)
    if cost == math.inf:
        return cost
    return cost + column_cost(c, frame, orient, x) + limit_cost(c, s, False) + pose_cost(c, frame, x, s, False)


@helper
def derive(c, frame, orient, x, scratch):
    """Gradient (`free_gradient`) and lower triangle of the matrix (`free_matrix`), right after `cost_of`."""
    s, f = scratch.frame, c.fixed
    for a in range(f.width):
        s.gradient[a], line = 0.0, s.matrix[a]
        for b in range(a + 1):
            line[b] = 0.0
    turn_axes(s)
    low, high = 0 if f.free_betas else 10, 20 if f.free_face else 10
    if low < high:
        move_by_coefficients(c, frame, low, high, scratch)
    for p in range(len(scratch.pull)):
        for d in range(3):
            scratch.pull[p, d] = 0.0
    for g in range(len(c.groups)):
        _add_group(c, frame, c.groups[g], scratch)
    add_through_correctives(c, frame, scratch)
    limit_cost(c, s, True)
    pose_cost(c, frame, x, s, True)
    if f.upright:
        add_upright(c, frame, orient, s)
    _to_state_columns(c, s)
    _take_free(c, frame, x, s)


@helper
def _add_group(c, frame, group, scratch):
    """The keypoints of one limb."""
    s, f, count = scratch.frame, c.fixed, 0
    for o in range(group.first, group.last):
        i = c.order[o]
        keypoint = c.keypoints[frame, i]
        # Across the line of sight there is a place of what is not detected, and of all that a given start knows.
        weight, across, along = keypoint.weight, keypoint.place_weight[0] > 0.0, keypoint.place_weight[2] > 0.0
        if keypoint.spot_weight[0] > 0.0:
            for k in range(3):
                e, far = scratch.error[i, 5 + k], keypoint.spot_rho[k] * keypoint.spot_rho[k]
                s.left[k, 0] = s.left[k, 1] = s.left[k, 2] = 0.0
                s.left[k, k] = keypoint.spot_weight[k] * far / (e * e + far)
                s.pulls[k] = s.left[k, k] * e
            count = _add_rows(c, c.points[i], group, 3, 3, count, scratch)
        if across:
            for k in range(3):
                _set_place_row(keypoint, scratch.error[i, 2 + k], k, s)
            count = _add_rows(c, c.points[i], group, 3, 0, count, scratch)
        if weight == 0.0 and (across or not along):
            continue
        squared, depth = c.points[i].rho * c.points[i].rho, scratch.points[i, 2]
        for k in range(2):
            e = scratch.error[i, k]
            scale = weight * squared / (e * e + squared)
            s.left[k, 1 - k] = 0.0
            s.left[k, k] = scale * f.focal[k] / depth
            s.left[k, 2] = -scale * f.focal[k] * scratch.points[i, k] / (depth * depth)
            s.pulls[k] = scale * e
        ranks = 2
        if along and not across:  # with the two of the image: half of the work of its own
            _set_place_row(keypoint, scratch.error[i, 4], 2, s)
            ranks = 3
        count = _add_rows(c, c.points[i], group, ranks, 2, count, scratch)
    for k in range(group.width):
        for extra in range(count, count + -count % LANES):
            scratch.rows[k, extra] = 0.0
    count += -count % LANES
    half_products(scratch.rows, group.width, scratch.rows, count, s.small)
    for a in range(group.width):
        line = s.matrix[group.column[a]]
        for b in range(a + 1):
            line[group.column[b]] += s.small[b, a]


@helper
def _set_place_row(keypoint, e, k, s):
    """The derivative and the pull of a known position along an axis."""
    far = keypoint.place_rho[k] * keypoint.place_rho[k]
    s.left[k, 0] = s.left[k, 1] = s.left[k, 2] = 0.0
    s.left[k, k] = keypoint.place_weight[k] * far / (e * e + far)
    s.pulls[k] = s.left[k, k] * e


@helper
def _add_rows(c, point, group, ranks, moving, count, scratch):
    """Rows of a keypoint: into the gradient, and to the `count` that wait to be multiplied. Returns how many wait."""
    s = scratch.frame
    _set_rows(c, point, group, ranks, moving, scratch)
    for r in range(ranks):
        for k in range(group.width):
            scratch.rows[k, count + r] = s.three[r, k]
            s.gradient[group.column[k]] += s.three[r, k] * s.pulls[r]
    return count + ranks


@helper
def _set_rows(c, point, group, ranks, moving, scratch):
    """Two or three rows of a keypoint in its group's columns, in `three`; the first ones move with the translation."""
    s, f = scratch.frame, c.fixed
    for p in range(point.first_pair, point.last_pair):
        for d in range(3):
            scratch.pull[p, d] += s.left[0, d] * s.pulls[0] + s.left[1, d] * s.pulls[1]
            if ranks == 3:
                scratch.pull[p, d] += s.left[2, d] * s.pulls[2]
    for k in range(ranks):
        row = s.three[k]
        for a in range(group.width):
            row[a] = 0.0
    for e in range(point.first_entry, point.last_entry):
        entry = c.entries[e]
        _lever_arm(c, point.joint, entry, scratch)
        axes, finger = s.axes[entry.joint], entry.joint - FIRST_FINGER
        if finger >= 0:
            at = group.place[HANDS + (f.hand if finger >= 15 else 0)]
        else:
            at = group.place[f.jaw if entry.joint == JAW_JOINT else 3 * entry.joint]
        for k in range(ranks):
            l0, l1, l2 = s.left[k, 0], s.left[k, 1], s.left[k, 2]
            c0, c1, c2 = s.v[1] * l2 - s.v[2] * l1, s.v[2] * l0 - s.v[0] * l2, s.v[0] * l1 - s.v[1] * l0
            q0 = c0 * axes[0, 0] + c1 * axes[1, 0] + c2 * axes[2, 0]
            q1 = c0 * axes[0, 1] + c1 * axes[1, 1] + c2 * axes[2, 1]
            q2 = c0 * axes[0, 2] + c1 * axes[1, 2] + c2 * axes[2, 2]
            if finger >= 0:
                b = f.hand_basis
                row = s.three[k, at : at + f.hand]
                _add_three(row, q0, q1, q2, b[3 * finger], b[3 * finger + 1], b[3 * finger + 2])
            else:
                s.three[k, at], s.three[k, at + 1], s.three[k, at + 2] = q0, q1, q2
    translation = group.place[f.translation]
    for k in range(moving):
        for d in range(3):
            s.three[k, translation + d] = s.left[k, d]
    if f.free_betas:
        _add_coefficients(point, 0, group.place[f.betas], ranks, scratch)
    if f.free_face:
        _add_coefficients(point, 10, group.place[f.expression], ranks, scratch)


@helper
def _add_three(row, w0, w1, w2, l0, l1, l2):
    """Adds the weighted sum of three lines."""
    for k in range(len(row)):
        row[k] += w0 * l0[k] + w1 * l1[k] + w2 * l2[k]


@helper
def _lever_arm(c, joint, entry, scratch):
    """What of a point turns with a joint, from this joint on (see `body.points`), into `v`."""
    s, turning = scratch.frame, entry.joint
    if joint >= 0:
        for d in range(3):
            s.v[d] = s.joints[joint, d] - s.joints[turning, d]
        return
    share = 0.0
    s.v[0] = s.v[1] = s.v[2] = 0.0
    for a in range(entry.first_arm, entry.last_arm):
        p = c.arms[a]
        share += scratch.weight[p]
        for d in range(3):
            s.v[d] += scratch.pairs[p, d]
    for d in range(3):
        s.v[d] -= share * s.joints[turning, d]


@helper
def _add_coefficients(point, low, at, ranks, scratch):
    """The columns of betas or expression."""
    s, last = scratch.frame, low + 10
    for k in range(ranks):
        row, l0, l1, l2 = s.three[k, at : at + 10], s.left[k, 0], s.left[k, 1], s.left[k, 2]
        if point.joint >= 0:
            m = s.joint_motion[point.joint]
            _add_three(row, l0, l1, l2, m[0, low:last], m[1, low:last], m[2, low:last])
        for p in range(point.first_pair, point.last_pair):
            m = scratch.pair_motion[p]
            _add_three(row, l0, l1, l2, m[0, low:last], m[1, low:last], m[2, low:last])


@helper
def _to_state_columns(c, s):
    """From turn columns to those of the state (lower triangle): the body's go through the pose prior."""
    f, size, count = c.fixed, c.fixed.latent, 3 * N_BODY + 1  # the last one 0 in `by_latent`, see LANES
    for a in range(f.width):
        if BODY <= a < HANDS and len(c.layers):
            continue
        at = a if a < BODY else a - f.shift
        s.state_gradient[at], line, out = s.gradient[a], s.matrix[a], s.state_matrix[at]
        for b in range(min(a + 1, BODY)):
            out[b] = line[b]
        for b in range(BODY if len(c.layers) == 0 else HANDS, a + 1):
            out[b - f.shift] = line[b]
    if not f.free_body or not len(c.layers):
        return
    turns_by_latent(c, s)
    latent_gradient(c, s.gradient[BODY:HANDS], s, s.state_gradient[BODY : BODY + size])
    for a in range(f.width):
        line, own = s.matrix[a], s.by_body[a]
        for n in range(min(max(a + 1 - BODY, 0), 3 * N_BODY)):
            own[n] = line[BODY + n]
    for n in range(3 * N_BODY):
        line = s.matrix[BODY + n]
        for a in range(BODY + n):
            s.by_body[a, n] = line[a]
    products(s.by_latent, size, s.by_body, f.width, count, 0.0, s.chained)
    for k in range(size):
        for n in range(3 * N_BODY):
            s.transposed[k, n] = s.chained[BODY + n, k]
    half_products(s.by_latent, size, s.transposed, count, s.small)
    for k in range(size):
        line = s.state_matrix[BODY + k]
        for b in range(BODY):
            line[b] = s.chained[b, k]
        for b in range(k + 1):
            line[BODY + b] = s.small[b, k]
    for a in range(HANDS, f.width):
        line, chained = s.state_matrix[a - f.shift, BODY : BODY + size], s.chained[a]
        for k in range(size):
            line[k] = chained[k]


@helper
def _take_free(c, frame, x, s):
    """The free columns, with the terms that look at columns of the state."""
    f, target = c.fixed, c.held[frame].target
    for a in range(f.free):
        at = f.index[a]
        weight, line, out = f.weight[at] * f.weight[at], s.state_matrix[at], s.free_matrix[a]
        s.free_gradient[a] = s.state_gradient[at] + weight * (x[at] - target[at])
        for b in range(a + 1):
            out[b] = line[f.index[b]]
        out[a] += weight
    if f.free_betas:
        first, missing = f.free - 10, taller_by(c, x)
        for k in range(10):
            s.free_gradient[first + k] += missing * f.taller[k]
            for n in range(k + 1):
                s.free_matrix[first + k, first + n] += f.taller[k] * f.taller[n]
