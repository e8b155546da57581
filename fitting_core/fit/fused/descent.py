"""The functions called from Python: whole descents of single frames, and normal equations.

This repeats the Levenberg-Marquardt of `least_squares`, because compiled code cannot call Python, and returning to
Python for each step would cost more than the rest of it.
"""

import math

from fitting_core.fit.compiled.jit import helper, kernel
from fitting_core.fit.compiled.turns import exponential, multiply
from fitting_core.fit.fused.frame import cost_of, derive
from fitting_core.fit.fused.joint_jacobians import joints_of

CONVERGED, ITERATIONS, STALLED, FAILED = range(4)
"""Why a descent ended, as in `least_squares.Ending`."""
_START, _SMALLEST, _LARGEST, _GROWTH = 1e-3, 1e-7, 1e8, 2.0
_FLOOR = 1e-9
_EPSILON = 2.0**-52
"""As in `least_squares`: a descent takes the same steps in both."""


@helper
def solve_damped(s, size, extra):
    """move = -(matrix + extra I)^-1 gradient by Cholesky; False where that is not positive definite."""
    factor, move = s.factor, s.move
    for i in range(size):
        mine = factor[i]
        for j in range(i):
            other = factor[j]
            total = s.free_matrix[i, j]
            for k in range(j):
                total -= mine[k] * other[k]
            mine[j] = total * factor[j, size]  # column `size` keeps 1 / diagonal
        total = s.free_matrix[i, i] + extra
        for k in range(i):
            total -= mine[k] * mine[k]
        if not total > 0.0:
            return False
        mine[i] = math.sqrt(total)
        mine[size] = 1.0 / mine[i]
    for i in range(size):
        total = -s.free_gradient[i]
        for k in range(i):
            total -= factor[i, k] * move[k]
        move[i] = total * factor[i, size]
    for i in range(size - 1, -1, -1):
        move[i] *= factor[i, size]
        for k in range(i):
            move[k] -= factor[i, k] * move[i]
    return True


@helper
def _copy_normal(s, size, gradient, matrix):
    for a in range(size):
        gradient[a] = s.free_gradient[a]
        for b in range(a + 1):
            matrix[a, b] = matrix[b, a] = s.free_matrix[a, b]


@helper
def _damping_diagonal(s, size, damping):
    mean, largest = 0.0, 0.0
    for k in range(size):
        mean += s.free_matrix[k, k]
        largest = max(largest, s.free_matrix[k, k])
    return damping * mean / size + _FLOOR * largest


@helper
def _try_step(c, orient, x, extra, s, trial):
    """Write the state after a step to `trial_orient` and `trial`; return the predicted decrease."""
    predicted = 0.0
    trial[:] = x
    for k in range(c.clip.free):
        predicted += extra * s.move[k] * s.move[k] - s.free_gradient[k] * s.move[k]
        if k >= 3:
            trial[c.clip.index[k]] += s.move[k]
    exponential(s.move[:3], s.m, s.chart[0])
    multiply(s.m, orient, s.trial_orient)
    return predicted


@kernel
def descend(
    c, frames, orient, x, scratch, iterations, tolerance, cost, ending, evaluations, gradient, matrix, joints, rows
):
    """Levenberg-Marquardt of each frame, in place; the rule is that of `least_squares.Descent`.

    With 0 iterations only the costs are computed, and what else has an array that is not empty: gradients and matrices,
    joints and their derivatives. One kernel for everything, so that cost and derivatives are compiled only once: that
    is what takes long.
    """
    s, size = scratch.frame, c.clip.free
    trial_orient, trial = s.trial_orient, s.trial[: x.shape[1]]
    for i in range(len(frames)):
        damping, growth, promised, rounding, predicted = _START, _GROWTH, 0.0, 0.0, math.inf
        cost[i], ending[i], evaluations[i] = math.inf, FAILED, 0
        for step in range(iterations + 1):
            solved = True
            if step == 0:
                s.turned_at[0] = math.inf
                trial_orient[:] = orient[i]
                trial[:] = x[i]
            else:
                extra = _damping_diagonal(s, size, damping)
                solved = solve_damped(s, size, extra)
                predicted = _try_step(c, orient[i], x[i], extra, s, trial) if solved else math.inf
            new = cost_of(c, frames[i], trial_orient, trial, scratch, step == 0) if solved else math.inf
            evaluations[i] += 1
            before = cost[i]
            if new < before:
                cost[i] = new
                orient[i] = trial_orient
                x[i] = trial
                if step == 0:
                    ending[i], rounding = ITERATIONS, _EPSILON * new
                else:
                    gain = min((before - new) / max(predicted, 1e-300), 1.0)
                    damping, growth = max(damping * max(1 - (2 * gain - 1) ** 3, 0.2), _SMALLEST), _GROWTH
                    if before - new < tolerance * before:
                        ending[i] = CONVERGED
                        break
                if iterations or len(gradient):
                    derive(c, frames[i], trial_orient, trial, scratch)
            elif step == 0:
                break
            else:
                if growth == _GROWTH:
                    promised = predicted
                damping, growth = damping * growth, growth * 2
                if damping > _LARGEST:
                    ending[i] = CONVERGED if promised <= max(tolerance * before, rounding) else STALLED
                    break
        derived = len(gradient) > 0 and cost[i] < math.inf
        if derived:
            _copy_normal(s, size, gradient[i], matrix[i])
        if len(joints):
            joints_of(c, frames[i], scratch, derived, joints[i], rows[i])
