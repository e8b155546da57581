"""What kernels look at and never change.

A solver's number is a column of a frame's state. The kernels work in *turn columns*, where every body joint has three
numbers: how it turns about its own axes (or, without a latent pose prior, its axis-angle). Turn columns stand in this
order: root (turns about the axes of camera space), 21 body joints, left hand, right hand, jaw, expression, translation,
betas. Those behind the body stand `shift` places earlier in the state.

Arrays of records, and not an array for each field: the compiler takes a third of the time.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

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

_I, _F = np.int64, np.float64

FIXED = np.dtype(
    [
        # columns: numbers of one hand, first turn columns, numbers of the pose prior (63 for axis-angle)
        *[(name, _I) for name in ("hand", "jaw", "expression", "translation", "betas", "width", "latent", "shift")],
        # what moves besides the root and the translation, and how many columns of the state are free
        *[(name, np.bool_) for name in ("free_body", "free_hands", "free_face", "free_betas")],
        ("free", _I),
        ("index", _I, MOST_COLUMNS),
        # the body at rest; directions by betas, then expression, and those of a bone relative to its parent
        ("parents", _I, N_JOINTS),
        ("rest", _F, (N_JOINTS, 3)),
        ("rest_directions", _F, (N_JOINTS, 3, N_COEFFICIENTS)),
        ("bone_directions", _F, (N_JOINTS, 3, N_COEFFICIENTS)),
        ("hand_mean", _F, 90),
        ("hand_basis", _F, (90, MOST_HAND)),
        # the camera
        ("focal", _F, 2),
        ("center", _F, 2),
        # terms: joint limits (see terms.limits), rest, bending, and quadratic terms by columns of the state
        ("limited", _I),
        ("limit_weight", _F),
        ("held", np.bool_),
        ("rest_pose", _F, 3 * N_BODY),
        ("bending", _F),
        ("bent", _F, 3 * N_BODY),  # the sign with which elbows and knees bend, 0 elsewhere
        ("upright", np.bool_),
        ("pelvis", _F, 3),  # from which relative positions are measured
        ("taller", _F, 10),  # weight x what each beta adds to the height, and weight x what all are to add
        ("height", _F),
        ("columns_held", _I),
        ("weight", _F, MOST_COLUMNS),
    ]
)
"""All that has one size whatever the clip."""

LIMIT = np.dtype([("joint", _I), ("frame", _F, (4, 4)), ("offset", _F, 3), ("low", _F, 3), ("high", _F, 3)])
"""A joint with limits, see `terms.limits.AngleTable`."""

LAYER = np.dtype([("inputs", _I), ("outputs", _I), ("activation", _I), ("below", _F)])
"""Of the pose prior's decoder; `below` is the slope of a leaky ReLU below zero."""

PAIR = np.dtype([("bone", _I), ("weight", _F), ("template", _F, 3), ("directions", _F, (3, N_COEFFICIENTS))])
"""Of a point and a bone, see `body.points.pairs`."""

POINT = np.dtype(
    [
        ("joint", _I),  # of a point that is one, else -1
        ("first_pair", _I),  # pairs that add up to the point
        ("last_pair", _I),
        ("first_entry", _I),  # entries: joints whose turn moves the point
        ("last_entry", _I),
        ("rho", _F),
    ]
)

ENTRY = np.dtype([("joint", _I), ("first_arm", _I), ("last_arm", _I)])
"""A free joint whose turn moves a point, and the pairs of the point that turn with it: places in `arms`."""

GROUP = np.dtype(
    [("first", _I), ("last", _I), ("width", _I), ("column", _I, MOST_COLUMNS), ("place", _I, MOST_COLUMNS)]
)
"""Points (places in `order`) that share the columns on which they depend, those of a limb: these turn columns, and the
place of each turn column among them."""

KEYPOINT = np.dtype(
    [
        *[("xy", _F, 2), ("side", _F, 2), ("weight", _F)],  # see `terms.data.Data`
        *[("place", _F, 3), ("place_weight", _F, 3), ("place_rho", _F, 3)],  # RelativePosition, see `terms.positions`
        *[("spot", _F, 3), ("spot_weight", _F, 3), ("spot_rho", _F, 3)],  # HeldPosition
    ]
)

HELD = np.dtype(
    [
        ("variant", _I),  # of the second table of pairs
        ("rest", _F, 3 * N_BODY),
        ("lean", _F),
        ("turn", _F),
        ("target", _F, MOST_COLUMNS),
    ]
)
"""What terms know of a frame besides its keypoints: weights, and the targets of the quadratic terms."""


class Pairs(NamedTuple):
    """A table of `body.points.pairs`, of which the first axis counts variants."""

    pair: np.ndarray
    """PAIR, (K, P)."""
    driving: Int[np.ndarray, "n"]
    correctives: Float[np.ndarray, "K P*3 n*9"]


class Constants(NamedTuple):
    """Everything; arrays are C-contiguous."""

    fixed: np.record
    """FIXED."""
    limits: np.ndarray
    """LIMIT, (n,)."""
    layers: np.ndarray
    """LAYER, (L,); none for axis-angle."""
    weights: Float[np.ndarray, "w"]
    """(outputs, inputs) of one layer after the other."""
    weights32: np.ndarray
    """The same in float32, for the derivative in the normal matrix."""
    biases: Float[np.ndarray, "b"]
    tables: tuple[Pairs, Pairs]
    points: np.ndarray
    """POINT, (N,)."""
    entries: np.ndarray
    """ENTRY, (E,)."""
    arms: Int[np.ndarray, "A"]
    order: Int[np.ndarray, "N"]
    """Points group by group."""
    groups: np.ndarray
    """GROUP, (G,)."""
    keypoints: np.ndarray
    """KEYPOINT, (T, N): what terms know of a point in a frame."""
    held: np.ndarray
    """HELD, (T,)."""
