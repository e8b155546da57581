"""A glTF 2.0 file, binary or not, as its JSON and one block of data; and writing it again."""

import base64
import binascii
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file

_MOST = 2**30
"""Limit for a rig's file, in bytes."""
_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_PACKED = "_meshopt_compression"
"""Suffix of the names of extensions with their own buffers."""
_IMAGES = {b"\x89PNG": "image/png", b"RIFF": "image/webp", b"\xabKTX": "image/ktx2"}
"""Image types by first bytes; otherwise JPEG."""
_HEADER = 20
"""Bytes of a GLB before its JSON."""
WRONG = (ValueError, KeyError, IndexError, TypeError, AttributeError, OverflowError, struct.error, RecursionError)
"""Errors of reading a malformed file, and their messages."""
_SAID: dict[type[Exception], str] = {
    KeyError: "it lacks {}",
    IndexError: "it names a part that it does not have",
    TypeError: "a part of it is of the wrong kind ({})",
    AttributeError: "a part of it is of the wrong kind ({})",
    OverflowError: "a number is too large",
    RecursionError: "it is nested too deeply",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class GltfFile:
    """A file's content, with its buffers joined."""

    document: dict[str, Any]
    """The JSON. Its first buffer, if any, is `data`."""
    data: bytes
    path: Path

    def written(self) -> bytes:
        """The content of a GLB."""
        document = dict(self.document)
        data = self.data + bytes(-len(self.data) % 4)
        if data:
            document["buffers"] = [{"byteLength": len(data)}]
        text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), _JSON) + text
        if data:
            chunks += struct.pack("<II", len(data), _BIN) + data
        return struct.pack("<III", _MAGIC, 2, 12 + len(chunks)) + chunks


def read_gltf(path: Path, *, with_data: bool = True) -> GltfFile:
    """Read a .glb or .gltf. Raises InputError if it cannot be read, or is not glTF 2.0.

    Args:
        path: The file. Files that a .gltf refers to must be in its folder.
        with_data: Read buffers and images as well; without them, only the skeleton is available.
    """
    try:
        content = regular_file(path, most=_MOST).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}).") from error
    try:
        document, data = _parts(content)
        if str(document.get("asset", {}).get("version", "")).partition(".")[0] != "2":
            raise ValueError(f"its version is {document.get('asset', {}).get('version')!r}, expected 2.0")
        if with_data:
            data = _joined(document, data, path)
    except WRONG as error:
        raise InputError(
            f"{path}: is not a readable glTF 2.0 file: {said_of(error)}. Export the rig again as GLB."
        ) from error
    return GltfFile(document=document, data=data, path=path)


def said_of(error: Exception) -> str:
    """What is wrong with a file, from WRONG."""
    return _SAID.get(type(error), "{}").format(error)


def _parts(content: bytes) -> tuple[dict[str, Any], bytes]:
    if content[:4] != b"glTF":
        return _json(content), b""
    if len(content) < _HEADER:
        raise ValueError("it is cut off")
    _, version, length = struct.unpack_from("<III", content)
    if version != 2:
        raise ValueError(f"its version is {version}, expected 2")
    if length > len(content):
        raise ValueError(f"it has {len(content)} of {length} bytes")
    size, kind = struct.unpack_from("<II", content, 12)
    if kind != _JSON or _HEADER + size > len(content):
        raise ValueError("its first part is not JSON of the stated length")
    document, data, place = _json(content[_HEADER : _HEADER + size]), b"", _HEADER + size
    while place + 8 <= length:
        size, kind = struct.unpack_from("<II", content, place)
        if place + 8 + size > len(content):
            raise ValueError("its binary part is cut off")
        if kind == _BIN:
            data = content[place + 8 : place + 8 + size]
            break
        place += 8 + size
    return document, data


def _json(content: bytes) -> dict[str, Any]:
    found = json.loads(content.decode("utf-8-sig"))
    if not isinstance(found, dict):
        raise ValueError("its JSON is not an object")
    return found


def _joined(document: dict[str, Any], data: bytes, path: Path) -> bytes:
    """All buffers and images as one block, which the document then refers to."""
    if packed := sorted(name for name in document.get("extensionsUsed", []) if name.endswith(_PACKED)):
        raise ValueError(f"its data is compressed by {packed[0]}; expected none, or Draco")
    places, joined = [], b""
    for buffer in document.get("buffers", []):
        content = data if "uri" not in buffer else _content(buffer["uri"], path)
        if len(content) < buffer["byteLength"]:
            raise ValueError(f"a buffer has {len(content)} of {buffer['byteLength']} bytes")
        places.append(len(joined))
        joined += content[: buffer["byteLength"]] + bytes(-buffer["byteLength"] % 4)
    for view in document.get("bufferViews", []):
        view["byteOffset"] = view.get("byteOffset", 0) + places[view["buffer"]]
        view["buffer"] = 0
    for image in document.get("images", []):
        if "uri" in image:
            content = _content(image["uri"], path)
            kind = next((kind for begin, kind in _IMAGES.items() if content.startswith(begin)), "image/jpeg")
            document.setdefault("bufferViews", []).append(
                {"buffer": 0, "byteOffset": len(joined), "byteLength": len(content)}
            )
            image |= {"mimeType": kind} | image | {"bufferView": len(document["bufferViews"]) - 1}
            del image["uri"]
            joined += content + bytes(-len(content) % 4)
    return joined


def _content(uri: str, path: Path) -> bytes:
    """The content behind a uri: embedded data, or a file in the folder of the glTF."""
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.partition(",")[2], validate=True)
        except binascii.Error:
            raise ValueError("its embedded data is not base64") from None
    folder = path.parent.resolve()
    file = (folder / unquote(uri)).resolve()
    if not file.is_relative_to(folder):
        raise ValueError(f"it refers to {uri!r}, which is outside its folder")
    try:
        return regular_file(file, most=_MOST).read_bytes()
    except OSError as error:
        raise ValueError(f"{uri!r}, which it refers to, cannot be read ({error.strerror or error})") from None
