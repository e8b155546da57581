"""What lies in a folder: projects, results of fits, videos and folders of numbered frames."""

import hashlib
import logging
import os
import re
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, count, pairwise
from pathlib import Path
from typing import Literal

from fitting_core.errors import InputError
from fitting_core.io.people_file import PEOPLE_NAME
from fitting_core.video.frames import FrameSource
from fitting_core.video.images import IMAGE_SUFFIXES
from tcfit_app.project.storage.database import NAME as PROJECT

VIDEOS = frozenset(".3gp .avi .m2ts .m4v .mkv .mov .mp4 .mpeg .mpg .mts .webm .wmv".split())
"""Suffixes of what is taken for a video."""
PROJECT_SUFFIX = ".tcfit"
_IMAGES = "images"
"""The folder of frames in SMPLify-X's layout."""
RESULT = "fit.npz"
"""`result_files.FIT_NAME`, which would take torch's two seconds to import."""
BATCH_SUFFIX = ".batch"
"""Of the folder beside a list of clips with the outcome of its batch."""
EXPORTS_SUFFIX = ".exports"
"""Of the folder beside a project into which the list exports it."""
MOST = 20_000
"""Clips that are listed."""
_KEY = 12
"""Characters of a key."""
Kind = Literal["project", "result", "video", "images"]
_FEWEST = 10
"""Images that a clip has at least."""
_SMALLEST = 200
"""Pixels of the shorter side: images that are smaller are thumbnails."""
_NUMBERED = re.compile(r"(.*?)(\d+)")
_PHOTO = re.compile(r"(?=.*[A-Z])[A-Z0-9_]{4}\d{4}")
"""Names that cameras give to photos (DCF): IMG_0001, DSC_0001, DSCF0001."""
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
    one_of_people: bool = False
    """It lies beside a people.json."""

    @property
    def is_footage(self) -> bool:
        """Whether nothing but frames is there yet."""
        return self.kind in ("video", "images")

    @property
    def footage(self) -> Path:
        """Where the frames are, if there is nothing else: in SMPLify-X's layout in a folder of their own."""
        inside = self.path / _IMAGES
        return inside if self.kind == "images" and inside.is_dir() else self.path

    def project_places(self) -> Iterator[Path]:
        """Folders beside it for its project, in order; another clip's project may be in the first ones."""
        name = self.path.stem if self.kind == "video" else self.path.name
        names = dict.fromkeys((name, self.path.name))  # walk.tcfit, and walk.mov.tcfit beside walk.mp4's
        for one in chain(names, (f"{self.path.name}-{number}" for number in count(2))):
            yield self.path.with_name(one + PROJECT_SUFFIX)


def find(root: Path) -> list[Found]:
    """All clips below a folder, by their places. Hidden folders and links are not followed, and nothing is looked for
    in projects and results. Unreadable ones are reported in the terminal, once in a process, and left out."""
    found: list[Found] = []
    of_people: set[Path] = set()
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
        if PROJECT in names or RESULT in names:
            found.append(_found(root, folder, "project" if PROJECT in names else "result", folder.parent in of_people))
        else:
            if PEOPLE_NAME in names:
                of_people.add(folder)
            if folder != root and _is_clip(folder, names):
                in_layout = folder.name == _IMAGES and folder.parent != root
                found.append(_found(root, folder.parent if in_layout else folder, "images"))
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


def are_frames(names: Iterable[str]) -> bool:
    """Whether images in a folder are the frames of one clip, by their names: all of one form, numbered in equal
    steps, and not as cameras number photos."""
    numbers, forms = list[int](), set[tuple[str, str]]()
    for name in names:
        stem, suffix = os.path.splitext(name)
        numbered = _NUMBERED.fullmatch(stem)
        if numbered is None or _PHOTO.fullmatch(stem):
            return False
        forms.add((numbered[1], suffix))
        numbers.append(int(numbered[2]))
    steps = {after - before for before, after in pairwise(sorted(numbers))}
    return len(numbers) >= _FEWEST and len(forms) == len(steps) == 1 and 0 not in steps


def _is_clip(folder: Path, names: Collection[str]) -> bool:
    images = sorted(name for name in names if name.lower().endswith(IMAGE_SUFFIXES))
    if len(images) < _FEWEST or not are_frames(images):
        return False
    try:
        changed = os.stat(folder / images[0]).st_mtime_ns
    except OSError:
        return False
    return _shorter_side(folder / images[0], changed) >= _SMALLEST


@lru_cache(maxsize=4096)
def _shorter_side(image: Path, changed: int) -> int:
    """Pixels; 0 if it cannot be read. `changed` is when it was."""
    try:
        with FrameSource(image) as source:
            return min(source.size)
    except (InputError, OSError):
        return 0


def _found(root: Path, path: Path, kind: Kind, one_of_people: bool = False) -> Found:
    place = path.relative_to(root).as_posix()
    key = hashlib.sha256(place.encode(errors="surrogateescape")).hexdigest()[:_KEY]
    return Found(key=key, path=path, place=place, kind=kind, one_of_people=one_of_people)


_told: set[Path] = set()


def _tell_once(folder: Path, error: OSError) -> None:
    if folder not in _told:
        _told.add(folder)
        _log.warning("%s is left out of the list: %s", folder, error.strerror or error)
