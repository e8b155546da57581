"""How right joint angles are: fits of the motion suite against the truth, in degrees.

A joint counts in frames in which it and its neighbours along the limb are in the image, and both angles are determined.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Bool, Float
from tyro.conf import OmitArgPrefixes, arg

from benchmarks.report import Common, Row, progress, report, start
from evaluation.suite_runs import fitted_body
from evaluation.synthetic.motion_suite.clips import MotionClipMade, make_motion, motion_sequences
from fitting_core.body.model import JOINT
from fitting_core.io.result_files import read_fit
from fitting_core.measure.angles.joint_angles import joint_angles
from fitting_core.motion import Motion

_ANGLES = {
    # By angle: the joints that are in the image. Captured knees are hinges, so nothing is told of their turning.
    "lumbar_extension": ("left_hip", "right_hip", "neck"),
    "hip_flexion": ("hip", "knee"),
    "hip_adduction": ("hip", "knee"),
    "hip_rotation": ("hip", "knee", "ankle"),
    "knee_flexion": ("hip", "knee", "ankle"),
    "ankle_dorsiflexion": ("knee", "ankle", "foot"),
    "shoulder_elevation": ("neck", "shoulder", "elbow"),
    "shoulder_plane": ("neck", "shoulder", "elbow"),
    "shoulder_axial": ("shoulder", "elbow", "wrist"),
    "elbow_flexion": ("shoulder", "elbow", "wrist"),
}


@dataclass(frozen=True, kw_only=True)
class AngleOptions:
    """What to measure."""

    fits: Annotated[Path, arg(metavar="FOLDER")]
    """Fits of `python -m evaluation motion`: its folder fits/<focal>/<preset>."""
    half: Literal["tuning", "untouched"] = "untouched"
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """One angle of one side in one sequence."""

    angle: str
    cut: str
    error: Float[np.ndarray, "n"]
    """Degrees in the frames that count."""
    true: Float[np.ndarray, "n"]


def run(options: AngleOptions) -> None:
    """Measures, and prints the tables."""
    courses: list[Course] = []
    for name, sequence in motion_sequences().items():
        if sequence.half == options.half:
            progress(name)
            courses += _of_sequence(make_motion(sequence), options.fits)
    cuts = {"whole body in the image": ("whole",), "all": ("whole", "knee", "hip", "chest")}
    report(
        options,
        {
            title: [_row(angle, [c for c in courses if c.angle == angle and c.cut in cut]) for angle in _ANGLES]
            for title, cut in cuts.items()
        },
    )


def _of_sequence(made: MotionClipMade, fits: Path) -> list[Course]:
    stored = read_fit(fits / made.sequence.name)
    found, true = (
        joint_angles(Motion(body=body, params=params, camera=made.clip.camera, frame_rate=30.0, name=made.clip.name))
        for body, params in ((fitted_body(), stored.params), (made.body, made.truth.params))
    )
    courses = []
    for angle, joints in _ANGLES.items():
        for side in ("left_", "right_") if f"left_{angle}" in true else ("",):
            seen = _inside(made, [name if name in JOINT else f"{side}{name}" for name in joints])
            error = (found[f"{side}{angle}"] - true[f"{side}{angle}"] + 180) % 360 - 180
            counts = seen & np.isfinite(error)
            if counts.any():
                one = {"error": error[counts], "true": true[f"{side}{angle}"][counts]}
                courses.append(Course(angle=angle, cut=made.sequence.shot.cut, **one))
    return courses


def _inside(made: MotionClipMade, names: Sequence[str]) -> Bool[np.ndarray, "T"]:
    return np.asarray(made.inside[:, [JOINT[name] for name in names]].all(1))


def _row(angle: str, courses: Sequence[Course]) -> Row:
    """Means over all frames; the course is what is left when each clip's own mean error is taken away."""
    if not courses:
        return {"": angle}
    errors = np.concatenate([course.error for course in courses])
    shapes = np.concatenate([course.error - course.error.mean() for course in courses])
    spread = np.concatenate([course.true - course.true.mean() for course in courses])
    return {
        "": angle,
        "frames": str(len(errors)),
        "RMS, °": _rms(errors),
        "median, °": float(np.median(abs(errors))),
        "mean with its sign, °": float(errors.mean()),
        "RMS of the course, °": _rms(shapes),
        "true movement, RMS °": _rms(spread),
    }


def _rms(values: Float[np.ndarray, "n"]) -> float:
    return float(np.sqrt((values**2).mean()))


if __name__ == "__main__":
    start(AngleOptions, run)
