"""Rotations as three angles about the axes of a frame, continuous over time, with the frames of gimbal lock."""

import warnings

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

SINGULAR = 5.0
"""Degrees around the pose in which the first and the third axis of a sequence coincide. There, only the sum of these
two angles is known: noise of half a degree turns each of them by six."""


def angles_of(matrices: Float[np.ndarray, "T 3 3"], sequence: str) -> Float[np.ndarray, "T 3"]:
    """Degrees about body-fixed axes, such as R = Rz(a) Rx(b) Ry(c) for "ZXY"; the middle one is in its main range.

    That is -90 to 90 for three axes, and 0 to 180 where the first is the third as well.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Gimbal lock")
        return Rotation.from_matrix(matrices).as_euler(sequence, degrees=True)


def singular(angles: Float[np.ndarray, "T 3"], sequence: str) -> Bool[np.ndarray, "T"]:
    """Where the first and third angle are not determined: where their axes coincide, up to SINGULAR."""
    middle = np.radians(angles[:, 1])
    away = abs(np.sin(middle)) if sequence[0] == sequence[2] else abs(np.cos(middle))
    return away < np.sin(np.radians(SINGULAR))


def continuous(
    angles: Float[np.ndarray, "T n"],
    sequence: str,
    *,
    start: tuple[float, ...] | None = None,
    determined: Bool[np.ndarray, "T n"] | None = None,
) -> Float[np.ndarray, "T n"]:
    """The same rotations, each by the angles that are nearest to those before; NaN where one is not determined.

    Full turns are added, and of three different axes the other triple is taken, (a + 180, 180 - b, c + 180), where it
    is nearer. Where the first axis is the third as well, the middle angle keeps its sign: an arm's elevation.

    Args:
        angles: degrees.
        sequence: their axes.
        start: what an angle is near to in the first frame, and after a gap; None: zeros.
        determined: which angles are; None: all.
    """
    found, origin = np.full_like(angles, np.nan), np.zeros(angles.shape[1]) if start is None else np.array(start)
    known = np.ones(angles.shape, bool) if determined is None else determined
    before = origin
    for t, one in enumerate(angles):
        near = np.where(known[t] & ~known[t - 1], origin, before) if t else before
        triples = [one, one * (1, -1, 1) + 180] if len(set(sequence)) == 3 else [one]
        choices = [triple + 360 * np.round((near - triple) / 360) for triple in triples]
        nearest = choices[np.argmin([abs(choice - near).sum() for choice in choices])]
        found[t, known[t]] = nearest[known[t]]
        before = np.where(known[t], nearest, before)
    return found


def nearest_turn(matrices: Float[np.ndarray, "T 3 3"], axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "T"]:
    """Radians about one unit axis, by which a rotation about it alone comes nearest to these (trace distance)."""
    antisymmetric = np.stack(
        [
            matrices[:, 2, 1] - matrices[:, 1, 2],
            matrices[:, 0, 2] - matrices[:, 2, 0],
            matrices[:, 1, 0] - matrices[:, 0, 1],
        ],
        -1,
    )
    along = np.einsum("i,tij,j->t", axis, matrices, axis)
    return np.arctan2(antisymmetric @ axis, np.trace(matrices, axis1=1, axis2=2) - along)


def held(matrices: Float[np.ndarray, "T 3 3"], sequence: str) -> Float[np.ndarray, "T 3"]:
    """Angles about three different axes as `continuous`, determined or not, for what plays them must have a number.

    Where the first and the third axis coincide, to a tenth of a degree, the first angle stays as it was before, and the
    third one is what is left of the rotation.
    """
    found = continuous(angles_of(matrices, sequence), sequence)
    third = unit_axis(sequence[2])
    for t in np.flatnonzero(abs(np.cos(np.radians(found[:, 1]))) < np.sin(np.radians(0.1))):
        before = found[t - 1] if t else np.zeros(3)
        found[t, 0] = before[0]
        turned = Rotation.from_euler(sequence[:2], found[t, :2], degrees=True).as_matrix()
        rest = np.degrees(nearest_turn((turned.T @ matrices[t])[None], third))[0]
        found[t, 2] = rest + 360 * np.round((before[2] - rest) / 360)
    return found


def unit_axis(letter: str) -> Float[np.ndarray, "3"]:
    """X, Y or Z."""
    return np.eye(3)["XYZ".index(letter)]
