"""Downloads a known model when the user asks for it: resumable, checked, and installed whole or not at all."""

import hashlib
import http.client
import json
import shutil
import socket
import urllib.error
import urllib.request
import zipfile
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path

from fitting_core.detect.known_models import KnownModel, model_path, pin, pinned
from fitting_core.detect.onnx_model import OnnxModel
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing

_PIECE = 1 << 18
"""Bytes between two looks at whether to go on."""
_PATIENCE = 30.0
"""Seconds in which the server must say something."""
_LARGEST = 4 << 30
"""Bytes; no model is larger."""
_PARTIAL_CONTENT, _WRONG_RANGE = 206, 416


@dataclass(frozen=True, kw_only=True)
class DownloadProgress:
    """How far a download is."""

    done: int
    """Bytes."""
    total: int | None
    """Bytes; None if the server does not say it."""

    @property
    def share(self) -> float:
        """0 to 1; 0 while unknown."""
        return self.done / self.total if self.total else 0.0


@dataclass(frozen=True, kw_only=True)
class Downloaded:
    """A model that is on this computer now."""

    path: Path
    sha256: str
    checked: bool
    """Whether the checksum is one that was known before; else it is remembered from now on."""


def download_notice(model: KnownModel) -> str:
    """Source, size and licence of a download, which the user confirms."""
    checksum = model.sha256 or "none is known; that of the first download is shown and remembered"
    return "\n".join(
        [
            f"{model.name}: {model.title}, {model.size}",
            f"  from      {model.url}",
            f"  licence   {model.licence}",
            f"  SHA-256   {checksum}",
            f"  kept as   {model_path(model.name)}",
        ]
    )


def download(model: KnownModel, folder: Path | None = None) -> Generator[DownloadProgress | Downloaded, None, None]:
    """Fetch a model; the last event is the result. An interrupted download is resumed the next time. Raises InputError
    if the server cannot be reached or sends something else, the disk is full, or the checksum differs; no new model is
    left behind then.

    Args:
        model: Which.
        folder: Where it is kept; None: the user's.
    """
    folder = folder or model_path(model.name).parent
    part = folder / f".{model.name}.part"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield from _fetch(model.url, part)
        try:
            result = _installed(model, part, folder)
        finally:
            _forget(part)  # It was complete: if it cannot be used, resuming would not help.
        yield result
    except urllib.error.HTTPError as error:
        raise InputError(f"{model.url}: the server answers {error.code} ({error.reason}). {_BY_HAND}") from error
    except (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError) as error:
        raise InputError(
            f"{model.url}: cannot be fetched: {_why(error)}. {_kept(model.url, part)}{_BY_HAND}"
        ) from error
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}). Free space there.") from error


_BY_HAND = "Or download it in a browser, and give the ONNX file's path."


def _why(error: Exception) -> str:
    """Why the server cannot be reached, in plain words."""
    reason = getattr(error, "reason", error)
    if isinstance(reason, socket.gaierror):
        return "the server's address cannot be found; check the internet connection, or whether a proxy is needed"
    if isinstance(reason, TimeoutError):
        return "the server does not answer"
    if isinstance(reason, ConnectionRefusedError):
        return "the server refuses the connection"
    if isinstance(reason, http.client.IncompleteRead):
        return "the connection broke off"
    if isinstance(reason, OSError) and reason.strerror:
        return f"the connection failed ({reason.strerror})"
    return f"the connection failed ({reason})"


def _there(url: str, part: Path) -> int:
    """Bytes that have arrived, from which another attempt continues."""
    known = _state(part)
    return part.stat().st_size if part.is_file() and known.get("url") == url and known.get("tag") else 0


def _kept(url: str, part: Path) -> str:
    have = _there(url, part)
    size = f"{have / 1e6:.1f} MB" if have >= 1e5 else f"{have / 1e3:g} kB"
    return f"The first {size} have arrived; another attempt continues from there. " if have else ""


def _fetch(url: str, part: Path) -> Iterator[DownloadProgress]:
    """Complete the partial file from the server."""
    known, have = _state(part), _there(url, part)
    headers = {"User-Agent": "tcfit", "Accept-Encoding": "identity"}
    if have:
        headers |= {"Range": f"bytes={have}-", "If-Range": known["tag"]}
    try:
        answer = urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=_PATIENCE)
    except urllib.error.HTTPError as error:
        if error.code != _WRONG_RANGE:
            raise
        _forget(part)  # what is here is longer than what the server has
        yield from _fetch(url, part)
        return
    with answer:
        if url.startswith("https:") and not answer.url.startswith("https:"):
            raise InputError(f"{url}: leads to {answer.url}, which is not encrypted. {_BY_HAND}")
        goes_on = answer.status == _PARTIAL_CONTENT
        done = have if goes_on else 0
        length = answer.headers.get("Content-Length")
        total = done + int(length) if length else None
        tag = answer.headers.get("ETag") or answer.headers.get("Last-Modified") or ""
        if not goes_on:
            _note(part).write_text(json.dumps({"url": url, "tag": "" if tag.startswith("W/") else tag}))
        yield from _written(answer, part, done, total)


def _written(answer: http.client.HTTPResponse, part: Path, done: int, total: int | None) -> Iterator[DownloadProgress]:
    with part.open("ab" if done else "wb") as file:
        yield DownloadProgress(done=done, total=total)
        while piece := answer.read(_PIECE):
            file.write(piece)
            done += len(piece)
            if done > _LARGEST:
                _forget(part)
                raise InputError(f"{answer.url}: sends more than {_LARGEST >> 30} GB, which no model has.")
            yield DownloadProgress(done=done, total=total)
    if total is not None and done < total:
        raise http.client.IncompleteRead(b"", total - done)


def _installed(model: KnownModel, part: Path, folder: Path) -> Downloaded:
    """Extract the model from the download, check it, and install it."""
    target = model_path(model.name, folder)
    expected = model.sha256 or pinned(model.name, folder)
    with replacing(target) as draft:
        _unpack(part, draft, model.url)
        with draft.open("rb") as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
        if expected and found != expected:
            origin = "known for it" if model.sha256 else "of its first download"
            raise InputError(
                f"{model.url}: gave a model with the SHA-256 {found}; {expected} is {origin}. It was not kept: "
                "it may have been altered in transit, or the publisher has replaced it."
            )
        OnnxModel(draft, threads=1)
    if not model.sha256:
        pin(model.name, found, folder)
    origin = {"url": model.url, "sha256": found, "checked": bool(expected), "licence": model.licence}
    with replacing(target.with_suffix(".json")) as draft:
        draft.write_text(json.dumps(origin, indent=1), encoding="utf-8")
    return Downloaded(path=target, sha256=found, checked=bool(expected))


def _unpack(part: Path, draft: Path, url: str) -> None:
    """The ONNX file in an archive, or the file itself."""
    if not zipfile.is_zipfile(part):
        shutil.copyfile(part, draft)
        return
    try:
        with zipfile.ZipFile(part) as archive:
            models = [entry for entry in archive.infolist() if entry.filename.lower().endswith(".onnx")]
            if len(models) != 1 or models[0].file_size > _LARGEST:
                raise InputError(f"{url}: holds {len(models)} ONNX files of a fitting size; expected one.")
            # Nothing of the entry's name becomes a path.
            with archive.open(models[0]) as source, draft.open("wb") as target:
                shutil.copyfileobj(source, target, _PIECE)
    except (zipfile.BadZipFile, NotImplementedError, EOFError) as error:
        raise InputError(f"{url}: gave a damaged archive ({error}). It was not kept; try again.") from error


def _note(part: Path) -> Path:
    return part.with_suffix(".part.json")


def _state(part: Path) -> dict[str, str]:
    try:
        known = json.loads(_note(part).read_text())
    except (OSError, ValueError):
        return {}
    return known if isinstance(known, dict) else {}


def _forget(part: Path) -> None:
    part.unlink(missing_ok=True)
    _note(part).unlink(missing_ok=True)
