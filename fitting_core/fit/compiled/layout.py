"""The layout of what kernels work on.

A solver's variable is a column of a frame's state. The kernels work in *turn columns*, where every body joint has three
numbers: its rotation about its own axes (or, without a latent pose prior, its axis-angle). The order of turn columns
is: root (rotation about the axes of camera space), 21 body joints, left hand, right hand, jaw, expression, translation,
betas. Those after the body are `shift` places earlier in the state.
"""

import numpy as np

N_JOINTS = 55
N_BODY = 21
BODY, HANDS = 3, 66
"""First turn columns."""
JAW_JOINT, FIRST_FINGER = 22, 25
N_COEFFICIENTS = 20
MOST_LATENT = 63
MOST_HAND = 45
MOST_COLUMNS = HANDS + 2 * MOST_HAND + 26

LINEAR, LEAKY_RELU, ELU, SILU, SOFTPLUS, TANH = range(6)
"""Activations of the pose prior's decoder."""
INTEGER, NUMBER = np.int64, np.float64
"""Types of the fields of records."""
