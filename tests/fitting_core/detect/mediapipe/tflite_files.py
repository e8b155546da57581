"""Small .tflite networks, written for tests: as TensorFlow Lite reads them, and for any numbers."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import flatbuffers
import numpy as np

IMAGES = 0
"""The number of the input's tensor."""
TYPES = {np.float32: 0, np.float16: 1, np.int32: 2, np.uint8: 3, np.int64: 4}
OPTION_KINDS = {3: 1, 4: 2, 17: 5, 9: 8, 2: 10, 0: 11, 22: 17, 5: 94, 40: 27, 45: 32, 23: 15, 34: 22}
"""An operator's number -> that of the form of its options."""
_PREPENDED = {np.int8: "PrependInt8Slot", np.int32: "PrependInt32Slot", np.uint32: "PrependUint32Slot"}


@dataclass(frozen=True, kw_only=True)
class Level:
    """A dimension of a sparse tensor: dense, or a list of indices."""

    size: int = 0
    segments: Sequence[int] | None = None
    indices: Sequence[int] = ()


@dataclass(frozen=True, kw_only=True)
class Sparsity:
    """How a sparse tensor is stored."""

    order: Sequence[int]
    blocks: Sequence[int] = ()
    levels: Sequence[Level]


@dataclass
class TfliteWriter:
    """A network, as far as it is made. Tensor 0 is the images.

    Args:
        size: Height, width and channels of the images.
    """

    size: tuple[int, int, int]
    tensors: list[tuple[str, Sequence[int], np.ndarray | None, Sparsity | None, type]] = field(default_factory=list)
    operators: list[tuple[int, Sequence[int], Sequence[int], dict[int, tuple[type, int]]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.computed("images", (1, *self.size))

    def computed(self, name: str, shape: Sequence[int]) -> int:
        """The number of a tensor that an operator gives."""
        self.tensors.append((name, shape, None, None, np.float32))
        return len(self.tensors) - 1

    def constant(
        self, content: np.ndarray, *, shape: Sequence[int] | None = None, sparsity: Sparsity | None = None
    ) -> int:
        """The number of a tensor of known content; of a sparse one, `content` has what is stored."""
        shape = content.shape if shape is None else shape
        self.tensors.append((f"constant {len(self.tensors)}", shape, content, sparsity, content.dtype.type))
        return len(self.tensors) - 1

    def step(self, number: int, inputs: Sequence[int], shape: Sequence[int], **options: int) -> int:
        """Add an operator; fN=value is its byte option of field N, iN=value one of 32 bits.

        Returns:
            The number of what it gives, which is called after its own.
        """
        output = self.computed(f"step {len(self.operators)}", shape)
        kinds = {"f": np.int8, "i": np.int32}
        told = {int(name[1:]): (kinds[name[0]], value) for name, value in options.items()}
        self.operators.append((number, inputs, [output], told))
        return output

    def write(self, path: Path, outputs: Sequence[int]) -> Path:
        """Write the file."""
        path.write_bytes(self.content(outputs))
        return path

    def content(self, outputs: Sequence[int]) -> bytes:
        """The file's content."""
        builder = flatbuffers.Builder(1024)
        codes = sorted({operator[0] for operator in self.operators})
        buffers = [self._table(builder, {})]
        tensors = [self._tensor(builder, tensor, buffers) for tensor in self.tensors]
        operators = [self._operator(builder, operator, codes) for operator in self.operators]
        graph = {
            0: _tables(builder, tensors),
            1: _numbers(builder, [IMAGES]),
            2: _numbers(builder, outputs),
            3: _tables(builder, operators),
        }
        graphs = _tables(builder, [self._table(builder, graph)])
        names = _tables(builder, [_code(builder, code) for code in codes])
        stored = _tables(builder, buffers)
        builder.StartObject(8)
        builder.PrependUint32Slot(0, 3, 0)
        for slot, offset in ((1, names), (2, graphs), (4, stored)):
            builder.PrependUOffsetTRelativeSlot(slot, offset, 0)
        builder.Finish(builder.EndObject(), file_identifier=b"TFL3")
        return bytes(builder.Output())

    def _tensor(self, builder: flatbuffers.Builder, tensor: tuple, buffers: list[int]) -> int:
        name, shape, content, sparsity, kind = tensor
        number = 0
        if content is not None:
            number = len(buffers)
            data = builder.CreateNumpyVector(np.frombuffer(content.tobytes(), np.uint8))
            buffers.append(self._table(builder, {0: data}))
        title, lengths = builder.CreateString(name), _numbers(builder, shape)
        stored = _sparsity(builder, sparsity) if sparsity else 0
        builder.StartObject(8)
        builder.PrependUOffsetTRelativeSlot(0, lengths, 0)
        builder.PrependInt8Slot(1, TYPES[kind], 0)
        builder.PrependUint32Slot(2, number, 0)
        builder.PrependUOffsetTRelativeSlot(3, title, 0)
        builder.PrependUOffsetTRelativeSlot(6, stored, 0)
        return builder.EndObject()

    def _operator(self, builder: flatbuffers.Builder, operator: tuple, codes: list[int]) -> int:
        number, inputs, outputs, told = operator
        given, results = _numbers(builder, inputs), _numbers(builder, outputs)
        builder.StartObject(8)
        for slot, (kind, value) in told.items():
            getattr(builder, _PREPENDED[kind])(slot, value, 0)
        options = builder.EndObject()
        builder.StartObject(8)
        builder.PrependUint32Slot(0, codes.index(number), 0)
        builder.PrependUOffsetTRelativeSlot(1, given, 0)
        builder.PrependUOffsetTRelativeSlot(2, results, 0)
        if number in OPTION_KINDS:
            builder.PrependUint8Slot(3, OPTION_KINDS[number], 0)
            builder.PrependUOffsetTRelativeSlot(4, options, 0)
        return builder.EndObject()

    @staticmethod
    def _table(builder: flatbuffers.Builder, offsets: dict[int, int]) -> int:
        builder.StartObject(5)
        for slot, offset in offsets.items():
            builder.PrependUOffsetTRelativeSlot(slot, offset, 0)
        return builder.EndObject()


def _code(builder: flatbuffers.Builder, number: int) -> int:
    builder.StartObject(4)
    builder.PrependInt8Slot(0, min(number, 127), 0)
    builder.PrependInt32Slot(2, 1, 0)
    builder.PrependInt32Slot(3, number, 0)
    return builder.EndObject()


def _numbers(builder: flatbuffers.Builder, values: Sequence[int]) -> int:
    return builder.CreateNumpyVector(np.array(values, np.int32))


def _tables(builder: flatbuffers.Builder, offsets: Sequence[int]) -> int:
    builder.StartVector(4, len(offsets), 4)
    for offset in reversed(offsets):
        builder.PrependUOffsetTRelative(offset)
    return builder.EndVector()


def _sparsity(builder: flatbuffers.Builder, sparsity: Sparsity) -> int:
    levels = _tables(builder, [_level(builder, level) for level in sparsity.levels])
    order, blocks = _numbers(builder, sparsity.order), _numbers(builder, sparsity.blocks)
    builder.StartObject(3)
    for slot, offset in enumerate((order, blocks, levels)):
        builder.PrependUOffsetTRelativeSlot(slot, offset, 0)
    return builder.EndObject()


def _level(builder: flatbuffers.Builder, level: Level) -> int:
    lists = []
    if level.segments is not None:
        for values, kind in ((level.segments, np.uint8), (level.indices, np.uint16)):
            vector = builder.CreateNumpyVector(np.array(values, kind))
            builder.StartObject(1)
            builder.PrependUOffsetTRelativeSlot(0, vector, 0)
            lists.append(builder.EndObject())
    builder.StartObject(6)
    builder.PrependInt8Slot(0, int(bool(lists)), 0)
    builder.PrependInt32Slot(1, level.size, 0)
    if lists:
        builder.PrependUint8Slot(2, 3, 0)
        builder.PrependUOffsetTRelativeSlot(3, lists[0], 0)
        builder.PrependUint8Slot(4, 2, 0)
        builder.PrependUOffsetTRelativeSlot(5, lists[1], 0)
    return builder.EndObject()
