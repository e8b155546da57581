"""Malformed files of every format: what is broken, what reads it, and what is to be said about it."""

import io
import json
import os
import pickle
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fitting_core.io import read_detections
from fitting_core.io.keypoints.pose_binary import Component, PoseFile, write_pose_file
from fitting_core.io.keypoints.pose_file import openpose_components


@dataclass(frozen=True)
class Case:
    """A broken file."""

    make: Callable[[Path], Path]
    """Writes it into a folder; what is to be read."""
    read: Callable[[Path], Any]
    says: str
    """What the error says, as a regular expression."""
    name: str = ""
    """Of the file that the error must name; by default that of what was read."""


def content(name: str, data: bytes | str) -> Callable[[Path], Path]:
    """A file with this content."""

    def make(folder: Path) -> Path:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
        return path

    return make


def directory(name: str) -> Callable[[Path], Path]:
    """A folder where a file is expected."""

    def make(folder: Path) -> Path:
        (folder / name).mkdir()
        return folder / name

    return make


class Bomb:
    """Runs a command when it is unpickled freely."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, ("touch unpickled",)


PICKLE_BOMB = pickle.dumps({"poses": Bomb(), "v_template": Bomb()}, protocol=2)
FAR_MEMO = b"\x80\x02}r\xff\xff\xff\x7f."
"""An empty dictionary, which asks the unpickler for a table of 32 GB."""
_ENDLESS = b"K\x00K\x00\x86" + b"2\x86" * 60
"""A tuple that holds itself 2^60 times."""
HOSTILE: dict[str, tuple[bytes, str]] = {
    "a key that is hashed for ever": (b"\x80\x04}(" + _ENDLESS + b"Nu.", "an entry under a tuple, expected names"),
    "a key of the old kind that is hashed for ever": (
        b"(" + _ENDLESS + b"Nd.",
        "an entry under a tuple, expected names",
    ),
    "a key of many tuples": (b"\x80\x04}(" + b")" + b"\x85" * 10**5 + b"Nu.", "an entry under a tuple"),
    "a key of an ordered dictionary": (
        b"\x80\x02ccollections\nOrderedDict\n(](" + _ENDLESS + b"N\x86etR.",
        "an entry under a tuple",
    ),
    "a set that is hashed for ever": (b"\x80\x04}\x8c\x01a\x8f(" + _ENDLESS + b"\x90s.", "has no|holds a dict of a"),
    "a frozen set that is hashed for ever": (b"\x80\x04}\x8c\x01a(" + _ENDLESS + b"\x91s.", "has no|holds a dict of a"),
    "a dictionary whose methods are others": (
        b"\x80\x04\x8c\x0bcollections\x8c\x0bOrderedDict\x93)R}\x8c\x05items\x8c\x05numpy\x8c\x07ndarray\x93sb.",
        "has no|holds a dict of nothing|is no result",
    ),
    "more objects than the memory holds": (
        b"\x80\x04}\x8c\x01a](" + b"]" * (2**23) + b"es.",
        "holds more than 8388608 objects, expected those of a clip",
    ),
}
"""Pickles that would keep an unpickler for ever or end the process, and what is said of them."""


def doubling(key: str) -> bytes:
    """A pickle of 200 bytes whose list has 2^40 elements."""
    values: list[Any] = [0.0, 0.0]
    for _ in range(40):
        values = [values, values]
    return pickle.dumps({key: values}, protocol=2)


def npz(**arrays: Any) -> bytes:
    """The bytes of an archive."""
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def endless_npz(key: str, *others: str) -> bytes:
    """An archive of 200 bytes whose array says that it has 8 TB; nothing is in the others."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    return zipped({f"{key}.npy": header.getvalue()} | {f"{other}.npy": b"" for other in others})


def zip_bomb(key: str, *others: str) -> bytes:
    """An archive of 4 MB that unpacks to 4 GB, of which the zip's table tells; nothing is in the others."""
    raw = io.BytesIO()
    with zipfile.ZipFile(raw, "w", zipfile.ZIP_DEFLATED) as archive:
        for other in others:
            archive.writestr(f"{other}.npy", b"")
        archive.writestr(f"{key}.npy", bytes(1000))
    data = bytearray(raw.getvalue())
    at = data.rindex(b"PK\x01\x02") + 24  # the uncompressed size in the central directory
    data[at : at + 4] = struct.pack("<I", 2**32 - 2)
    return bytes(data)


def zipped(members: dict[str, bytes]) -> bytes:
    """A zip of these members."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return file.getvalue()


# --- keypoints ---

OPENPOSE = "walk_000000000007_keypoints.json"
_BODY = [float(v) for k in range(25) for v in (k, 2 * k, 0.5)]


def _person(**lists: Any) -> str:
    return json.dumps({"people": [{"pose_keypoints_2d": _BODY, **lists}]})


def _body_with(place: int, value: Any) -> str:
    return _person(pose_keypoints_2d=[value if k == place else v for k, v in enumerate(_BODY)])


def openpose(data: bytes | str, says: str) -> Case:
    """A folder with one broken file among the OpenPose JSON."""

    def make(folder: Path) -> Path:
        content(f"keypoints/{OPENPOSE}", data)(folder)
        content("keypoints/walk_000000000008_keypoints.json", _person())(folder)
        return folder / "keypoints"

    return Case(make, read_detections, says, OPENPOSE)


KEYPOINTS: dict[str, Case] = {
    "openpose truncated": openpose(_person()[:-9], "not readable as JSON .* cut off"),
    "openpose empty": openpose(b"", "not readable as JSON"),
    "openpose wrong encoding": openpose(_person().encode("utf-16"), "not readable as JSON .*decode"),
    "openpose nested": openpose("[" * 100_000, "not readable as JSON .*recursion"),
    "openpose 9000 digits": openpose(_body_with(3, 7).replace(" 7,", "9" * 9000 + ",", 1), "not readable as JSON"),
    "openpose 74 numbers": openpose(_person(pose_keypoints_2d=_BODY[:-1]), r"found 74 values; expected 75"),
    "openpose NaN": openpose(_body_with(12, float("nan")), r"right_wrist .*position \(nan"),
    "openpose huge": openpose(_body_with(12, 1e300), r"right_wrist .*position \(1e\+300.*up to 1e\+06"),
    "openpose negative confidence": openpose(_body_with(14, -0.1), r"right_wrist .*confidence -0.1; expected 0 "),
    "openpose people null": openpose('{"people": null}', "expected an object with a list 'people'"),
    "openpose person a list": openpose('{"people": [[1, 2]]}', "person 0 is a list; expected an object"),
    "openpose person without lists": openpose('{"people": [{"person_id": [-1]}]}', "person 0 has no list of keypoints"),
    "openpose text for a number": openpose(_body_with(12, "14"), "right_wrist .*found '14'; expected a number"),
    "openpose a number for a list": openpose(_person(pose_keypoints_2d=5), "found .*5.*expected a list"),
    "openpose not there": Case(lambda folder: folder / "a_keypoints.json", read_detections, "no such file"),
    "openpose hand of 20": openpose(_person(hand_left_keypoints_2d=[1.0] * 60), "found 60 values; expected 63"),
    "openpose another object": openpose('{"annotations": []}', "is not OpenPose JSON: found an object with annot"),
    "openpose a folder for a file": Case(
        lambda f: directory(f"keypoints/{OPENPOSE}")(f) if (f / "keypoints").mkdir() is None else f,
        lambda path: read_detections(path.parent),
        "is a folder, expected a file",
    ),
    "openpose nothing in the folder": Case(directory("keypoints"), read_detections, "found an empty folder"),
    "no keypoints at all": Case(lambda f: f / "gone", read_detections, "there is no such file or folder"),
    "an unknown text": Case(content("clip.csv", "x,y\n1,2\n"), read_detections, "starts as none of these"),
    "an empty file": Case(content("clip.json", b""), read_detections, "it is empty. Expected a folder of OpenPose"),
}

_WHOLE = [float(v) for k in range(133) for v in (k, 2 * k, 0.5)]


def _annotations(**entry: Any) -> dict[str, Any]:
    images = [{"id": 5, "file_name": "walk_0005.jpg", "width": 640, "height": 480}]
    return {"images": images, "annotations": [{"image_id": 5, "keypoints": _WHOLE, **entry}]}


def coco(value: Any, says: str) -> Case:
    """A broken COCO-WholeBody JSON."""
    data = value if isinstance(value, bytes | str) else json.dumps(value)
    return Case(content("clip.json", data), read_detections, says)


def _whole_with(place: int, value: Any) -> list[Any]:
    return [value if k == place else v for k, v in enumerate(_WHOLE)]


_TWICE = [{"id": 1, "file_name": "a/0001.jpg"}, {"id": 2, "file_name": "b/0001.jpg"}]
KEYPOINTS |= {
    "coco truncated": coco(json.dumps(_annotations())[:-20], "not readable as JSON"),
    "coco nested": coco('{"images": ' + "[" * 100_000, "not readable as JSON"),
    "coco wrong encoding": coco(b'{"images": [], "annotations": "\xff\xfe"}', "not readable as JSON .*decode"),
    "coco without annotations": coco({"images": []}, "found an object with images; expected 'images' and 'annot"),
    "coco without images": coco({"images": [], "annotations": []}, "'images' is empty"),
    "coco body only of 18": coco(_annotations(keypoints=_WHOLE[:54]), "annotation 0, keypoints: found 18 points"),
    "coco 398 numbers": coco(_annotations(keypoints=_WHOLE[:-1]), "found 398 values; expected 3 for each"),
    "coco hand of 20": coco(
        _annotations(keypoints=_WHOLE[:51], lefthand_kpts=_WHOLE[:60]), "lefthand_kpts: found 20 points; expected 21"
    ),
    "coco text in a hand": coco(
        _annotations(keypoints=_WHOLE[:51], lefthand_kpts=[*_WHOLE[:12], "x", *_WHOLE[13:63]]),
        r"left_thumb4 .lefthand_kpts.: found 'x'; expected a number",
    ),
    "coco NaN": coco(_annotations(keypoints=_whole_with(30, float("nan"))), r"right_.*position \(nan"),
    "coco huge": coco(_annotations(keypoints=_whole_with(0, 10**400)), r"nose: found position \(inf"),
    "coco negative confidence": coco(_annotations(keypoints=_whole_with(2, -1)), "nose: found confidence -1"),
    "coco percent": coco(_annotations(keypoints=_whole_with(2, 87.5)), "nose: found confidence 87.5"),
    "coco text for a number": coco(_annotations(keypoints=_whole_with(2, "1")), "nose .*: found '1'; expected a num"),
    "coco image that is not there": coco(_annotations(image_id=9), "is of the image 9, which 'images' does not have"),
    "coco two images of a name": coco({"images": _TWICE, "annotations": []}, "two images are called '0001'"),
    "coco results of mixed ids": coco(
        [{"image_id": 1, "keypoints": _WHOLE}, {"image_id": "a.jpg", "keypoints": _WHOLE}], "some are names"
    ),
    "coco person is a list": coco([{"image_id": 1}, [1, 2]], "result 1 is a list; expected an object"),
    "mmpose scores missing": coco(
        {"instance_info": [{"frame_id": 1, "instances": [{"keypoints": [[0, 1]] * 133, "keypoint_scores": [1] * 9}]}]},
        "keypoint_scores: found 9 values; expected one for each of 133",
    ),
    "mmpose a frame twice": coco(
        {"instance_info": [{"frame_id": 1, "instances": []}, {"frame_id": 1, "instances": []}]}, "frame_id 1; expected"
    ),
    "mmpose frames without instances": coco([{"instances": []}, {"frame_id": 7}], "frame 7, person: found null"),
    "mmpose several frames in a file of a folder": Case(
        lambda f: content("walk/1.json", json.dumps([{"frame_id": k, "instances": []} for k in (0, 1)]))(f).parent,
        read_detections,
        "holds 2 frames; expected one per file in a folder",
        "1.json",
    ),
}


def _pose_bytes(folder: Path, *, x: float = 5.0, sure: float = 0.5, **changed: Any) -> bytes:
    components, places = openpose_components()
    data, confidence = np.full((3, 1, len(places), 2), 5.0), np.full((3, 1, len(places)), 0.5)
    data[1, 0, 4, 0], confidence[1, 0, 4] = x, sure
    fields = {"components": components, "size": (640, 480), "frame_rate": 25.0}
    fields |= {"data": data, "confidence": confidence}
    write_pose_file(folder / "scratch", PoseFile(**{**fields, **changed}))
    written = (folder / "scratch").read_bytes()
    (folder / "scratch").unlink()
    return written


def pose(says: str, change: Callable[[bytes], bytes] = lambda data: data, **changed: Any) -> Case:
    """A broken .pose file: written with what was changed, its bytes then changed."""
    return Case(lambda f: content("clip.pose", change(_pose_bytes(f, **changed)))(f), read_detections, says)


_OTHER = Component(name="HEAD", points=("a", "b"))
KEYPOINTS |= {
    "pose empty": Case(content("clip.pose", b""), read_detections, "ends within its version, after 0 bytes"),
    "pose truncated header": pose("ends within .* it is cut off", lambda data: data[:300]),
    "pose truncated points": pose("3 frames of 1 people, which take 4932 bytes, but 4931 follow", lambda d: d[:-1]),
    "pose with more behind it": pose("but 4940 follow", lambda data: data + bytes(8)),
    "pose of version 7": pose("version 7, expected 0.1 or 0.2", lambda data: struct.pack("<f", 7) + data[4:]),
    "pose is a text": Case(content("clip.pose", "no pose " * 9), read_detections, "starts with the version"),
    "pose without components": pose("has no components", lambda data: data[:10] + bytes(2) + data[12:]),
    "pose of other components": pose(
        "has the components HEAD of 2 points; expected those of OpenPose",
        components=(_OTHER,),
        data=np.zeros((3, 1, 2, 2)),
        confidence=np.zeros((3, 1, 2)),
    ),
    "pose of a wrong format": pose(
        "component 0 has the format 'ZC', expected XYC", lambda data: data.replace(b"\x03\x00XYC", b"\x02\x00ZC", 1)
    ),
    "pose names in latin-1": pose("is not UTF-8 text", lambda data: data.replace(b"Nose", b"N\xf6se", 1)),
    "pose NaN": pose(r"frame 1, person 0, right_wrist: found position \(nan", x=float("nan")),
    "pose huge": pose(r"right_wrist: found position \(1e\+30", x=1e30),
    "pose negative confidence": pose("right_wrist: found confidence -0.5", sure=-0.5),
    "pose frame rate NaN": pose("has nan frames per second", frame_rate=float("nan")),
    "pose of a thousand million frames": pose(
        "has 1000000000 frames of 0 people",
        lambda data: data[: -(3 * 137 * 12 + 10)] + struct.pack("<fIH", 25, 10**9, 0),
    ),
    "pose in a folder's place": Case(directory("clip.pose"), read_detections, "found an empty folder"),
}
