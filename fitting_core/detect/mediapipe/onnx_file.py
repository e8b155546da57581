"""Writing a network as an ONNX file.

ONNX is a message of protocol buffers: fields by number, each a number or bytes that say how long they are. Field
numbers are those of onnx.proto3 (Apache-2.0). The package `onnx` writes the same, but would have to be fetched for this
alone, also where there is no network.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

_OPSET, _IR_VERSION = 17, 9
"""Old enough for every onnxruntime that tcfit takes."""
_NUMBER, _BYTES = 0, 2
_FLOAT = 1
TYPES: dict[type[np.generic], int] = {np.float32: _FLOAT, np.int64: 7, np.float16: 10}
"""ONNX's numbers for what tensors hold."""
_INT_ATTRIBUTE, _TEXT_ATTRIBUTE, _INTS_ATTRIBUTE = 2, 3, 7

Attribute = int | str | Sequence[int]


@dataclass(frozen=True, kw_only=True)
class Node:
    """One step, which gives one tensor."""

    operator: str
    inputs: Sequence[str]
    output: str
    attributes: Mapping[str, Attribute] = field(default_factory=dict)


def onnx_bytes(
    nodes: Sequence[Node],
    weights: Mapping[str, np.ndarray],
    *,
    inputs: Mapping[str, Sequence[int | str]],
    outputs: Mapping[str, Sequence[int | str]],
) -> bytes:
    """An ONNX file.

    Args:
        nodes: In the order in which they run.
        weights: Constant tensors by name.
        inputs: Shapes by name; a length that is a name may be any. Inputs and outputs are 32-bit floats.
        outputs: The same.
    """
    graph = b"".join(
        [
            *(_part(1, _node(node)) for node in nodes),
            _part(2, b"mediapipe"),
            *(_part(5, _tensor(name, value)) for name, value in weights.items()),
            *(_part(11, _value(name, shape)) for name, shape in inputs.items()),
            *(_part(12, _value(name, shape)) for name, shape in outputs.items()),
        ]
    )
    return _number(1, _IR_VERSION) + _part(2, b"tcfit") + _part(7, graph) + _part(8, _number(2, _OPSET))


def _node(node: Node) -> bytes:
    return b"".join(
        [
            *(_part(1, name.encode()) for name in node.inputs),
            _part(2, node.output.encode()),
            _part(3, node.output.encode()),
            _part(4, node.operator.encode()),
            *(_part(5, _attribute(name, value)) for name, value in node.attributes.items()),
        ]
    )


def _attribute(name: str, value: Attribute) -> bytes:
    named = _part(1, name.encode())
    if isinstance(value, int):
        return named + _number(3, value) + _number(20, _INT_ATTRIBUTE)
    if isinstance(value, str):
        return named + _part(4, value.encode()) + _number(20, _TEXT_ATTRIBUTE)
    return named + b"".join(_number(8, entry) for entry in value) + _number(20, _INTS_ATTRIBUTE)


def _tensor(name: str, value: np.ndarray) -> bytes:
    lengths = b"".join(_number(1, length) for length in value.shape)
    content = np.ascontiguousarray(value, value.dtype.newbyteorder("<")).tobytes()
    return lengths + _number(2, TYPES[value.dtype.type]) + _part(8, name.encode()) + _part(9, content)


def _value(name: str, shape: Sequence[int | str]) -> bytes:
    lengths = [_part(2, n.encode()) if isinstance(n, str) else _number(1, n) for n in shape]
    dimensions = b"".join(_part(1, length) for length in lengths)
    tensor = _number(1, _FLOAT) + _part(2, dimensions)
    return _part(1, name.encode()) + _part(2, _part(1, tensor))


def _number(index: int, value: int) -> bytes:
    return _varint(index << 3 | _NUMBER) + _varint(value)


def _part(index: int, content: bytes) -> bytes:
    return _varint(index << 3 | _BYTES) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    """Seven bits for each byte, lowest first."""
    assert value >= 0
    septets = bytearray()
    while value > 0x7F:
        septets.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*septets, value])
