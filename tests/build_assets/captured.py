"""Small motion capture in the sources' own forms, made of random poses."""

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

CMU_JOINTS = {
    # parent, offset in centimetres; a figure like the real one, without fingers and eyes
    "hip": (None, (0.0, 0.0, 0.0)),
    "abdomen": ("hip", (0.0, 20.7, -0.7)),
    "chest": ("abdomen", (0.0, 11.7, -0.5)),
    "neck": ("chest", (0.0, 22.2, -2.2)),
    "head": ("neck", (-0.2, 7.1, 1.2)),
    **{
        f"{side}{joint}": (f"{side}{parent}" if parent[0].isupper() else parent, (sign * x, y, z))
        for side, sign in (("r", -1), ("l", 1))
        for joint, parent, (x, y, z) in (
            ("Collar", "chest", (2.7, 19.3, -4.9)),
            ("Shldr", "Collar", (8.8, -2.0, 1.5)),
            ("ForeArm", "Shldr", (28.17, -1.71, 0.49)),
            ("Hand", "ForeArm", (22.6, 0.8, 7.1)),
            ("Buttock", "hip", (8.8, 4.3, 1.2)),
            ("Thigh", "Buttock", (0.0, -1.7, -2.2)),
            ("Shin", "Thigh", (0.0, -36.8, 0.7)),
            ("Foot", "Shin", (-0.7, -45.1, -5.1)),
        )
    },
}
ROTATIONS = ["Zrotation", "Xrotation", "Yrotation"]
CMU_CHANNELS = [
    ["Xposition", "Yposition", "Zposition", "Zrotation", "Yrotation", "Xrotation"] if name == "hip" else ROTATIONS
    for name in CMU_JOINTS
]
DEEPMIMIC_NUMBERS = {
    # where each joint's numbers start in a frame, and how many they are
    "root": (4, 4),
    "chest": (8, 4),
    "neck": (12, 4),
    "right_hip": (16, 4),
    "right_knee": (20, 1),
    "right_ankle": (21, 4),
    "right_shoulder": (25, 4),
    "right_elbow": (29, 1),
    "left_hip": (30, 4),
    "left_knee": (34, 1),
    "left_ankle": (35, 4),
    "left_shoulder": (39, 4),
    "left_elbow": (43, 1),
}


def cmu_channels(angles: dict[str, tuple[float, float, float]] | None = None, frames: int = 3) -> np.ndarray:
    """Channels of a pose: for each joint its angles in degrees, in the order of its channels."""
    row = np.zeros(sum(map(len, CMU_CHANNELS)))
    for joint, values in (angles or {}).items():
        end = sum(map(len, CMU_CHANNELS[: list(CMU_JOINTS).index(joint) + 1]))
        row[end - 3 : end] = values
    return np.tile(row, (frames, 1))


def euler(rotation: Rotation) -> tuple[float, float, float]:
    """Channels of a joint that turns so."""
    z, x, y = rotation.as_euler("ZXY", degrees=True)
    return z, x, y


def write_cmu(folder: Path, clips: dict[str, np.ndarray]) -> Path:
    """The folder `cmu` with clips as channels."""
    (folder / "cmu" / "clips").mkdir(parents=True)
    names = list(CMU_JOINTS)
    parents = [-1 if parent is None else names.index(parent) for parent, _ in CMU_JOINTS.values()]
    layout = {"joint_names": names, "parents": parents, "channels": CMU_CHANNELS}
    (folder / "cmu" / "skeleton.json").write_text(json.dumps(layout))
    rows = "".join(f'{name},"made up, for a test"\n' for name in clips)
    (folder / "cmu" / "manifest.csv").write_text(f"clip,description\n{rows}")
    offsets = np.array([offset for _, offset in CMU_JOINTS.values()])
    for name, channels in clips.items():
        np.savez(folder / "cmu" / "clips" / f"{name}.npz", channels=channels, offsets=offsets, fps=30.0)
    return folder


def deepmimic_frames(values: dict[str, list[float]] | None = None, frames: int = 3) -> np.ndarray:
    """Frames in which all joints rest but those that are given, as quaternions (w, x, y, z) or hinge angles (rad)."""
    row = np.zeros(44)
    row[0] = 1 / 30
    for start, numbers in DEEPMIMIC_NUMBERS.values():
        row[start] = 1.0 if numbers == 4 else 0.0
    for joint, given in (values or {}).items():
        start, numbers = DEEPMIMIC_NUMBERS[joint]
        row[start : start + numbers] = given
    return np.tile(row, (frames, 1))


def random_deepmimic(rng: np.random.Generator, frames: int) -> np.ndarray:
    """Frames of random poses, every joint turned by up to a radian or so; hinges bend as knees and elbows do."""
    rows = deepmimic_frames(frames=frames)
    for joint, (start, numbers) in DEEPMIMIC_NUMBERS.items():
        if numbers == 4:
            turns = Rotation.from_rotvec(rng.uniform(-0.7, 0.7, (frames, 3)))
            rows[:, start : start + 4] = turns.as_quat()[:, [3, 0, 1, 2]]
        else:
            rows[:, start] = rng.uniform(0.1, 2.0, frames) * (-1 if "knee" in joint else 1)
    return rows


def write_deepmimic(folder: Path, clips: dict[str, np.ndarray]) -> Path:
    """The folder `deepmimic` with clips as frames."""
    (folder / "deepmimic").mkdir(parents=True)
    for name, frames in clips.items():
        text = json.dumps({"Loop": "none", "Frames": frames.tolist()})
        (folder / "deepmimic" / f"humanoid3d_{name}.txt").write_text(text)
    return folder
