"""transforms.json, as written by Nerfstudio, Instant NGP and Blender add-ons: one camera, with a pose for each image.

docs.nerf.studio/quickstart/data_conventions.html: intrinsics fl_x, fl_y, cx, cy, w, h and OpenCV's k1, k2, k3, p1, p2
for all images, or camera_angle_x (radians) in place of a focal length; and `frames`, each with file_path and
transform_matrix, from camera space (OpenGL's: x right, y up, z back) into the world.
"""

import math
from typing import Any

import numpy as np

from fitting_core.io.cameras.calibration import Calibration, calibration, finite_numbers, pose_of
from fitting_core.io.cameras.moving import Poses

_MODELS = ("", "OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
_INTRINSICS = ("fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "k2", "k3", "k4", "p1", "p2", "camera_angle_x")
_FROM_OPENGL = np.diag([1.0, -1.0, -1.0])


def is_transforms(table: Any) -> bool:
    """Whether a JSON text is one of these."""
    frames = table.get("frames") if isinstance(table, dict) else None
    return isinstance(frames, list) and any(isinstance(f, dict) and "transform_matrix" in f for f in frames)


def read_transforms(table: dict[str, Any]) -> list[Calibration]:
    """The camera. Raises ValueError if a part of it is missing or unusable."""
    frames = table["frames"]
    for place, frame in enumerate(frames):
        if not (isinstance(frame, dict) and {"file_path", "transform_matrix"} <= set(frame)):
            raise ValueError(f"has a frame (number {place} of its list) without file_path or transform_matrix")
    known = [{name: f.get(name, table.get(name)) for name in _INTRINSICS} for f in frames]
    if any(other != known[0] for other in known):
        raise ValueError(
            "has intrinsics that differ between images, as of a zooming lens; expected one camera of one focal length"
        )
    poses = [_pose(str(frame["file_path"]), frame["transform_matrix"]) for frame in frames]
    return [
        _camera(
            table,
            known[0],
            Poses(
                rotation=np.stack([rotation for rotation, _ in poses]),
                translation=np.stack([translation for _, translation in poses]),
                names=tuple(str(frame["file_path"]) for frame in frames),
            ),
        )
    ]


def _camera(table: dict[str, Any], known: dict[str, Any], poses: Poses) -> Calibration:
    model = str(table.get("camera_model") or "")
    if model not in _MODELS or table.get("is_fisheye"):
        raise ValueError(
            f"has a lens of the model {model or 'fisheye'}; expected {', '.join(filter(None, _MODELS))}. Undistort the "
            "images, and write the file for those"
        )
    if known["k4"]:
        raise ValueError("has a coefficient k4 of a fisheye lens; expected k1, k2, k3, p1, p2 of OpenCV's")
    size = None if known["w"] is None or known["h"] is None else (known["w"], known["h"])
    fx, fy = _focal(known)
    if None in (known["cx"], known["cy"]) and size is None:
        raise ValueError("has no principal point (cx, cy) and no image size (w, h); expected either")
    center = [known[c] if known[c] is not None else finite_numbers(s, known[s], 1)[0] / 2 for c, s in _CENTERS]
    return calibration(
        "",
        matrix=[[fx, 0, center[0]], [0, fy, center[1]], [0, 0, 1]],
        distortion=[known[name] or 0.0 for name in ("k1", "k2", "p1", "p2", "k3")],
        size=size,
        poses=poses,
        has_unit=False,
    )


_CENTERS = (("cx", "w"), ("cy", "h"))


def _focal(known: dict[str, Any]) -> tuple[float, float]:
    if known["fl_x"] is not None:
        fx = finite_numbers("fl_x", known["fl_x"], 1)[0]
        return fx, fx if known["fl_y"] is None else finite_numbers("fl_y", known["fl_y"], 1)[0]
    if known["camera_angle_x"] is None or known["w"] is None:
        raise ValueError("has neither fl_x nor both camera_angle_x and w; expected a focal length in pixels")
    angle, width = (finite_numbers(name, known[name], 1)[0] for name in ("camera_angle_x", "w"))
    if not 0 < angle < math.pi:
        raise ValueError(f"has a camera_angle_x of {angle:g}; expected radians between 0 and pi")
    fx = width / 2 / math.tan(angle / 2)
    return fx, fx


def _pose(name: str, matrix: Any) -> tuple[np.ndarray, np.ndarray]:
    """x_camera = rotation x_world + translation, in OpenCV's axes."""
    try:
        values = finite_numbers("transform_matrix", matrix)
        if len(values) not in (12, 16):
            raise ValueError(f"transform_matrix has {len(values)} numbers, expected 16")
        to_world = values.reshape(-1, 4)
        turn = (to_world[:3, :3] @ _FROM_OPENGL).T
        return pose_of(turn, -turn @ to_world[:3, 3])
    except ValueError as error:
        raise ValueError(f"frame {name}: {error}") from error
