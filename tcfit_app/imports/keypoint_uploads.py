"""Keypoint files that a browser sends: written under names of our own, whatever they are called."""

import io
import re
import zipfile
from pathlib import Path, PurePosixPath

from fitting_core.errors import InputError
from fitting_core.io.keypoints.openpose import SUFFIX
from fitting_core.video.frame_names import natural_key, split_number

MOST_BYTES = 1 << 30
"""Of all files together, unpacked: 100,000 frames of OpenPose JSON with hands and face have half of it."""
MOST_FILES = 200_000
_SUFFIXES = (".json", ".pose")
_ENCRYPTED = 0x1
"""Bit of a ZIP entry's flags."""
_EXPECTED = "expected one JSON or .pose file, or a ZIP archive of OpenPose's JSON files"


def received(name: str, content: bytes, folder: Path) -> Path:
    """Write what was uploaded into an empty folder; what to read as keypoints.

    Nothing of a name becomes a path: of an archive's entries only the frame's number counts.

    Args:
        name: As the browser calls the file.
        content: Of the file.
        folder: Where to write.

    Raises:
        InputError: It is no file of keypoints, or an archive that holds something else, too much, or names that lead
            out of it.
    """
    shown = _shown(name)
    if len(content) > MOST_BYTES:
        raise InputError(f"{shown} has {len(content) >> 20} MB; expected {MOST_BYTES >> 20} MB at most.")
    if zipfile.is_zipfile(io.BytesIO(content)):
        return _unpacked(shown, content, folder)
    suffix = next((suffix for suffix in _SUFFIXES if name.lower().endswith(suffix)), None)
    if suffix is None or not content:
        raise InputError(f"{shown} has {len(content)} bytes and is no keypoint file by its name; {_EXPECTED}.")
    single = folder / (f"upload_0{SUFFIX}" if name.lower().endswith(SUFFIX) else f"upload{suffix}")
    single.write_bytes(content)
    return single


def _unpacked(shown: str, content: bytes, folder: Path) -> Path:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = _keypoint_entries(shown, archive)
            if len(entries) == 1 and not entries[0].filename.lower().endswith(SUFFIX):
                return received(
                    PurePosixPath(entries[0].filename).name, _content(archive, entries[0], MOST_BYTES), folder
                )
            left = MOST_BYTES
            for number, entry in _numbered(shown, entries):
                data = _content(archive, entry, left)
                left -= len(data)
                (folder / f"upload_{number:012}{SUFFIX}").write_bytes(data)
    except (zipfile.BadZipFile, NotImplementedError, EOFError, RuntimeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{shown} is a damaged ZIP archive ({error}). Pack it again.") from error
    return folder


def _keypoint_entries(shown: str, archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    """The files of an archive, all of which are keypoints."""
    # macOS adds a folder of its own; names that start with a dot are what systems leave beside real files.
    entries = [
        entry
        for entry in archive.infolist()
        if not entry.is_dir()
        and not any((part.startswith(".") and part != "..") or part == "__MACOSX" for part in _parts(entry))
    ]
    for entry in entries:
        if ".." in _parts(entry) or entry.filename.startswith(("/", "\\")) or re.match(r"[A-Za-z]:", entry.filename):
            raise InputError(f"{shown} holds {_shown(entry.filename)}, which leads out of the archive: it is refused.")
        if entry.flag_bits & _ENCRYPTED:
            raise InputError(f"{shown} is encrypted; expected a ZIP archive without a password.")
    wrong = [entry.filename for entry in entries if not entry.filename.lower().endswith(_SUFFIXES)]
    if wrong or not entries:
        found = f"other files, such as {_shown(wrong[0])}" if wrong else "no file"
        raise InputError(f"{shown} holds {found}; {_EXPECTED}.")
    if len(entries) > MOST_FILES or sum(entry.file_size for entry in entries) > MOST_BYTES:
        total = sum(entry.file_size for entry in entries) >> 20
        raise InputError(
            f"{shown} unpacks to {len(entries)} files of {total} MB; expected {MOST_FILES} files and "
            f"{MOST_BYTES >> 20} MB at most."
        )
    return entries


def _numbered(shown: str, entries: list[zipfile.ZipInfo]) -> list[tuple[int, zipfile.ZipInfo]]:
    """Entries with the numbers of their frames, or counted in natural order where not all names have one."""
    stems = [PurePosixPath(entry.filename.replace("\\", "/")).name for entry in entries]
    split = [split_number(re.sub(r"(_keypoints)?\.json$", "", stem, flags=re.IGNORECASE)) for stem in stems]
    prefixes = {prefix for prefix, _ in split}
    if len(prefixes) > 1 and all(number is not None for _, number in split):
        some = ", ".join(sorted(map(_shown, prefixes))[:3])
        raise InputError(f"{shown} holds keypoints of several clips ({some}); expected those of one.")
    numbers = [number for _, number in split if number is not None and number < 10**12]
    if len(set(numbers)) < len(entries):
        ordered = sorted(entries, key=lambda entry: natural_key(entry.filename))
        return list(enumerate(ordered))
    return sorted(zip(numbers, entries, strict=True), key=lambda pair: pair[0])


def _content(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, limit: int) -> bytes:
    """An entry unpacked, up to a limit: what an archive says of its sizes need not be so."""
    with archive.open(entry) as file:
        data = file.read(limit + 1)
    if len(data) > limit:
        raise InputError(f"The archive unpacks to more than {MOST_BYTES >> 20} MB; expected less.")
    return data


def _parts(entry: zipfile.ZipInfo) -> list[str]:
    return entry.filename.replace("\\", "/").split("/")


def _shown(name: str) -> str:
    """A name for messages: short, and of letters that can be seen."""
    return "".join(c if c.isprintable() else "?" for c in name)[:80] or "the file"
