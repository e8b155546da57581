"""The objective E_o of one frame: cost, gradient and Gauss-Newton matrix, as `objective.FrameObjective` has them.

With residuals r and their Jacobian J the gradient is J^T r, the matrix J^T J; both are halves, as in `terms.term.Rows`.
Terms on points share their rows: what all points of a limb give to the matrix is one product. Each other term adds its
own (`terms.entry.Kernel`).
"""

import math
from functools import reduce

from fitting_core.fit.compiled.body import (
    add_through_correctives,
    move_by_coefficients,
    pose_points,
    pose_skeleton,
    turn_joints,
    update_turn_axes,
)
from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import BODY, FIRST_FINGER, HANDS, JAW_JOINT, N_BODY
from fitting_core.fit.compiled.network import latent_gradient, turns_by_latent
from fitting_core.fit.compiled.products import half_products, products
from fitting_core.fit.fused.constants import KERNELS
from fitting_core.fit.fused.scratch import LANES
from fitting_core.fit.terms.data import data_cost, set_data_rows
from fitting_core.fit.terms.positions import position_cost, set_position_row
from fitting_core.fit.variables.estimate import NEAREST

_NEAR = 0.05**2
"""Squared distance of two latents whose derivatives by the pose count as the same."""


@helper
def _no_cost(c, frame, orient, x, s, derivatives):
    return 0.0


@helper
def _nothing_added(c, frame, x, s):
    pass


def _and_cost(first, second):
    """The sum of two kernels' costs; numba does not unroll loops over functions."""

    @helper
    def both(c, frame, orient, x, s, derivatives):
        return first(c, frame, orient, x, s, derivatives) + second(c, frame, orient, x, s, derivatives)

    return both


def _and_columns(first, second):
    @helper
    def both(c, frame, x, s):
        first(c, frame, x, s)
        second(c, frame, x, s)

    return both


_terms_cost = reduce(_and_cost, [kernel.cost for kernel in KERNELS.values() if kernel.cost], _no_cost)
_add_columns = reduce(_and_columns, [k.add_columns for k in KERNELS.values() if k.add_columns], _nothing_added)


@helper
def cost_of(c, frame, orient, x, scratch, everything):
    """Cost of a state (root's rotation, variables); infinite where a point is behind the camera.

    `everything`: more than the free variables may differ from the previous state.
    """
    s = scratch.frame
    turn_joints(c, orient, x, s, everything)
    pose_skeleton(c, x, s)
    pose_points(c, frame, x, scratch)
    cost = _points_cost(c, frame, x, scratch)
    if cost == math.inf:
        return cost
    return cost + _terms_cost(c, frame, orient, x, s, False)


@helper
def _points_cost(c, frame, x, scratch):
    """Cost of the keypoints, in the image and in space; infinite where a point is behind the camera. Leaves the errors
    in `scratch.error`."""
    cost, clip, pelvis = 0.0, c.clip, scratch.frame.v
    for d in range(3):  # the root turns about the pelvis: only the translation moves it
        pelvis[d] = x[clip.translation - clip.shift + d] + clip.pelvis[d]
    for i in range(len(scratch.points)):
        if not scratch.points[i, 2] > NEAREST:
            return math.inf
        cost = data_cost(c, frame, i, scratch, cost)
        cost = position_cost(c, frame, i, scratch, cost)
    return cost


@helper
def derive(c, frame, orient, x, scratch):
    """Gradient (`free_gradient`) and lower triangle of the matrix (`free_matrix`), right after `cost_of`."""
    s, clip = scratch.frame, c.clip
    for a in range(clip.width):
        s.gradient[a], line = 0.0, s.matrix[a]
        for b in range(a + 1):
            line[b] = 0.0
    update_turn_axes(s)
    low, high = 0 if clip.free_betas else 10, 20 if clip.free_face else 10
    if low < high:
        move_by_coefficients(c, frame, low, high, scratch)
    for p in range(len(scratch.pair_gradient)):
        for d in range(3):
            scratch.pair_gradient[p, d] = 0.0
    for g in range(len(c.groups)):
        _add_limb(c, frame, c.groups[g], scratch)
    add_through_correctives(c, frame, scratch)
    _terms_cost(c, frame, orient, x, s, True)
    _to_state_columns(c, s)
    for a in range(clip.free):
        at, out = clip.index[a], s.free_matrix[a]
        line, s.free_gradient[a] = s.state_matrix[at], s.state_gradient[at]
        for b in range(a + 1):
            out[b] = line[clip.index[b]]
    _add_columns(c, frame, x, s)


@helper
def _add_limb(c, frame, group, scratch):
    """Add the keypoints of one limb: their rows as columns of `scratch.rows`, and the product of these.

    A point has up to eight: x and y in the image, and three coordinates each relative to the pelvis and to its held
    position. Those in the image and of the held position move with the translation; relative to the pelvis they do not.
    """
    s, count = scratch.frame, 0
    for o in range(group.first, group.last):
        i = c.order[o]
        keypoint, error = c.keypoints[frame, i], scratch.error[i]
        # x and y are known for keypoints that are not detected, and for all keypoints of a given start.
        across, along = keypoint.relative_weight[0] > 0.0, keypoint.relative_weight[2] > 0.0
        if keypoint.held_weight[0] > 0.0:
            for d in range(3):
                set_position_row(keypoint.held_weight[d], keypoint.held_rho[d], error[5 + d], d, s)
            count = _add_rows(c, c.points[i], group, 3, 3, count, scratch)
        if across:
            for d in range(3):
                set_position_row(keypoint.relative_weight[d], keypoint.relative_rho[d], error[2 + d], d, s)
            count = _add_rows(c, c.points[i], group, 3, 0, count, scratch)
        if keypoint.weight == 0.0 and (across or not along):
            continue
        set_data_rows(c, frame, i, scratch)
        rows = 2
        if along and not across:  # together with the two of the image, for half the work
            set_position_row(keypoint.relative_weight[2], keypoint.relative_rho[2], error[4], 2, s)
            rows = 3
        count = _add_rows(c, c.points[i], group, rows, 2, count, scratch)
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
def _add_rows(c, point, group, rows, moving, count, scratch):
    """Add a keypoint's rows to the gradient, and append them to the `count` rows waiting for the product; returns the
    new count."""
    s = scratch.frame
    _set_rows(c, point, group, rows, moving, scratch)
    for r in range(rows):
        for k in range(group.width):
            scratch.rows[k, count + r] = s.three[r, k]
            s.gradient[group.column[k]] += s.three[r, k] * s.residual[r]
    return count + rows


@helper
def _set_rows(c, point, group, rows, moving, scratch):
    """Two or three rows of a keypoint in its group's columns, in `three`.

    The chain rule: with g = d residual / d point (a row of `by_point`, camera space), a row is g . d point / d column.
    Only the first `moving` rows depend on the translation.
    """
    s, clip = scratch.frame, c.clip
    for p in range(point.first_pair, point.last_pair):  # by_point^T residual, for the pose correctives
        for d in range(3):
            scratch.pair_gradient[p, d] += s.by_point[0, d] * s.residual[0] + s.by_point[1, d] * s.residual[1]
            if rows == 3:
                scratch.pair_gradient[p, d] += s.by_point[2, d] * s.residual[2]
    for k in range(rows):
        row = s.three[k]
        for a in range(group.width):
            row[a] = 0.0
    for e in range(point.first_entry, point.last_entry):
        entry = c.entries[e]
        _lever_arm(c, point.joint, entry, scratch)
        axes, finger = s.axes[entry.joint], entry.joint - FIRST_FINGER
        if finger >= 0:
            at = group.place[HANDS + (clip.hand if finger >= 15 else 0)]
        else:
            at = group.place[clip.jaw if entry.joint == JAW_JOINT else 3 * entry.joint]
        for k in range(rows):
            # A small rotation w of the joint (camera axes) moves the point by w x arm, and the residual by
            # g . (w x arm) = (arm x g) . w. With w = axes t, t the joint's turn columns, the row is (arm x g)^T axes.
            g0, g1, g2 = s.by_point[k, 0], s.by_point[k, 1], s.by_point[k, 2]
            by_w0, by_w1, by_w2 = s.v[1] * g2 - s.v[2] * g1, s.v[2] * g0 - s.v[0] * g2, s.v[0] * g1 - s.v[1] * g0
            by_t0 = by_w0 * axes[0, 0] + by_w1 * axes[1, 0] + by_w2 * axes[2, 0]
            by_t1 = by_w0 * axes[0, 1] + by_w1 * axes[1, 1] + by_w2 * axes[2, 1]
            by_t2 = by_w0 * axes[0, 2] + by_w1 * axes[1, 2] + by_w2 * axes[2, 2]
            if finger >= 0:  # a finger's axis-angle is linear in its hand's numbers
                b = clip.hand_basis
                row = s.three[k, at : at + clip.hand]
                _add_three(row, by_t0, by_t1, by_t2, b[3 * finger], b[3 * finger + 1], b[3 * finger + 2])
            else:
                s.three[k, at], s.three[k, at + 1], s.three[k, at + 2] = by_t0, by_t1, by_t2
    translation = group.place[clip.translation]
    for k in range(moving):
        for d in range(3):
            s.three[k, translation + d] = s.by_point[k, d]
    if clip.free_betas:
        _add_coefficients(point, 0, group.place[clip.betas], rows, scratch)
    if clip.free_face:
        _add_coefficients(point, 10, group.place[clip.expression], rows, scratch)


@helper
def _add_three(row, w0, w1, w2, l0, l1, l2):
    """Add the weighted sum of three lines."""
    for k in range(len(row)):
        row[k] += w0 * l0[k] + w1 * l1[k] + w2 * l2[k]


@helper
def _lever_arm(c, joint, entry, scratch):
    """The lever arm of a point about a joint, in camera axes, into `v`.

    It is the sum of weight x (the point's position on the bone - the joint's position) over the pairs (point, bone)
    that rotate with the joint, see `body.points`.
    """
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
def _add_coefficients(point, low, at, rows, scratch):
    """The columns of betas or expression: g . d point / d coefficient, summed over the point's pairs."""
    s, last = scratch.frame, low + 10
    for k in range(rows):
        row, g0, g1, g2 = s.three[k, at : at + 10], s.by_point[k, 0], s.by_point[k, 1], s.by_point[k, 2]
        if point.joint >= 0:
            m = s.joint_motion[point.joint]
            _add_three(row, g0, g1, g2, m[0, low:last], m[1, low:last], m[2, low:last])
        for p in range(point.first_pair, point.last_pair):
            m = scratch.pair_motion[p]
            _add_three(row, g0, g1, g2, m[0, low:last], m[1, low:last], m[2, low:last])


@helper
def _renew_turns(c, s):
    """`by_latent`, unless the latent has hardly moved since: it shapes the matrix, and the gradient does without."""
    moved = 0.0
    for k in range(c.clip.latent):
        away = s.value[0, k] - s.turned_at[k]
        moved += away * away
    if moved > _NEAR:
        turns_by_latent(c, s)
        for k in range(c.clip.latent):
            s.turned_at[k] = s.value[0, k]


@helper
def _to_state_columns(c, s):
    """From turn columns to state columns (lower triangle): the body's go through the pose prior.

    With D = d turns / d latent the body's gradient g becomes D^T g, its own block M becomes D^T M D, and its
    off-diagonal blocks M D or D^T M; everything else moves to its place in the state.
    """
    clip, size, count = c.clip, c.clip.latent, 3 * N_BODY + 1  # padded with a 0 in `by_latent`, see LANES
    for a in range(clip.width):
        if BODY <= a < HANDS and len(c.layers):
            continue
        at = a if a < BODY else a - clip.shift
        s.state_gradient[at], line, out = s.gradient[a], s.matrix[a], s.state_matrix[at]
        for b in range(min(a + 1, BODY)):
            out[b] = line[b]
        for b in range(BODY if len(c.layers) == 0 else HANDS, a + 1):
            out[b - clip.shift] = line[b]
    if not clip.free_body or not len(c.layers):
        return
    _renew_turns(c, s)
    latent_gradient(c, s.gradient[BODY:HANDS], s, s.state_gradient[BODY : BODY + size])
    for a in range(clip.width):  # by_body = the body's columns of M in all rows, mirrored from the lower triangle
        line, own = s.matrix[a], s.by_body[a]
        for n in range(min(max(a + 1 - BODY, 0), 3 * N_BODY)):
            own[n] = line[BODY + n]
    for n in range(3 * N_BODY):
        line = s.matrix[BODY + n]
        for a in range(BODY + n):
            s.by_body[a, n] = line[a]
    products(s.by_latent, size, s.by_body, clip.width, count, 0.0, s.chained)  # chained = M D
    for k in range(size):
        for n in range(3 * N_BODY):
            s.transposed[k, n] = s.chained[BODY + n, k]
    half_products(s.by_latent, size, s.transposed, count, s.small)  # small = D^T (M D), of the body's own rows
    for k in range(size):
        line = s.state_matrix[BODY + k]
        for b in range(BODY):
            line[b] = s.chained[b, k]
        for b in range(k + 1):
            line[BODY + b] = s.small[b, k]
    for a in range(HANDS, clip.width):
        line, chained = s.state_matrix[a - clip.shift, BODY : BODY + size], s.chained[a]
        for k in range(size):
            line[k] = chained[k]
