"""The video or images of a project: inside its folder, or a link that says whether what it finds is still the same."""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import cv2
import msgspec

from fitting_core.errors import InputError
from fitting_core.video.fingerprint import fingerprint, visible_files
from fitting_core.video.frames import FrameSource, image_files
from tcfit_app.project.storage.accessing import accessing
from tcfit_app.project.storage.names import portable

FOLDER = "media"


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
        return Media(
            path=None,
            problem="Where the video was is damaged in the project. Say where the video is now, in the panel Review.",
        )
    places = [project / link.relative] if link.relative else []
    found = [path for path in (*places, Path(link.absolute)) if not _absence(path)]
    same = [path for path in found if _fingerprint_or_none(path) == link.fingerprint]
    if same:
        return Media(path=same[0])
    if found:
        problem = f"{found[0]} is not what the project was made with: other content, or it cannot be read."
        return Media(path=found[0], problem=problem)
    return Media(
        path=None,
        problem=f"{link.absolute} {_absence(Path(link.absolute))}. Say where the video is now, in the panel Review.",
    )


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
