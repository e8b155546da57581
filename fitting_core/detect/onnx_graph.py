"""What an ONNX file says of its graph that onnxruntime does not tell: which operators take the image.

ONNX files are protocol buffers. Only four fields of them are needed here, so they are read as such, without the `onnx`
package (https://github.com/onnx/onnx/blob/main/onnx/onnx.proto has their numbers).
"""

from collections.abc import Iterator
from pathlib import Path

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file

_GRAPH, _NODE, _NODE_INPUT, _OPERATOR = 7, 1, 1, 4
"""Numbers of the fields ModelProto.graph, GraphProto.node, NodeProto.input and NodeProto.op_type."""
_VARINT, _EIGHT_BYTES, _LENGTH, _FOUR_BYTES = 0, 1, 2, 5
"""Ways in which a field's value is written."""


def consumers(path: Path, tensor: str) -> tuple[str, ...]:
    """The operators that take a tensor, such as ("Conv",), in the order of the file.

    Raises:
        InputError: The file is no ONNX model, or cut off.
    """
    try:
        content = memoryview(regular_file(path).read_bytes())
        found = [
            _texts(node, _OPERATOR)[0]
            for graph in _parts(content, _GRAPH)
            for node in _parts(graph, _NODE)
            if tensor in _texts(node, _NODE_INPUT)
        ]
    except (ValueError, IndexError) as error:
        raise InputError(f"{path}: is not an ONNX model, or was not fully copied ({error}).") from error
    return tuple(found)


def _texts(message: memoryview, field: int) -> list[str]:
    return [bytes(part).decode() for part in _parts(message, field)]


def _parts(message: memoryview, field: int) -> Iterator[memoryview]:
    """All values of a field that holds bytes: texts and other messages."""
    place = 0
    while place < len(message):
        key, place = _varint(message, place)
        kind = key & 7
        if kind == _VARINT:
            _, place = _varint(message, place)
        elif kind in (_EIGHT_BYTES, _FOUR_BYTES):
            place += 8 if kind == _EIGHT_BYTES else 4
        elif kind == _LENGTH:
            length, place = _varint(message, place)
            if place + length > len(message):
                raise ValueError("a part of it is longer than the file")
            if key >> 3 == field:
                yield message[place : place + length]
            place += length
        else:
            raise ValueError(f"it has a field of the unknown kind {kind}")


def _varint(message: memoryview, place: int) -> tuple[int, int]:
    """A number of seven bits for each byte, lowest first, and where it ends."""
    value = shift = 0
    while True:
        byte = message[place]
        value |= (byte & 0x7F) << shift
        place, shift = place + 1, shift + 7
        if not byte & 0x80:
            return value, place
