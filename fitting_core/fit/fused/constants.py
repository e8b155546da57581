"""Constants of the kernels: of the body, the camera, and as declared by terms (`terms.entry.Kernel`).

Arrays of records instead of an array per field: this compiles in a third of the time.
"""

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from fitting_core.fit.compiled.layout import INTEGER, MOST_COLUMNS, MOST_HAND, N_COEFFICIENTS, N_JOINTS, NUMBER
from fitting_core.fit.terms.entry import Kernel
from fitting_core.fit.terms.table import TERMS
from fitting_core.fit.terms.term import Term

KERNELS: dict[type[Term], Kernel] = {entry.kind: entry.kernel for entry in TERMS.values() if entry.kernel is not None}
"""By kind of term; exact types only, because a derived kind may differ."""


def _declared(record: Literal["clip", "frame", "point", "keypoint"]) -> list[tuple]:
    """The fields that terms declare in a record."""
    return [field for kernel in KERNELS.values() for field in getattr(kernel, record)]


CLIP = np.dtype(
    [
        # columns: numbers of one hand, first turn columns, numbers of the pose prior (63 for axis-angle)
        *[
            (name, INTEGER)
            for name in ("hand", "jaw", "expression", "translation", "betas", "width", "latent", "shift")
        ],
        # what moves besides the root and the translation, and how many columns of the state are free
        *[(name, np.bool_) for name in ("free_body", "free_hands", "free_face", "free_betas")],
        ("free", INTEGER),
        ("index", INTEGER, MOST_COLUMNS),
        # the body at rest; directions by betas, then expression, and those of a bone relative to its parent
        ("parents", INTEGER, N_JOINTS),
        ("rest", NUMBER, (N_JOINTS, 3)),
        ("rest_directions", NUMBER, (N_JOINTS, 3, N_COEFFICIENTS)),
        ("bone_directions", NUMBER, (N_JOINTS, 3, N_COEFFICIENTS)),
        ("hand_mean", NUMBER, 90),
        ("hand_basis", NUMBER, (90, MOST_HAND)),
        # the camera
        ("focal", NUMBER, 2),
        ("center", NUMBER, 2),
        *_declared("clip"),
    ]
)
"""Everything whose size does not depend on the clip."""

LAYER = np.dtype([("inputs", INTEGER), ("outputs", INTEGER), ("activation", INTEGER), ("below", NUMBER)])
"""Of the pose prior's decoder; `below` is the slope of a leaky ReLU below zero."""

PAIR = np.dtype(
    [("bone", INTEGER), ("weight", NUMBER), ("template", NUMBER, 3), ("directions", NUMBER, (3, N_COEFFICIENTS))]
)
"""Of a point and a bone, see `body.points.pairs`."""

POINT = np.dtype(
    [
        ("joint", INTEGER),  # of a point that is one, else -1
        ("first_pair", INTEGER),  # pairs that add up to the point
        ("last_pair", INTEGER),
        ("first_entry", INTEGER),  # entries: joints whose turn moves the point
        ("last_entry", INTEGER),
        *_declared("point"),
    ]
)

ENTRY = np.dtype([("joint", INTEGER), ("first_arm", INTEGER), ("last_arm", INTEGER)])
"""A free joint whose rotation moves a point, and the point's pairs that rotate with it: indices into `arms`."""

GROUP = np.dtype(
    [
        ("first", INTEGER),
        ("last", INTEGER),
        ("width", INTEGER),
        ("column", INTEGER, MOST_COLUMNS),
        ("place", INTEGER, MOST_COLUMNS),
    ]
)
"""Points (indices into `order`) that depend on the same columns, those of a limb: these turn columns, and the index of
each turn column among them."""

KEYPOINT = np.dtype(_declared("keypoint"))
"""A term's data for a point in a frame."""

FRAME = np.dtype([("variant", INTEGER), *_declared("frame")])
"""A frame's variant of the second table of pairs, and the terms' data besides its keypoints."""


class Pairs(NamedTuple):
    """A table of `body.points.pairs`; the first axis is variants."""

    pair: np.ndarray
    """PAIR, (K, P)."""
    driving: Int[np.ndarray, "n"]
    correctives: Float[np.ndarray, "K P*3 n*9"]


class Constants(NamedTuple):
    """Everything; arrays are C-contiguous."""

    clip: np.record
    """CLIP."""
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
    """KEYPOINT, (T, N)."""
    frames: np.ndarray
    """FRAME, (T,)."""
