"""Malformed camera files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fitting_core.frame_alignment import Timeline
from fitting_core.io.cameras.moving import ClipFrames
from fitting_core.io.cameras.reading import CameraFile, read_camera
from tests.fitting_core.io.cameras import camera_files as files
from tests.fitting_core.io.cameras.camera_files import DISTORTION, ROTATION, SIZE, TURNS, WAY, K
from tests.fitting_core.io.malformed import Bomb, Case, content, directory

_FRAMES = ClipFrames(timeline=Timeline(numbers=range(len(TURNS))), part=slice(0, len(TURNS)), frame_rate=5.0)
"""Of the clip that a camera which moves is read for."""


def _case(make: Callable[[Path], Path], says: str, **more: Any) -> Case:
    return Case(make, lambda path: read_camera(CameraFile(path=path, **more), SIZE, _FRAMES), says)


def _moving(**more: Any) -> Callable[[Path], Path]:
    return lambda folder: files.moving_npz(folder / "camera.npz", **more)


def _transforms(**more: Any) -> Callable[[Path], Path]:
    return lambda folder: files.transforms(folder / "transforms.json", **more)


def _with_a_frame(**more: Any) -> Callable[[Path], Path]:
    """A transforms.json of which one frame says something else; what is None is missing there."""

    def make(folder: Path) -> Path:
        path = files.transforms(folder / "transforms.json")
        table = json.loads(path.read_text())
        frame = table["frames"][3] | more
        table["frames"][3] = {key: value for key, value in frame.items() if value is not None}
        path.write_text(json.dumps(table))
        return path

    return make


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
    "camera is a text": _case(content("camera.txt", "900"), "not a known kind of camera file"),
    "camera npz cut off": _case(_cut(files.own, "camera.npz"), "damaged|npz"),
    "camera npz is empty": _case(content("camera.npz", b""), "npz"),
    "camera npz of objects": _case(_objects, "Python objects"),
    "camera npz without K": _case(_own(K=None), "no camera matrix K"),
    "camera K of 2 x 3": _case(_own(K=np.ones((2, 3))), "6 numbers, expected 9"),
    "camera K of texts": _case(_own(K=[["a"] * 3] * 3), "not an array of numbers"),
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
    "path of too few frames": _case(_own(R=TURNS[:5], t=WAY[:5]), "5 poses.*the clip has 8 frames"),
    "path of fewer turns": _case(_own(R=TURNS[:5], t=WAY), "8 rows of t and 5 of R"),
    "path without turns": _case(_own(R=None, t=WAY), "8 rows of t and 0 of R"),
    "path with one turn": _case(_own(R=ROTATION, t=WAY), "8 rows of t and 3 of R"),
    "path of a pose that is none": _case(
        _moving(R=[*TURNS[:7], 2 * TURNS[7]]), "row 7 of R and t: .*invalid rotation .R R"
    ),
    "path with a NaN": _case(_moving(t=np.where(np.arange(24).reshape(8, 3) == 10, np.nan, WAY)), "row 3 .*not finite"),
    "path of a zoom": _case(_moving(K=[K * (1 + i) for i in range(8)]), "a zooming one"),
    "several K, one pose": _case(_own(K=[K] * 4), "a zooming one"),
    "path of frames in fractions": _case(_moving(frames=np.arange(8) / 2), "8 whole numbers"),
    "path of too few numbers": _case(_moving(frames=[1, 2]), "8 whole numbers"),
    "path of other frames": _case(_moving(frames=np.arange(8) + 100), "none of frames 0 to 7"),
    "path of frames twice": _case(_moving(frames=[0, 1, 2, 3, 4, 5, 6, 6]), "several poses for one frame"),
    "path that begins late": _case(_moving(frames=np.arange(8) + 2), "no pose for frames 0-1 .* 2 and 7"),
    "path with a hole": _case(
        lambda f: files.moving_npz(f / "camera.npz", TURNS[:2], WAY[:2], frames=[0, 7]), "no pose for frames 1-6"
    ),
    "transforms cut off": _case(_cut(files.transforms, "transforms.json"), "JSON"),
    "transforms without a focal length": _case(_transforms(fl_x=None), "neither fl_x"),
    "transforms of a half turn": _case(_transforms(fl_x=None, camera_angle_x=4.0), "camera_angle_x of 4"),
    "transforms of a text": _case(_transforms(fl_x="wide"), "fl_x is not an array of numbers"),
    "transforms of a fisheye": _case(_transforms(camera_model="OPENCV_FISHEYE"), "OPENCV_FISHEYE"),
    "transforms of k4": _case(_transforms(k4=0.1), "k4"),
    "transforms without a centre": _case(_transforms(cx=None, w=None), "no principal point"),
    "transforms of a zoom": _case(_with_a_frame(fl_x=800.0), "a zooming lens"),
    "transforms without a pose": _case(_with_a_frame(transform_matrix=None), "number 3 of its list"),
    "transforms without a name": _case(_with_a_frame(file_path=None), "number 3 of its list"),
    "transforms of a short matrix": _case(_with_a_frame(transform_matrix=[[1.0, 0], [0, 1]]), "4 numbers, expected 16"),
    "transforms of a ragged matrix": _case(_with_a_frame(transform_matrix=[[1.0, 0], [0]]), "different lengths"),
    "transforms of a scaled pose": _case(
        _with_a_frame(transform_matrix=(2 * np.eye(4)).tolist()), "frame_00004.*invalid rotation"
    ),
    "transforms of a mirrored pose": _case(
        _with_a_frame(transform_matrix=np.diag([-1.0, 1, 1, 1]).tolist()), "frame_00004.*mirrors"
    ),
    "transforms of unnumbered images": _case(_transforms(names=list("abcdefgh")), "names do not say which frames"),
    "transforms of one image twice": _case(_transforms(names=["a1", "a1", *(f"a{i}" for i in range(2, 8))]), "several"),
    "camera names without rows": _case(_own(names=["a", "b"]), "2 names"),
    "camera up is north": _case(_own(up="north"), "up is 'north'"),
    "camera of another shape": _case(_own(size=(1280, 1024)), "another shape"),
    "camera of a turned image": _case(_own(size=(720, 1280)), "rotated by 90 degrees"),
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
    "camera toml of a key of 60 kB": _case(content("Calib.toml", "a" + ".a" * 30_000 + " = 1"), "more than 32 parts"),
    "camera toml of a quoted key": _case(
        content("Calib.toml", "[b]\n'a' " + '. "a"' * 9000 + " = 1"), "line 2 has a key"
    ),
    "camera toml of brackets": _case(content("Calib.toml", "a = " + "[" * 50_000), "nested too deeply"),
    "camera yaml of brackets": _case(
        content("camera.yml", "%YAML:1.0\n---\na: " + "[" * 50_000), "nested more than 256"
    ),
    "camera yaml of braces": _case(content("camera.yaml", "a: " + "{a: " * 50_000), "nested more than 256"),
    "camera yaml of dashes": _case(content("camera.yml", "a:\n" + "- " * 50_000 + "1"), "line 2 is nested too deeply"),
    "camera yaml of dashes behind a key": _case(
        content("camera.yml", "a: " + "- " * 50_000 + "1"), "line 1 is nested too deeply"
    ),
    "camera yaml of steps": _case(
        content("camera.yml", "".join(" " * k + "a:\n" for k in range(2000))), "line 257 is nested too deeply"
    ),
    "camera xml of tags": _case(
        content("camera.xml", '<?xml version="1.0"?><opencv_storage>' + "<a>" * 30_000), "nested more than 256 deep"
    ),
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
    "colmap of two images": _case(_colmap("cameras.txt", _LINE, images=("a", "b")), r"2 cameras \(a, b\), whose names"),
    "colmap of a few frames": _case(
        _colmap("cameras.txt", _LINE, images=("a0.jpg", "a1.jpg")), "no pose for frames 2-7"
    ),
}
