"""Malformed models and settings: bodies, VPoser, pose priors, configurations, projects, videos."""

import json
import pickle
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fitting_core.body.files.reading import load_body
from fitting_core.config.toml import read_config
from fitting_core.files.archives import open_members
from fitting_core.priors.files.network import read_network
from fitting_core.priors.files.vposer import read_vposer
from fitting_core.video.frames import FrameSource
from tcfit_app.project.project import Project
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
from tests.samples.body_files import body_arrays


def body(says: str, change: Callable[[bytes], bytes] = lambda data: data, **changed: Any) -> Case:
    """A body model with other arrays (None: without it), its bytes then changed."""
    arrays = {key: value for key, value in {**body_arrays(), **changed}.items() if value is not None}
    return Case(content("SMPLX_MALE.npz", change(npz(**arrays))), load_body, says)


def _pickled_body(data: bytes, says: str) -> Case:
    return Case(content("SMPLX_MALE.pkl", data), load_body, says)


MODELS: dict[str, Case] = {
    "body truncated": body("is not a complete npz archive", lambda data: data[:-90]),
    "body empty": Case(content("SMPLX_MALE.npz", b""), load_body, "is not a complete npz archive"),
    "body folder": Case(directory("SMPLX_MALE.npz"), load_body, "is a folder, expected a body model file"),
    "body that is a motion": Case(
        content("SMPLX_MALE.npz", npz(poses=np.zeros((4, 165)), trans=np.zeros((4, 3)))), load_body, "is a motion"
    ),
    "body without weights": body("has no weights", weights=None),
    "body NaN": body("'v_template' holds 180 values that are not finite", v_template=np.full((60, 3), np.nan)),
    "body of another shape": body("'posedirs' has the shape", posedirs=np.zeros((60, 3, 9))),
    "body face outside": body("'f' holds values from 99 to 99", f=np.full((40, 3), 99)),
    "body of a hand": body("16 joints like a MANO hand", J_regressor=np.full((16, 60), 1 / 60)),
    "body npz bomb": Case(content("SMPLX_MALE.npz", zip_bomb("v_template")), load_body, "SMPLX_MALE.npz"),
    "body says 8 TB": Case(content("SMPLX_MALE.npz", endless_npz("v_template")), load_body, "'v_template' declares"),
    "body pickle bomb": _pickled_body(PICKLE_BOMB, r"asks for (posix|nt).system, which no body model needs"),
    "body memo bomb": _pickled_body(FAR_MEMO, "has no v_template"),
    **{f"body of {name}": _pickled_body(*hostile) for name, hostile in HOSTILE.items()},
    "body list bomb": _pickled_body(
        pickle.dumps({**body_arrays(), "v_template": pickle.loads(doubling("v"))["v"]}, protocol=2), "lists nested"
    ),
    "body pickle truncated": _pickled_body(pickle.dumps(body_arrays(), protocol=2)[:-99], "damaged or incomplete"),
    "body archive outside": Case(
        content("models.zip", zipped({"/etc/SMPLX_MALE.npz": b""})), lambda p: open_members(p).__enter__(), "outside"
    ),
    "vposer empty folder": Case(directory("V02_05"), read_vposer, "holds no VPoser .found nothing"),
    "vposer truncated": Case(content("snapshots/TR00_E096.pt", b"PK\x03\x04rest"), read_vposer, "is not VPoser"),
    "vposer pickle bomb": Case(content("TR00_E096.pt", PICKLE_BOMB), read_vposer, "is not VPoser"),
    **{
        f"vposer of {name}": Case(content("TR00_E096.pt", hostile), read_vposer, "is not VPoser")
        for name, (hostile, _) in HOSTILE.items()
    },
    "vposer another network": Case(
        content("a.ckpt", zipped({"a/data.pkl": pickle.dumps({"state_dict": {}}, protocol=2)})),
        read_vposer,
        "is not VPoser",
    ),
    "prior truncated": Case(content("prior.npz", npz(about="{}")[:-20]), read_network, "not a complete npz archive"),
    "prior of another kind": Case(content("prior.npz", npz(about="{}")), read_network, "an npz of another kind"),
    "prior bomb": Case(content("prior.npz", zip_bomb("about")), read_network, "unpacks to 4.0 GB"),
}


def config(data: bytes | str, says: str) -> Case:
    """A broken configuration."""
    return Case(content("method.toml", data), read_config, says)


MODELS |= {
    "config no TOML": config("solver = ", "method.toml"),
    "config unknown setting": config("window_seize = 3", "window_seize"),
    "config wrong type": config('[temporal]\nwindow_size = "many"', "window_size"),
    "config NaN": config("[temporal]\nweight = nan", "weight"),
    "config wrong encoding": config('preset = "päper"'.encode("latin-1"), "is not UTF-8 text"),
    "config deeply nested": config("a = " + "[" * 100_000, "method.toml"),
    "config folder": Case(directory("method.toml"), read_config, "is a folder, expected a file"),
    "config of a binary": config(b"\x00" * 64, "method.toml"),
}


def project(data: bytes | Callable[[Path], None], says: str) -> Case:
    """A project whose database is broken."""

    def make(folder: Path) -> Path:
        path = content("walk.tcfit/project.sqlite", data if isinstance(data, bytes) else b"")(folder)
        if not isinstance(data, bytes):
            data(path)
        return path.parent

    return Case(make, lambda path: Project.open(path, read_only=True), says, "walk.tcfit")


def _foreign(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE cats (name TEXT)")
    connection.close()


def _newer(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute(f"PRAGMA application_id = {int.from_bytes(b'tcft')}")
        connection.execute("PRAGMA user_version = 99")
    connection.close()


def _video(folder: Path, keep: int) -> Path:
    path = folder / "walk.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25, (64, 48))
    for k in range(5):
        writer.write(np.full((48, 64, 3), 40 * k, np.uint8))
    writer.release()
    path.write_bytes(path.read_bytes()[:keep])
    return path


MODELS |= {
    "project is no database": project(b"no database " * 90, "project.sqlite: is damaged"),
    "project empty database": project(b"", "is another program's database"),
    "project of another program": project(_foreign, "is another program's database"),
    "project of a newer tcfit": project(_newer, "has version 99, but this tcfit supports versions up to"),
    "project is a folder": Case(
        directory("walk.tcfit"), lambda path: Project.open(path, read_only=True), "it has no project.sqlite"
    ),
    "video is a text": Case(content("walk.mp4", json.dumps([1, 2, 3])), FrameSource, "walk.mp4"),
    "video empty": Case(content("walk.mp4", b""), FrameSource, "walk.mp4"),
    "video header only": Case(lambda folder: _video(folder, 300), FrameSource, "walk.avi"),
    "video folder without images": Case(directory("images"), FrameSource, "images"),
    "image damaged": Case(
        content("images/0001.png", b"\x89PNG\r\n\x1a\n rest"), lambda p: FrameSource(p.parent), "0001"
    ),
}
