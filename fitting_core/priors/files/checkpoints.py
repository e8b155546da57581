"""Read the tensors of a torch checkpoint without running what its pickle asks for. Imports no torch.

torch.save writes a pickle that refers to storages of numbers: members of a zip beside it or, before torch 1.6, bytes
behind it. Lightning adds objects of its own. The unpickler below makes tensors and plain containers, and of everything
else an inert stand-in: no class or function that the file names is ever looked up. torch.load would not do: with
weights_only=True it refuses Lightning's objects, and before torch 2.6 even that could run code (CVE-2025-32434).
"""

import io
import math
import struct
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

from fitting_core.errors import InputError
from fitting_core.files.restricted_pickle import Kept, RestrictedUnpickler, Stream, mapping

MAX_COUNT = 2**26
"""Numbers of the largest tensor or storage that is read; VPoser's largest has some 260,000."""
_MOST_BYTES = 2**30
"""Of a checkpoint's pickle, or of one that holds its numbers too."""
_OTHER_ORDER = "it was written on a computer with another byte order; save it again on this one"
_LEGACY_MAGIC = 0x1950A86A20F9469CFC6C
_NUMBERS = {
    "DoubleStorage": "<f8", "FloatStorage": "<f4", "HalfStorage": "<f2", "LongStorage": "<i8", "IntStorage": "<i4",
    "ShortStorage": "<i2", "CharStorage": "<i1", "ByteStorage": "<u1", "BoolStorage": "?",
}  # fmt: skip


@dataclass(frozen=True)
class Storage:
    """Numbers that tensors look at: which of the file's, of what type, and how many."""

    key: str
    dtype: np.dtype
    count: int


@dataclass(frozen=True)
class StoredTensor:
    """A tensor: which numbers of a storage it looks at. They are read when they are asked for."""

    storage: Storage
    offset: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]


class Foreign(Kept):
    """Stands in for an object of a class that is not needed: takes whatever the pickle does to it and does nothing."""

    def __init__(self, *_: object, **__: object) -> None:
        super().__init__()

    def __setstate__(self, _: object) -> None: ...

    def append(self, _: object) -> None:
        """As lists have it."""

    def extend(self, _: object) -> None:
        """As lists have it."""


def _tensor(storage: object, offset: int, shape: tuple[int, ...], strides: tuple[int, ...], *_: object) -> object:
    """How torch's pickles make a tensor."""
    if not isinstance(storage, Storage):
        return Foreign()
    if len(shape) != len(strides):
        raise InputError(f"a tensor of shape {shape} has {len(strides)} strides")
    return StoredTensor(storage, int(offset), tuple(map(int, shape)), tuple(map(int, strides)))


def _parameter(data: object, *_: object) -> object:
    """How torch's pickles make a trained parameter."""
    return data


_MADE: dict[tuple[str, str], Any] = {
    ("torch._utils", "_rebuild_tensor"): _tensor,
    ("torch._utils", "_rebuild_tensor_v2"): _tensor,
    ("torch._utils", "_rebuild_parameter"): _parameter,
    ("collections", "OrderedDict"): mapping,
    **{("torch", name): np.dtype(code) for name, code in _NUMBERS.items()},
}


class _Unpickler(RestrictedUnpickler):
    def __init__(self, data: BinaryIO, size: int | None = None) -> None:
        super().__init__(Stream(data, size, most=_MOST_BYTES))
        self.storages: dict[str, Storage] = {}

    def find_class(self, module: str, name: str) -> Any:
        """What makes tensors and dictionaries; everything else is foreign."""
        return _MADE.get((module, name), Foreign)

    def persistent_load(self, pid: Any) -> Any:
        """The storage that a tensor names: ("storage", type, key, device, count, ...)."""
        match pid:
            case ("storage", np.dtype() as dtype, str() as key, _, int() as count, *_):
                return self.storages.setdefault(key, Storage(key, dtype, count))
        return Foreign()


@dataclass(frozen=True)
class Checkpoint:
    """What a checkpoint holds, and how to read the numbers of its tensors."""

    content: Any
    read: Callable[[Storage], bytes]

    def tensors(self) -> dict[str, StoredTensor]:
        """Tensors by name: those of its "state_dict", as Lightning has it, or of the checkpoint itself."""
        table = self.content.get("state_dict", self.content) if isinstance(self.content, dict) else {}
        pairs = table.items() if isinstance(table, dict) else ()
        return {name: value for name, value in pairs if isinstance(name, str) and isinstance(value, StoredTensor)}

    def array(self, tensor: StoredTensor) -> np.ndarray:
        """A tensor's numbers.

        Raises:
            InputError: It looks outside of its storage, or the storage is missing or damaged.
        """
        storage, shape = tensor.storage, tensor.shape
        last = tensor.offset + sum((n - 1) * step for n, step in zip(shape, tensor.strides, strict=True))
        sound = min((tensor.offset, *shape, *tensor.strides)) >= 0
        small = max(math.prod(shape), storage.count) <= MAX_COUNT
        if not (sound and small and (last < storage.count or 0 in shape)):
            raise InputError(f"a tensor of shape {shape} does not fit into its {storage.count} numbers")
        with _damage_told("the numbers of a tensor are missing or damaged"):
            flat = np.frombuffer(self.read(storage), storage.dtype, storage.count)
        apart = [step * flat.itemsize for step in tensor.strides]
        return np.lib.stride_tricks.as_strided(flat[tensor.offset :], shape, apart, writeable=False).copy()


@contextmanager
def _damage_told(what: str) -> Iterator[None]:
    """A damaged or hostile file can raise nearly anything; all of it means the same to the user."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{what} ({type(error).__name__}: {error})") from error


def read_checkpoint(data: bytes) -> Checkpoint:
    """A checkpoint that torch.save wrote, in its present form or that before torch 1.6.

    Raises:
        InputError: It is neither, or damaged.
    """
    with _damage_told("it is no checkpoint of torch, or damaged"):
        return _read_zip(data) if zipfile.is_zipfile(io.BytesIO(data)) else _read_legacy(io.BytesIO(data))


def _read_zip(data: bytes) -> Checkpoint:
    archive = zipfile.ZipFile(io.BytesIO(data))
    found = [name for name in archive.namelist() if name.endswith("/data.pkl")]
    if len(found) != 1:
        raise InputError("it is a zip without the data.pkl of a torch checkpoint")
    folder = found[0].removesuffix("data.pkl")
    if f"{folder}byteorder" in archive.namelist() and archive.read(f"{folder}byteorder") != b"little":
        raise InputError(_OTHER_ORDER)

    def read(storage: Storage) -> bytes:
        with archive.open(f"{folder}data/{storage.key}") as stream:
            return stream.read(storage.count * storage.dtype.itemsize)

    with archive.open(found[0]) as stream:
        return Checkpoint(_Unpickler(stream).load(), read)  # pyright: ignore[reportArgumentType]


def _read_legacy(stream: io.BytesIO) -> Checkpoint:
    """Pickles of a magic number, a version, the computer, the content and the storages' keys; then the storages."""
    size = stream.getbuffer().nbytes
    if _Unpickler(stream, size).load() != _LEGACY_MAGIC:
        raise InputError("it is no checkpoint of torch")
    _, computer = (_Unpickler(stream, size).load() for _ in range(2))
    if not computer["little_endian"]:
        raise InputError(_OTHER_ORDER)
    unpickler = _Unpickler(stream, size)
    content, keys, places = unpickler.load(), _Unpickler(stream, size).load(), {}
    for key in keys:
        (count,) = struct.unpack("<q", stream.read(8))
        places[key] = stream.tell()
        stream.seek(places[key] + max(count, 0) * unpickler.storages[key].dtype.itemsize)
    # Storages lie in the order of their addresses, another in each file: the cut-off one may be one nobody asks for.
    if stream.tell() > size:
        raise InputError("its end is missing: copy or download it again")

    def read(storage: Storage) -> bytes:
        stream.seek(places[storage.key])
        return stream.read(storage.count * storage.dtype.itemsize)

    return Checkpoint(content, read)
