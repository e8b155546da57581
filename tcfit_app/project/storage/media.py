"""The video or images of a project: in its folder, or a link that detects whether its target has changed."""

import os
import shutil
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path

import msgspec

from fitting_core.errors import InputError
from fitting_core.video.fingerprint import fingerprint, visible_files
from fitting_core.video.frames import FrameSource
from tcfit_app.project.storage.accessing import accessing
from tcfit_app.project.storage.names import portable

FOLDER = "media"
RELINK = "Relink the video in the panel Review."
"""What to do where it is not found."""


class MediaLink(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where a clip's frames are, as stored in a project."""

    relative: str
    """Relative to the project's folder, so that both can be moved together; empty if there is no such path."""
    absolute: str
    fingerprint: str


@dataclass(frozen=True, kw_only=True)
class Media:
    """Where a clip's frames are now."""

    path: Path | None
    """None if not found."""
    problem: str = ""
    """A warning for users: frames are missing, or differ from those that the project was created with."""


def link(source: Path, project: Path) -> MediaLink:
    """A link from a project's folder to a video or a folder of images. Raises InputError if it cannot be read."""
    source = _named(source)
    try:
        relative = Path(os.path.relpath(source, project.resolve())).as_posix()
    except ValueError:  # Windows: on another drive
        relative = ""
    return MediaLink(relative=relative, absolute=str(source), fingerprint=fingerprint(source))


def check_decodes(path: Path) -> None:
    """Raise InputError for what is neither a video nor a folder of images."""
    FrameSource(_named(path)).close()


def copy(source: Path, project: Path) -> MediaLink:
    """Copy a video, or the images of a folder, into a project. Raises InputError if that fails."""
    source = _named(source)
    target = project / FOLDER / _free_name(source.name, project / FOLDER)
    with accessing(target):
        target.parent.mkdir(exist_ok=True)
        if source.is_dir():
            target.mkdir()
            for file in visible_files(source):
                shutil.copyfile(file, target / file.name)
        else:
            shutil.copyfile(source, target)
    relative = target.relative_to(project).as_posix()
    return MediaLink(relative=relative, absolute=str(source), fingerprint=fingerprint(target))


def _free_name(name: str, folder: Path) -> str:
    path = Path(portable(name))
    names = chain([path.name], (f"{path.stem}-{number}{path.suffix}" for number in count(2)))
    return next(one for one in names if not (folder / one).exists())


def located(link: MediaLink, project: Path) -> Path:
    """Where a link points to from a project's folder."""
    return Path(os.path.normpath(project.resolve() / link.relative))


def find(link: MediaLink | None, project: Path) -> Media:
    """Find the target of a link, first relative to the project, then at its absolute path."""
    if link is None:
        return Media(path=None, problem="The project was created without a video.")
    places = [located(link, project)] if link.relative else []
    found = [path for path in (*places, Path(link.absolute)) if not _absence(path)]
    same = [path for path in found if _fingerprint_or_none(path) == link.fingerprint]
    if same:
        return Media(path=same[0])
    if found:
        problem = f"{found[0]} differs from what the project was created with, or cannot be read."
        return Media(path=found[0], problem=problem)
    return Media(path=None, problem=f"{link.absolute} {_absence(Path(link.absolute))}. {RELINK}")


def _absence(path: Path) -> str:
    """Why nothing is found at a path, possibly of another user or system; empty if something is."""
    try:
        path.stat()
        return ""
    except (FileNotFoundError, NotADirectoryError):
        return "is no longer there"
    except OSError as error:
        return f"cannot be accessed ({error.strerror or error})"
    except ValueError as error:  # not a valid path
        return f"cannot be accessed ({error})"


def _named(source: Path) -> Path:
    """The absolute path, which must be valid text to be stored."""
    path = source.resolve()
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        raise InputError(f"{str(path)!r}: its name is not valid UTF-8. Rename it.") from error
    return path


def _fingerprint_or_none(path: Path) -> str | None:
    try:
        return fingerprint(path)
    except InputError:
        return None
