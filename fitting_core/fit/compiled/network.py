"""The pose prior's decoder and its derivatives; see `priors.latent`."""

import math

import numpy as np

from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import ELU, LEAKY_RELU, N_BODY, SILU, SOFTPLUS, TANH
from fitting_core.fit.compiled.products import products


@helper
def _activated(kind, below, x):
    """Value and slope."""
    if kind == SILU:
        s = 1.0 / (1.0 + math.exp(-x))
        return x * s, s * (1.0 + x * (1.0 - s))
    if kind == LEAKY_RELU:
        return (x, 1.0) if x > 0 else (below * x, below)
    if kind == ELU:
        return (x, 1.0) if x > 0 else (math.exp(x) - 1.0, math.exp(x))
    if kind == SOFTPLUS:
        return max(x, 0.0) + math.log1p(math.exp(-abs(x))), 1.0 / (1.0 + math.exp(-x))
    if kind == TANH:
        y = math.tanh(x)
        return y, 1.0 - y * y
    return x, 1.0


@helper
def decode(c, latent, s):
    """Rotations of the body joints, and how they turn about their own axes with the network's six numbers of each."""
    for k in range(len(latent)):
        s.value[0, k] = latent[k]
    at, bias = 0, 0
    for n in range(len(c.layers)):
        layer = c.layers[n]
        inputs, outputs = layer.inputs, layer.outputs
        weights = c.weights[at : at + outputs * inputs].reshape(outputs, inputs)
        # value_{n+1} = activation(W_n value_n + b_n); its slope is kept for the derivatives.
        products(weights, outputs, s.value[n : n + 1], 1, inputs, 0.0, s.value[n + 1 : n + 2])
        value, slope = s.value[n + 1], s.slope[n]
        for i in range(outputs):
            value[i], slope[i] = _activated(layer.activation, layer.below, value[i] + c.biases[bias + i])
        at += outputs * inputs
        bias += outputs
    _orthonormalise(s.value[len(c.layers)], s)


@helper
def _orthonormalise(columns, s):
    """Gram-Schmidt on the 6D representation (Zhou et al. 2019, eq. 15), see `rotations`."""
    for j in range(N_BODY):
        a0, a1, a2 = columns[6 * j], columns[6 * j + 2], columns[6 * j + 4]
        b0, b1, b2 = columns[6 * j + 1], columns[6 * j + 3], columns[6 * j + 5]
        first = max(math.sqrt(a0 * a0 + a1 * a1 + a2 * a2), 1e-12)
        x0, x1, x2 = a0 / first, a1 / first, a2 / first
        along = x0 * b0 + x1 * b1 + x2 * b2
        y0, y1, y2 = b0 - along * x0, b1 - along * x1, b2 - along * x2
        second = max(math.sqrt(y0 * y0 + y1 * y1 + y2 * y2), 1e-12)
        y0, y1, y2 = y0 / second, y1 / second, y2 / second
        z0, z1, z2 = x1 * y2 - x2 * y1, x2 * y0 - x0 * y2, x0 * y1 - x1 * y0
        r, g = s.local[j + 1], s.sixes[j]
        r[0, 0], r[1, 0], r[2, 0] = x0, x1, x2
        r[0, 1], r[1, 1], r[2, 1] = y0, y1, y2
        r[0, 2], r[1, 2], r[2, 2] = z0, z1, z2
        lean = -along / (first * second)
        g[0, 0], g[0, 2], g[0, 4] = lean * z0, lean * z1, lean * z2
        g[1, 0], g[1, 2], g[1, 4] = -z0 / first, -z1 / first, -z2 / first
        g[2, 0], g[2, 2], g[2, 4] = y0 / first, y1 / first, y2 / first
        g[0, 1], g[0, 3], g[0, 5] = z0 / second, z1 / second, z2 / second


@helper
def turns_by_latent(c, s):
    """d turns of the body joints / d latent, (latent, 63).

    In float32: it shapes the steps of a solver and not where these end.
    """
    size, zero, last = c.clip.latent, np.float32(0), len(c.layers) - 1
    at, inputs = 0, size
    # Forward accumulation: rows hold d value_n / d latent, (latent, outputs of layer n).
    for n in range(last):
        outputs, slope = c.layers[n].outputs, s.slope32
        weights = c.weights32[at : at + outputs * inputs].reshape(outputs, inputs)
        for i in range(outputs):
            slope[i] = s.slope[n, i]
        if n:
            products(weights, outputs, s.rows[(n + 1) % 2], size, inputs, zero, s.rows[n % 2])
        for k in range(size):
            row = s.rows[n % 2, k]
            for i in range(outputs):
                row[i] = slope[i] * (row[i] if n else weights[i, k])
        at += outputs * inputs
        inputs = outputs
    _turn_last_layer(c, at, inputs, s)
    products(s.turning, 3 * N_BODY, s.rows[(last + 1) % 2], size, inputs, zero, s.turns)
    for k in range(size):
        for t in range(3 * N_BODY):
            s.by_latent[k, t] = s.turns[k, t]


@helper
def _turn_last_layer(c, at, inputs, s):
    """The last layer's weights for the turns themselves, three of each joint instead of its six numbers."""
    slope = s.slope[len(c.layers) - 1]
    weights = c.weights32[at : at + 6 * N_BODY * inputs].reshape(6 * N_BODY, inputs)
    for j in range(N_BODY):
        w0, w1, w2 = weights[6 * j], weights[6 * j + 1], weights[6 * j + 2]
        w3, w4, w5 = weights[6 * j + 3], weights[6 * j + 4], weights[6 * j + 5]
        for t in range(3):
            six, out = s.sixes[j, t], s.turning[3 * j + t]
            g0, g1 = np.float32(six[0] * slope[6 * j]), np.float32(six[1] * slope[6 * j + 1])
            g2, g3 = np.float32(six[2] * slope[6 * j + 2]), np.float32(six[3] * slope[6 * j + 3])
            g4, g5 = np.float32(six[4] * slope[6 * j + 4]), np.float32(six[5] * slope[6 * j + 5])
            for k in range(inputs):
                out[k] = g0 * w0[k] + g1 * w1[k] + g2 * w2[k] + g3 * w3[k] + g4 * w4[k] + g5 * w5[k]


@helper
def latent_gradient(c, by_turns, s, out):
    """Gradient by the latent, from that by the turns of the body joints; `s.value` is overwritten."""
    by = s.value[len(c.layers)]
    for j in range(N_BODY):
        t0, t1, t2, six = by_turns[3 * j], by_turns[3 * j + 1], by_turns[3 * j + 2], s.sixes[j]
        for k in range(6):
            by[6 * j + k] = t0 * six[0, k] + t1 * six[1, k] + t2 * six[2, k]
    # Backpropagation: by value_n = W_n^T (slope_n * by value_{n+1}).
    at = len(c.weights)
    for n in range(len(c.layers) - 1, -1, -1):
        inputs, outputs = c.layers[n].inputs, c.layers[n].outputs
        at -= inputs * outputs
        by, before = s.value[n + 1], s.value[n]
        for k in range(inputs):
            before[k] = 0.0
        for i in range(outputs):
            scaled = by[i] * s.slope[n, i]
            row = c.weights[at + i * inputs : at + (i + 1) * inputs]
            for k in range(inputs):
                before[k] += row[k] * scaled
    for k in range(len(out)):
        out[k] = s.value[0, k]
