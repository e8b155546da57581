"""A motion as BVH: a moving skeleton of 55 joints, without a mesh.

Metres and degrees. The root's position is that of the pelvis in the world; every joint rotates by Z, X and Y in this
order (R = Rz Rx Ry). Offsets are of the rest pose, with the motion's one shape and no expression. BVH has no place for
anything else: write `stated_by_frame` beside it.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.body.model import JOINTS, N_JOINTS
from fitting_core.files.atomic import replacing
from fitting_core.motion import Motion, Progress

_ORDER = "ZXY"
_CHANNELS = "Zrotation Xrotation Yrotation"
_END = (0.0, 0.02, 0.0)
"""Metres: BVH requires an end beyond the last joint."""
_DECIMALS = 6


def write_bvh(path: Path, motion: Motion, progress: Progress | None = None) -> None:
    """Write the skeleton and its motion. Raises OSError if the file cannot be written; nothing is left of it."""
    shaped = motion.one_shape
    with replacing(path) as draft, draft.open("w", encoding="ascii", newline="\n") as file:
        file.write("\n".join(_hierarchy(rest_offsets(shaped), motion.body.parents)))
        file.write(f"\nMOTION\nFrames: {len(motion)}\nFrame Time: {1 / motion.frame_rate:.9f}\n")
        rows = _rows(shaped)
        for done, values in enumerate(rows, 1):
            file.write(" ".join(f"{value:.{_DECIMALS}f}" for value in values) + "\n")
            if progress:
                progress(done / len(rows))


def rest_offsets(motion: Motion) -> Float[np.ndarray, "55 3"]:
    """Each joint from its parent in the rest pose of the first frame's shape without expression; the root from 0."""
    rest = motion.body.with_shape(motion.params.betas[0].double().numpy()).rest_joints
    return np.concatenate([rest[:1], rest[1:] - rest[motion.body.parents[1:]]])


def _hierarchy(offsets: np.ndarray, parents: np.ndarray) -> list[str]:
    children: dict[int, list[int]] = {j: [] for j in range(N_JOINTS)}
    for j in range(1, N_JOINTS):
        children[int(parents[j])].append(j)
    lines = [
        "HIERARCHY",
        "ROOT pelvis",
        "{",
        "\tOFFSET 0 0 0",
        f"\tCHANNELS 6 Xposition Yposition Zposition {_CHANNELS}",
    ]
    for child in children[0]:
        lines += _joint(child, offsets, children, "\t")
    return [*lines, "}"]


def _joint(j: int, offsets: np.ndarray, children: dict[int, list[int]], indent: str) -> list[str]:
    inner = indent + "\t"
    lines = [f"{indent}JOINT {JOINTS[j]}", f"{indent}{{", _offset(offsets[j], inner), f"{inner}CHANNELS 3 {_CHANNELS}"]
    for child in children[j]:
        lines += _joint(child, offsets, children, inner)
    if not children[j]:
        lines += [f"{inner}End Site", f"{inner}{{", _offset(_END, inner + "\t"), f"{inner}}}"]
    return [*lines, f"{indent}}}"]


def _offset(offset: np.ndarray | tuple[float, ...], indent: str) -> str:
    return f"{indent}OFFSET " + " ".join(f"{value:.{_DECIMALS}f}" for value in offset)


def _rows(motion: Motion) -> Float[np.ndarray, "T 168"]:
    """The root's position, then the joints' angles in the order of the hierarchy."""
    order = depth_first(motion.body.parents)
    angles = continuous_euler(motion.pose.numpy())[:, order]
    return np.concatenate([motion.pelvis, angles.reshape(len(motion), -1)], 1)


def depth_first(parents: np.ndarray) -> list[int]:
    """The joints in the order of a file with nested joints."""
    order = []
    waiting = [0]
    while waiting:
        joint = waiting.pop()
        order.append(joint)
        waiting += reversed(np.flatnonzero(parents == joint).tolist())
    return order


def continuous_euler(pose: Float[np.ndarray, "T J 3"]) -> Float[np.ndarray, "T J 3"]:
    """Degrees about Z, X and Y of axis-angle rotations, unwrapped over time.

    Of the two triples of a rotation, (z, x, y) and (z + 180, 180 - x, y + 180), and their full turns, each frame gets
    the one nearest to the frame before: programs that interpolate angles would otherwise turn the long way round.
    """
    frames, joints, _ = pose.shape
    angles = Rotation.from_rotvec(pose.reshape(-1, 3)).as_euler(_ORDER, degrees=True).reshape(frames, joints, 3)
    for t in range(1, frames):
        before, one = angles[t - 1], angles[t]
        other = one * (1, -1, 1) + 180
        choices = np.stack([c + 360 * np.round((before - c) / 360) for c in (one, other)])
        nearest = abs(choices - before).sum(-1).argmin(0)
        angles[t] = np.take_along_axis(choices, nearest[None, :, None], 0)[0]
    return angles
