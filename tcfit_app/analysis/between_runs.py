"""How far two runs' bodies lie apart."""

import numpy as np
from jaxtyping import Float, Float32

from fitting_core.errors import InputError
from tcfit_app.analysis.curves import Curve
from tcfit_app.analysis.posed_fit import PosedFit

BETWEEN = "between_runs"
"""Name of the curve."""
PEAKS = 5
"""Frames that are marked as those where runs differ most."""
_APART = 20
"""So many of them fit into a clip: neighbours of one peak are not peaks of their own."""


def vertex_distances(one: Float32[np.ndarray, "V 3"], other: Float32[np.ndarray, "V 3"]) -> Float32[np.ndarray, "V"]:
    """Distance between the same vertex of two runs in one frame, in millimetres: what a mesh is coloured by.

    Args:
        one: What `Meshes.vertices` has of one run (metres).
        other: The same of the other run.

    Raises:
        InputError: The bodies have different meshes.
    """
    if len(one) != len(other):
        raise InputError(
            f"The bodies cannot be compared vertex by vertex: they have {len(one)} and {len(other)} vertices. Compare "
            "runs of one body model."
        )
    return 1e3 * np.linalg.norm(other - one, axis=-1)


def between_runs(a: PosedFit, b: PosedFit) -> Curve:
    """Mean distance of the 55 joints of two runs by frame, in millimetres: of whatever bodies.

    Args:
        a: One run.
        b: Another one of the same clip.
    """
    values = 1e3 * np.linalg.norm(b.joints - a.joints, axis=-1).mean(1)
    return Curve(name=BETWEEN, title="Distance between A and B", unit="mm", values=values)


def peaks(values: Float[np.ndarray, "T"]) -> list[int]:
    """The frames of the largest values, largest first, none close to another; only those above zero."""
    left = np.nan_to_num(np.array(values, float))
    reach = max(1, len(left) // _APART)
    found: list[int] = []
    while len(found) < PEAKS and len(left) and left.max() > 0:
        frame = int(left.argmax())
        found.append(frame)
        left[max(0, frame - reach) : frame + reach + 1] = 0
    return found
