"""Malformed camera files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fitting_core.io.cameras.reading import CameraFile, read_camera
from tests.fitting_core.io.cameras import camera_files as files
from tests.fitting_core.io.cameras.camera_files import DISTORTION, ROTATION, SIZE, K
from tests.fitting_core.io.malformed import Bomb, Case, content, directory


def _case(make: Callable[[Path], Path], says: str, **more: Any) -> Case:
    return Case(make, lambda path: read_camera(CameraFile(path=path, **more), SIZE), says)


def _own(**more: Any) -> Callable[[Path], Path]:
    return lambda folder: files.own(folder / "camera.npz", **more)


def _objects(folder: Path) -> Path:
    np.savez(folder / "camera.npz", K=np.array([Bomb()], dtype=object))
    return folder / "camera.npz"


def _changed(write: Callable[[Path], Path], name: str, old: str, new: str) -> Callable[[Path], Path]:
    """A file of which a text is another one."""

    def make(folder: Path) -> Path:
        path = write(folder / name)
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))
        return path

    return make


def _cut(write: Callable[[Path], Path], name: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = write(folder / name)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        return path

    return make


def _colmap(file: str, text: str | None, **more: Any) -> Callable[[Path], Path]:
    """A COLMAP model with another text in one of its files, or without it."""

    def make(folder: Path) -> Path:
        model = files.colmap(folder / "model", **more)
        (model / file).unlink() if text is None else (model / file).write_text(text)
        return model

    return make


def _binary(folder: Path) -> Path:
    (folder / "model").mkdir()
    (folder / "model" / "cameras.bin").write_bytes(bytes(100))
    return folder / "model"


def _one(path: Path) -> Path:
    return files.pose2sim(path, names=("cam",))


_LINE = "1 PINHOLE 1280 720 900 910 640 360\n"
_EXPANDING = (
    '<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "1111111111"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    "<opencv_storage><camera_matrix>&b;</camera_matrix></opencv_storage>"
)
CAMERAS: dict[str, Case] = {
    "camera not there": _case(lambda folder: folder / "camera.npz", "does not exist"),
    "camera is a folder": _case(directory("camera.npz"), "cameras.txt"),
    "camera is a text": _case(content("camera.txt", "900"), "no camera file by its name"),
    "camera npz cut off": _case(_cut(files.own, "camera.npz"), "damaged|npz"),
    "camera npz is empty": _case(content("camera.npz", b""), "npz"),
    "camera npz of objects": _case(_objects, "Python objects"),
    "camera npz without K": _case(_own(K=None), "no camera matrix K"),
    "camera K of 2 x 3": _case(_own(K=np.ones((2, 3))), "6 numbers, expected 9"),
    "camera K of texts": _case(_own(K=[["a"] * 3] * 3), "no array of numbers"),
    "camera K transposed": _case(_own(K=K.T), "camera matrix"),
    "camera K with a NaN": _case(_own(K=K * np.nan), "not finite"),
    "camera K of a negative focal length": _case(_own(K=np.diag([-900.0, 900, 1])), "above 0"),
    "camera K in millimetres": _case(_own(K=[[26.0, 0, 18], [0, 26, 12], [0, 0, 1]]), "sees 175 degrees"),
    "camera K with skew": _case(_own(K=K + np.eye(3, k=1) * (0, 90, 0)), "skew"),
    "camera centre far outside": _case(_own(K=[[900, 0, 9000], [0, 900, 360], [0, 0, 1]]), "principal point"),
    "camera of three coefficients": _case(_own(dist=DISTORTION[:3]), "3 distortion coefficients"),
    "camera of a tilted sensor": _case(_own(dist=[*[0.01] * 14]), "tilted"),
    "camera coefficients that fold": _case(_own(dist=(-5.0, 0, 0, 0)), "fold"),
    "camera of infinite coefficients": _case(_own(dist=(np.inf, 0, 0, 0)), "not finite"),
    "camera R that is no rotation": _case(_own(R=2 * ROTATION), "R R.T"),
    "camera R that mirrors": _case(_own(R=-ROTATION), "mirrors"),
    "camera R of 2 x 2": _case(_own(R=np.eye(2)), "4 numbers"),
    "camera R without t": _case(_own(t=None), "no translation"),
    "camera t of two": _case(_own(t=(1, 2)), "2 numbers, expected 3"),
    "camera that moves": _case(_own(R=[ROTATION] * 9, t=np.zeros((9, 3))), "one that moves"),
    "camera names without rows": _case(_own(names=["a", "b"]), "2 names"),
    "camera up is north": _case(_own(up="north"), "up is 'north'"),
    "camera of another shape": _case(_own(size=(1280, 1024)), "another shape"),
    "camera of a turned image": _case(_own(size=(720, 1280)), "turned by a quarter"),
    "camera of half a pixel": _case(_own(size=(1280.5, 720)), "whole pixels"),
    "camera toml cut off": _case(_cut(_one, "Calib.toml"), "TOML"),
    "camera toml of settings": _case(content("Calib.toml", "[pose]\nmodel = 'x'\n"), "no camera matrix"),
    "camera toml of a fisheye": _case(_changed(_one, "Calib.toml", "fisheye = false", "fisheye = true"), "fisheye"),
    "camera toml ragged": _case(_changed(_one, "Calib.toml", "[[", "[[7.0], ["), "rows of different lengths"),
    "camera toml of two": _case(
        lambda f: files.pose2sim(f / "Calib.toml"), r"2 cameras \(int_cam01_img, int_cam02_img\)"
    ),
    "camera toml of no such name": _case(lambda f: _one(f / "Calib.toml"), "'side'; it has cam", name="side"),
    "camera toml is binary": _case(content("Calib.toml", b"\xff\xfe\x00\x81"), "UTF-8"),
    "camera yaml cut off": _case(_cut(files.opencv, "camera.yml"), "YAML|matrix"),
    "camera yaml of tabs": _case(content("camera.yml", "%YAML:1.0\n---\na:\n\t- b\n\t\t:"), "YAML"),
    "camera yaml that builds objects": _case(
        content("camera.yaml", '!!python/object/apply:os.system ["touch unpickled"]\n'), "YAML|matrix"
    ),
    "camera yaml of too few numbers": _case(
        _changed(files.opencv, "camera.yml", "rows: 3", "rows: 4"), "with 9 numbers"
    ),
    "camera yaml of a fisheye": _case(_changed(files.ros, "camera.yaml", "plumb_bob", "equidistant"), "equidistant"),
    "camera xml cut off": _case(_cut(files.opencv, "camera.xml"), "XML|matrix"),
    "camera xml that expands": _case(content("camera.xml", _EXPANDING), "XML|numbers|matrix"),
    "camera json cut off": _case(_cut(files.plain_json, "camera.json"), "JSON"),
    "camera json of a list": _case(content("camera.json", "[1, 2]"), "no camera matrix"),
    "camera json nested": _case(content("camera.json", '{"a":' * 50_000), "JSON"),
    "camera json of a table": _case(
        content("camera.json", json.dumps({"camera_matrix": {"data": 5, "rows": 3}})), "matrix without data"
    ),
    "colmap binary": _case(_binary, "model_converter"),
    "colmap fisheye": _case(_colmap("images.txt", None, model="OPENCV_FISHEYE"), "OPENCV_FISHEYE"),
    "colmap unknown model": _case(_colmap("cameras.txt", "1 PLENOPTIC 1280 720 900\n"), "PLENOPTIC"),
    "colmap too few parameters": _case(_colmap("cameras.txt", _LINE.replace(" 360", "")), "3 parameters, expected 4"),
    "colmap text for a number": _case(_colmap("cameras.txt", _LINE.replace("910", "wide")), "line 1.*wide"),
    "colmap short line": _case(_colmap("cameras.txt", "1 PINHOLE\n"), "line 1: has 2 entries"),
    "colmap of no camera": _case(_colmap("cameras.txt", "# nothing\n"), "of camera 1"),
    "colmap of no image": _case(_colmap("images.txt", "# nothing\n"), "has no camera"),
    "colmap image without a name": _case(_colmap("images.txt", "1 1 0 0 0 0 0 0 1\n"), "line 1: has 9 entries"),
    "colmap quaternion of zeros": _case(_colmap("images.txt", "1 0 0 0 0 0 0 0 1 a.jpg\n"), "quaternion"),
    "colmap of two images": _case(_colmap("cameras.txt", _LINE, images=("a", "b")), r"2 cameras \(a, b\)"),
}
