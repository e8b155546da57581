"""Picks the windows of captured motion that the motion suite is made of, and writes them.

CMU's come from the subjects that the pose prior has never seen. DeepMimic's it has seen: nobody else lies, crawls or
turns cartwheels.
"""

import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Bool, Float
from scipy.ndimage import binary_opening
from scipy.spatial.transform import Rotation, Slerp
from tyro.conf import Positional, arg

from build_assets.motion_capture.collections import HELD_OUT
from build_assets.motion_capture.retarget import MotionClip, load
from evaluation.synthetic.motion_suite.windows import (
    FRAME_RATE,
    MOTION_SUITE,
    MotionWindow,
    acted,
    speeds,
    write_windows,
)
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.model import JOINT
from fitting_core.body.points.positions import joints_in_space
from fitting_core.errors import InputError
from fitting_core.shipped import FREE_FOLDER

PLAN: dict[str, tuple[str, str]] = {
    "dance": ("05_02 05_07 05_09 05_13 05_18", "05_04 05_08 05_10 05_12 05_20"),
    # Directing traffic, drinking, laughing, washing windows.
    "gestures": ("13_26 13_07 13_15 14_05 14_17", "14_12 13_08 13_14 14_18 13_09"),
    # Boxing, jumping jacks and squats, jumps forward and up.
    "sport": ("13_18 13_18 13_30 13_11 13_39", "13_31 13_31 13_31 13_13 13_41"),
    "sit": ("13_01 14_27 14_29 14_31", "14_28 14_30 14_32 14_32"),
    # Walking, steps, ladders.
    "climb": ("05_01 13_33 13_36", "14_33 14_21 13_38"),
    "reach": ("13_10 14_07", "14_08 14_08"),
    "floor": ("crawl crawl getup_faceup getup_faceup", "roll roll getup_facedown getup_facedown"),
    "acrobatics": ("cartwheel backflip", "sideflip spin"),
}
"""Clips by kind of motion, for the tuning half and for the untouched one; a clip named twice gives two windows."""
SECONDS = (2.0, 4.0)
_SHORT = {"backflip": 1.7}
"""Whole clips that are shorter than that."""
_AT_REST = 0.15
"""Metres per second up to which a captured ankle is at rest: standing people sway with 0.02 to 0.1."""
_FEWEST_AT_REST = 4
"""Frames; a foot that turns on the spot does not stand."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Where motion comes from and goes to."""

    data: Annotated[Positional[Path], arg(metavar="FOLDER")]
    """Folder with the motion capture: `cmu` (BVH channels) and `deepmimic`."""
    out: Path = MOTION_SUITE
    """The file to write."""


def main(options: Options) -> None:
    """Load, pick, write, and say what slides."""
    windows = picked(load(options.data))
    write_windows(options.out, windows)
    body = load_body(find_body(search=FREE_FOLDER))
    slips = []
    for window in windows:
        ankles = joints_in_space(body, acted(window, body, (0.0,) * 10))[:, [JOINT["left_ankle"], JOINT["right_ankle"]]]
        found = slip(ankles, window.standing, FRAME_RATE)
        slips.append(np.nan if found is None else found)
        print(
            f"{window.name:18} {window.kind:10} {window.half:10} {len(window) / FRAME_RATE:.1f} s, at rest "
            f"{100 * window.standing.mean():3.0f} %, slip {slips[-1]:4.0f} mm/s"
        )
    median, most = np.nanmedian(slips), np.nanmax(slips)
    print(f"{len(windows)} windows, {sum(map(len, windows))} frames, {options.out.stat().st_size / 1e6:.2f} MB")
    print(f"slip of feet at rest on the neutral body: median {median:.0f} mm/s, at most {most:.0f}")


def picked(clips: list[MotionClip]) -> list[MotionWindow]:
    """The windows of PLAN.

    Raises:
        InputError: A clip is missing, belongs to a subject that is trained on, or is too short.
    """
    by_name = {clip.name: clip for clip in clips}
    windows = []
    for kind, halves in PLAN.items():
        for half, names in zip(("tuning", "untouched"), halves, strict=True):
            wanted = names.split()
            for name in dict.fromkeys(wanted):
                clip = by_name.get(name)
                if clip is None or not (clip.source == "deepmimic" or clip.subject in HELD_OUT):
                    raise InputError(f"The motion suite needs the clip {name}, which is missing. Copy it there.")
                windows += _windows(clip, kind, half, wanted.count(name))
    return windows


def _windows(clip: MotionClip, kind: str, half: str, count: int) -> list[MotionWindow]:
    """Windows of one clip: its liveliest one, then those that lie furthest from the others."""
    rng = np.random.default_rng([int.from_bytes(clip.name.encode()[-6:]), count])
    stretch = _longest(clip)
    moving = _resampled(clip, stretch)
    limit = _SHORT.get(clip.name, SECONDS[0])
    found: list[MotionWindow] = []
    starts: list[int] = []
    pose, pelvis, feet = moving
    for number in range(count):
        length = min(len(pose), round(rng.uniform(max(limit, SECONDS[0]), SECONDS[1]) * FRAME_RATE))
        if length < limit * FRAME_RATE:
            raise InputError(f"{clip.name}: its longest stretch has {length / FRAME_RATE:.1f} s, expected {limit}.")
        start = _start(pose, length, starts)
        starts.append(start)
        part = slice(start, start + length)
        found.append(
            MotionWindow(
                name=f"{clip.name}_{number + 1}",
                clip=clip.name,
                kind=kind,
                half=half,
                standing=at_rest(feet)[part],
                **dict(zip(("pose", "pelvis"), _facing(pose[part], pelvis[part] / clip.leg), strict=True)),
            )
        )
    return found


def _longest(clip: MotionClip) -> slice:
    """The longest stretch without a dropped frame."""
    cuts = [0, *(np.flatnonzero(np.diff(clip.frames) > 1) + 1), len(clip.frames)]
    return max((slice(a, b) for a, b in pairwise(cuts)), key=lambda s: s.stop - s.start)


def _resampled(clip: MotionClip, part: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pose (T, 22, 3), pelvis (T, 3) and ankles (T, 2, 3) at the suite's frame rate."""
    orient, pelvis, feet = clip.orient[part], clip.pelvis[part], clip.feet[part]
    body = clip.body_pose[part].reshape(len(orient), -1, 3)
    rotations = np.concatenate([Rotation.from_matrix(orient).as_rotvec()[:, None], body], 1)
    times = np.arange(len(orient)) / clip.fps
    wanted = np.arange(int(times[-1] * FRAME_RATE + 1e-6) + 1) / FRAME_RATE
    wanted = np.minimum(wanted, times[-1])
    joints = [Slerp(times, Rotation.from_rotvec(joint))(wanted).as_rotvec() for joint in rotations.transpose(1, 0, 2)]
    places = np.concatenate([pelvis, feet.reshape(len(feet), -1)], 1)
    moved = np.stack([np.interp(wanted, times, column) for column in places.T], 1)
    return np.stack(joints, 1), moved[:, :3], moved[:, 3:].reshape(-1, 2, 3)


def _start(pose: Float[np.ndarray, "T 22 3"], length: int, taken: list[int]) -> int:
    """Where the next window begins."""
    last = len(pose) - length
    if taken:
        return max(range(last + 1), key=lambda start: min(abs(start - other) for other in taken))
    change = np.linalg.norm(np.diff(pose[:, 1:], axis=0), axis=-1).sum(1)
    lively = np.convolve(np.concatenate([[0.0], change]), np.ones(length), "valid")
    return int(lively.argmax())


def slip(ankles: Float[np.ndarray, "T 2 3"], standing: Bool[np.ndarray, "T 2"], frame_rate: float) -> float | None:
    """Mean speed of feet that rest, mm/s; None where none does. Metres, of a world or a camera that stands."""
    return float(1e3 * speeds(ankles, frame_rate)[standing].mean()) if standing.any() else None


def at_rest(feet: Float[np.ndarray, "T 2 3"]) -> Bool[np.ndarray, "T 2"]:
    """Which captured feet do not move, for some frames at least."""
    return binary_opening(speeds(feet, FRAME_RATE) < _AT_REST, np.ones((_FEWEST_AT_REST, 1)))


def _facing(pose: Float[np.ndarray, "T 22 3"], pelvis: Float[np.ndarray, "T 3"]) -> tuple[np.ndarray, np.ndarray]:
    """The same motion turned and moved so that it faces +z on average, about x = z = 0.

    Who lies or crawls faces where the head is.
    """
    root = Rotation.from_rotvec(pose[:, 0])
    forward = root.apply([0.0, 1.0, 1.0]).mean(0)
    turn = Rotation.from_euler("y", -np.arctan2(forward[0], forward[2]))
    turned = np.concatenate([(turn * root).as_rotvec()[:, None], pose[:, 1:]], 1)
    return turned, turn.apply(pelvis - pelvis.mean(0) * (1, 0, 1))


if __name__ == "__main__":
    try:
        main(tyro.cli(Options, description=__doc__))
    except InputError as error:
        sys.exit(str(error))
