"""The video or images of a project: inside its folder, or a link that says whether what it finds is still the same."""

import hashlib
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import msgspec

from fitting_core.errors import InputError
from fitting_core.video.frame_names import natural_key
from fitting_core.video.frames import FrameSource, image_files
from tcfit_app.project.storage.accessing import accessing
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


UNREADABLE = MediaLink(relative="", absolute="", fingerprint="")
"""Stands in for a link that is damaged."""


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


def check_decodes(path: Path) -> None:
    """Refuse what is no video and no image: a link to it would hand on any other file with the project.

    Raises:
        InputError: It cannot be decoded, or an image's file holds something else.
    """
    with FrameSource(_named(path)) as source:
        images = image_files(path) if source.stems is not None else ()
    for image in images:
        if not cv2.haveImageReader(str(_named(image))):
            raise InputError(f"{image}: is no image that can be decoded. Remove it from its folder.")


def frames_of(path: Path) -> list[Path]:
    """The files that hold a clip's frames: the video, or the images of a folder and nothing else that lies there.

    Raises:
        InputError: As `check_decodes`.
    """
    check_decodes(path)
    return list(image_files(path)) if path.is_dir() else [path]


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
            for file in visible_files(source):
                shutil.copyfile(file, target / file.name)
        else:
            shutil.copyfile(source, target)
    relative = target.relative_to(project).as_posix()
    return MediaLink(relative=relative, absolute=str(source), fingerprint=fingerprint(target))


def is_own(link: MediaLink) -> bool:
    """Whether a link says that the frames lie in the project, as `copy` puts them there."""
    return link.relative.startswith(f"{FOLDER}/")


def find(link: MediaLink | None, project: Path) -> Media:
    """Look for what a link points at, first beside the project and then where it was."""
    if link is None:
        return Media(path=None, problem="The project was made without a video.")
    if link == UNREADABLE:
        return Media(path=None, problem="Where the video was is damaged in the project. Say where the video is now.")
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
    try:
        if path.is_dir():
            return fingerprint_of_images(visible_files(path))
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: is neither a file nor a folder; expected a video or a folder of images.")
        digest = hashlib.sha256()
        _add_blocks(digest, path)
        return digest.hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}). Allow reading it.") from error


def fingerprint_of_images(files: Sequence[Path]) -> str:
    """`fingerprint` of a folder that holds these files, in natural order. Raises OSError if one cannot be read."""
    digest = hashlib.sha256("\n".join(f"{file.name}/{file.stat().st_size}" for file in files).encode())
    for file in files[:1]:
        _add_blocks(digest, file)
    return digest.hexdigest()


def visible_files(folder: Path) -> list[Path]:
    """Those of a folder whose names do not begin with a dot, in natural order."""
    visible = [file for file in folder.iterdir() if file.is_file() and not file.name.startswith(".")]
    return sorted(visible, key=lambda file: natural_key(file.name))


def _add_blocks(digest: "hashlib._Hash", file: Path) -> None:
    with file.open("rb") as stream:
        size = os.fstat(stream.fileno()).st_size
        digest.update(str(size).encode())
        for start in (0, (size - _BLOCK) // 2, size - _BLOCK):
            stream.seek(max(0, start))
            digest.update(stream.read(_BLOCK))
