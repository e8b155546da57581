"""Learns the hand space from recorded hands and postures.

    python -m fitting_core.build_assets.free_body.hand.hand_space RECORDINGS

Principal components of angles would count a fingertip's joint like a knuckle, which moves the tip three times as far.
Here each posture's error is measured by how far it moves the posture's own joints, J (x - mean - c @ components) with
J the derivative of the joints' positions by the angles: components and coefficients are found in turns, each by linear
least squares (alternating least squares of a weighted low-rank approximation; K. R. Gabriel, S. Zamir, Lower Rank
Approximation of Matrices by Least Squares With Any Choice of Weights, 1979).
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from assets import BODIES, HAND_SPACE
from fitting_core.body.files.reading import load_body
from fitting_core.body.hand_skeleton import FINGERS, SIZE, HandSkeleton
from fitting_core.body.model import N_HAND_COMPONENTS, BodyModel
from fitting_core.build_assets.free_body.body_file import write_body
from fitting_core.build_assets.free_body.hand.basis import HandSpace
from fitting_core.build_assets.free_body.hand.postures import postures
from fitting_core.build_assets.free_body.hand.recordings import Recording, aligned, joint_angles, read_recording
from fitting_core.errors import InputError

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
        InputError: there is none, or one cannot be read.
    """
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise InputError(f"{folder} holds no .npz files; expected the folder of the hand recordings.")
    return aligned([read_recording(path) for path in paths])


def main(arguments: list[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m fitting_core.build_assets.free_body.hand.hand_space", description=__doc__
    )
    parser.add_argument("recordings", type=Path, help="folder of recorded hands, one npz file for each recording")
    parser.add_argument("--out", type=Path, default=HAND_SPACE, help="the file to write")
    options = parser.parse_args(arguments)
    hand = hand_of(load_body(BODIES / "SMPLX_NEUTRAL.npz"))
    try:
        recordings = read_recordings(options.recordings)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    angles = [joint_angles(recording.directions, hand) for recording in recordings]
    space = learn(angles, hand)
    write_body(options.out, {key: value.astype(np.float32) for key, value in vars(space).items()})
    print(f"{options.out}: {sum(map(len, angles))} recorded hands")
    return 0


if __name__ == "__main__":
    sys.exit(main())
