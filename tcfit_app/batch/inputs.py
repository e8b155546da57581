"""The hash of a clip's settings and input files: while it stays the same, the clip is not fitted again."""

import hashlib
import os
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from functools import cache, lru_cache
from pathlib import Path

import msgspec

from fitting_core.clips.footage import locate
from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.config.schema import POSE_PRIORS, FitConfig
from fitting_core.config.toml import as_plain
from fitting_core.detect.detectors import find_detector
from fitting_core.errors import InputError
from fitting_core.files.regular import at_home, regular_file
from fitting_core.io.cameras.reading import camera_files
from fitting_core.io.known_shape import read_known_shape
from tcfit_app.batch.manifest import ClipTask
from tcfit_app.options.fit import StartOptions, ViewOptions
from tcfit_app.options.preparing import body_file

_BLOCK = 1 << 20
_KINDS = ("video", "keypoints")


def inputs_of(task: ClipTask) -> str:
    """One hash of a clip: one half of its settings, one of the names, sizes and times of its input files.

    Raises:
        InputError: The body model is missing, or a path is that of a pipe or device.
        OSError: A file cannot be read.
    """
    return f"{settings_of(task)}-{files_of(task)}"


def unchanged(then: str, task: ClipTask) -> bool:
    """Whether a clip has the same hash as before. If its input or its detector is missing, only its settings count."""
    settings = settings_of(task)
    if missing_input(task) or _detector_is_gone(task):
        return then.partition("-")[0] == settings
    return then == f"{settings}-{files_of(task)}"


def missing_input(task: ClipTask) -> list[tuple[str, Path]]:
    """Column and path of each input file that does not exist."""
    fit = task.fit
    named = [
        ("video", fit.video),
        ("keypoints", fit.keypoints),
        ("camera", fit.camera.camera),
        ("start", fit.begin.start),
        *(("other_view", path) for path in fit.views.other_view),
        *(("other_keypoints", path) for path in fit.views.other_keypoints),
    ]
    return [(column, path) for column, path in named if path is not None and not path.exists()]


def detector_of(task: ClipTask) -> str | None:
    """The detector of a clip's keypoints, or of its other views'; None where they are given, or where there is no video
    to find them in."""
    try:
        needed = any(keypoints is None for _, keypoints in _located(task).values())
    except InputError:
        return None  # the fit reports it
    return task.fit.clip.detector if needed else None


def _located(task: ClipTask) -> dict[str, tuple[Path | None, Path | None]]:
    """Frames and keypoints of the clip and of its other view, if any, by what precedes their names."""
    fit, views = task.fit, task.fit.views
    found = {"": locate(fit.video, fit.keypoints)}
    for video in views.other_view:  # a list names at most one
        found["other_"] = locate(video, next(iter(views.other_keypoints), None))
    return found


@cache
def detector_version(name: str) -> str:
    """What a detector finds depends on it. Raises InputError if it is not on this computer."""
    return find_detector(name).version


def _detector_is_gone(task: ClipTask) -> bool:
    name = detector_of(task)
    try:
        return name is not None and not detector_version(name)
    except InputError:
        return True


def settings_of(task: ClipTask) -> str:
    """Hash of everything but the input files, without what does not affect the result."""
    shape = [] if task.fit.shape is None else [msgspec.json.encode(_betas(task.fit.shape))]
    fit = task.fit
    # The detector is not used if keypoints are given.
    clip = fit.clip if detector_of(task) else replace(fit.clip, detector="")
    common = _common(clip, fit.camera, fit.views, fit.begin, body_file(fit.body), task.config, fit.overlay)
    return _hashed([common, *shape])


@lru_cache(maxsize=256)  # Most clips of a list have the same, which takes milliseconds to write down.
def _common(
    clip: ClipOptions,
    camera: CameraOptions,
    views: ViewOptions,
    begin: StartOptions,
    body: Path,
    config: FitConfig,
    overlay: bool,
) -> bytes:
    """Settings without the shape."""
    plain = {
        "clip": asdict(clip),
        # Files are input, and not settings.
        "camera": asdict(camera) | {"camera": None},
        "start": asdict(begin) | {"start": None},
        "body": _file_hash(body),
        "config": {name: value for name, value in as_plain(config).items() if name != "device"},
        "prior": "" if config.pose_prior in POSE_PRIORS else _file_hash(Path(config.pose_prior)),
        "overlay": overlay,
    }
    if views.other_view:  # files are input here too
        plain["views"] = asdict(replace(views, other_view=(), other_keypoints=()))
    return msgspec.json.encode(plain, order="sorted")


def _betas(path: Path) -> list[float] | None:
    """The betas, because the same shape in another file must not cause another fit. None if unreadable."""
    try:
        return read_known_shape(path).betas.tolist()
    except InputError:
        return None


def files_of(task: ClipTask) -> str:
    """Hash of the names, sizes and times of modification of the input files, and of the detector's version."""
    lines = _detector_line(task)
    for kind, file in _inputs(task):
        status = file.stat()
        lines.append(f"{kind} {file.name} {status.st_size} {status.st_mtime_ns}\n".encode())
    return _hashed(lines)


def _detector_line(task: ClipTask) -> list[bytes]:
    """The detector's version is an input too."""
    name = detector_of(task)
    return [] if name is None else [f"detector {detector_version(name)}\n".encode()]


def _inputs(task: ClipTask) -> Iterator[tuple[str, Path]]:
    """Every input file with its role, in a fixed order."""
    try:
        located = _located(task).items()
    except InputError:
        return  # the fit reports it
    paths = [
        (f"{of}{kind}", path) for of, both in located for kind, path in zip(("video", "keypoints"), both, strict=True)
    ]
    for kind, path in (*paths, ("start", task.fit.begin.start)):
        if path is not None and path.is_dir():
            for folder, folders, names in os.walk(path):
                folders.sort()
                yield from ((kind, file) for name in sorted(names) if (file := Path(folder, name)).is_file())
        elif path is not None:
            yield kind, path
    if task.fit.camera.camera is not None:
        yield from (("camera", file) for file in camera_files(task.fit.camera.camera))


def _parts(file: Path) -> Iterator[bytes]:
    with regular_file(file, most=None).open("rb") as stream:
        while block := stream.read(_BLOCK):
            yield block


def _hashed(parts: Iterable[bytes]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    return digest.hexdigest()[:16]


@cache
def _file_hash(path: Path) -> str:
    """Hash of a model file, or of all files of a folder; once per process."""
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [at_home(path)]
    return _hashed([part for file in files for part in _parts(file)])
