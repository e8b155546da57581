"""Malformed results of learned systems: pickles that ask for code, files that are cut off, declare too much, or lie."""

import gzip
import io
import os
import pickle
import struct
import subprocess
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fitting_core.io import read_motion
from tests.fitting_core.io.malformed import FAR_MEMO, HOSTILE, Bomb, Case, content, doubling, zipped
from tests.fitting_core.io.motion.learned_files import (
    gvhmr,
    joblib_bytes,
    phalp,
    prompthmr,
    torch_bytes,
    truth,
    wham,
    zlib_packed,
)

FRAMES = np.arange(5)
_PERSON = {1: (truth(), FRAMES)}
_NAN = np.full((5, 3), np.nan, np.float32)


class Reduced:
    """Pickles as a call.

    Args:
        function: What is called when it is unpickled freely.
        arguments: With what.
    """

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        self._call = (function, arguments)

    def __reduce__(self) -> Any:
        return self._call


class Stated:
    """Pickles as a call whose result then gets a state."""

    def __reduce__(self) -> Any:
        return np.dtype, ("f4",), {"__class__": Bomb()}


_CODE: dict[str, Any] = {
    "os.system": Bomb(),
    "eval": Reduced(eval, "open('unpickled', 'w')"),
    "exec": Reduced(exec, "open('unpickled', 'w')"),
    "open": Reduced(open, "unpickled", "w"),
    "getattr": Reduced(getattr, "a", "join"),
    "subprocess": Reduced(subprocess.Popen, ["touch", "unpickled"]),
    "partial": partial(os.system, "touch unpickled"),
    "torch.load": Reduced(torch.load, "unpickled"),
    "torch.hub": Reduced(torch.hub.load, "a/b", "c"),
    "np.load": Reduced(np.load, "unpickled.npy"),
    "state": Stated(),
    "path": Path("unpickled"),
}
_WRITERS: dict[str, tuple[str, Callable[[Any], bytes]]] = {
    "joblib": ("wham_output.pkl", joblib_bytes),
    "pickle": ("plain.pkl", partial(pickle.dumps, protocol=4)),
    "torch": ("hmr4d_results.pt", torch_bytes),
    "torch of before 1.6": ("old.pth", partial(torch_bytes, _use_new_zipfile_serialization=False)),
    "packed": ("packed.pkl", lambda value: zlib.compress(joblib_bytes(value))),
}


def case(name: str, data: bytes, says: str) -> Case:
    """A file that is broken."""
    return Case(content(name, data), read_motion, says)


LEARNED: dict[str, Case] = {
    f"{writer} asks for {code}": case(name, write({"a": np.zeros(3), "pose": _CODE[code]}), "asks for .*could run code")
    for writer, (name, write) in _WRITERS.items()
    for code in (_CODE if writer in ("joblib", "torch") else ("os.system", "eval", "torch.load"))
}


def of_wham(says: str, **changed: Any) -> Case:
    """WHAM's with other values."""
    return case("wham_output.pkl", joblib_bytes(wham(_PERSON, **changed)), says)


def of_gvhmr(says: str, incam: dict[str, Any] | None = None, **changed: Any) -> Case:
    """GVHMR's with other values."""
    return case("hmr4d_results.pt", torch_bytes(gvhmr(truth(), incam=incam or {}, **changed)), says)


def of_phalp(says: str, **changed: Any) -> Case:
    """PHALP's with other values."""
    return case("demo_walk.pkl", joblib_bytes(phalp(_PERSON, **changed)), says)


def of_prompthmr(says: str, **changed: Any) -> Case:
    """PromptHMR's with other values."""
    return case("results.pkl", joblib_bytes(prompthmr(_PERSON) | changed), says)


def _torch_with(replaced: dict[str, bytes | None]) -> bytes:
    """GVHMR's zip with other members, None: without."""
    with zipfile.ZipFile(io.BytesIO(torch_bytes(gvhmr(truth())))) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    ends = {name: next((data for part, data in replaced.items() if part in name), members[name]) for name in members}
    return zipped({name: data for name, data in ends.items() if data is not None})


_JOBLIB = joblib_bytes(wham(_PERSON))
_TORCH = torch_bytes(gvhmr(truth()))
_OLD = torch_bytes(gvhmr(truth()), _use_new_zipfile_serialization=False)


def _declared(shape: tuple[int, ...], like: tuple[int, ...] = (5, 72)) -> bytes:
    """A file of joblib whose array of poses says that it has another shape."""

    text = joblib_bytes({1: {"trans_world": 0, "pose": np.zeros(like, np.float32)}}, protocol=3)
    before, after = (pickle.dumps(s, protocol=3)[2:-1].split(b"q\x00")[0] for s in (like, shape))
    assert before in text
    return text.replace(before, after)


_numbers = io.BytesIO()
np.save(_numbers, np.zeros(3))
_LOOP = b"\x80\x04" + b"(" * 5000 + b"t" * 5000 + b"."
_DICT_LOOP = b"\x80\x04" + b"}\x8c\x01a" * 20000 + b"N" + b"s" * 20000 + b"."
_HUGE_TEXT = b"\x80\x04\x8d" + struct.pack("<Q", 2**50) + b"abc"
_HUGE_BYTES = b"\x80\x05\x96" + struct.pack("<Q", 2**50) + b"abc"
_HUGE_FRAME = b"\x80\x04\x95" + struct.pack("<Q", 2**50) + b"}."
_DTYPE = b"\x80\x02cnumpy\ndtype\n" + b"K\x00K\x00\x86" + b"2\x86" * 60 + b"\x85R."
_PERSISTENT = b"\x80\x02K\x00K\x00\x86" + b"2\x86" * 60 + b"Q."
_NAMED = b"\x80\x02c" + b"a" * 5000 + b"\nb\n."

LEARNED |= {
    "joblib truncated in the pickle": case("a.pkl", _JOBLIB[:60], "cannot be read, it is damaged or incomplete"),
    "joblib truncated in an array": case("a.pkl", _JOBLIB[:900], "ends in an array of 1440 bytes; it was cut off"),
    "joblib packed and truncated": case("a.pkl", zlib.compress(_JOBLIB)[:900], "damaged or incomplete|cut off"),
    "joblib gzip with a changed byte": case(
        "a.pkl", (packed := gzip.compress(_JOBLIB))[:700] + b"\xff\x00\xff" + packed[703:], "damaged|cut off|has|holds"
    ),
    "joblib lz4": case("a.pkl", b"\x04\x22\x4d\x18" + bytes(50), "is packed with lz4, which cannot be read here"),
    "joblib says 8 TB": case("a.pkl", _declared((10**12, 72)), "ends in an array of 288000000000000 bytes"),
    "joblib of negative shape": case("a.pkl", _declared((-5, 72)), "an array without a valid shape"),
    "joblib bomb": case("a.pkl", zlib.compress(_declared((10**9, 72))), "holds more than 0.3 GB, which no"),
    "nested tuples": case("a.pkl", _LOOP, "holds a tuple of nothing known, no result of GVHMR, WHAM"),
    "nested dictionaries": case("a.pkl", _DICT_LOOP, "holds a dict of a, no result of GVHMR"),
    **{name: case("a.pkl", *hostile) for name, hostile in HOSTILE.items()},
    "a key of many tuples, packed": case(
        "a.pkl", zlib_packed(HOSTILE["a key of many tuples"][0]), "an entry under a tuple"
    ),
    "a type that is a list without end": case("a.pkl", _DTYPE, "holds a _Dtype of nothing known"),
    "a reference without end": case("a.pkl", _PERSISTENT, "refers to an object outside the pickle .a tuple"),
    "a name of 5 kB": case("a.pkl", _NAMED, "asks for a{60}, which no result needs"),
    "memo bomb": case("a.pkl", FAR_MEMO, "is no result|has no|holds"),
    "list bomb": case(
        "a.pkl",
        pickle.dumps({1: {"trans_world": 0, "frame_ids": pickle.loads(doubling("b"))["b"]}}),
        "'frame_ids' is lists nested more than 16 deep",
    ),
    "a text of 1 PB": case("a.pkl", _HUGE_TEXT, "cannot be read, it is damaged or incomplete"),
    "bytes of 1 PB": case("a.pkl", _HUGE_BYTES, "cannot be read, it is damaged or incomplete"),
    "a frame of 1 PB": case("a.pkl", _HUGE_FRAME, r"has no 'global_orient' \(it has nothing\)"),
    "packed, a text of 1 PB": case("a.pkl", zlib.compress(_HUGE_TEXT), "holds more than 0.3 GB"),
    "a set": case("a.pkl", pickle.dumps({"a": {1, 2}}, protocol=4), "holds a dict of a, no result of"),
    "a set of protocol 2": case("a.pkl", pickle.dumps({"a": {1, 2}}, protocol=2), r"asks for __builtin__.set"),
    "torch truncated": case("a.pt", _TORCH[:-300], "is damaged or was cut off"),
    "torch of before 1.6 truncated": case(
        "a.pt", _OLD[:-3000], "ends in an array|of another size|damaged or incomplete"
    ),
    "torch of before 1.6 cut in the head": case("a.pt", _OLD[:40], "cannot be read, it is damaged"),
    "torch without storages": case(
        "a.pt", _torch_with({"/data/": None}), "is a tensor whose numbers are not in the file"
    ),
    "torch with short storages": case(
        "a.pt", _torch_with({"/data/": b"ab"}), "a tensor whose numbers are not in the file"
    ),
    "torch without a pickle": case("a.pt", _torch_with({"data.pkl": b""}), "cannot be read, it is damaged"),
    "torch of a list": case("a.pt", torch_bytes([torch.zeros(3)]), "holds a list of nothing known, no result of GVHMR"),
    "torch of weights": case("a.pt", torch_bytes(torch.nn.Linear(2, 2).state_dict()), "holds a dict of weight, bias"),
    "torch of a module": case("a.pt", torch_bytes(torch.nn.Linear(2, 2)), "asks for torch.nn.modules.linear.Linear"),
    "npy of numbers": case("a.npy", _numbers.getvalue(), "is not a readable result of a fit"),
    "gvhmr without a camera": case(
        "a.pt",
        torch_bytes({k: v for k, v in gvhmr(truth()).items() if k != "K_fullimg"}),
        r"has no 'K_fullimg' \(it has smpl_params_global",
    ),
    "gvhmr without a translation": of_gvhmr("has no 'transl'", {"transl": None}),
    "gvhmr with 23 joints": of_gvhmr(
        r"'body_pose' has the shape \(5, 69\), expected \(5, 63\)", {"body_pose": torch.zeros(5, 69)}
    ),
    "gvhmr NaN": of_gvhmr("'transl' holds nan", {"transl": torch.as_tensor(_NAN)}),
    "gvhmr of no frame": of_gvhmr(r"'transl' has the shape \(0, 3\)", {"transl": torch.zeros(0, 3)}),
    "gvhmr with another clip's pose": of_gvhmr("'global_orient' has the shape", {"global_orient": torch.zeros(4, 3)}),
    "gvhmr with a camera of zero": of_gvhmr("has a focal length of 0 pixels", K_fullimg=torch.zeros(5, 3, 3)),
    "gvhmr with complex numbers": of_gvhmr("asks for|holds", {"transl": torch.zeros(5, 3, dtype=torch.complex64)}),
    "gvhmr in the world alone": case(
        "a.pt", torch_bytes({"smpl_params_global": {}}), "what holds 'transl' is a NoneType, expected a dictionary"
    ),
    "wham NaN": of_wham("'trans' holds nan, expected finite", trans=_NAN),
    "wham huge": of_wham(r"'pose' holds 1e\+30", pose=np.full((5, 72), 1e30)),
    "wham of 165 numbers": of_wham(r"'pose' has the shape \(5, 165\), expected \(5, 72\)", pose=np.zeros((5, 165))),
    "wham without frames": of_wham("'frame_ids' does not hold frame numbers", frame_ids=np.zeros(0)),
    "wham with half frames": of_wham("'frame_ids' does not hold frame numbers", frame_ids=np.arange(5) + 0.5),
    "wham with a frame twice": of_wham("'frame_ids' has a frame twice", frame_ids=np.array([1, 2, 2, 3, 4])),
    "wham with negative frames": of_wham("'frame_ids' does not hold frame numbers", frame_ids=np.arange(5) - 2),
    "wham with one frame less": of_wham(r"'betas' has the shape \(4, 10\)", betas=np.zeros((4, 10))),
    "wham with text": of_wham("'trans' holds <U1 values", trans=np.full((5, 3), "a")),
    "wham with objects": of_wham("'pose' is of the type 'O8', expected numbers", pose=np.array([{}] * 5, dtype=object)),
    "wham with three betas": of_wham(
        r"'betas' has the shape \(5, 3\), expected 5 x 10 or more", betas=np.zeros((5, 3))
    ),
    "wham whose people have names": case(
        "a.pkl", joblib_bytes({"Ann": wham(_PERSON)[1]}), "has people without numbers, expected a number for each"
    ),
    "wham whose people are lists": case(
        "a.pkl",
        joblib_bytes({1: wham(_PERSON)[1], 2: [1, 2]}),
        "what holds 'frame_ids' is a list, expected a dictionary",
    ),
    "phalp with no rotations": of_phalp(
        "'smpl' holds matrices that are not rotations", smpl={"body_pose": np.zeros((23, 3, 3))}
    ),
    "phalp mirrored": of_phalp(
        "'smpl' holds matrices that are not rotations", smpl={"global_orient": -np.eye(3, dtype=np.float32)[None]}
    ),
    "phalp with too few cameras": of_phalp("'camera' has no entry for each person", camera=[]),
    "phalp whose tracks are no list": of_phalp("'tid' is not a list", tid=3),
    "phalp whose tracks are names": of_phalp(
        "'tid' holds something other than numbers of people", tid=["a"], tracked_time=[0]
    ),
    "phalp without a person": of_phalp("without a person", tid=[], tracked_time=[]),
    "phalp without times": of_phalp("'time' has|'time' holds", time=None),
    "phalp with a person twice": case(
        "demo_walk.pkl",
        joblib_bytes(
            {
                "a.jpg": (image := phalp(_PERSON))["outputs/_DEMO/walk/img/000001.jpg"],
                "b.jpg": next(iter(image.values())),
            }
        ),
        "has person 1 twice in a frame, expected each person once",
    ),
    "prompthmr without a fit": of_prompthmr(
        "what holds 'pose' is a NoneType", people={1: {"frames": FRAMES, "bboxes": np.zeros((5, 4))}}
    ),
    "prompthmr without a person": of_prompthmr("is a result of PromptHMR without a person", people={}),
    "prompthmr without a camera": of_prompthmr(r"has no 'img_focal' \(it has nothing\)", camera={}),
    "prompthmr whose people are a list": of_prompthmr("'people' is a list, expected a dictionary", people=[1]),
}
