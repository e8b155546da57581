"""Learns the hand space from recorded hands and postures, and turns it about the axes of a body's own fingers.

    python -m build_assets.free_body.hand.hand_space RECORDINGS

Recorded hands are mostly open. Manual alphabets want every finger straight, bent or curled by itself, and the thumb
wherever a thumb goes. So postures are drawn at random from what each finger does, as anatomical angles of the left hand
(see hand_skeleton.py).

Principal components of angles would count a fingertip's joint like a knuckle, which moves the tip three times as far.
Here each posture's error is measured by how far it moves the posture's own joints, J (x - mean - c @ components) with
J the derivative of the joints' positions by the angles: components and coefficients are found in turns, each by linear
least squares (alternating least squares of a weighted low-rank approximation; K. R. Gabriel, S. Zamir, Lower Rank
Approximation of Matrices by Least Squares With Any Choice of Weights, 1979).
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from build_assets.free_body.hand.hand_skeleton import (
    FLEXION,
    SIZE,
    SPREAD,
    TWIST,
    HandSkeleton,
    axis_angle_of,
    finger_axes,
)
from build_assets.free_body.hand.recordings import Recording, aligned, joint_angles, read_recording
from fitting_core.body.files.reading import load_body
from fitting_core.body.geometry import MIRROR_ROTATION
from fitting_core.body.model import N_HAND_COMPONENTS, BodyModel
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz, write_npz
from fitting_core.keypoints import FINGERS
from fitting_core.shipped import FREE_FOLDER

HAND_SPACE = FREE_FOLDER.parent / "hands" / "hand_space.npz"
"""What hands do, learnt from recordings and postures; the bodies are built with it."""
_LONG = ("index", "middle", "ring", "pinky")
_BENDS = {
    "straight": (0.36, (0, 5, 3)),
    "curled": (0.36, (82, 100, 60)),
    "round": (0.10, (42, 45, 28)),
    "hooked": (0.09, (8, 95, 55)),
    "knuckle": (0.09, (80, 8, 5)),
}
"""Share, and degrees of flexion of the three joints, of what a finger does."""
_ALIKE = ((0.30, 0), (0.20, 1), (0.15, 2))
"""Share of hands in which all fingers from this one on do the same."""
_CURLED_TWIST = (8.0, 1.0, -5.0, -16.0)
"""Degrees at the knuckle of a curled finger, near those of the recorded fists: tips close towards the palm's middle."""
_CLOSED, _FAN = np.array([2.0, 0.0, 0.0, -2.0]), np.array([-13.0, -2.5, 9.0, 20.0])
"""Degrees of spread of straight fingers side by side, and of an open hand."""
_FANNED = 0.4
"""Share of hands that spread between these two; in the others every finger goes where it can."""
_SPREAD_RANGES = np.array([(-13.0, 8.0), (-11.0, 9.0), (-9.0, 11.0), (-6.0, 22.0)])
_THUMBS = (
    ((12, 0, -3), (14, 0), (15, 0)),  # at ease
    ((28, -9, -7), (7, 0), (4, 0)),  # beside the index finger
    ((-17, -1, 10), (-5, 0), (-4, 0)),  # out
    ((-14, -22, 0), (-8, 0), (-12, 0)),  # up
    ((12, 34, 0), (4, 0), (6, 0)),  # before the palm
    ((39, 27, 10), (38, 8), (49, 0)),  # across a fist
    ((35, -2, 5), (43, 0), (46, 0)),  # folded on the palm
    ((32, 22, 1), (7, 0), (-18, 0)),  # on the tip of the index finger
    ((46, 26, -3), (12, 0), (-17, 0)),  # of the middle finger
    ((53, 27, -3), (20, 0), (-10, 0)),  # of the ring finger
    ((56, -16, -15), (41, 0), (26, 0)),  # of the little finger
)
"""Degrees of flexion, spread (and twist) of the three joints, those on fingertips by inverse kinematics on the body."""
_BETWEEN = 1 / 3
"""Share of thumbs that stand between two of these."""
_SCATTER = 5.0
"""Degrees, of most angles."""


def postures(count: int, random: np.random.Generator) -> Float[np.ndarray, "n 45"]:
    """A sample of the postures, radians."""
    return np.radians(np.stack([_posture(random).ravel() for _ in range(count)]))


def _posture(random: np.random.Generator) -> Float[np.ndarray, "5 3 3"]:
    angles = np.zeros((len(FINGERS), 3, 3))
    bends, spread = _finger_bends(random), _spread(random)
    for i, finger in enumerate(_LONG):
        joints = angles[FINGERS.index(finger)]
        together, against = random.normal(0, _SCATTER, 2)
        joints[:, FLEXION] = _BENDS[bends[i]][1]
        joints[:, FLEXION] += together * np.array([1, 1, 0.6]) + 0.7 * against * np.array([1, -1, -0.6])
        joints[0, SPREAD] = spread[i]
        if bends[i] == "curled":
            joints[0, SPREAD] = random.normal(0, 0.6 * _SCATTER)
            joints[0, TWIST] = _CURLED_TWIST[i] + random.normal(0, 0.8 * _SCATTER)
    angles[FINGERS.index("thumb")] = _thumb(random)
    return angles


def _finger_bends(random: np.random.Generator) -> list[str]:
    bends = list(random.choice(list(_BENDS), len(_LONG), p=[share for share, _ in _BENDS.values()]))
    shares = [share for share, _ in _ALIKE]
    first = random.choice([*(first for _, first in _ALIKE), len(_LONG) - 1], p=[*shares, 1 - sum(shares)])
    return bends[:first] + [bends[first]] * (len(_LONG) - first)


def _spread(random: np.random.Generator) -> Float[np.ndarray, "4"]:
    if random.random() < _FANNED:
        return _CLOSED + (_FAN - _CLOSED) * random.random()
    return random.uniform(*_SPREAD_RANGES.T)


def _thumb(random: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    one, other = (_THUMBS[k] for k in random.choice(len(_THUMBS), 2, replace=False))
    share = random.random() if random.random() < _BETWEEN else 0.0
    angles = np.zeros((3, 3))
    for k in range(3):
        angles[k, : len(one[k])] = (1 - share) * np.array(one[k]) + share * np.array(other[k])
    angles[:, FLEXION] += random.normal(0, _SCATTER, 3)
    angles[0, SPREAD] += random.normal(0, _SCATTER)
    return angles


@dataclass(frozen=True, kw_only=True, eq=False)
class HandSpace:
    """Hand poses: mean + coefficients @ components, in anatomical angles (radians, see hand_skeleton.py)."""

    mean: Float[np.ndarray, "45"]
    components: Float[np.ndarray, "45 45"]
    """Orthonormal rows. The first 12 carry hands best, ordered by their variance; then the others, likewise."""


def read_hand_space(path: Path = HAND_SPACE) -> HandSpace:
    """The space that ships with the project, or another."""
    return HandSpace(**{key: array.astype(float) for key, array in read_npz(path, ("mean", "components")).items()})


@dataclass(frozen=True, kw_only=True, eq=False)
class HandBasis:
    """Hand poses: mean + coefficients @ components, as axis-angle of the 15 finger joints in SMPL-X's order."""

    components: Float[np.ndarray, "45 45"]
    """Orthonormal rows; the first 12 span what hands do most."""
    mean: Float[np.ndarray, "45"]
    """A hand at ease, relative to the rest pose's flat one: the mean of recorded hands and postures."""

    def mirrored(self) -> "HandBasis":
        """The basis of the other hand."""
        return HandBasis(components=_mirror(self.components), mean=_mirror(self.mean))


def left_hand_basis(joints: Float[np.ndarray, "55 3"], space: HandSpace) -> HandBasis:
    """The left hand's basis, from the joints of a typical body in the rest pose (metres)."""
    axes = finger_axes(joints)
    return HandBasis(components=axis_angle_of(space.components, axes), mean=axis_angle_of(space.mean, axes))


def _mirror(vectors: Float[np.ndarray, "*n 45"]) -> Float[np.ndarray, "*n 45"]:
    return (vectors.reshape(*vectors.shape[:-1], -1, 3) * MIRROR_ROTATION).reshape(vectors.shape)


_SEED = 1
_POSTURES = 3000
_RECORDED = 60
"""Frames taken from each recording: they are all alike, and one has 2000."""
_POSTURES_SHARE = 0.4
_ROUNDS = 25
_STIFFNESS = 0.02
"""Of the mean metric: what angles cost that move nothing."""
_FEWEST = 20
"""Frames of a recording that counts."""


def hand_of(body: BodyModel) -> HandSkeleton:
    """The left hand of a body's mean shape."""
    tips = np.stack([body.template[body.surface_keypoints[f"left_{finger}"]] for finger in FINGERS])
    return HandSkeleton.of(body.rest_joints, tips)


def learn(recorded: list[Float[np.ndarray, "n 45"]], hand: HandSkeleton) -> HandSpace:
    """The space of recorded hands and of postures.

    Args:
        recorded: angles of each recording; all recordings count alike.
        hand: whose joints the errors are measured on.
    """
    random = np.random.default_rng(_SEED)
    recorded = [angles for angles in recorded if len(angles) >= _FEWEST]
    drawn = postures(_POSTURES, random)
    recorded_mean = np.mean([angles.mean(0) for angles in recorded], axis=0)
    mean = (1 - _POSTURES_SHARE) * recorded_mean + _POSTURES_SHARE * drawn.mean(0)
    real = np.concatenate([random.choice(angles, min(_RECORDED, len(angles)), replace=False) for angles in recorded])
    weight = np.repeat([(1 - _POSTURES_SHARE) / len(real), _POSTURES_SHARE / len(drawn)], [len(real), len(drawn)])
    centred = np.concatenate([real, drawn]) - mean
    metric = position_metric(hand, centred + mean)
    metric += _STIFFNESS * np.trace(metric.mean(0)) / SIZE * np.eye(SIZE)
    first, coefficients = _best_span(centred, weight, metric, N_HAND_COMPONENTS)
    return _completed(mean, first, centred, coefficients, weight)


def position_metric(hand: HandSkeleton, angles: Float[np.ndarray, "n 45"]) -> Float[np.ndarray, "n 45 45"]:
    """J^T J of the joints' and tips' positions by the angles, square metres."""

    def positions(one: torch.Tensor) -> torch.Tensor:
        return hand.pose(one.view(len(FINGERS), 3, 3)).flatten()

    jacobian = torch.func.vmap(torch.func.jacfwd(positions))(torch.as_tensor(angles))
    return (jacobian.mT @ jacobian).numpy()


def _best_span(
    centred: Float[np.ndarray, "n 45"], weight: Float[np.ndarray, "n"], metric: Float[np.ndarray, "n 45 45"], size: int
) -> tuple[Float[np.ndarray, "k 45"], Float[np.ndarray, "n k"]]:
    """Orthonormal rows and the coefficients of the least squares under each sample's own metric."""
    rows = _principal(centred, weight, size)
    pulled = (metric @ centred[..., None])[..., 0]
    for _ in range(_ROUNDS):
        coefficients = _coefficients(rows, metric, pulled)
        products = coefficients[:, :, None] * coefficients[:, None] * weight[:, None, None]
        matrix = (products.reshape(len(weight), -1).T @ metric.reshape(len(weight), -1)).reshape(size, size, SIZE, SIZE)
        matrix = matrix.transpose(0, 2, 1, 3).reshape(size * SIZE, size * SIZE)
        solved = np.linalg.solve(matrix, ((coefficients * weight[:, None]).T @ pulled).ravel())
        rows = np.linalg.qr(solved.reshape(size, SIZE).T)[0].T
    return rows, _coefficients(rows, metric, pulled)


def _coefficients(
    rows: Float[np.ndarray, "k 45"], metric: Float[np.ndarray, "n 45 45"], pulled: Float[np.ndarray, "n 45"]
) -> Float[np.ndarray, "n k"]:
    return np.linalg.solve(rows @ metric @ rows.T, (pulled @ rows.T)[..., None])[..., 0]


def _principal(centred: Float[np.ndarray, "n 45"], weight: Float[np.ndarray, "n"], size: int) -> np.ndarray:
    _, vectors = np.linalg.eigh((centred * weight[:, None]).T @ centred)
    return vectors[:, ::-1][:, :size].T


def _completed(
    mean: Float[np.ndarray, "45"],
    rows: Float[np.ndarray, "k 45"],
    centred: Float[np.ndarray, "n 45"],
    coefficients: Float[np.ndarray, "n k"],
    weight: Float[np.ndarray, "n"],
) -> HandSpace:
    """Turns the first rows to their principal axes, and adds those of what they leave."""
    axes = _principal(coefficients, weight, len(rows))
    first = axes @ rows
    left = centred - centred @ first.T @ first
    # Rows that are there already are pushed below those of no variance, and so to the end.
    _, vectors = np.linalg.eigh((left * weight[:, None]).T @ left - first.T @ first)
    components = np.concatenate([first, vectors[:, ::-1][:, : SIZE - len(first)].T])
    components *= np.where(components.sum(1, keepdims=True) < 0, -1.0, 1.0)  # plus mostly means flexion
    return HandSpace(mean=mean, components=components)


def read_recordings(folder: Path) -> list[Recording]:
    """All recordings of a folder, by name, their palms aligned.

    Raises:
        InputError: A file is missing or cannot be read.
    """
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise InputError(f"{folder} holds no .npz files; expected the folder of the hand recordings.")
    return aligned([read_recording(path) for path in paths])


def main(arguments: list[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(prog="python -m build_assets.free_body.hand.hand_space", description=__doc__)
    parser.add_argument("recordings", type=Path, help="folder of recorded hands, one npz file for each recording")
    parser.add_argument("--out", type=Path, default=HAND_SPACE, help="the file to write")
    options = parser.parse_args(arguments)
    hand = hand_of(load_body(FREE_FOLDER / "SMPLX_NEUTRAL.npz"))
    try:
        recordings = read_recordings(options.recordings)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    angles = [joint_angles(recording.directions, hand) for recording in recordings]
    space = learn(angles, hand)
    write_npz(options.out, {key: value.astype(np.float32) for key, value in vars(space).items()})
    print(f"{options.out}: {sum(map(len, angles))} recorded hands")
    return 0


if __name__ == "__main__":
    sys.exit(main())
