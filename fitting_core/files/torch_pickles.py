"""Pickles with numpy arrays, joblib's arrays and torch's tensors in them, read without running what they ask for.

No class or function that a file names is ever looked up. torch.load would not do: with weights_only=True it refuses
objects of Lightning, and before torch 2.6 even that could run code (CVE-2025-32434). Imports no torch.

Sources of the forms: joblib/joblib `joblib/numpy_pickle.py` (a wrapper's state is followed by the array's bytes in the
same file), pytorch/pytorch `torch/serialization.py` and `torch/storage.py` (tensors are views of numbered storages).
"""

import io
import math
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np

from fitting_core.errors import InputError
from fitting_core.files.pickles import MAX_ELEMENTS, as_array, stand_in
from fitting_core.files.restricted_pickle import Kept, Load, RestrictedUnpickler, Stream, mapping

MAX_BYTES = 2 * 2**30
"""Of what is held in memory of one file: pickles themselves, and arrays of packed files."""
_MAX_EXPANDED = 2**24
"""Elements of a tensor that has more than its storage, which it repeats."""
_LEGACY = 0x1950A86A20F9469CFC6C
"""The number that torch's files of before 1.6 begin with."""
_ORDERS = {True: "<", False: ">"}
_BFLOAT16 = "bfloat16"
_STORAGES = {
    "DoubleStorage": "f8", "FloatStorage": "f4", "HalfStorage": "f2", "BFloat16Storage": _BFLOAT16,
    "LongStorage": "i8", "IntStorage": "i4", "ShortStorage": "i2", "CharStorage": "i1", "ByteStorage": "u1",
    "BoolStorage": "b1",
}  # fmt: skip
"""Types of numbers by the names of torch's storages."""


class _Inline(Kept):
    """joblib's NumpyArrayWrapper: what follows in the file is an array."""

    title = "joblib array"

    def read_from(self, stream: Stream) -> object:
        shape, code = _shape(self.state.get("shape")), self.state.get("dtype")
        if getattr(code, "code", "") == "O8":
            return ResultUnpickler(stream).load()
        dtype = code.numpy()  # pyright: ignore[reportOptionalMemberAccess]
        if self.state.get("numpy_array_alignment_bytes") is not None:
            stream.read(int.from_bytes(stream.read(1), "little"))
        return _Later(shape, dtype, self.state.get("order") == "F", stream.take(math.prod(shape) * dtype.itemsize))


class _Later(Kept):
    """An array whose bytes are read on demand."""

    title = "joblib array"

    def __init__(self, shape: tuple[int, ...], dtype: np.dtype, fortran: bool, load: Load) -> None:
        super().__init__()
        self._shape, self._dtype, self._fortran, self._load = shape, dtype, fortran, load

    def array(self) -> np.ndarray:
        if math.prod(self._shape) > MAX_ELEMENTS:
            raise InputError(f"an array of the shape {self._shape}, expected at most {MAX_ELEMENTS} elements")
        return np.frombuffer(self._load(), self._dtype).reshape(self._shape, order="F" if self._fortran else "C").copy()


class Storage:
    """The numbers that tensors are views of."""

    def __init__(self, code: str, count: int, load: Load | None = None, *, order: str = "<") -> None:
        self.code, self.count, self.load, self.order = code, count, load, order

    @property
    def size(self) -> int:
        """Bytes."""
        return self.count * (2 if self.code == _BFLOAT16 else np.dtype(self.code).itemsize)

    def numbers(self) -> np.ndarray:
        """All of them, flat. Raises InputError if the file has fewer."""
        if self.load is None or len(data := self.load()) < self.size:
            raise InputError("a tensor whose numbers are not in the file")
        if self.code == _BFLOAT16:  # the upper half of a float32
            halves = np.frombuffer(data, f"{self.order}u2", self.count).astype(np.uint32)
            return (halves << 16).view(np.float32)
        return np.frombuffer(data, self.order + self.code, self.count)


class StoredTensor(Kept):
    """A tensor: which numbers of a storage it looks at. They are read when they are asked for."""

    title = "tensor"

    def __init__(self, storage: object = None, offset: object = 0, size: object = (), stride: object = ()) -> None:
        super().__init__()
        self.state = {"storage": storage, "offset": offset, "size": size, "stride": stride}

    def array(self) -> np.ndarray:
        """Its numbers."""
        storage = self.state["storage"]
        if not isinstance(storage, Storage):
            raise InputError("a tensor without numbers")
        shape, stride = _shape(self.state["size"]), _shape(self.state["stride"])
        (offset,) = _shape([self.state["offset"]])
        if len(shape) != len(stride) or math.prod(shape) > max(_MAX_EXPANDED, storage.count):
            raise InputError(f"a tensor of the shape {shape} in a storage of {storage.count} numbers")
        steps = [0 if n == 1 else step for n, step in zip(shape, stride, strict=True)]
        last = offset + sum((n - 1) * step for n, step in zip(shape, steps, strict=True))
        if last >= storage.count and 0 not in shape:
            raise InputError(f"a tensor of the shape {shape} in a storage of {storage.count} numbers")
        flat = storage.numbers()[offset:] if 0 not in shape else np.zeros(0, storage.numbers().dtype)
        return np.lib.stride_tricks.as_strided(flat, shape, [step * flat.itemsize for step in steps]).copy()


def _shape(value: object) -> tuple[int, ...]:
    """A shape as it may be. Raises InputError if it is not a shape."""
    if not isinstance(value, list | tuple) or len(value) > 16 or not all(type(n) is int and n >= 0 for n in value):
        raise InputError("an array without a valid shape")
    return tuple(value)


class Foreign(Kept):
    """Stand-in for an object of a class that is not needed: accepts every operation of the pickle and ignores it."""

    def __init__(self, *_: object, **__: object) -> None:
        super().__init__()

    def __setstate__(self, _: object) -> None: ...

    def append(self, _: object) -> None:
        """As lists have it."""

    def extend(self, _: object) -> None:
        """As lists have it."""


def _tensor(storage: object, offset: object, size: object, stride: object, *_: object) -> StoredTensor:
    return StoredTensor(storage, offset, size, stride)


def _first(first: object, *_: object) -> object:
    """A parameter is its tensor; a size is its tuple."""
    return first


def _storage_of_bytes(data: object) -> Storage:
    """A storage in a pickle: a file of torch's older form in a string of bytes."""
    found = legacy(Stream(io.BytesIO(data), len(data), most=MAX_BYTES)) if isinstance(data, bytes) else None
    if not isinstance(found, Storage):
        raise InputError("a tensor whose numbers are not in the file")
    return found


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """How Python 3 writes bytes into pickles of protocol 2."""
    return text.encode("latin1" if encoding == "latin1" else "ascii")


_ADMITTED: dict[tuple[str, str], Any] = {
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): _Inline,
    ("torch._utils", "_rebuild_tensor"): _tensor,
    ("torch._utils", "_rebuild_tensor_v2"): _tensor,
    ("torch._utils", "_rebuild_parameter"): _first,
    ("torch.storage", "_load_from_bytes"): _storage_of_bytes,
    ("torch", "Size"): _first,
    ("collections", "OrderedDict"): mapping,
    ("collections", "defaultdict"): mapping,
    ("builtins", "dict"): mapping,
    ("__builtin__", "dict"): mapping,
    ("_codecs", "encode"): _encode,
    **{("torch", name): Storage(code, 0) for name, code in _STORAGES.items()},
}
"""What results need, beside numpy's arrays."""


class ResultUnpickler(RestrictedUnpickler):
    """Unpickler that admits arrays, tensors and plain containers, and nothing else.

    Args:
        stream: Stands where the pickle begins; stands behind it afterwards.
        storage: Of tensors, by key, type and count; None: no storages beside the pickle.
        foreign: Put `Foreign` in the place of everything else, and do not refuse it.
    """

    def __init__(
        self, stream: Stream, storage: Callable[[str, str, int], Storage] | None = None, *, foreign: bool = False
    ) -> None:
        super().__init__(stream)
        self._storage, self._foreign = storage, foreign

    def find_class(self, module: str, name: str) -> Any:
        """The stand-in for what the pickle names. Raises InputError if it asks for anything outside the table; the
        message names it."""
        found = _ADMITTED.get((module, name)) or stand_in(module, name)
        if found is None and not self._foreign:
            raise InputError(f"asks for {f'{module}.{name}':.60}, which no result needs and which could run code")
        return found or Foreign

    def persistent_load(self, pid: object) -> Storage:
        """A storage beside the pickle. Raises InputError if the pickle refers to anything else."""
        if self._storage is None or not isinstance(pid, tuple) or len(pid) < 5 or pid[0] != "storage":
            raise InputError(f"refers to an object outside the pickle (a {type(pid).__name__})")
        _, kind, key, _, count, *_ = pid
        if not isinstance(kind, Storage) or not isinstance(key, str) or type(count) is not int or count < 0:
            raise InputError("refers to a storage without numbers")
        return self._storage(key, kind.code, count)

    def built(self, stand_in: Kept) -> object:
        """Behind joblib's wrapper of an array lies the array."""
        return stand_in.read_from(self.stream) if isinstance(stand_in, _Inline) else stand_in


def unpickled(stream: Stream) -> Any:
    """What a pickle holds, or a file of torch's older form; arrays and tensors are stand-ins for `as_array`. Raises
    InputError if it is damaged, or asks for something that is not admitted."""
    return _guarded(lambda: legacy(stream))


def of_torch_zip(archive: zipfile.ZipFile, pickled: str, *, foreign: bool = False) -> Any:
    """As `unpickled`, of torch's form since 1.6: `data.pkl`, and each storage as a member `data/<key>`. Raises
    InputError as `unpickled` does.

    Args:
        archive: Stays open as long as tensors may be read.
        pickled: The name of data.pkl in it.
        foreign: See `ResultUnpickler`.
    """
    prefix = pickled.removesuffix("data.pkl")
    members = {member.filename: member for member in archive.infolist()}
    byte_order = members.get(f"{prefix}byteorder")
    order = ">" if byte_order and byte_order.file_size < 16 and archive.read(byte_order) == b"big" else "<"

    def storage(key: str, code: str, count: int) -> Storage:
        found, member = Storage(code, count, order=order), members.get(f"{prefix}data/{key}")
        if member is not None and member.file_size <= MAX_BYTES:

            def load() -> bytes:
                with archive.open(member) as stream:
                    return stream.read(found.size)

            found.load = load
        return found

    with archive.open(pickled) as file:
        stream = Stream(file, None, most=MAX_BYTES)  # pyright: ignore[reportArgumentType]
        return _guarded(ResultUnpickler(stream, storage, foreign=foreign).load)


def checkpoint(data: bytes) -> Any:
    """What a checkpoint of torch.save holds, in either form; objects of classes that are not known become `Foreign`.
    Raises InputError if it is not a checkpoint, or damaged."""

    def load() -> Any:
        file = io.BytesIO(data)
        if zipfile.is_zipfile(file):
            archive = zipfile.ZipFile(file)
            found = [name for name in archive.namelist() if name.endswith("/data.pkl")]
            if len(found) != 1:
                raise InputError("it is a zip without the data.pkl of a torch checkpoint")
            return of_torch_zip(archive, found[0], foreign=True)
        file.seek(0)
        stream = Stream(file, len(data), most=MAX_BYTES)
        if ResultUnpickler(stream, foreign=True).load() != _LEGACY:
            raise InputError("it is not a checkpoint of torch")
        return legacy(stream, _LEGACY, foreign=True)

    return _guarded(load, "it is not a checkpoint of torch, or damaged", but=())


def numbers_of(tensor: StoredTensor) -> np.ndarray:
    """The numbers of a tensor. Raises InputError where they are not in the file, or damaged."""
    return _guarded(lambda: as_array(tensor), "the numbers of a tensor are missing or damaged", but=())


def _guarded(
    load: Callable[[], Any],
    otherwise: str = "cannot be read, it is damaged or incomplete",
    *,
    but: tuple[type[Exception], ...] = (OSError,),
) -> Any:
    try:
        return load()
    except (InputError, *but):
        raise
    # A damaged or hostile stream can make the unpickler raise nearly anything; all of it means the same to the user.
    except Exception as error:
        raise InputError(f"{otherwise} ({str(error)[:80]})") from error


def legacy(stream: Stream, first: object = None, *, foreign: bool = False) -> Any:
    """What a stream holds whose first pickle is `first`: itself, unless torch's older form begins with it.

    That is a number, a version, a description of the computer, the object, the keys of its storages, and these: a count
    of 8 bytes, and numbers.

    Raises:
        InputError: Its storages are not as declared.
    """
    first = ResultUnpickler(stream).load() if first is None else first
    if first != _LEGACY:
        return first
    _, machine = (ResultUnpickler(stream, foreign=foreign).load() for _ in range(2))
    order = _ORDERS[not isinstance(machine, dict) or bool(machine.get("little_endian", True))]
    storages: dict[str, Storage] = {}

    def storage(key: str, code: str, count: int) -> Storage:
        return storages.setdefault(key, Storage(code, count, order=order))

    found, keys = ResultUnpickler(stream, storage, foreign=foreign).load(), ResultUnpickler(stream).load()
    for key in keys if isinstance(keys, list) else []:
        if not isinstance(key, str) or key not in storages:
            raise InputError("declares a storage that no tensor has")
        if int.from_bytes(stream.read(8), "little") != storages[key].count:
            raise InputError("has a storage of another size than it declares")
        storages[key].load = stream.take(storages[key].size)
    return found


def plain(value: object) -> Any:
    """A number of numpy as one of Python; anything else as it is."""
    if isinstance(value, Kept) and (array := as_array(value)).size == 1:
        return array.reshape(()).item()
    return value
