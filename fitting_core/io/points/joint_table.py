"""The joints of a motion as a table: their positions and error bars."""

import csv
from pathlib import Path

import numpy as np

from fitting_core.body.model import JOINTS
from fitting_core.files.atomic import replacing
from fitting_core.motion import Motion
from fitting_core.results import error_bars
from fitting_core.results.error_bars import DIRECTIONS, WIDER, ErrorBars

_DECIMALS = 5


def write_joints_csv(path: Path, motion: Motion) -> None:
    """A row for each frame: its number, seconds in the video, x, y and z of the 55 joints in the motion's axes, metres,
    and error bars of the joints that have them; unknown ones are empty. Lines that start with # explain this. Raises
    OSError if the file cannot be written; nothing is left of it."""
    names = [f"{joint}_{axis}" for joint in JOINTS for axis in "xyz"]
    bars = motion.error_bars or ErrorBars.unknown(len(motion))
    names += [f"{joint}_error_bar_{direction}" for joint in error_bars.JOINTS for direction in DIRECTIONS]
    values = np.concatenate([motion.joints().reshape(len(motion), -1), bars.joints.reshape(len(motion), -1)], 1)
    frames = motion.first_frame + np.arange(len(motion))
    with replacing(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        file.write(f"# Joints of {motion.name}, metres. World: {motion.axes_text}.\n")
        file.write(
            "# error_bar: 68 % of errors relative to the pelvis lie within it, along the camera's ray through the "
            f"joint or across it, and 95 % within {WIDER:g} times as much; empty where it is not known.\n"
        )
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["frame", "time_s", *names])
        for frame, row in zip(frames, values, strict=True):
            cells = ["" if np.isnan(value) else f"{value:.{_DECIMALS}f}" for value in row]
            writer.writerow([frame, f"{frame / motion.frame_rate:.6f}", *cells])
