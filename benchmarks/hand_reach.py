"""How near hand spaces come to hands: recordings that they were not learnt from, and the named handshapes.

`python -m benchmarks.hand_reach`: for each space and number of components, the hand of the space whose joints lie
nearest to the given hand's is found without any prior; told is how far fingertips remain apart.
"""

import numpy as np
import torch
import tyro
from jaxtyping import Float

from benchmarks.clips import data_folder
from build_assets.free_body.hand.hand_space import hand_of, learn, read_recordings
from build_assets.free_body.hand.recordings import joint_angles
from fitting_core.body.files.reading import load_body
from fitting_core.body.hand_skeleton import HandSkeleton
from fitting_core.shipped import FREE_FOLDER
from fitting_core.synthetic.acting.handshapes import HANDSHAPES
from tests.samples.hand_spaces import Space, anatomical, named_shapes, nearest

HELD_OUT = ("brian", "grab", "gun", "Waiting-110fps", "HandSplay-110fps")
"""Recordings for the test. `waiting-short` is a part of one of them."""
_FRAMES = 60
"""Of each recording."""


def explained(angles: Float[np.ndarray, "n 45"], space: Space, size: int) -> float:
    """Share of the variance of joint angles that lies in a space: 1 - squared distance to it / that to their mean."""
    mean, rows = space[0], space[1][:size]
    apart = angles - mean
    left = apart - apart @ rows.T @ rows
    return float(1 - (left**2).sum() / ((angles - angles.mean(0)) ** 2).sum())


def space_of(body_file: str, hand: HandSkeleton) -> Space:
    """The left hand's space of a body file, in anatomical angles of the hand."""
    body = load_body(FREE_FOLDER / body_file)
    return anatomical(body.hand_mean[0], hand), anatomical(body.hand_components[0], hand)


def main(bodies: tuple[str, ...] = ("SMPLX_NEUTRAL.npz",), sizes: tuple[int, ...] = (6, 12, 24)) -> None:
    """Measures and prints.

    Args:
        bodies: files whose hand spaces are measured; absolute paths, or names in assets/bodies.
        sizes: numbers of components.
    """
    torch.set_num_threads(1)
    hand = hand_of(load_body(FREE_FOLDER / "SMPLX_NEUTRAL.npz"))
    folder = data_folder() / "mocap" / "leap_hands" / "npz"
    recorded = {r.name: joint_angles(r.directions, hand) for r in read_recordings(folder)}
    random = np.random.default_rng(0)
    tested = [random.choice(recorded[n], min(_FRAMES, len(recorded[n])), replace=False) for n in HELD_OUT]
    rest = [angles for name, angles in recorded.items() if name not in (*HELD_OUT, "waiting-short")]
    learnt = learn(rest, hand)
    spaces = {name: space_of(name, hand) for name in bodies}
    spaces["learnt without the tested"] = (learnt.mean, learnt.components)
    spaces["recordings alone, PCA"] = _principal(rest, random)
    sets = {"held-out recordings": np.concatenate(tested), "handshapes": named_shapes(hand)}
    for size in sizes:
        for name, space in spaces.items():
            errors = {what: nearest(hand, angles, space, size)[:, :, 3].mean(1) for what, angles in sets.items()}
            told = [f"{what} {e.mean():.1f} (largest {e.max():.1f})" for what, e in errors.items()]
            print(f"{size:2d} components, {name}: fingertips " + ", ".join(told) + " mm")
            shares = [f"{what} {100 * explained(angles, space, size):.1f} %" for what, angles in sets.items()]
            print("   variance of the angles explained: " + ", ".join(shares))
            if size == 12:
                print("   " + ", ".join(f"{s} {e:.1f}" for s, e in zip(HANDSHAPES, errors["handshapes"], strict=True)))


def _principal(recorded: list[Float[np.ndarray, "n 45"]], random: np.random.Generator) -> Space:
    taken = np.concatenate([random.choice(a, min(_FRAMES, len(a)), replace=False) for a in recorded])
    return taken.mean(0), np.linalg.svd(taken - taken.mean(0))[2]


if __name__ == "__main__":
    tyro.cli(main)
