"""Where numbers stand in what kernels work on.

A solver's number is a column of a frame's state. The kernels work in *turn columns*, where every body joint has three
numbers: how it turns about its own axes (or, without a latent pose prior, its axis-angle). Turn columns stand in this
order: root (turns about the axes of camera space), 21 body joints, left hand, right hand, jaw, expression, translation,
betas. Those behind the body stand `shift` places earlier in the state.
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
