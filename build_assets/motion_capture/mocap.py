"""Readers of motion capture: skeletons in their own joints, as world rotations and positions over time.

Every reader turns its source into one world: y up, and in the source's rest pose (all rotations the identity) the body
faces +z with its left at +x. Lengths are metres.
"""

import csv
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz
from fitting_core.files.regular import regular_file

_CMU_UNIT = 0.01
"""Metres of one unit of the Daz-friendly conversion of the CMU data (its figure is about 1.7 m high)."""
_ROTATIONS = ["Xrotation", "Yrotation", "Zrotation"]
_CMU_CHANNELS = ([], _ROTATIONS, ["Xposition", "Xrotation", "Yposition", "Yrotation", "Zposition", "Zrotation"])
"""What a joint can have, in alphabetical order."""
_CMU_ARRAYS = ("channels", "offsets", "fps")


@dataclass(frozen=True, kw_only=True, eq=False)
class Skeleton:
    """A tree of joints in its rest pose."""

    joints: tuple[str, ...]
    parents: Int[np.ndarray, "J"]
    """Parent of each joint, -1 for the root; parents come first."""
    offsets: Float[np.ndarray, "J 3"]
    """From the parent to the joint in the rest pose, metres; zero for the root."""

    def index(self, joint: str) -> int:
        """Number of a joint.

        Raises:
            InputError: There is no joint of that name.
        """
        if joint not in self.joints:
            raise InputError(f"A captured skeleton has no joint {joint}, only {', '.join(self.joints)}. Copy it again.")
        return self.joints.index(joint)


@dataclass(frozen=True, kw_only=True, eq=False)
class SourceMotion:
    """One captured clip."""

    name: str
    subject: str
    source: str
    """Which of READERS it came from."""
    fps: float
    description: str
    skeleton: Skeleton
    rotations: Float[np.ndarray, "T J 3 3"]
    """World rotation of each joint against the rest pose."""
    positions: Float[np.ndarray, "T J 3"]
    """World, metres."""

    def __len__(self) -> int:
        return len(self.rotations)

    def world(self, joint: str) -> Float[np.ndarray, "T 3 3"]:
        """World rotations of one joint."""
        return self.rotations[:, self.skeleton.index(joint)]


def read_motions(folder: Path, sources: Sequence[str] = ("cmu", "deepmimic")) -> Iterator[SourceMotion]:
    """All clips of some sources in a folder, which lie in subfolders named as in READERS.

    Raises:
        InputError: The folder has none of them, or a file is not of the form that is expected.
    """
    found = [name for name in sources if (folder / name).is_dir()]
    if not found:
        raise InputError(
            f"{folder}: holds no motion capture, expected at least one of the folders {', '.join(sources)}. "
            "Give the folder that they lie in."
        )
    for name in found:
        yield from READERS[name](folder / name)


def read_cmu(folder: Path) -> Iterator[SourceMotion]:
    """CMU motion capture in the Daz-friendly BVH conversion by B. Hahne, as channel arrays.

    Each file begins with the figure's own T-pose, which is left out: it was never captured.

    Args:
        folder: Holds skeleton.json (joint names, parents, channels), manifest.csv and clips/*.npz with `channels`
            (T, C) in degrees and centimetres, `offsets` (J, 3) and `fps`.

    Raises:
        InputError: Something of it is missing or of another form.
    """
    joints, parents, channels = _cmu_layout(folder / "skeleton.json")
    descriptions = _descriptions(folder / "manifest.csv")
    paths = sorted((folder / "clips").glob("*.npz"))
    if not paths:
        raise InputError(f"{folder / 'clips'}: holds no clips, expected npz files such as 02_01.npz. Copy them there.")
    for path in paths:
        values, offsets, fps = _cmu_arrays(path, sum(map(len, channels)), len(joints))
        skeleton = Skeleton(joints=joints, parents=parents, offsets=offsets)
        local, root = _channels_to_rotations(values[1:], channels)
        rotations, positions = _forward_kinematics(skeleton, local, root * _CMU_UNIT)
        yield SourceMotion(
            name=path.stem,
            subject=f"cmu{path.stem.split('_')[0]}",
            source="cmu",
            fps=fps,
            description=descriptions.get(path.stem, ""),
            skeleton=skeleton,
            rotations=rotations,
            positions=positions,
        )


def _cmu_layout(path: Path) -> tuple[tuple[str, ...], Int[np.ndarray, "J"], list[list[str]]]:
    """Names, parents and channels of the joints."""
    layout = _json(path)
    try:
        joints, channels = tuple(layout["joint_names"]), [list(names) for names in layout["channels"]]
        parents = np.array(layout["parents"], int)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: has no joint_names, parents and channels. Take it from the data set again."
        ) from error
    tree = parents.shape == (len(joints),) and parents[0] == -1 and (parents[1:] < np.arange(1, len(joints))).all()
    known = len(channels) == len(joints) and all(names in _CMU_CHANNELS for names in map(sorted, channels))
    if not (tree and known):
        raise InputError(
            f"{path}: expected a parent before each joint (-1 for the first) and for each joint its channels, three "
            "rotations, for the root three positions too, or none. Take it from the data set again."
        )
    return joints, parents, channels


def _cmu_arrays(path: Path, channels: int, joints: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Channels, offsets in metres and frame rate of one clip."""
    try:
        arrays = read_npz(path, _CMU_ARRAYS)
        values, offsets, fps = (np.asarray(arrays[name], float) for name in _CMU_ARRAYS)
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            f"{path}: cannot be read as a clip ({error}), expected an npz file with channels, offsets and fps. "
            "Copy it again or remove it."
        ) from error
    shapes = f"channels {values.shape} and offsets {offsets.shape}"
    if values.ndim != 2 or len(values) < 2 or values.shape[1] != channels or offsets.shape != (joints, 3):
        expected = f"expected channels (2 or more, {channels}) and offsets ({joints}, 3) as skeleton.json says"
        raise InputError(f"{path}: has {shapes}, {expected}. Copy it again or remove it.")
    if not (np.isfinite(values).all() and np.isfinite(offsets).all() and fps > 0):
        raise InputError(f"{path}: holds values that are not finite, or no frame rate. Copy it again or remove it.")
    return values, offsets * _CMU_UNIT, float(fps)


def _channels_to_rotations(values: np.ndarray, channels: list[list[str]]) -> tuple[np.ndarray, np.ndarray]:
    """Local rotations (T, J, 3, 3) and the root's position (T, 3) from BVH channels, which apply from left to right."""
    local = np.tile(np.eye(3), (len(values), len(channels), 1, 1))
    root, start = np.zeros((len(values), 3)), 0
    for joint, names in enumerate(channels):
        columns = {name: values[:, start + i] for i, name in enumerate(names)}
        turns = [name for name in names if name.endswith("rotation")]
        if turns:
            angles = np.stack([columns[name] for name in turns], -1)
            order = "".join(name[0] for name in turns)
            local[:, joint] = Rotation.from_euler(order, angles, degrees=True).as_matrix()
        if joint == 0:
            root = np.stack([columns[f"{axis}position"] for axis in "XYZ"], -1)
        start += len(names)
    return local, root


_DEEPMIMIC_JOINTS = {
    # parent, offset in DeepMimic's axes (x forward, y up, z to the right), numbers in a frame
    "root": (None, (0.0, 0.0, 0.0), 4),
    "chest": ("root", (0.0, 0.236151, 0.0), 4),
    "neck": ("chest", (0.0, 0.223894, 0.0), 4),
    "right_hip": ("root", (0.0, 0.0, 0.084887), 4),
    "right_knee": ("right_hip", (0.0, -0.421546, 0.0), 1),
    "right_ankle": ("right_knee", (0.0, -0.409870, 0.0), 4),
    "right_shoulder": ("chest", (-0.02405, 0.24350, 0.18311), 4),
    "right_elbow": ("right_shoulder", (0.0, -0.274788, 0.0), 1),
    "left_hip": ("root", (0.0, 0.0, -0.084887), 4),
    "left_knee": ("left_hip", (0.0, -0.421546, 0.0), 1),
    "left_ankle": ("left_knee", (0.0, -0.409870, 0.0), 4),
    "left_shoulder": ("chest", (-0.02405, 0.24350, -0.18311), 4),
    "left_elbow": ("left_shoulder", (0.0, -0.274788, 0.0), 1),
    "right_wrist": ("right_elbow", (0.0, -0.258947, 0.0), 0),
    "left_wrist": ("left_elbow", (0.0, -0.258947, 0.0), 0),
    "head_end": ("neck", (0.0, 0.25, 0.0), 0),
    "right_toes": ("right_ankle", (0.13, -0.04, 0.0), 0),
    "left_toes": ("left_ankle", (0.13, -0.04, 0.0), 0),
}
"""DeepMimic's humanoid (Peng et al. 2018), in the order of a frame's numbers; the last rows are ends without any."""
_DEEPMIMIC_TO_WORLD = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
_DEEPMIMIC_HEADER = 4  # duration of the frame, position of the root
_DEEPMIMIC_NUMBERS = _DEEPMIMIC_HEADER + sum(numbers for *_, numbers in _DEEPMIMIC_JOINTS.values())


def read_deepmimic(folder: Path) -> Iterator[SourceMotion]:
    """Motions of DeepMimic's humanoid: knees and elbows are hinges, hands and toes do not exist.

    Args:
        folder: Holds humanoid3d_*.txt: JSON with `Frames`, each of 44 numbers: duration (s), root position (m), and the
            joints' rotations against their parents as quaternions (w, x, y, z) or hinge angles (rad, about z).

    Raises:
        InputError: A file is missing or of another form.
    """
    names = tuple(_DEEPMIMIC_JOINTS)
    parents = np.array([-1 if p is None else names.index(p) for p, *_ in _DEEPMIMIC_JOINTS.values()])
    offsets = np.array([offset for _, offset, _ in _DEEPMIMIC_JOINTS.values()]) @ _DEEPMIMIC_TO_WORLD.T
    skeleton = Skeleton(joints=names, parents=parents, offsets=offsets)
    paths = sorted(folder.glob("humanoid3d_*.txt"))
    if not paths:
        raise InputError(f"{folder}: holds no motions, expected files such as humanoid3d_walk.txt. Copy them there.")
    for path in paths:
        frames = _deepmimic_frames(path)
        try:
            local = _DEEPMIMIC_TO_WORLD @ _deepmimic_rotations(frames) @ _DEEPMIMIC_TO_WORLD.T
        except ValueError as error:
            raise InputError(f"{path}: holds a quaternion that is no rotation. Copy it again or remove it.") from error
        rotations, positions = _forward_kinematics(skeleton, local, frames[:, 1:4] @ _DEEPMIMIC_TO_WORLD.T)
        name = path.stem.removeprefix("humanoid3d_")
        yield SourceMotion(
            name=name,
            subject="deepmimic",
            source="deepmimic",
            fps=1 / float(np.median(frames[:, 0])),
            description=name.replace("_", " "),
            skeleton=skeleton,
            rotations=rotations,
            positions=positions,
        )


def _deepmimic_frames(path: Path) -> Float[np.ndarray, "T 44"]:
    content = _json(path)
    try:
        frames = np.array(content["Frames"], float)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: holds no table `Frames` of numbers. Copy it again or remove it.") from error
    expected = f"expected (T, {_DEEPMIMIC_NUMBERS}) finite numbers with positive durations"
    if frames.ndim != 2 or frames.shape[1] != _DEEPMIMIC_NUMBERS or not len(frames):
        raise InputError(f"{path}: its frames are {frames.shape}, {expected}. Copy it again or remove it.")
    # A file's last frame may last 0 s: it is where the motion ends.
    if not np.isfinite(frames).all() or np.median(frames[:, 0]) <= 0:
        raise InputError(f"{path}: its frames are not usable, {expected}. Copy it again or remove it.")
    return frames


def _deepmimic_rotations(frames: np.ndarray) -> Float[np.ndarray, "T J 3 3"]:
    """Rotations against the parents, in DeepMimic's axes."""
    local = np.tile(np.eye(3), (len(frames), len(_DEEPMIMIC_JOINTS), 1, 1))
    start = _DEEPMIMIC_HEADER
    for joint, (_, _, numbers) in enumerate(_DEEPMIMIC_JOINTS.values()):
        values = frames[:, start : start + numbers]
        if numbers == 4:
            local[:, joint] = Rotation.from_quat(values[:, [1, 2, 3, 0]]).as_matrix()
        elif numbers == 1:
            local[:, joint] = Rotation.from_euler("z", values).as_matrix()
        start += numbers
    return local


_EXPMAP_UNIT = 0.05644
"""Metres of one unit of the root's path, CMU's own: an inch over 0.45."""
_SIDE_JOINTS = ("hip", "femur", "tibia", "foot", "toes", "toes_end")
_ARM_JOINTS = ("clavicle", "humerus", "radius", "wrist", "hand", "fingers", "fingers_end", "thumb", "thumb_end")
_EXPMAP_JOINTS = (
    "root",
    *(side + name for side in "lr" for name in _SIDE_JOINTS),
    *("lower_back", "upper_back", "thorax", "lower_neck", "upper_neck", "head", "head_end"),
    *(side + name for side in "lr" for name in _ARM_JOINTS),
)
"""CMU's own skeleton in the order of the files: each joint turns the bone that begins there."""


def read_cmu_expmap(folder: Path) -> Iterator[SourceMotion]:
    """More CMU motion, as exponential maps of the joints of CMU's own skeleton.

    Which subjects these are is not known; `subject` tells the kind of motion.

    Args:
        folder: Holds skeleton.json (parents, offsets in millimetres) and cmu_expmap_30fps.npz with an array (T, 117)
            for each clip: the root's path, then exponential maps that turn row vectors.

    Raises:
        InputError: Something of it is missing or of another form.
    """
    layout = _json(folder / "skeleton.json")
    try:
        parents, offsets = np.array(layout["parents"], int), np.array(layout["offsets"], float) / 1000
        clips = read_npz(folder / "cmu_expmap_30fps.npz")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{folder}: cannot be read ({error}). Copy it again.") from error
    count = len(_EXPMAP_JOINTS)
    if parents.shape != (count,) or offsets.shape != (count, 3):
        raise InputError(f"{folder}: its skeleton has {len(parents)} joints, expected {count}. Copy it again.")
    skeleton = Skeleton(joints=_EXPMAP_JOINTS, parents=parents, offsets=offsets)
    for name, values in sorted(clips.items()):
        if values.ndim != 2 or values.shape[1] != 3 + 3 * count or len(values) < 2 or not np.isfinite(values).all():
            raise InputError(f"{folder}: its clip {name} is {values.shape}, expected (2 or more, {3 + 3 * count}).")
        turns = Rotation.from_rotvec(-values[:, 3:].reshape(-1, 3)).as_matrix().reshape(len(values), count, 3, 3)
        rotations, positions = _forward_kinematics(skeleton, turns, values[:, :3] * _EXPMAP_UNIT)
        _, kind, clip = name.split("-")
        yield SourceMotion(
            name=clip,
            subject=f"expmap {kind}",
            source="cmu_expmap",
            fps=30.0,
            description=kind.replace("_", " "),
            skeleton=skeleton,
            rotations=rotations,
            positions=positions,
        )


READERS: dict[str, Callable[[Path], Iterator[SourceMotion]]] = {
    "cmu": read_cmu,
    "deepmimic": read_deepmimic,
    "cmu_expmap": read_cmu_expmap,
}
"""Reader of each source by the name of its folder."""


def _forward_kinematics(skeleton: Skeleton, local: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World rotations (T, J, 3, 3) and positions (T, J, 3)."""
    rotations, positions = local.copy(), np.zeros(local.shape[:3])
    positions[:, 0] = root
    for joint, parent in enumerate(skeleton.parents[1:], 1):
        rotations[:, joint] = rotations[:, parent] @ local[:, joint]
        positions[:, joint] = positions[:, parent] + rotations[:, parent] @ skeleton.offsets[joint]
    return rotations, positions


def _descriptions(path: Path) -> dict[str, str]:
    try:
        with regular_file(path).open(newline="", encoding="utf-8") as file:
            return {row["clip"]: row["description"] for row in csv.DictReader(file)}
    except (OSError, KeyError, UnicodeDecodeError) as error:
        raise InputError(
            f"{path}: is no table with the columns clip and description ({error}). Take it from the data set again."
        ) from error


def _json(path: Path) -> Any:
    try:
        return json.loads(regular_file(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as JSON ({error}). Copy it from the data set again.") from error
