"""The video or images of a project: inside its folder, or a link that says whether what it finds is still the same."""

import hashlib
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import msgspec

from fitting_core.errors import InputError
from fitting_core.video.frame_names import natural_key
from tcfit_app.project.storage.durable import accessing, sync
from tcfit_app.project.storage.names import portable

FOLDER = "media"
_BLOCK = 1 << 20
"""Bytes: of a file as many are read at its start, its middle and its end. All of it would take seconds a gigabyte."""


class MediaLink(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where a clip's frames are, as a project remembers it."""

    relative: str
    """From the project's folder, so that both can be moved together; empty if there is no such path."""
    absolute: str
    fingerprint: str


@dataclass(frozen=True, kw_only=True)
class Media:
    """Where a clip's frames are now."""

    path: Path | None
    """None if they are not found."""
    problem: str = ""
    """What a user should know: frames are missing, or not those with which the project was made."""


def link(source: Path, project: Path) -> MediaLink:
    """A link from a project's folder to a video or a folder of images.

    Raises:
        InputError: It cannot be read.
    """
    source = _named(source)
    try:
        relative = Path(os.path.relpath(source, project.resolve())).as_posix()
    except ValueError:  # Windows: on another drive
        relative = ""
    return MediaLink(relative=relative, absolute=str(source), fingerprint=fingerprint(source))


def copy(source: Path, project: Path) -> MediaLink:
    """Copy a video, or the files of a folder of images, into a project that has no media yet.

    Raises:
        InputError: It cannot be read or written.
    """
    source = _named(source)
    target = project / FOLDER / portable(source.name)
    with accessing(target):
        target.parent.mkdir()
        if source.is_dir():
            target.mkdir()
            for file in _files(source):
                shutil.copyfile(file, target / file.name)
                sync(target / file.name)
        else:
            shutil.copyfile(source, target)
        sync(target)
        sync(target.parent)
    relative = target.relative_to(project).as_posix()
    return MediaLink(relative=relative, absolute=str(source), fingerprint=fingerprint(target))


def is_own(link: MediaLink) -> bool:
    """Whether a link says that the frames lie in the project, as `copy` puts them there."""
    return link.relative.startswith(f"{FOLDER}/")


def find(link: MediaLink | None, project: Path) -> Media:
    """Look for what a link points at, first beside the project and then where it was."""
    if link is None:
        return Media(path=None, problem="The project was made without a video.")
    places = [project / link.relative] if link.relative else []
    found = [path for path in (*places, Path(link.absolute)) if not _absence(path)]
    same = [path for path in found if _fingerprint_or_none(path) == link.fingerprint]
    if same:
        return Media(path=same[0])
    if found:
        problem = f"{found[0]} is not what the project was made with: other content, or it cannot be read."
        return Media(path=found[0], problem=problem)
    return Media(path=None, problem=f"{link.absolute} {_absence(Path(link.absolute))}. Say where the video is now.")


def _absence(path: Path) -> str:
    """Why nothing is found under a path, which may be of another user or another system; empty if something is."""
    try:
        path.stat()
        return ""
    except (FileNotFoundError, NotADirectoryError):
        return "is no longer there"
    except OSError as error:
        return f"cannot be looked for ({error.strerror or error})"
    except ValueError as error:  # no path at all
        return f"cannot be looked for ({error})"


def _named(source: Path) -> Path:
    """The absolute path, which must be a text to be stored."""
    path = source.resolve()
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        raise InputError(f"{str(path)!r}: has a name that is no text in UTF-8. Rename it.") from error
    return path


def _fingerprint_or_none(path: Path) -> str | None:
    try:
        return fingerprint(path)
    except InputError:
        return None


def fingerprint(path: Path) -> str:
    """Tells apart other content, though not every change: a hash of the size and of three blocks of a file.

    Of a folder: of its files' names and sizes, and of the content of the first one.

    Raises:
        InputError: It cannot be read.
    """
    digest = hashlib.sha256()
    try:
        if path.is_dir():
            files = _files(path)
            digest.update("\n".join(f"{file.name}/{file.stat().st_size}" for file in files).encode())
            files = files[:1]
        else:
            files = [path]
        for file in files:
            _add_blocks(digest, file)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}). Allow reading it.") from error
    return digest.hexdigest()


def _files(folder: Path) -> list[Path]:
    visible = [file for file in folder.iterdir() if file.is_file() and not file.name.startswith(".")]
    return sorted(visible, key=lambda file: natural_key(file.name))


def _add_blocks(digest: "hashlib._Hash", file: Path) -> None:
    with file.open("rb") as stream:
        size = os.fstat(stream.fileno()).st_size
        digest.update(str(size).encode())
        for start in (0, (size - _BLOCK) // 2, size - _BLOCK):
            stream.seek(max(0, start))
            digest.update(stream.read(_BLOCK))
