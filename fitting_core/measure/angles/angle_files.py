"""Joint angles as files: a table for statistics, and a motion for OpenSim."""

from pathlib import Path

import numpy as np

from fitting_core.files.atomic import replacing
from fitting_core.io.points.tables import write_frames_csv
from fitting_core.measure.angles.cardan import SINGULAR
from fitting_core.measure.angles.joint_angles import ANATOMICAL_JOINTS, ANGLES, UNSEEN, joint_angles
from fitting_core.measure.angles.opensim import LOCKED, opensim_coordinates
from fitting_core.motion import Motion
from fitting_core.results.error_bars import ANGLES as BARRED
from fitting_core.results.error_bars import WIDER, ErrorBars


def write_angles_csv(path: Path, motion: Motion) -> None:
    """A row for each frame: its number, seconds in the video, ANGLES in degrees, and the error bars of some of them;
    empty where not determined.

    The lines before the names begin with # and state the conventions.

    Raises:
        OSError: The file cannot be written; nothing is left of it.
    """
    columns, bars = joint_angles(motion), motion.error_bars or ErrorBars.unknown(len(motion))
    columns |= {f"{name}_error_bar": values for name, values in zip(BARRED, bars.angles.T, strict=True)}
    write_frames_csv(path, motion, _conventions(motion), columns, digits=4)


def _conventions(motion: Motion) -> list[str]:
    upright = motion.in_axes("y-up")
    lines = [
        f"Joint angles of {motion.name}, degrees; {len(motion)} frames at {motion.frame_rate:g} frames per second.",
        "Segment axes by the ISB (Wu et al. 2002, 2005; Grood & Suntay 1983): x forward, y up, z to the right, of a "
        "person who stands upright with hanging arms and palms forward, where all angles are 0.",
        f"The world y-up, for pelvis and thorax: {upright.axes_text}.",
        "Body-fixed sequences: "
        + "; ".join(
            f"{joint.name} {'-'.join(joint.sequence)} ({joint.child} in {joint.parent or 'the world'})"
            for joint in ANATOMICAL_JOINTS
        )
        + "; shoulder_flexion and shoulder_abduction are projections on the thorax' planes.",
        "Left and right have the same signs. Positive: ",
    ]
    lines += [f"  {name.removeprefix('right_')}: {text}" for name, text in ANGLES.items() if "left_" not in name]
    lines += [
        f"Empty: not determined. The first and third angle of a sequence within {SINGULAR:g} degrees of where their "
        f"axes coincide; shoulder_flexion and shoulder_abduction within {UNSEEN:g} degrees of the plane's normal.",
        "Angles run on over time without jumps of 360 degrees.",
        f"error_bar: 68 % of errors lie within it and 95 % within {WIDER:g} times as much; empty where not known.",
    ]
    return lines


def write_mot(path: Path, motion: Motion) -> None:
    """The motion for OpenSim's model `Rajagopal2015.osim`, see `opensim`: seconds in the video, degrees, metres. Raises
    OSError if the file cannot be written; nothing is left of it."""
    columns, world = opensim_coordinates(motion)
    times = (motion.first_frame + np.arange(len(motion))) / motion.frame_rate
    upright = motion.in_axes("y-up")
    header = [
        motion.name.replace("\n", " "),
        "version=1",
        f"nRows={len(motion)}",
        f"nColumns={len(columns) + 1}",
        "inDegrees=yes",
        "",
        "Coordinates of OpenSim's Rajagopal2015.osim, degrees and metres, by its own axes and signs.",
        f"World: y up; x, where the pelvis mostly faces, is {world.forward} of the world y-up.",
        f"The world y-up: {upright.axes_text.replace('=', ':')}.",
        f"The model holds {', '.join(LOCKED)} still until they are unlocked.",
        "endheader",
        "\t".join(["time", *columns]),
    ]
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(header) + "\n")
        for time, values in zip(times, np.stack(list(columns.values()), -1), strict=True):
            file.write("\t".join([f"{time:.6f}", *(f"{value:.6f}" for value in values)]) + "\n")
