"""A body's points of one frame and their derivatives by turn columns; the formulas are those of `body.points`."""

from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import BODY, FIRST_FINGER, HANDS, JAW_JOINT, N_BODY, N_COEFFICIENTS, N_JOINTS
from fitting_core.fit.compiled.network import decode
from fitting_core.fit.compiled.products import product
from fitting_core.fit.compiled.turns import exponential, inverse_chart, logarithm, multiply


@helper
def turn_joints(c, orient, x, s, everything):
    """The joints' own rotations, and how they turn with their columns (`chart`); or only of those that are free."""
    f = c.clip
    for row in range(3):
        for column in range(3):
            s.local[0, row, column] = orient[row, column]
    if f.free_body or everything:
        if len(c.layers):
            decode(c, x[BODY : BODY + f.latent], s)
        else:
            for j in range(1, N_BODY + 1):
                exponential(x[3 * j : 3 * j + 3], s.local[j], s.chart[j])
    if f.free_face or everything:
        jaw = f.jaw - f.shift
        exponential(x[jaw : jaw + 3], s.local[JAW_JOINT], s.chart[JAW_JOINT])
    if f.free_hands or everything:
        for j in range(N_JOINTS - FIRST_FINGER):
            first = HANDS - f.shift + (f.hand if j >= 15 else 0)
            numbers = x[first : first + f.hand]
            # Axis-angle of a finger joint: mean + basis x coefficients of the hand's principal components.
            for d in range(3):
                s.v[d] = f.hand_mean[3 * j + d] + product(f.hand_basis[3 * j + d], numbers, f.hand, 0.0)
            exponential(s.v, s.local[FIRST_FINGER + j], s.chart[FIRST_FINGER + j])


@helper
def pose_skeleton(c, x, s):
    """The joints in the world, without translation."""
    f = c.clip
    for k in range(10):
        s.coefficients[k], s.coefficients[10 + k] = x[f.betas - f.shift + k], x[f.expression - f.shift + k]
    # Rest joints J = J0 + dJ/dc c, with coefficients c = (betas, expression).
    for j in range(N_JOINTS):
        for d in range(3):
            moved = product(f.rest_directions[j, d], s.coefficients, N_COEFFICIENTS, 0.0)
            s.rest[j, d] = f.rest[j, d] + moved
    for d in range(3):
        s.joints[0, d] = s.rest[0, d]
        for k in range(3):
            s.world[0, d, k] = s.local[0, d, k]
    # From the root on: W_j = W_p R_j, x_j = x_p + W_p (J_j - J_p).
    for j in range(1, N_JOINTS):
        p = f.parents[j]
        up = s.world[p]
        multiply(up, s.local[j], s.world[j])
        b0, b1, b2 = s.rest[j, 0] - s.rest[p, 0], s.rest[j, 1] - s.rest[p, 1], s.rest[j, 2] - s.rest[p, 2]
        for d in range(3):
            s.joints[j, d] = s.joints[p, d] + up[d, 0] * b0 + up[d, 1] * b1 + up[d, 2] * b2
    # Skinning takes a rest vertex v to W_j v + (x_j - W_j J_j).
    for j in range(N_JOINTS):
        w, rest = s.world[j], s.rest[j]
        for d in range(3):
            s.offset[j, d] = s.joints[j, d] - (w[d, 0] * rest[0] + w[d, 1] * rest[1] + w[d, 2] * rest[2])


@helper
def pose_points(c, frame, x, scratch):
    """The points in camera space."""
    s, first = scratch.frame, 0
    for table in c.tables:
        if table.pair.shape[1]:
            _pose_pairs(table, c.frames[frame].variant if len(table.pair) > 1 else 0, first, scratch)
            first += table.pair.shape[1]
    translation = x[c.clip.translation - c.clip.shift :]
    for i in range(len(c.points)):
        point = c.points[i]
        for d in range(3):
            place = translation[d]
            if point.joint >= 0:
                place += s.joints[point.joint, d]
            else:
                for p in range(point.first_pair, point.last_pair):
                    place += scratch.pairs[p, d]
            scratch.points[i, d] = place


@helper
def _pose_pairs(table, variant, first, scratch):
    s = scratch.frame
    # SMPL's pose correctives are linear in R - I of the driving joints.
    for n in range(len(table.driving)):
        m = s.local[table.driving[n]]
        for e in range(9):
            s.features[9 * n + e] = m[e // 3, e % 3] - (1.0 if e % 4 == 0 else 0.0)
    correctives = table.correctives[variant]
    for p in range(table.pair.shape[1]):
        pair = table.pair[variant, p]
        for d in range(3):
            shaped = product(pair.directions[d], s.coefficients, N_COEFFICIENTS, 0.0)
            corrected = product(correctives[3 * p + d], s.features, 9 * len(table.driving), 0.0)
            s.v[d] = pair.template[d] + shaped + corrected
        # One bone's share of a skinned point; template, directions and correctives contain its weight already.
        w, offset = s.world[pair.bone], s.offset[pair.bone]
        for d in range(3):
            posed = w[d, 0] * s.v[0] + w[d, 1] * s.v[1] + w[d, 2] * s.v[2]
            scratch.pairs[first + p, d] = posed + pair.weight * offset[d]
        scratch.weight[first + p] = pair.weight


@helper
def update_turn_axes(s):
    """Axes about which joints turn in the world with their columns."""
    for row in range(3):
        for column in range(3):
            s.axes[0, row, column] = 1.0 if row == column else 0.0
    for j in range(1, N_JOINTS):
        multiply(s.world[j], s.chart[j], s.axes[j])


@helper
def move_by_coefficients(c, frame, low, high, scratch):
    """d joints and d pairs / d coefficients low to high."""
    s, f = scratch.frame, c.clip
    # dx_j = dx_p + W_p d(J_j - J_p), and d offset_j = dx_j - W_j dJ_j.
    for j in range(N_JOINTS):
        p = f.parents[j]
        w, up = s.world[j], s.world[p] if j else s.axes[0]  # the root's bone rests in the world: axes[0] is I
        b0, b1, b2 = f.bone_directions[j, 0], f.bone_directions[j, 1], f.bone_directions[j, 2]
        r0, r1, r2 = f.rest_directions[j, 0], f.rest_directions[j, 1], f.rest_directions[j, 2]
        for d in range(3):
            u0, u1, u2, w0, w1, w2 = up[d, 0], up[d, 1], up[d, 2], w[d, 0], w[d, 1], w[d, 2]
            before, here, offset = s.joint_motion[p, d], s.joint_motion[j, d], s.offset_motion[j, d]
            for k in range(low, high):
                motion = (before[k] if j else 0.0) + u0 * b0[k] + u1 * b1[k] + u2 * b2[k]
                here[k] = motion
                offset[k] = motion - (w0 * r0[k] + w1 * r1[k] + w2 * r2[k])
    first = 0
    for table in c.tables:
        variant = c.frames[frame].variant if len(table.pair) > 1 else 0
        for p in range(table.pair.shape[1]):
            pair = table.pair[variant, p]
            w, weight = s.world[pair.bone], pair.weight
            a0, a1, a2 = pair.directions[0], pair.directions[1], pair.directions[2]
            for d in range(3):
                w0, w1, w2, offset = w[d, 0], w[d, 1], w[d, 2], s.offset_motion[pair.bone, d]
                out = scratch.pair_motion[first + p, d]
                for k in range(low, high):
                    out[k] = w0 * a0[k] + w1 * a1[k] + w2 * a2[k] + weight * offset[k]
        first += table.pair.shape[1]


@helper
def add_through_correctives(c, frame, scratch):
    """Adds to the gradient what goes through the pose correctives, which the rows leave out."""
    s, first = scratch.frame, 0
    for table in c.tables:
        variant = c.frames[frame].variant if len(table.pair) > 1 else 0
        correctives, count = table.correctives[variant], 9 * len(table.driving)
        for e in range(count):
            s.by_feature[e] = 0.0
        for p in range(table.pair.shape[1]):
            w, g = s.world[table.pair[variant, p].bone], scratch.pair_gradient[first + p]
            if g[0] == 0.0 and g[1] == 0.0 and g[2] == 0.0:
                continue
            for d in range(3):
                # (W^T g)_d: the gradient by the unposed point, then by each feature through its row.
                along, row = w[0, d] * g[0] + w[1, d] * g[1] + w[2, d] * g[2], correctives[3 * p + d]
                for e in range(count):
                    s.by_feature[e] += row[e] * along
        first += table.pair.shape[1]
        for n in range(len(table.driving)):
            joint = table.driving[n]
            _add_turn_gradient(c, joint, _turned(s.local[joint], s.by_feature[9 * n : 9 * n + 9]), s)


@helper
def _turned(r, by):
    """Gradient by the turn about a joint's own axes (dR = R hat(d)), from that by the nine numbers of its matrix."""
    # With A = R^T by: dE = sum A_ij hat(d)_ij, which leaves A's antisymmetric part.
    a01 = a02 = a10 = a12 = a20 = a21 = 0.0
    for k in range(3):
        a01 += r[k, 0] * by[3 * k + 1]
        a02 += r[k, 0] * by[3 * k + 2]
        a10 += r[k, 1] * by[3 * k]
        a12 += r[k, 1] * by[3 * k + 2]
        a20 += r[k, 2] * by[3 * k]
        a21 += r[k, 2] * by[3 * k + 1]
    return a21 - a12, a02 - a20, a10 - a01


@helper
def by_column(chart, by_turn, column):
    """Of a row by a joint's turn about its own axes, the entry of one of its columns."""
    return by_turn[0] * chart[0, column] + by_turn[1] * chart[1, column] + by_turn[2] * chart[2, column]


@helper
def joint_row(c, joint, by_turn, s):
    """A row by a joint's turn about its own axes as one by its turn columns, in `wide`: the first and how many."""
    f = c.clip
    if joint < FIRST_FINGER:
        for column in range(3):
            s.wide[column] = by_column(s.chart[joint], by_turn, column)
        return (f.jaw if joint == JAW_JOINT else 3 * joint), 3
    # Chain rule: by the axis-angle through the chart, then by the hand's coefficients through the basis.
    finger = joint - FIRST_FINGER
    for k in range(f.hand):
        s.wide[k] = 0.0
    for d in range(3):
        along, basis = by_column(s.chart[joint], by_turn, d), f.hand_basis[3 * finger + d]
        for k in range(f.hand):
            s.wide[k] += along * basis[k]
    return HANDS + (f.hand if finger >= 15 else 0), f.hand


@helper
def _add_turn_gradient(c, joint, by_turn, s):
    if N_BODY < joint < FIRST_FINGER and joint != JAW_JOINT:
        return  # eyes stay
    first, count = joint_row(c, joint, by_turn, s)
    for k in range(count):
        s.gradient[first + k] += s.wide[k]


@helper
def add_row(s, first, row, count, weight, residual):
    """Adds a weighted row, which depends on `count` turn columns from the `first` on: weight x row^T residual to the
    gradient, weight x row^T row to the lower triangle of the matrix."""
    for a in range(count):
        s.gradient[first + a] += weight * residual * row[a]
        for b in range(a + 1):
            s.matrix[first + a, first + b] += weight * row[a] * row[b]


@helper
def joint_axis_angle(c, joint, x, s):
    """The axis-angle of a body joint into `v`, and its derivative by the joint's turn columns into `m`."""
    if len(c.layers):
        logarithm(s.local[joint], s.q, s.v)
        inverse_chart(s.v, s.m)
        return
    for d in range(3):
        s.v[d] = x[3 * joint + d]
        for k in range(3):
            s.m[d, k] = 1.0 if d == k else 0.0
