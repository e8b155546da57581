"""A sheet of pictures for judging the joint limits by eye: each joint at both ends of each of its ranges."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import UInt8
from scipy.spatial.transform import Rotation
from tyro.conf import OmitArgPrefixes, Positional

from benchmarks.report import Common, start
from fitting_core.body.joint_ranges import JointRange, joint_ranges
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, POSE_JOINTS, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.render.renderer import Renderer

ANGLES = ("flexion", "side", "twist")
_SIZE = (150, 190)
_SHOWN_BENT = {"shoulder": "elbow", "elbow": "elbow", "hip": "knee", "knee": "knee"}
"""The joint that is bent by 90 degrees while another one twists, so that the twist can be seen."""


@dataclass(frozen=True, kw_only=True)
class JointLimits:
    """What to draw."""

    out: Positional[Path]
    """The picture to write (PNG)."""
    joints: tuple[str, ...] = ()
    """Names such as left_hip or spine1; by default the trunk's, the left limbs' and left fingers'."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True)
class _Eye:
    """Looks at a place (metres, rest pose's frame) from a direction that a turn about the vertical and a tilt give."""

    center: tuple[float, float, float]
    extent: float
    turn: float
    tilt: float = 0.0

    def draw(self, vertices: np.ndarray, faces: np.ndarray) -> UInt8[np.ndarray, "H W 3"]:
        focal = 8.0 * _SIZE[0]
        to_camera = Rotation.from_euler("yx", (self.turn, 180 + self.tilt), degrees=True)
        placed = to_camera.apply(vertices - self.center) + np.array([0, 0, 8.0 * self.extent])
        camera = Camera(focal=(focal, focal), center=(_SIZE[0] / 2, _SIZE[1] / 2), size=_SIZE)
        return Renderer(camera).render(placed, faces)


_BODY_EYES = (_Eye((0, -0.35, 0), 1.75, 0), _Eye((0, -0.35, 0), 1.75, -70))
_HAND_EYES = (_Eye((0.79, 0.05, 0.06), 0.27, 0, 60), _Eye((0.79, 0.05, 0.06), 0.27, 0, 0))


def _pose(body: BodyModel, ranges: dict[str, JointRange], name: str, angle: str, degrees: float) -> BodyParams:
    """One joint at one angle, its others at the middle of its range, and what makes a twist visible bent."""
    part = name.removeprefix("left_").removeprefix("right_")
    flexion, side = ranges[name].centre
    turned = {name: {"flexion": flexion, "side": side, angle: degrees}}
    if angle == "twist" and part in _SHOWN_BENT:
        turned.setdefault(name.replace(part, _SHOWN_BENT[part]), {})["flexion"] = 90
    pose = torch.zeros(len(JOINT), 3, dtype=torch.float64)
    for joint, angles in turned.items():
        pose[JOINT[joint]] = torch.as_tensor(ranges[joint].rotation(**angles).as_rotvec())
    left, right = pose[JOINT["left_index1"] :].view(2, 1, 45) - torch.as_tensor(body.hand_mean)[:, None]
    neutral = BodyParams.neutral(1, hand_components=45)
    return replace(
        neutral, body_pose=pose[POSE_JOINTS["body_pose"]].reshape(1, 63), left_hand_pose=left, right_hand_pose=right
    )


def _row(mesh: Mesh, ranges: dict[str, JointRange], name: str) -> UInt8[np.ndarray, "H W 3"]:
    """Low and high end of the three ranges, each from two sides."""
    eyes = _HAND_EYES if JOINT[name] >= JOINT["left_index1"] else _BODY_EYES
    cells = []
    for angle, bounds in zip(ANGLES, ranges[name].bounds, strict=True):
        for degrees in bounds:
            vertices = mesh(_pose(mesh.body, ranges, name, angle, degrees))[0].numpy()
            cell = np.concatenate([eye.draw(vertices, mesh.body.faces) for eye in eyes], 1)
            text = f"{name} {angle} {degrees:.0f}"
            cells.append(cv2.putText(cell, text, (4, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1, cv2.LINE_AA))
    return np.concatenate(cells, 1)


def run(options: JointLimits) -> None:
    """Draws the sheet."""
    body = options.common.load_body()
    mesh, ranges = Mesh(body), joint_ranges(body)
    names = options.joints or tuple(name for name in ranges if not name.startswith("right"))
    if unknown := sorted(set(names) - set(ranges)):
        raise InputError(f"No range is known for {', '.join(unknown)}; expected some of {', '.join(ranges)}.")
    sheet = np.concatenate([_row(mesh, ranges, name) for name in names])
    if not cv2.imwrite(str(options.out), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR)):
        raise InputError(f"The picture could not be written to {options.out}; is the folder there, the suffix .png?")


if __name__ == "__main__":
    start(JointLimits, run)
