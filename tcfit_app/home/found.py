"""What lies in a folder: projects, results of fits, and videos."""

import hashlib
import logging
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tcfit_app.project.storage.database import NAME as PROJECT

VIDEOS = frozenset(".3gp .avi .m2ts .m4v .mkv .mov .mp4 .mpeg .mpg .mts .webm .wmv".split())
"""Suffixes of what is taken for a video."""
PROJECT_SUFFIX = ".tcfit"
RESULT = "fit.npz"
"""`result_files.FIT_NAME`, which would take torch's two seconds to import."""
BATCH_SUFFIX = ".batch"
"""`records.FOLDER_SUFFIX`, like it."""
EXPORTS_SUFFIX = ".exports"
"""Of the folder beside a project into which the list exports it."""
MOST = 20_000
"""Clips that are listed."""
_KEY = 12
"""Characters of a key."""
Kind = Literal["project", "result", "video"]
_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Found:
    """A clip in some form."""

    key: str
    """In addresses and messages: of its place in the folder, so that links stay right."""
    path: Path
    place: str
    """From the folder, with "/"."""
    kind: Kind

    @property
    def project(self) -> Path:
        """Its project's folder, which is made beside it where it is none itself."""
        if self.kind == "project":
            return self.path
        return self.path.with_name((self.path.stem if self.kind == "video" else self.path.name) + PROJECT_SUFFIX)


def find(root: Path) -> list[Found]:
    """All clips below a folder, by their places. Hidden folders and links are not followed, and nothing is looked for
    in projects and results. What cannot be read is told in the terminal, once in a process, and left out."""
    found: list[Found] = []
    folders = [root]
    while folders and len(found) < MOST:
        folder = folders.pop()
        try:
            with os.scandir(folder) as entries:
                inside = [entry for entry in entries if not entry.name.startswith(".") and not entry.is_symlink()]
        except OSError as error:
            _tell_once(folder, error)
            continue
        names = {entry.name for entry in inside}
        if PROJECT in names:
            found.append(_found(root, folder, "project"))
        elif RESULT in names:
            found.append(_found(root, folder, "result"))
        else:
            for entry in inside:
                if entry.is_dir() and not entry.name.endswith((BATCH_SUFFIX, EXPORTS_SUFFIX)):
                    folders.append(Path(entry.path))
                elif os.path.splitext(entry.name)[1].lower() in VIDEOS and entry.is_file():
                    found.append(_found(root, Path(entry.path), "video"))
    return sorted(found, key=lambda one: one.place)


def exports_beside(project: Path) -> Path:
    """Where a project's exports go."""
    return project.with_name(project.name.removesuffix(PROJECT_SUFFIX) + EXPORTS_SUFFIX)


def as_result(folder: Path) -> Found | None:
    """A folder that is a result itself; None for any other."""
    return _found(folder.parent, folder, "result") if (folder / RESULT).is_file() else None


def _found(root: Path, path: Path, kind: Kind) -> Found:
    place = path.relative_to(root).as_posix()
    key = hashlib.sha256(place.encode(errors="surrogateescape")).hexdigest()[:_KEY]
    return Found(key=key, path=path, place=place, kind=kind)


_told: set[Path] = set()


def _tell_once(folder: Path, error: OSError) -> None:
    if folder not in _told:
        _told.add(folder)
        _log.warning("%s is left out of the list: %s", folder, error.strerror or error)
