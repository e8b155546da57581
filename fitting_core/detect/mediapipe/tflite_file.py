"""Reading a network in a .tflite file: its tensors, and its operators in the order in which they run.

The file is a FlatBuffer: tables whose fields lie where a list of offsets in front of them says. Field numbers are
those of TensorFlow Lite's schema (tensorflow/compiler/mlir/lite/schema/schema.fbs, Apache-2.0). Only what MediaPipe's
networks use is read. No package has to be fetched for it, so that a file from elsewhere is enough without a network.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

_TYPES = {0: np.float32, 1: np.float16, 2: np.int32, 3: np.uint8, 4: np.int64}
_BYTE, _SHORT, _INT, _OFFSET = "<b", "<H", "<i", "<I"
_COMPRESSED = 1
"""A level of a sparse tensor that lists its indices."""
_INDEX_TYPES = {1: np.int32, 2: np.uint16, 3: np.uint8}

_OPERATORS = {
    0: "ADD", 2: "CONCATENATION", 3: "CONV_2D", 4: "DEPTHWISE_CONV_2D", 5: "DEPTH_TO_SPACE", 6: "DEQUANTIZE",
    9: "FULLY_CONNECTED", 14: "LOGISTIC", 17: "MAX_POOL_2D", 19: "RELU", 22: "RESHAPE", 23: "RESIZE_BILINEAR",
    34: "PAD", 40: "MEAN", 45: "STRIDED_SLICE", 54: "PRELU", 124: "DENSIFY",
}  # fmt: skip
"""By their number in the file."""
_SLIDING = {"padding": (0, _BYTE, 0), "stride_width": (1, _INT, 0), "stride_height": (2, _INT, 0)}
_OPTIONS: dict[str, dict[str, tuple[int, str, int]]] = {
    "ADD": {"activation": (0, _BYTE, 0)},
    "CONCATENATION": {"axis": (0, _INT, 0), "activation": (1, _BYTE, 0)},
    "CONV_2D": _SLIDING
    | {"activation": (3, _BYTE, 0), "dilation_width": (4, _INT, 1), "dilation_height": (5, _INT, 1)},
    "DEPTHWISE_CONV_2D": _SLIDING
    | {"activation": (4, _BYTE, 0), "dilation_width": (5, _INT, 1), "dilation_height": (6, _INT, 1)},
    "DEPTH_TO_SPACE": {"block": (0, _INT, 0)},
    "FULLY_CONNECTED": {"activation": (0, _BYTE, 0)},
    "MAX_POOL_2D": _SLIDING | {"width": (3, _INT, 0), "height": (4, _INT, 0), "activation": (5, _BYTE, 0)},
    "MEAN": {"keep": (0, _BYTE, 0)},
    "RESIZE_BILINEAR": {"align_corners": (2, _BYTE, 0), "half_pixels": (3, _BYTE, 0)},
    "STRIDED_SLICE": {"begin_mask": (0, _INT, 0), "end_mask": (1, _INT, 0), "shrink_mask": (4, _INT, 0)},
}
"""Field number, form and default of an operator's options."""


@dataclass(frozen=True, kw_only=True)
class TfliteTensor:
    """One tensor; images and what is made of them are N H W C."""

    name: str
    shape: tuple[int, ...]
    constant: np.ndarray | None
    """Its content in the file, made dense; None where it is computed."""


@dataclass(frozen=True, kw_only=True)
class Operator:
    """One step; inputs and outputs are numbers of tensors, and an input that is left out is -1."""

    name: str
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    options: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class TfliteFile:
    """A network."""

    tensors: tuple[TfliteTensor, ...]
    operators: tuple[Operator, ...]
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]


def read_tflite(path: Path) -> TfliteFile:
    """Read a network.

    Raises:
        ValueError: The file is damaged, or has what MediaPipe's networks do not have; in words that follow its name.
        OSError: It cannot be read.
    """
    data = path.read_bytes()
    if data[4:8] != b"TFL3":
        raise ValueError("is not a .tflite file")
    try:
        return _network(data)
    except (struct.error, IndexError) as error:
        raise ValueError(f"is damaged ({error})") from error


@dataclass(frozen=True)
class _Table:
    """A table of the file; fields that are left out have their usual values."""

    data: bytes
    at: int

    def number(self, index: int, form: str, usual: int = 0) -> int:
        place = self._place(index)
        return _unpack(self.data, place, form) if place else usual

    def table(self, index: int) -> "_Table | None":
        place = self._place(index)
        return _Table(self.data, place + _unpack(self.data, place, _OFFSET)) if place else None

    def array(self, index: int, kind: type[np.generic]) -> np.ndarray:
        start, count = self._vector(index)
        return np.frombuffer(self.data, kind, count, start)

    def numbers(self, index: int) -> tuple[int, ...]:
        return tuple(self.array(index, np.int32).tolist())

    def text(self, index: int) -> str:
        return self.array(index, np.uint8).tobytes().decode()

    def tables(self, index: int) -> list["_Table"]:
        start, count = self._vector(index)
        places = range(start, start + 4 * count, 4)
        return [_Table(self.data, place + _unpack(self.data, place, _OFFSET)) for place in places]

    def _vector(self, index: int) -> tuple[int, int]:
        """Position of its entries, and their number."""
        place = self._place(index)
        if not place:
            return 0, 0
        place += _unpack(self.data, place, _OFFSET)
        return place + 4, _unpack(self.data, place, _OFFSET)

    def _place(self, index: int) -> int:
        """Where a field lies; 0 if it is left out."""
        offsets = self.at - _unpack(self.data, self.at, _INT)
        slot = 4 + 2 * index
        if slot >= _unpack(self.data, offsets, _SHORT):
            return 0
        offset = _unpack(self.data, offsets + slot, _SHORT)
        return self.at + offset if offset else 0


def _unpack(data: bytes, place: int, form: str) -> int:
    return struct.unpack_from(form, data, place)[0]


def _network(data: bytes) -> TfliteFile:
    model = _Table(data, _unpack(data, 0, _OFFSET))
    graphs = model.tables(2)
    if len(graphs) != 1:
        raise ValueError(f"has {len(graphs)} graphs, expected one")
    codes = [_operator_name(code) for code in model.tables(1)]
    buffers = model.tables(4)
    return TfliteFile(
        tensors=tuple(_tensor(tensor, buffers) for tensor in graphs[0].tables(0)),
        operators=tuple(_operator(operator, codes) for operator in graphs[0].tables(3)),
        inputs=graphs[0].numbers(1),
        outputs=graphs[0].numbers(2),
    )


def _operator_name(code: _Table) -> str:
    number = max(code.number(3, _INT), code.number(0, _BYTE))
    if number not in _OPERATORS:
        raise ValueError(f"has an operator that tcfit does not know (number {number}, {code.text(1) or 'built in'})")
    return _OPERATORS[number]


def _operator(operator: _Table, codes: list[str]) -> Operator:
    name, table = codes[operator.number(0, _OFFSET)], operator.table(4)
    options = {
        option: table.number(index, form, usual) if table else usual
        for option, (index, form, usual) in _OPTIONS.get(name, {}).items()
    }
    return Operator(name=name, inputs=operator.numbers(1), outputs=operator.numbers(2), options=options)


def _tensor(tensor: _Table, buffers: list[_Table]) -> TfliteTensor:
    shape, sparsity = tensor.numbers(0), tensor.table(6)
    content = buffers[tensor.number(2, _OFFSET)].array(0, np.uint8)
    constant = None
    if len(content):
        values = content.view(_TYPES[tensor.number(1, _BYTE)])
        constant = _dense(values, shape, sparsity) if sparsity else values.reshape(shape)
    return TfliteTensor(name=tensor.text(3), shape=shape, constant=constant)


def _dense(values: np.ndarray, shape: tuple[int, ...], sparsity: _Table) -> np.ndarray:
    """A sparse tensor with its zeros.

    Its dimensions are gone through in an order of their own, each dense or as a list of indices, and some of them once
    more within small blocks (Kjolstad et al., The tensor algebra compiler, 2017).
    """
    order, block_map, levels = sparsity.numbers(0), sparsity.numbers(1), sparsity.tables(2)
    rank = len(shape)
    blocks = [levels[order.index(rank + k)].number(1, _INT) for k in range(len(block_map))]
    at, indices = np.zeros(1, int), np.zeros((1, 0), int)
    for level in levels:
        at, indices = _next_level(level, at, indices)
    if len(at) != len(values):
        raise ValueError(f"has a sparse tensor of {len(values)} values, expected {len(at)}")
    where = np.zeros((len(at), rank), int)
    for dimension, index in zip(order, indices.T, strict=True):
        if dimension < rank:
            where[:, dimension] += index * (blocks[block_map.index(dimension)] if dimension in block_map else 1)
        else:
            where[:, block_map[dimension - rank]] += index
    dense = np.zeros(shape, values.dtype)
    dense[tuple(where.T)] = values[at]
    return dense


def _next_level(level: _Table, at: np.ndarray, indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each entry of a level is stored, and its indices with those of the levels above it."""
    if level.number(0, _BYTE) == _COMPRESSED:
        segments, listed = _index_list(level, 2, 3), _index_list(level, 4, 5)
        counts = segments[at + 1] - segments[at]
        starts = np.repeat(segments[at] - np.cumsum(counts) + counts, counts)
        places = starts + np.arange(counts.sum())
        last = listed[places]
    else:
        size = level.number(1, _INT)
        counts = np.full(len(at), size)
        last = np.tile(np.arange(size), len(at))
        places = np.repeat(at * size, size) + last
    return places, np.concatenate([np.repeat(indices, counts, axis=0), last[:, None]], axis=1)


def _index_list(level: _Table, kind: int, index: int) -> np.ndarray:
    table = level.table(index)
    if table is None:
        raise ValueError("has a sparse tensor without its indices")
    return table.array(0, _INDEX_TYPES[level.number(kind, _BYTE)]).astype(int)
