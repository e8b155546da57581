"""A project as one file, NAME.tcfit.zip: packed from a project, even an open one, and unpacked from untrusted files.

| entry | |
|---|---|
| tcfit-project.json | what the file is, and its version |
| project.sqlite | a consistent snapshot of the database (SQLite's backup) |
| detections.npz, reference.npz, runs/... | as in the project |
| media/... | the video or images, if they are in the project or were requested |

Unpacking trusts nothing: names, kinds and sizes of all entries are checked before a byte is written, and the project is
opened once before it is moved into place. Packing includes an external video only on request: a project made by someone
else may refer to any file as its video.
"""

import os
import re
import shutil
import sqlite3
import stat
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import msgspec

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing, scratch_folder
from fitting_core.files.regular import regular_file
from fitting_core.motion import Progress
from fitting_core.video.fingerprint import fingerprint_of_images, visible_files
from tcfit_app.project.project import Project
from tcfit_app.project.storage import database, media, runs
from tcfit_app.project.storage.accessing import creating
from tcfit_app.project.storage.clip import DETECTIONS, copy_detections, creation_time, stored_link
from tcfit_app.project.storage.columns import Damage
from tcfit_app.project.storage.media import MediaLink
from tcfit_app.project.storage.reference import NAME as REFERENCE
from tcfit_app.project.storage.view_media import store_view_link, view_links

SUFFIX = ".tcfit.zip"
ABOUT = "tcfit-project.json"
FORMAT, VERSION = "tcfit project", 1
HANDSHAPES = "handshapes.toml"
"""The user's own handshapes, if any: see docs/linguists.md."""
MOST_ENTRIES = 500_000
MOST_BYTES = 1 << 40
MOST_RATIO = 1100
"""Deflate compresses at most 1032-fold: an entry claiming more is not ours."""
# A backslash or a colon in a frame's name is a path or a drive on Windows only.
_FRAME = r"[^/\0]" if os.name == "posix" else r"[^/\\:\0]"
_NAMES = re.compile(
    rf"tcfit-project\.json|project\.sqlite|handshapes\.toml|(detections|reference)\.npz|{runs.ENTRY}"
    rf"|media/[^/\\:\0]+(/{_FRAME}+)?",
    re.DOTALL,
)
_BLOCK = 1 << 20
_ATTEMPTS = 3
"""A project gets its detections only once, so at most the first attempt can be disturbed."""


class PackageAbout(msgspec.Struct, frozen=True, kw_only=True):
    """The header of a packed project."""

    format: str
    version: int


def is_packed(path: Path) -> bool:
    """Whether a path is a packed project, by its content."""
    if not path.is_file() or not zipfile.is_zipfile(path):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            return ABOUT in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return path.name.endswith(SUFFIX)


# --- packing ---


def pack(folder: Path, path: Path, *, with_media: bool = False, progress: Progress | None = None) -> None:
    """Pack a project. Others may keep writing to it: the file has every edit and run either completely or not at all.

    Args:
        folder: The project's.
        path: The file; it appears when complete.
        with_media: Include a video or images outside of the project.
        progress: See `Progress`.

    Raises:
        InputError: Database or detections are damaged, the requested video is missing, or the project's own video is in
            fact elsewhere.
        OSError: Something cannot be read or written.
    """
    with scratch_folder() as copies, replacing(path) as draft:
        copy, detections = copies / database.NAME, copies / DETECTIONS
        _back_up_with_detections(folder, copy, detections)
        files = [
            (copy, database.NAME),
            (detections, DETECTIONS),
            *((folder / name, name) for name in (REFERENCE, HANDSHAPES) if (folder / name).is_file()),
            *_run_files(folder, copy),
            *_media_files(folder, copy, with_media=with_media),
        ]
        with zipfile.ZipFile(draft, "w", zipfile.ZIP_STORED) as archive:
            archive.writestr(ABOUT, msgspec.json.encode(PackageAbout(format=FORMAT, version=VERSION)))
            _add(archive, files, progress)


def _back_up_with_detections(folder: Path, copy: Path, detections: Path) -> None:
    """Snapshot both consistently, even if another process is just storing the project's detections."""
    for _ in range(_ATTEMPTS):
        _back_up(folder / database.NAME, copy)
        if copy_detections(folder, copy, detections):
            return
    raise InputError(
        f"{folder / DETECTIONS}: is missing, or was changed since the project was created. It must not be changed: "
        "restore it from a backup."
    )


def _back_up(source: Path, copy: Path) -> None:
    try:
        with (
            closing(sqlite3.connect(f"{source.resolve().as_uri()}?mode=ro", uri=True)) as old,
            closing(sqlite3.connect(copy)) as new,
        ):
            old.backup(new)
            new.execute("PRAGMA journal_mode = DELETE")
    except sqlite3.Error as error:
        raise InputError(f"{source}: cannot be copied ({error}). Open the project once to check it.") from error


def _run_files(folder: Path, copy: Path) -> list[tuple[Path, str]]:
    """Results of the runs in the snapshot: newer ones may have been added since."""
    with closing(database.copied(copy)) as connection:
        return [(folder / name, name) for name in runs.entries(folder, connection)]


def _media_files(folder: Path, copy: Path, *, with_media: bool) -> list[tuple[Path, str]]:
    """Files of the videos, of the clip and of its other views; the snapshot is updated with their places in the
    package."""
    with closing(database.copied(copy)) as connection:
        links = _links(connection)
        standing = _standing_views(copy) if links.keys() - {None} else set()
        files, taken = list[tuple[Path, str]](), {link.relative.casefold() for link in links.values()}
        for view, link in links.items():
            if (view is not None and view not in standing) or not (with_media or media.is_own(link)):
                continue
            path, frames, packed = _packed_media(folder, link, lambda name: name.casefold() in taken)
            taken.add(packed.relative.casefold())
            files += [(file, packed.relative + f"/{file.name}" * (file != path)) for file in frames]
            if view is not None:
                store_view_link(connection, view, packed)
            else:
                connection.execute("UPDATE clip SET media = ?", (msgspec.json.encode(packed).decode(),))
        connection.commit()
    return files


def _links(connection: sqlite3.Connection) -> dict[int | None, MediaLink]:
    """The links to the videos, in a copy of the database, by the id of the view; None: of the clip."""
    link = stored_link(connection)
    return ({} if link is None else {None: link}) | dict(
        view_links(lambda query: connection.execute(query).fetchall(), Damage())
    )


def _standing_views(copy: Path) -> set[int]:
    """The ids of the views in the snapshot, beside which its detections lie."""
    with Project.open(copy.parent, read_only=True) as project:
        return {view.id for view in project.views}


def _packed_media(folder: Path, link: MediaLink, taken: Callable[[str], bool]) -> tuple[Path, list[Path], MediaLink]:
    """A video, its files, and the link to it in a package."""
    if media.is_own(link):
        path = _own_video(folder, link)
        return path, _files(path), link
    path = _video_elsewhere(folder, link)
    files = media.frame_files(path)
    packed = msgspec.structs.replace(link, relative=media.free_name(path.name, taken))
    if path.is_dir():
        packed = msgspec.structs.replace(packed, fingerprint=fingerprint_of_images(files))
    return path, files, packed


def _video_elsewhere(folder: Path, link: MediaLink) -> Path:
    found = media.find(link, folder)
    if found.path is None or found.problem:
        raise InputError(f"The video cannot be packed. {found.problem} Otherwise pack the project without it.")
    return found.path.resolve()


def _own_video(folder: Path, link: MediaLink) -> Path:
    """A video in the project. Raises InputError if one of its files, with links resolved, is elsewhere."""
    path, own = folder / link.relative, folder.resolve() / media.FOLDER
    for file in (path, *_files(path)):
        if not file.resolve().is_relative_to(own):
            raise InputError(
                f"{folder}: was not packed: its video {link.relative!r} links to {file.resolve()}, outside of "
                f"{media.FOLDER}. Put the files themselves there."
            )
    return path


def _files(path: Path) -> list[Path]:
    """A file, or the visible files of a folder."""
    return [path] if path.is_file() else visible_files(path)


def _add(archive: zipfile.ZipFile, files: list[tuple[Path, str]], progress: Progress | None) -> None:
    whole, done = sum(file.stat().st_size for file, _ in files) or 1, 0
    for file, name in files:
        # Videos, images and most npz do not compress; the database does.
        entry = zipfile.ZipInfo.from_file(file, name, strict_timestamps=False)
        entry.compress_type = zipfile.ZIP_DEFLATED if file.suffix in (".sqlite", ".npz") else zipfile.ZIP_STORED
        with file.open("rb") as source, archive.open(entry, "w", force_zip64=True) as target:
            while block := source.read(_BLOCK):
                target.write(block)
                done += len(block)
                if progress:
                    progress(min(1.0, done / whole))


# --- unpacking ---


def unpack(path: Path, folder: Path) -> None:
    """Create a project from a packed one.

    Args:
        path: The file.
        folder: Must not exist, or be empty; it appears when complete.

    Raises:
        InputError: The file is not a packed project, is damaged, comes from a newer tcfit, or has unexpected entries;
            or the folder cannot be written. Nothing is left behind then.
    """
    with creating(folder.resolve()) as draft:
        _extract(path, draft)
        Project.open(draft).close()  # refuses what cannot be opened
        _check_link(path, draft)


def packed_creation_time(path: Path) -> str:
    """`creation_time` of a packed project, without unpacking the rest. Raises InputError as `unpack` does."""
    with scratch_folder() as folder:
        _extract(path, folder, only=database.NAME)
        return creation_time(folder)


def _extract(path: Path, draft: Path, *, only: str | None = None) -> None:
    try:
        with zipfile.ZipFile(regular_file(path, most=None)) as archive:
            entries = archive.infolist()
            _check_about(path, archive)
            _check_entries(path, entries)
            wanted = [entry for entry in entries if entry.filename != ABOUT and only in (None, entry.filename)]
            _check_space(path, wanted, draft)
            for entry in wanted:
                _extract_entry(archive, entry, draft / entry.filename)
    except InputError:  # is also a ValueError
        raise
    except FileNotFoundError as error:
        raise InputError(f"{path}: does not exist; expected a project as one file ({SUFFIX}).") from error
    except (zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
        raise InputError(f"{path}: is damaged ({error}). Copy it again, or ask for it to be packed again.") from error


def _check_about(path: Path, archive: zipfile.ZipFile) -> None:
    try:
        with archive.open(ABOUT) as file:
            about = msgspec.json.decode(file.read(_BLOCK), type=PackageAbout)
    except (KeyError, msgspec.DecodeError) as error:
        raise InputError(f"{path}: not a packed project; expected one made by `tcfit export --formats project`.") from (
            error
        )
    if about.format != FORMAT:
        raise InputError(f"{path}: is a {about.format!r}; expected a {FORMAT!r}.")
    if about.version > VERSION:
        raise InputError(
            f"{path}: has version {about.version}, but this tcfit supports versions up to {VERSION}: update tcfit."
        )


def _check_entries(path: Path, entries: list[zipfile.ZipInfo]) -> None:
    """Accept only what `pack` writes: nothing outside the folder, no links, no zip bombs, no duplicates."""
    refusal = f"{path}: was not unpacked: it holds"
    if len(entries) > MOST_ENTRIES:
        raise InputError(f"{refusal} {len(entries)} files; expected {MOST_ENTRIES} at most.")
    seen: set[str] = set()
    for entry in entries:
        name = entry.filename
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if not _is_ours(name) or kind not in (0, stat.S_IFREG):
            raise InputError(f"{refusal} {name[:100]!r}, which is not part of a tcfit project.")
        if entry.flag_bits & 1:
            raise InputError(f"{refusal} {name[:100]!r} encrypted. Ask for a copy without a password.")
        if name.casefold() in seen:
            raise InputError(f"{refusal} {name[:100]!r} twice.")
        if entry.file_size > MOST_RATIO * max(1, entry.compress_size):
            raise InputError(
                f"{refusal} {name[:100]!r}, which claims to be {entry.file_size} bytes, which is impossible."
            )
        seen.add(name.casefold())


def _is_ours(name: str) -> bool:
    """Whether `pack` writes entries with such a name."""
    return _NAMES.fullmatch(name) is not None and not {"..", "."} & set(name.split("/"))


def _check_link(path: Path, draft: Path) -> None:
    """Check that videos said to be in the project are there, or nowhere."""
    with closing(database.copied(draft / database.NAME)) as connection:
        links = _links(connection)
    for link in links.values():
        if media.is_own(link) and not _is_ours(link.relative):
            raise InputError(f"{path}: was not unpacked: its video has the invalid path {link.relative[:100]!r}.")


def _check_space(path: Path, entries: list[zipfile.ZipInfo], draft: Path) -> None:
    needed, free = sum(entry.file_size for entry in entries), shutil.disk_usage(draft).free
    if needed > min(MOST_BYTES, free):
        raise InputError(
            f"{path}: needs {needed / 1e9:.1f} GB, but only {free / 1e9:.1f} GB are free. Free some space."
        )


def _extract_entry(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    left = entry.file_size
    with archive.open(entry) as source, target.open("xb") as file:
        while block := source.read(_BLOCK):
            left -= len(block)
            if left < 0:
                raise zipfile.BadZipFile(f"{entry.filename} is longer than it says")
            file.write(block)
    if left:
        raise zipfile.BadZipFile(f"{entry.filename} is shorter than it says")
