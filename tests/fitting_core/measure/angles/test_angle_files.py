"""Files of joint angles: the table, and the motion for OpenSim, played on the chain of its model."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.body.markers.joint_centres import joint_centres_in_space
from fitting_core.body.model import BodyModel
from fitting_core.measure.angles.angle_files import write_angles_csv, write_mot
from fitting_core.measure.angles.joint_angles import ANGLES, Segments, joint_angles
from fitting_core.measure.limbs import HIPS
from fitting_core.results.error_bars import ANGLES as BARRED
from tests.fitting_core.io.motion.motions import swinging
from tests.fitting_core.measure.angles.anatomy import posed, turned

X, Y, Z = np.eye(3)
WRITTEN = 1e-5
"""Degrees: six decimals in the file, and in the axes below."""
LEG = "hip_flexion hip_adduction hip_rotation knee_angle knee_angle#beta ankle_angle subtalar_angle mtp_angle".split()
ARM = "arm_flex arm_add arm_rot elbow_flex pro_sup wrist_flex wrist_dev".split()


def of_side(name: str, side: str) -> str:
    return name.replace("#", f"_{side}_") if "#" in name else f"{name}_{side}"


RAJAGOPAL = [
    *"pelvis_tilt pelvis_list pelvis_rotation pelvis_tx pelvis_ty pelvis_tz".split(),
    *(of_side(name, "r") for name in LEG),
    *(of_side(name, "l") for name in LEG),
    *"lumbar_extension lumbar_bending lumbar_rotation".split(),
    *(of_side(name, "r") for name in ARM),
    *(of_side(name, "l") for name in ARM),
]
"""The coordinates of Rajagopal2015.osim."""
CHAIN = {
    # body: its parent, and the axes of its coordinates in the parent, right and left, as they stand in the model
    "femur": ("pelvis", {"hip_flexion": (Z, Z), "hip_adduction": (X, -X), "hip_rotation": (Y, -Y)}),
    "tibia": ("femur", {"knee_angle": (-Z, -Z)}),
    "talus": ("tibia", {"ankle_angle": ((-0.105014, -0.174022, 0.979126), (0.105014, 0.174022, 0.979126))}),
    "calcn": ("talus", {"subtalar_angle": ((0.787180, 0.604747, -0.120949), (-0.787180, -0.604747, -0.120949))}),
    "toes": ("calcn", {"mtp_angle": ((0.580954, 0.0, -0.813936), (-0.580954, 0.0, -0.813936))}),
    "humerus": ("torso", {"arm_flex": (Z, Z), "arm_add": (X, -X), "arm_rot": (Y, -Y)}),
    "ulna": ("humerus", {"elbow_flex": ((0.226047, 0.022269, 0.973862), (-0.226047, -0.022269, 0.973862))}),
    "radius": ("ulna", {"pro_sup": ((0.056398, 0.998406, 0.001952), (-0.056398, -0.998406, 0.001952))}),
    "hand": ("radius", {"wrist_flex": (Z, Z), "wrist_dev": (X, -X)}),
}
"""The knee without what it turns and tilts by itself."""
AROUND = float(np.arctan2(0.226047, 0.973862))
"""Radians by which the elbow's axis is turned about the upper arm, 13 degrees."""
SEGMENTS = {"femur": "thigh", "tibia": "shank", "calcn": "foot", "toes": "toes", "humerus": "humerus", "hand": "hand"}


def read_mot(path: Path) -> tuple[list[str], dict[str, np.ndarray]]:
    """Header, and columns by name."""
    lines = path.read_text(encoding="utf-8").splitlines()
    start = lines.index("endheader") + 1
    rows = np.array([[float(value) for value in line.split("\t")] for line in lines[start + 1 :]])
    return lines[:start], dict(zip(lines[start].split("\t"), rows.T, strict=True))


def played(columns: dict[str, np.ndarray], side: str) -> dict[str, np.ndarray]:
    """Rotations of the model's bodies in its world, from the coordinates alone, turn after turn."""
    index = "rl".index(side)

    def turn(name: str, axis: np.ndarray) -> np.ndarray:
        return Rotation.from_rotvec(np.radians(columns[name])[:, None] * np.array(axis)).as_matrix()

    bodies = {"pelvis": turn("pelvis_tilt", Z) @ turn("pelvis_list", X) @ turn("pelvis_rotation", Y)}
    back = turn("lumbar_extension", Z) @ turn("lumbar_bending", X) @ turn("lumbar_rotation", Y)
    bodies["torso"] = bodies["pelvis"] @ back
    for body, (parent, coordinates) in CHAIN.items():
        bodies[body] = bodies[parent]
        for name, axes in coordinates.items():
            bodies[body] = bodies[body] @ turn(f"{name}_{side}", axes[index])
    return bodies


def degrees_between(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.degrees(Rotation.from_matrix(np.swapaxes(one, 1, 2) @ other).magnitude()).max())


def test_the_table(free_body: BodyModel, tmp_path: Path):
    arms = [turned("X", -angle) for angle in (0, 40, 88)]
    motion = posed(free_body, {"right_shoulder": arms})
    write_angles_csv(tmp_path / "angles.csv", motion)
    lines = (tmp_path / "angles.csv").read_text(encoding="utf-8").splitlines()
    comments = [line for line in lines if line.startswith("# ")]
    assert lines[: len(comments)] == comments
    assert any("ISB" in line for line in comments) and any("knee_flexion: shank goes backward" in c for c in comments)
    assert any("y up" in line and "the camera stands at the origin" in line for line in comments)
    rows = list(csv.DictReader(lines[len(comments) :]))
    assert list(rows[0]) == ["frame", "time_s", *ANGLES, *(f"{name}_error_bar" for name in BARRED)]
    assert {row["left_knee_flexion_error_bar"] for row in rows} == {""}, "not known of this motion"
    assert [row["frame"] for row in rows] == ["0", "1", "2"] and float(rows[2]["time_s"]) == pytest.approx(2 / 50)
    assert [row["right_shoulder_plane"] for row in rows] == ["", "0.0000", "0.0000"]
    assert rows[2]["right_shoulder_flexion"] == ""
    for name, values in joint_angles(motion).items():
        read = [float(row[name]) if row[name] else np.nan for row in rows]
        assert np.allclose(read, values, atol=6e-5, equal_nan=True)


def test_time_is_that_of_the_video(free_body: BodyModel, tmp_path: Path):
    motion = swinging(free_body, 3)
    write_angles_csv(tmp_path / "angles.csv", motion)
    write_mot(tmp_path / "walk.mot", motion)
    rows = [line.split(",") for line in (tmp_path / "angles.csv").read_text().splitlines() if line[0] not in "#f"]
    header, columns = read_mot(tmp_path / "walk.mot")
    assert [row[0] for row in rows] == ["12", "13", "14"]
    assert np.allclose([float(row[1]) for row in rows], columns["time"], atol=1e-6)
    assert np.allclose(columns["time"], np.array([12, 13, 14]) / 29.97, atol=1e-6)
    assert {"inDegrees=yes", "nRows=3", f"nColumns={len(RAJAGOPAL) + 1}"} <= set(header)
    assert list(columns) == ["time", *RAJAGOPAL]
    said = [line for line in header if "=" in line]
    assert {line.split("=")[0] for line in said} == {"version", "nRows", "nColumns", "inDegrees"}, "OpenSim reads those"


@pytest.mark.parametrize("side", ["r", "l"])
def test_the_model_that_plays_it_moves_as_the_fit(free_body: BodyModel, tmp_path: Path, side: str):
    """Its own chain of axes, played from the file, against the fit's segments."""
    motion = swinging(free_body, 30).in_axes("y-up")
    write_mot(tmp_path / "swing.mot", motion)
    header, columns = read_mot(tmp_path / "swing.mot")
    assert any(line.startswith("World: y up; x, where the pelvis mostly faces, is along x ") for line in header)
    world = np.eye(3)  # which is y-up's own
    own = Segments(motion)
    long_side = {"r": "right", "l": "left"}[side]
    fit = {body: world @ own.axes[f"{long_side}_{segment}"] for body, segment in SEGMENTS.items()}
    fit |= {"pelvis": world @ own.axes["pelvis"], "torso": world @ own.axes["thorax"]}
    model = played(columns, side)
    for body in ("pelvis", "torso", "femur"):
        assert degrees_between(model[body], fit[body]) < WRITTEN, body
    elbow = Rotation.from_rotvec([0, AROUND if side == "r" else -AROUND, 0]).as_matrix()
    assert degrees_between(model["humerus"] @ elbow, fit["humerus"]) < WRITTEN, "so that the elbows' axes coincide"
    knees = np.degrees(np.arccos(np.clip((model["tibia"][:, :, 1] * fit["tibia"][:, :, 1]).sum(1), -1, 1)))
    adduction = joint_angles(motion)[f"{long_side}_knee_adduction"]
    assert np.allclose(knees, abs(adduction), atol=WRITTEN), "what a hinge has no angle for, and nothing else"
    hips = joint_centres_in_space(motion.body, motion.params)[:, HIPS].mean(1) @ world.T
    place = np.stack([columns[f"pelvis_t{axis}"] for axis in "xyz"], -1)
    assert np.allclose(place + model["pelvis"] @ [-0.056276, -0.07849, 0.0], hips, atol=2e-6)
    assert all(abs(np.diff(values)).max() < 90 for values in columns.values()), "no jumps"
