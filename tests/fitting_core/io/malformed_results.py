"""Malformed results of fits: SMPLify-X, SMPL-X and AMASS npz, fit.npz, and the runs of a project."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fitting_core.config.schema import PRESETS
from fitting_core.io import read_motion
from fitting_core.io.result_files import read_fit
from tcfit_app.project.storage.run_files import read_run
from tests.fitting_core.io.malformed import (
    FAR_MEMO,
    HOSTILE,
    PICKLE_BOMB,
    Case,
    content,
    directory,
    doubling,
    endless_npz,
    npz,
    zip_bomb,
    zipped,
)

_RESULT: dict[str, Any] = {
    "camera_rotation": np.eye(3)[None],
    "camera_translation": np.array([[0.0, 0.0, 9.0]]),
    "betas": np.zeros((1, 10)),
    "expression": np.zeros((1, 10)),
    "body_pose": np.zeros((1, 63)),
    "left_hand_pose": np.zeros((1, 12)),
    "right_hand_pose": np.zeros((1, 12)),
    **{key: np.zeros((1, 3)) for key in ("global_orient", "jaw_pose", "leye_pose", "reye_pose")},
}


def _pickled(**changed: Any) -> bytes:
    return pickle.dumps({k: v for k, v in {**_RESULT, **changed}.items() if v is not None}, protocol=2)


def smplifyx(data: bytes, says: str) -> Case:
    """A folder with one broken result among those of SMPLify-X."""

    def make(folder: Path) -> Path:
        content("results/walk_0001/000.pkl", _pickled())(folder)
        content("results/walk_0002/000.pkl", data)(folder)
        return folder / "results"

    return Case(make, read_motion, says, "000.pkl")


RESULTS: dict[str, Case] = {
    "smplifyx truncated": smplifyx(_pickled()[:-30], "the pickle cannot be read, it is damaged"),
    "smplifyx empty": smplifyx(b"", "the pickle cannot be read"),
    "smplifyx a text": smplifyx(b"body_pose: 0\n", "the pickle"),
    "smplifyx pickle bomb": smplifyx(PICKLE_BOMB, r"asks for (posix|nt).system, which no body model needs"),
    "smplifyx memo bomb": smplifyx(FAR_MEMO, "has no .* .it has nothing"),
    **{f"smplifyx of {name}": smplifyx(*hostile) for name, hostile in HOSTILE.items()},
    "smplifyx list bomb": smplifyx(
        pickle.dumps({**_RESULT, "betas": pickle.loads(doubling("b"))["b"]}, protocol=2), "'betas' is lists nested"
    ),
    "smplifyx holds a list": smplifyx(pickle.dumps([1, 2], protocol=2), "holds a list, expected a dictionary"),
    "smplifyx without a body": smplifyx(_pickled(body_pose=None), r"has no 'body_pose' \(it has camera_rotation"),
    "smplifyx body of 69": smplifyx(_pickled(body_pose=np.zeros((1, 69))), "expected 32 or 63 numbers"),
    "smplifyx NaN": smplifyx(_pickled(jaw_pose=np.full((1, 3), np.nan)), "'jaw_pose' holds nan, expected finite"),
    "smplifyx huge": smplifyx(_pickled(betas=np.full((1, 10), 1e30)), r"'betas' holds 1e\+30"),
    "smplifyx text for numbers": smplifyx(_pickled(betas=np.array(["a"] * 10)), "'betas' has the shape .* of <U1"),
    "smplifyx mirrored camera": smplifyx(_pickled(camera_rotation=-np.eye(3)[None]), "is not a rotation matrix"),
    "smplifyx needs VPoser": Case(
        content("results/walk_0001/000.pkl", _pickled(body_pose=np.zeros((1, 32)))),
        read_motion,
        "32 VPoser numbers instead of angles, and no VPoser was added.*tcfit models add",
    ),
    "smplifyx two runs": Case(
        lambda f: (
            content("results/a_1/000.pkl", _pickled(left_hand_pose=np.zeros((1, 6))))(f)
            and smplifyx(_pickled(), "").make(f)
        ),
        read_motion,
        "'left_hand_pose' has 12 numbers in walk_0001 and 6 in a_1",
        "results",
    ),
    "smplifyx no results": Case(directory("results"), read_motion, "holds no results of SMPLify-X .found nothing"),
    "smplifyx zip that points outside": Case(
        content("results.zip", zipped({"../../walk_1/000.pkl": _pickled()})), read_motion, "points outside of it"
    ),
    "smplifyx zip cut off": Case(
        content("results.zip", zipped({"walk_1/000.pkl": _pickled()})[:-40]), read_motion, "is damaged or was cut off"
    ),
    "smplifyx about.json": Case(
        lambda f: smplifyx(_pickled(), "").make(content("results/about.json", '{"gender": 3}')(f).parent.parent),
        read_motion,
        "its about.json was not written by tcfit",
        "results",
    ),
    "a result that is none": Case(content("notes.txt", "hello"), read_motion, "is not a readable result of a fit"),
    "a result that is not there": Case(lambda f: f / "gone", read_motion, "there is no such file or folder"),
}

_MOTION: dict[str, Any] = {
    "poses": np.zeros((4, 165)),
    "trans": np.zeros((4, 3)),
    "betas": np.zeros(16),
    "gender": "neutral",
    "mocap_frame_rate": 30.0,
}


def motion(says: str, change: Callable[[bytes], bytes] = lambda data: data, **changed: Any) -> Case:
    """An npz of AMASS with other arrays (None: without it), its bytes then changed."""
    arrays = {key: value for key, value in {**_MOTION, **changed}.items() if value is not None}
    return Case(content("walk.npz", change(npz(**arrays))), read_motion, says)


RESULTS |= {
    "npz truncated": motion("is not a complete npz archive, it is damaged", lambda data: data[:-50]),
    "npz empty": Case(content("walk.npz", b""), read_motion, "is not a complete npz archive"),
    "npz changed byte": motion("is damaged", lambda data: data[:400] + b"\xff" + data[401:]),
    "npz folder": Case(directory("walk.npz"), read_motion, "holds no results"),
    "npz says 8 TB": Case(content("walk.npz", endless_npz("poses")), read_motion, "declares the shape"),
    "npz bomb": Case(content("walk.npz", zip_bomb("poses")), read_motion, "unpacks to 4.0 GB, expected at most 0.3"),
    "npz of objects": motion("'poses' is an array of Python objects", poses=np.array([{}, {}], dtype=object)),
    "npz that points outside": Case(
        content("walk.npz", zipped({"../poses.npy": npz()})), read_motion, "has neither 'poses' nor 'root_orient'"
    ),
    "npz of joints by three": motion(
        r"'poses' has the shape \(4, 55, 3\), expected \(4, 165\).* flatten the 55 joints", poses=np.zeros((4, 55, 3))
    ),
    "npz of one number": motion(r"'poses' has the shape \(\), expected \(frames, 165\)", poses=np.float64(3)),
    "npz of SMPL": motion(r"72 columns \(SMPL's 24 joints: it has no hands\), expected 165", poses=np.zeros((4, 72))),
    "npz of one frame less": motion(r"'trans' has the shape \(3, 3\), expected \(4, 3\)", trans=np.zeros((3, 3))),
    "npz without a frame": motion("there is no frame", poses=np.zeros((0, 165)), trans=np.zeros((0, 3))),
    "npz without trans": motion(r"has no 'trans' \(it has betas", trans=None),
    "npz NaN": motion("'poses' holds nan, expected finite", poses=np.full((4, 165), np.nan)),
    "npz huge": motion(r"'trans' holds 1e\+30", trans=np.full((4, 3), 1e30)),
    "npz text": motion("'poses' holds <U1 values", poses=np.full((4, 165), "a")),
    "npz three betas": motion(r"'betas' has the shape \(3,\), expected 10 or more", betas=np.zeros(3)),
    "npz gender": motion("'gender' is 'robot', expected neutral, male, female or child", gender="robot"),
    "npz frame rate": motion("'mocap_frame_rate' is -30, expected", mocap_frame_rate=-30.0),
    "npz mirrored world": motion("'camera_to_world' is not a rotation", camera_to_world=-np.eye(3)),
    "npz is a body model": Case(
        content("SMPLX_MALE.npz", npz(v_template=np.zeros((5, 3)))), read_motion, "has neither 'poses'"
    ),
}


def _fit(data: bytes, says: str) -> Case:
    return Case(content("out/fit.npz", data), read_fit, says)


_NO_RUN = PRESETS["paper"]
RESULTS |= {
    "fit.npz missing": Case(directory("out"), read_fit, "does not exist; expected a result of tcfit fit"),
    "fit.npz truncated": _fit(npz(**_MOTION)[:-50], "not a complete npz archive"),
    "fit.npz of another program": _fit(npz(**_MOTION), "is 'an npz of another program'; expected 'tcfit fit 1'"),
    "fit.npz without parameters": _fit(npz(format="tcfit fit 1"), "lacks 'poses'; expected a fit.npz of tcfit"),
    "fit.npz bomb": _fit(zip_bomb("poses"), "unpacks to 4.0 GB"),
    "fit.npz says 8 TB": _fit(endless_npz("format"), "declares the shape"),
    "fit.npz of objects": _fit(npz(format=np.array([{}], dtype=object)), "array of Python objects"),
    "run missing": Case(lambda f: f / "000001.npz", lambda path: read_run(path, _NO_RUN), "is missing; expected the"),
    "run truncated": Case(
        content("000001.npz", npz(about="{}")[:-9]),
        lambda path: read_run(path, _NO_RUN),
        "not a complete result of a run",
    ),
    "run of another kind": Case(
        content("000001.npz", npz(about='{"format": 1}')), lambda path: read_run(path, _NO_RUN), "not a complete result"
    ),
    "run says 8 TB": Case(
        content("000001.npz", endless_npz("about")), lambda path: read_run(path, _NO_RUN), "declares the shape"
    ),
}
