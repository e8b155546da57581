"""Calibration files as the programs write them, all of one camera: K, distortion, R and t below."""

import json
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from fitting_core.files.npz import write_npz

SIZE = (1280, 720)
K = np.array([[894.5288733, 0.0, 624.0117915], [0.0, 896.8778118, 361.281898436], [0.0, 0.0, 1.0]])
DISTORTION = (-0.2383569013, 0.09672714757, -0.00135122267, 0.00315576032, -0.003748934632)
VECTOR = np.array([1.678784562972848, 1.031972654261743, -0.3910235872501538])
ROTATION = Rotation.from_rotvec(VECTOR).as_matrix()
TRANSLATION = np.array([0.2609476905995074, 0.9641586618892432, 2.932963441842366])


def pose2sim(path: Path, *, names: tuple[str, ...] = ("int_cam01_img", "int_cam02_img")) -> Path:
    """As Pose2Sim's Calib_scene.toml; cameras after the first stand a metre farther each."""
    sections = [
        f'[{name}]\nname = "{name}"\nsize = [ {SIZE[0]}.0, {SIZE[1]}.0]\nmatrix = {K.tolist()}\n'
        f"distortions = {list(DISTORTION[:4])}\nrotation = {VECTOR.tolist()}\n"
        f"translation = {(TRANSLATION + i).tolist()}\nfisheye = false\n"
        for i, name in enumerate(names)
    ]
    path.write_text("\n".join([*sections, "[metadata]\nadjusted = false\nerror = 0.0\n"]))
    return path


def caliscope(path: Path) -> Path:
    """As caliscope's camera_array.toml: a table of cameras by number, the rotation as a matrix."""
    sections = [
        f"[cameras.{i}]\ncam_id = {i}\nrotation_count = 0\nerror = 0.19\nexposure = -7.0\ngrid_count = 24\n"
        f"ignore = false\nsize = {list(SIZE)}\nmatrix = {K.tolist()}\ndistortions = {list(DISTORTION)}\n"
        f"translation = {(TRANSLATION + i).tolist()}\nrotation = {ROTATION.tolist()}\n"
        for i in range(2)
    ]
    path.write_text("\n".join(sections))
    return path


def opencv(path: Path, *, world: bool = True) -> Path:
    """As OpenCV's own writer makes it, in the form of the suffix, with the keys of its calibration sample."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Wed May 23 14:21:16 2018")
    storage.write("image_width", SIZE[0])
    storage.write("image_height", SIZE[1])
    storage.write("flags", 0)
    storage.write("camera_matrix", K)
    storage.write("distortion_coefficients", np.array([DISTORTION]))
    storage.write("avg_reprojection_error", 0.65)
    if world:
        storage.write("R", ROTATION)
        storage.write("T", TRANSLATION[:, None])
    storage.release()
    return path


def ros(path: Path) -> Path:
    """As ROS's camera_info: matrices without types, comments, no header."""
    path.write_text(
        f"# made by camera_calibration\nimage_width: {SIZE[0]}\nimage_height: {SIZE[1]}\ncamera_name: head_camera\n"
        f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: {K.ravel().tolist()}\ndistortion_model: plumb_bob\n"
        f"distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: {list(DISTORTION)}\n"
        f"rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"
    )
    return path


def plain_json(path: Path) -> Path:
    """As Python programs write it: lists, with some other spellings."""
    text = {
        "cameraMatrix": K.tolist(),
        "dist_coeffs": [list(DISTORTION)],
        "image_size": list(SIZE),
        "rvec": VECTOR[:, None].tolist(),
        "tvec": TRANSLATION.tolist(),
    }
    path.write_text(json.dumps(text))
    return path


COLMAP_PARAMETERS = {
    "SIMPLE_PINHOLE": "900 640.5 360.25",
    "PINHOLE": "900 910 640.5 360.25",
    "SIMPLE_RADIAL": "900 640.5 360.25 -0.1",
    "RADIAL": "900 640.5 360.25 -0.1 0.02",
    "OPENCV": "900 910 640.5 360.25 -0.1 0.02 0.001 -0.002",
    "FULL_OPENCV": "900 910 640.5 360.25 -0.1 0.02 0.001 -0.002 0.003 0.01 0.02 0.003",
}


def colmap(folder: Path, *, model: str = "OPENCV", images: tuple[str, ...] = ("walk_0001.jpg",)) -> Path:
    """As COLMAP's text export; the images' points are a line, or an empty one."""
    folder.mkdir(exist_ok=True)
    (folder / "cameras.txt").write_text(
        "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
        f"# Number of cameras: 1\n1 {model} {SIZE[0]} {SIZE[1]} {COLMAP_PARAMETERS.get(model, '1 2 3 4')}\n"
    )
    x, y, z, w = Rotation.from_matrix(ROTATION).as_quat().tolist()
    lines = ["# Image list with two lines of data per image:"]
    for i, name in enumerate(images):
        tx, ty, tz = (TRANSLATION + i).tolist()
        lines.append(f"{i + 1} {w!r} {x!r} {y!r} {z!r} {tx!r} {ty!r} {tz!r} 1 {name}")
        lines.append("" if i % 2 else "2362.39 248.498 58396 1784.7 268.254 59027 1784.7 268.254 -1")
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    return folder


def own(path: Path, **more: object) -> Path:
    """tcfit's npz; arrays of `more` are added, take the place of others, or (None) leave them out."""
    arrays = {"K": K, "dist": DISTORTION, "size": SIZE, "R": ROTATION, "t": TRANSLATION, **more}
    write_npz(path, {name: np.asarray(value) for name, value in arrays.items() if value is not None})
    return path


TURNS = (
    Rotation.from_rotvec(VECTOR) * Rotation.from_rotvec(np.linspace(0, 0.4, 8)[:, None] * [0.1, 1.0, 0.3])
).as_matrix()
"""Of a camera that moves: x_camera = turn (x_world - place)."""
WAY = (
    np.array([0.3, -0.2, 1.4])
    + np.linspace(0, 1, 8)[:, None] * [0.6, 0.1, -0.2]
    + 0.02 * np.sin(np.arange(24.0).reshape(8, 3))
)
"""Its places in the world."""


def moving_npz(path: Path, turns: np.ndarray = TURNS, way: np.ndarray = WAY, **more: object) -> Path:
    """tcfit's npz with a pose for each frame; arrays of `more` as in `own`."""
    return own(path, **{"R": turns, "t": -np.einsum("tij,tj->ti", turns, way), **more})


def moving_colmap(path: Path) -> Path:
    """COLMAP's text export of a video's frames, in no order."""
    folder = colmap(path.with_suffix(""), model="PINHOLE")
    lines = []
    for i in np.random.default_rng(0).permutation(len(TURNS)).tolist():
        x, y, z, w = Rotation.from_matrix(TURNS[i]).as_quat().tolist()
        tx, ty, tz = (-TURNS[i] @ WAY[i]).tolist()
        lines += [f"{i + 1} {w!r} {x!r} {y!r} {z!r} {tx!r} {ty!r} {tz!r} 1 frame_{i + 1:04}.png", ""]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    return folder


def transforms(
    path: Path, turns: np.ndarray = TURNS, way: np.ndarray = WAY, *, names: list[str] | None = None, **more: object
) -> Path:
    """transforms.json as ns-process-data writes it; keys of `more` are added or take the place of others."""
    frames = []
    for i, (turn, place) in enumerate(zip(turns, way, strict=True)):
        to_world = np.eye(4)
        to_world[:3, :3], to_world[:3, 3] = turn.T @ np.diag([1.0, -1.0, -1.0]), place
        name = names[i] if names else f"images/frame_{i + 1:05}.png"
        frames.append({"file_path": name, "transform_matrix": to_world.tolist(), "colmap_im_id": i + 1})
    intrinsics = {
        **{"w": SIZE[0], "h": SIZE[1], "fl_x": 894.5, "fl_y": 896.9, "cx": 624.0, "cy": 361.3},
        **{"k1": -0.05, "k2": 0.01, "p1": 0.0, "p2": 0.001, "camera_model": "OPENCV"},
    }
    path.write_text(json.dumps(intrinsics | {"frames": frames, "applied_transform": np.eye(4)[:3].tolist()} | more))
    return path
