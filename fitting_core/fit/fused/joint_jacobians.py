"""How a frame's joints depend on the free columns, for terms over time."""

from fitting_core.fit.compiled.body import move_by_coefficients, update_turn_axes
from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import BODY, FIRST_FINGER, JAW_JOINT, N_BODY, N_JOINTS
from fitting_core.fit.compiled.network import turns_by_latent


@helper
def joints_of(c, frame, scratch, derived, joints, rows):
    """The joints without translation, (55, 3), right after `cost_of`, and their derivatives by the free columns,
    (165, free), if `rows` is not empty; `derived`: right after `derive`."""
    s = scratch.frame
    for j in range(N_JOINTS):
        for d in range(3):
            joints[j, d] = s.joints[j, d]
    if len(rows):
        if not derived:
            update_turn_axes(s)
            if c.clip.free_body and len(c.layers):
                turns_by_latent(c, s)
            if c.clip.free_face:
                move_by_coefficients(c, frame, 10, 20, scratch)
        _set_rows(c, s, rows)


@helper
def _set_rows(c, s, rows):
    """From the root down: a joint moves with its parent, and rotates about it with all that rotates the parent."""
    f = c.clip
    hands = BODY + (f.latent if f.free_body else 0)
    jaw = hands + (2 * f.hand if f.free_hands else 0)
    for k in range(f.free):
        for d in range(3):
            rows[d, k] = 0.0
            s.turning_by[0, d, k] = 1.0 if k == d else 0.0
    for j in range(1, N_JOINTS):
        p = f.parents[j]
        b0, b1, b2 = s.joints[j, 0] - s.joints[p, 0], s.joints[j, 1] - s.joints[p, 1], s.joints[j, 2] - s.joints[p, 2]
        before, here = s.turning_by[p], s.turning_by[j]
        for k in range(f.free):
            t0, t1, t2 = before[0, k], before[1, k], before[2, k]
            rows[3 * j, k] = rows[3 * p, k] + t1 * b2 - t2 * b1
            rows[3 * j + 1, k] = rows[3 * p + 1, k] + t2 * b0 - t0 * b2
            rows[3 * j + 2, k] = rows[3 * p + 2, k] + t0 * b1 - t1 * b0
            here[0, k], here[1, k], here[2, k] = t0, t1, t2
        _add_own_turn(c, j, hands, jaw, s)
    if f.free_face:
        for j in range(N_JOINTS):
            for d in range(3):
                for k in range(10):
                    rows[3 * j + d, jaw + 3 + k] = s.joint_motion[j, d, 10 + k]


@helper
def _add_own_turn(c, joint, hands, jaw, s):
    """A joint's own rotation; `hands` and `jaw` are their first free columns."""
    f, here, axes = c.clip, s.turning_by[joint], s.axes[joint]
    if joint <= N_BODY:
        if not f.free_body:
            return
        first = 3 * (joint - 1)
        for d in range(3):
            for k in range(f.latent if len(c.layers) else 3):
                if len(c.layers):
                    by = s.by_latent[k]
                    turned = axes[d, 0] * by[first] + axes[d, 1] * by[first + 1]
                    here[d, BODY + k] += turned + axes[d, 2] * by[first + 2]
                else:
                    here[d, BODY + first + k] += axes[d, k]
    elif joint == JAW_JOINT and f.free_face:
        for d in range(3):
            for k in range(3):
                here[d, jaw + k] += axes[d, k]
    elif joint >= FIRST_FINGER and f.free_hands:
        finger = joint - FIRST_FINGER
        first, basis = hands + (f.hand if finger >= 15 else 0), f.hand_basis
        for d in range(3):
            for k in range(f.hand):
                moved = axes[d, 0] * basis[3 * finger, k] + axes[d, 1] * basis[3 * finger + 1, k]
                here[d, first + k] += moved + axes[d, 2] * basis[3 * finger + 2, k]
