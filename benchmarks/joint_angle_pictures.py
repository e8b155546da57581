"""Draws the axes of the segments, and what each joint does while its angles grow.

python -m benchmarks.joint_angle_pictures docs/images/joint-angles.jpg
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
import tyro
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation
from tyro.conf import Positional

from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.segment_axes import BONES, rest_axes
from fitting_core.camera import Camera
from fitting_core.io.motion.fitted_motion import Motion
from fitting_core.measure.angles.joint_angles import joint_angles
from fitting_core.measure.angles.segments import Segments
from fitting_core.render.renderer import DrawnMesh, Renderer
from fitting_core.render.sheets import Cell, View, beside, sheet
from fitting_core.shipped import FREE_FOLDER

Image = UInt8[np.ndarray, "H W 3"]
_AXES = ((200, 30, 30), (20, 140, 40), (30, 60, 220))
"""Of x, y and z, RGB."""
_ZERO, _POSITIVE = (0.55, 0.72, 0.92), (0.93, 0.6, 0.38)
_FRONT, _RIGHT, _ABOVE = (0.0, 0.0), (-90.0, 0.0), (0.0, 89.0)
"""Degrees around and above."""
_BY_JOINT = {
    # the model's joint that is turned; parent and child; metres across in the picture
    "pelvis": ("pelvis", None, "pelvis", 2.0),
    "lumbar": ("spine2", "pelvis", "thorax", 1.2),
    "neck": ("neck", "thorax", "head", 0.7),
    "hip": ("right_hip", "pelvis", "right_thigh", 1.5),
    "knee": ("right_knee", "right_thigh", "right_shank", 1.2),
    "ankle": ("right_ankle", "right_shank", "right_foot", 0.6),
    "toes": ("right_foot", "right_foot", "right_toes", 0.5),
    "shoulder": ("right_shoulder", "thorax", "right_humerus", 1.5),
    "elbow": ("right_elbow", "right_humerus", "right_forearm", 0.8),
    "wrist": ("right_wrist", "right_forearm", "right_hand", 0.45),
}
_PICTURES = (
    # the angle, the turns about x, y and z in this order of axes, and where one stands
    ("pelvis_tilt", "Z", (-25,), _RIGHT),
    ("pelvis_obliquity", "X", (-15,), _FRONT),
    ("pelvis_rotation", "Y", (35,), _FRONT),
    ("lumbar_extension", "Z", (25,), _RIGHT),
    ("lumbar_bending", "X", (25,), _FRONT),
    ("lumbar_rotation", "Y", (35,), _FRONT),
    ("neck_extension", "Z", (30,), _RIGHT),
    ("neck_bending", "X", (25,), _FRONT),
    ("neck_rotation", "Y", (45,), _FRONT),
    ("hip_flexion", "Z", (50,), _RIGHT),
    ("hip_adduction", "X", (20,), _FRONT),
    ("hip_rotation", "Y", (35,), _FRONT),
    ("knee_flexion", "Z", (-60,), _RIGHT),
    ("knee_adduction", "X", (15,), _FRONT),
    ("knee_rotation", "Y", (30,), _FRONT),
    ("ankle_dorsiflexion", "Z", (25,), _RIGHT),
    ("ankle_inversion", "X", (25,), _FRONT),
    ("ankle_rotation", "Y", (30,), _FRONT),
    ("toes_extension", "Z", (40,), _RIGHT),
    ("shoulder_elevation", "YXY", (45, -60, -45), _FRONT),
    ("shoulder_plane", "YXY", (90, -80, 0), _ABOVE),
    ("shoulder_axial", "YXY", (0, -60, 60), _FRONT),
    ("shoulder_flexion", "Z", (60,), _RIGHT),
    ("shoulder_abduction", "X", (-60,), _FRONT),
    ("elbow_flexion", "Z", (80,), _RIGHT),
    ("elbow_carrying", "X", (-15,), _FRONT),
    ("elbow_pronation", "Y", (90,), _FRONT),
    ("wrist_flexion", "Z", (45,), _RIGHT),
    ("wrist_deviation", "X", (25,), _FRONT),
    ("wrist_rotation", "Y", (30,), _FRONT),
)
_BEFORE = {
    "shoulder_plane": ("YXY", (0, -80, 0)),
    "shoulder_axial": ("YXY", (0, -60, 0)),
}
"""Where an angle has a zero only in a raised arm."""
_CENTERED = ("pelvis", "lumbar", "neck", "ankle", "toes")
"""Joints in the middle of their pictures; of others, the limb is."""
_SIZE = (230, 230)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Where it goes."""

    out: Positional[Path]


def main(options: Options) -> None:
    """Draw and write."""
    body = load_body(find_body(gender="neutral", search=FREE_FOLDER))
    cells = [_angle(body, name, sequence, turns, view) for name, sequence, turns, view in _PICTURES]
    joints = sheet(cells, 6)
    whole = beside([_whole(body, degrees, (joints.shape[1] // 3, 700)) for degrees in (-20.0, -75.0, 35.0)])
    image = cv2.cvtColor(np.concatenate([whole, joints]), cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(options.out), image, [cv2.IMWRITE_JPEG_QUALITY, 82])


def _standing(body: BodyModel, turned: Mapping[str, Rotation]) -> Motion:
    """One frame: anatomically upright, but for the rotations of anatomical frames of these joints."""
    neutral = BodyParams.neutral(1)
    camera = Camera(focal=(500.0, 500.0), center=(320.0, 240.0), size=(640, 480), source="as given")
    motion = Motion(body=body, params=neutral, camera=camera, frame_rate=1.0, name="standing", axes="y-up")
    axes = {name: frames[0] for name, frames in rest_axes(motion.rest_joints.numpy()).items()}
    pose = np.zeros((55, 3))
    named = {name: _BY_JOINT[name][:3] for name in _BY_JOINT}
    left = {
        f"left {name}": tuple(part and part.replace("right", "left") for part in parts)
        for name, parts in named.items()
        if "right" in parts[0]
    }
    for name, (joint, parent, child) in (named | left).items():
        rotation = turned.get(name, Rotation.identity()).as_matrix()
        above = axes["pelvis"] if parent is None else axes[parent]
        pose[JOINT[joint]] = Rotation.from_matrix(above @ rotation @ axes[child].T).as_rotvec()
    params = replace(
        neutral,
        global_orient=torch.as_tensor(pose[:1]),
        body_pose=torch.as_tensor(pose[1:22].reshape(1, -1)),
    )
    return replace(motion, params=params)


def _angle(body: BodyModel, name: str, sequence: str, turns: tuple[float, ...], view: tuple[float, float]) -> Cell:
    """The joint at zero and after the turn, with the axes of the child."""
    joint = name.split("_")[0]
    model_joint, _, child, extent = _BY_JOINT[joint]
    motions = [
        _standing(body, {joint: Rotation.from_euler(letters, angles, degrees=True)})
        for letters, angles in (_BEFORE.get(name, ("Z", (0,))), (sequence, turns))
    ]
    centers = [Segments(motion).joints[0, JOINT[model_joint]] for motion in motions]
    end = Segments(motions[1]).axes[child][0] @ [0, -0.2 * extent, 0] * (joint not in _CENTERED)
    x, y, z = centers[0] + end
    shown = View(center=(x, y, z), extent=extent, degrees=view[0], above=view[1], size=_SIZE)
    zero, positive = (_picture(motion, shown, color) for motion, color in zip(motions, (_ZERO, _POSITIVE), strict=True))
    drawn = (positive < 255).any(-1, keepdims=True)
    image = np.where(drawn, positive // 4 * 3 + zero // 4, zero).astype(np.uint8)
    _draw_axes(image, shown, centers[1], Segments(motions[1]).axes[child][0], 0.16 * extent)
    column = f"right_{name}" if child.startswith("right") else name
    before, after = (float(joint_angles(motion)[column][0]) for motion in motions)
    assert np.nan_to_num(before) + 10 < after, f"{name} does not grow: {before}, {after}"
    return Cell(picture=image, caption=f"{name} {after:+.0f}")


def _whole(body: BodyModel, degrees: float, size: tuple[int, int]) -> Image:
    """All segments with their axes."""
    motion = _standing(
        body,
        {
            side + "shoulder": Rotation.from_euler("X", angle, degrees=True)
            for side, angle in (("", -14), ("left ", 14))
        },
    )
    segments = Segments(motion)
    vertices = next(iter(motion.vertices()))
    x, y, z = (vertices.min(0) + vertices.max(0)) / 2
    view = View(center=(x, y, z), extent=1.16, degrees=degrees, above=8.0, size=size)
    pale = _picture(motion, view, (0.8, 0.83, 0.87))
    image = np.ascontiguousarray(255 - (255 - pale) // 2)
    bones = {"pelvis": "pelvis", "thorax": "spine3", "head": "head"}
    limbs = dict(thigh="hip", shank="knee", foot="ankle", humerus="shoulder", forearm="elbow", hand="wrist")
    bones |= {f"{side}_{name}": f"{side}_{joint}" for side in ("left", "right") for name, joint in limbs.items()}
    for name in BONES:
        if name in bones:
            _draw_axes(image, view, segments.joints[0, JOINT[bones[name]]], segments.axes[name][0], 0.085)
    return image


def _picture(motion: Motion, view: View, color: tuple[float, float, float]) -> Image:
    vertices = next(iter(motion.vertices()))
    surface = DrawnMesh(vertices=view.camera_space(vertices), faces=motion.body.faces, color=color)
    return np.ascontiguousarray(Renderer(view.camera).draw([surface]).over())


def _draw_axes(
    image: Image, view: View, at: Float[np.ndarray, "3"], axes: Float[np.ndarray, "3 3"], length: float
) -> None:
    """Arrows over whatever is in front of them."""
    tips = at + length * axes.T
    start, *ends = [(round(x), round(y)) for x, y in view.pixels(np.vstack([at, tips])).tolist()]
    for axis, end in sorted(enumerate(ends), key=lambda one: -view.camera_space(tips)[one[0], 2]):
        cv2.arrowedLine(image, start, end, _AXES[axis], 2, cv2.LINE_AA, tipLength=0.2)


if __name__ == "__main__":
    main(tyro.cli(Options))
