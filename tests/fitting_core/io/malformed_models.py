"""Malformed models and settings: bodies, VPoser, pose priors, configurations, projects, videos."""

import json
import pickle
import sqlite3
from collections.abc import Callable
from pathlib import Path

from fitting_core.body.files.reading import load_body
from fitting_core.config.toml import read_config
from fitting_core.files.archives import open_members
from fitting_core.priors.files.network import read_prior_network
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
    zip_bomb,
    zipped,
)
from tests.samples.body_files import body_arrays


def _pickled_body(data: bytes, says: str) -> Case:
    return Case(content("SMPLX_MALE.pkl", data), load_body, says)


MODELS: dict[str, Case] = {
    "body npz bomb": Case(content("SMPLX_MALE.npz", zip_bomb("v_template")), load_body, "SMPLX_MALE.npz"),
    "body says 8 TB": Case(content("SMPLX_MALE.npz", endless_npz("v_template")), load_body, "'v_template' declares"),
    "body pickle bomb": _pickled_body(PICKLE_BOMB, r"asks for (posix|nt).system, which no body model needs"),
    "body memo bomb": _pickled_body(FAR_MEMO, "has no v_template"),
    **{f"body of {name}": _pickled_body(*hostile) for name, hostile in HOSTILE.items()},
    "body list bomb": _pickled_body(
        pickle.dumps({**body_arrays(), "v_template": pickle.loads(doubling("v"))["v"]}, protocol=2), "lists nested"
    ),
    "body archive outside": Case(
        content("models.zip", zipped({"/etc/SMPLX_MALE.npz": b""})), lambda p: open_members(p).__enter__(), "outside"
    ),
    "vposer truncated": Case(content("snapshots/TR00_E096.pt", b"PK\x03\x04rest"), read_vposer, "is not VPoser"),
    "vposer pickle bomb": Case(content("TR00_E096.pt", PICKLE_BOMB), read_vposer, "is not VPoser"),
    **{
        f"vposer of {name}": Case(content("TR00_E096.pt", hostile), read_vposer, "is not VPoser")
        for name, (hostile, _) in HOSTILE.items()
    },
    "prior bomb": Case(content("prior.npz", zip_bomb("about")), read_prior_network, "unpacks to 4.0 GB"),
}


def config(data: bytes | str, says: str) -> Case:
    """A broken configuration."""
    return Case(content("method.toml", data), read_config, says)


MODELS |= {
    "config unknown setting": config("window_seize = 3", "window_seize"),
    "config deeply nested": config("a = " + "[" * 100_000, "method.toml"),
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


MODELS |= {
    "project is no database": project(b"no database " * 90, "project.sqlite: is damaged"),
    "project empty database": project(b"", "is another program's database"),
    "project of another program": project(_foreign, "is another program's database"),
    "project of a newer tcfit": project(_newer, "has version 99, but this tcfit supports versions up to"),
    "project is a folder": Case(
        directory("walk.tcfit"), lambda path: Project.open(path, read_only=True), "it has no project.sqlite"
    ),
    "video is a text": Case(content("walk.mp4", json.dumps([1, 2, 3])), FrameSource, "walk.mp4"),
    "video folder without images": Case(directory("images"), FrameSource, "images"),
}
