"""Read the arrays of a pickle, such as a body model's, without running what the pickle asks for.

Body models come as pickles of Python 2 and 3 that hold numpy arrays, scipy sparse matrices and chumpy arrays. The
unpickler below admits these and plain containers by name and refuses everything else. All of them become stand-ins that
only keep their state until `as_array` checks and unfolds it: neither chumpy nor a scipy of the file's time is needed.
"""

import io
import pickle
import re
from collections.abc import Callable
from typing import Any, BinaryIO

import numpy as np

from fitting_core.errors import InputError
from fitting_core.files.restricted_pickle import Kept, RestrictedUnpickler, Stream, mapping

MAX_ELEMENTS = 2**28
"""Elements of the largest matrix that a stand-in may unfold to, 2 GB of float64; a body needs some 16 million."""
MAX_BYTES = 4 * 2**30
"""Of the largest body model file that is read, unpacked; SMPL-X's has some 0.5 GB."""
_MAX_DEPTH = 16
"""Of lists in lists; an array has 3."""


class _Dtype(Kept):
    """A numpy dtype: its code, and its byte order as the state that follows tells it."""

    title = "dtype"

    def __init__(self, code: object = "", *_: object) -> None:
        super().__init__()
        # Not str(code): the text of a list that holds itself often has no end.
        self.code, self._order = code if isinstance(code, str) else "", "="

    def __setstate__(self, state: object) -> None:
        if isinstance(state, tuple) and len(state) > 1 and state[1] in ("<", ">", "|", "="):
            self._order = state[1]

    def numpy(self) -> np.dtype:
        """The plain dtype. Raises InputError if it holds neither numbers nor text."""
        if not re.fullmatch(r"[<>|=]?[biufSU]\d+", self.code):
            raise InputError(f"of the type '{self.code}', expected numbers")
        return np.dtype(self._order + self.code.lstrip("<>|="))


class _Array(Kept):
    """A numpy array: shape, dtype, order and bytes; numpy's own unpickling would trust them unseen."""

    title = "numpy array"

    def __setstate__(self, state: object) -> None:
        if isinstance(state, tuple) and len(state) == 5:
            self.state = dict(zip(("shape", "dtype", "fortran", "data"), state[1:], strict=True))

    def array(self) -> np.ndarray:
        dtype = self.state["dtype"].numpy()
        flat = np.frombuffer(_bytes(self.state["data"]), dtype)
        return flat.reshape(self.state["shape"], order="F" if self.state["fortran"] else "C").copy()


class _Chumpy(Kept):
    """A chumpy array that holds its numbers."""

    title = "chumpy array"

    def array(self) -> np.ndarray:
        return as_array(self.state["x"])


class _ChumpySelection(Kept):
    """Elements of another chumpy array: how SMPL files cut their shape directions to 10."""

    title = "chumpy array"

    def array(self) -> np.ndarray:
        selected = as_array(self.state["a"]).reshape(-1)[as_array(self.state["idxs"])]
        return selected.reshape(tuple(int(n) for n in self.state.get("preferred_shape", selected.shape)))


class _ChumpyExpression(Kept):
    """Any other chumpy object: what models hold for their own computations (J, v_posed), never read here."""

    def array(self) -> np.ndarray:
        raise InputError("a chumpy expression that would have to be computed, expected numbers")


class _Sparse(Kept):
    """A scipy sparse matrix, unfolded by numpy.

    scipy's own compiled code trusts the indices: with a row pointer like (0, 10**9, 0), which passes its full check, it
    reads outside of the arrays.
    """

    title = "sparse matrix"

    def array(self) -> np.ndarray:
        shape = tuple(int(n) for n in self.state.get("_shape", self.state.get("shape", ())))
        if len(shape) != 2 or min(shape) < 0 or shape[0] * shape[1] > MAX_ELEMENTS:
            raise InputError(f"a sparse matrix of shape {shape}, expected two sides, at most {MAX_ELEMENTS} elements")
        dense = np.zeros(shape)
        rows, columns, values = self._entries()
        if min(rows.min(initial=0), columns.min(initial=0)) < 0:
            raise ValueError("negative indices")
        np.add.at(dense, (rows, columns), values)
        return dense

    def _entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Row, column and value of each entry; entries of the same place add up."""
        raise NotImplementedError

    def _compressed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of compressed forms: the place along the compressed axis, along the other one, and the value."""
        values, other, starts = (as_array(self.state[key]) for key in ("data", "indices", "indptr"))
        counts = np.diff(starts.astype(np.int64))
        entries = int(starts[-1])
        if starts[0] != 0 or counts.min(initial=0) < 0 or entries > min(len(values), len(other)):
            raise ValueError("pointers out of order")
        return np.repeat(np.arange(len(counts)), counts), other[:entries].astype(np.int64), values[:entries]


class _Csc(_Sparse):
    def _entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        columns, rows, values = self._compressed()
        return rows, columns, values


class _Csr(_Sparse):
    def _entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self._compressed()


class _Coo(_Sparse):
    def _entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        coordinates = self.state["coords"] if "coords" in self.state else (self.state["row"], self.state["col"])
        rows, columns = (as_array(c).astype(np.int64) for c in coordinates)
        return rows, columns, as_array(self.state["data"])


def stand_in(module: str, name: str) -> Any:
    """What takes the place of a numpy array, its type or a scalar, by the name in a pickle; None for anything else."""
    return _ADMITTED.get((module, name)) if module.split(".")[0] == "numpy" else None


def as_array(value: object) -> np.ndarray:
    """Numbers of an unpickled value: an array, a list of numbers, a sparse matrix (dense here) or a chumpy array.
    Raises InputError if the state of a stand-in is not understood; the message starts with what it holds."""
    if not isinstance(value, Kept):
        _forbid_endless(value)
        return np.asarray(value)
    try:
        return value.array()
    except InputError:
        raise
    except (KeyError, ValueError, TypeError, IndexError, RecursionError, AttributeError) as error:
        raise InputError(f"a {value.title} that is damaged ({error})") from error


def _forbid_endless(value: object) -> None:
    """Lists that hold one list many times take no space in a pickle, and all memory as an array."""
    known: dict[int, int] = {}

    def elements(part: object, depth: int) -> int:
        if not isinstance(part, list | tuple):
            return 1
        if depth > _MAX_DEPTH:
            raise InputError(f"lists nested more than {_MAX_DEPTH} deep, expected numbers")
        if id(part) not in known:
            known[id(part)] = sum(elements(inner, depth + 1) for inner in part)
        return known[id(part)]

    if (count := elements(value, 0)) > MAX_ELEMENTS:
        raise InputError(f"lists of {count:.3g} elements, expected at most {MAX_ELEMENTS}")


def _array_from_buffer(buffer: object, dtype: _Dtype, shape: tuple[int, ...], order: str) -> _Array:
    array = _Array()
    array.state = {"shape": shape, "dtype": dtype, "fortran": order == "F", "data": buffer}
    return array


def _bytes(data: Any) -> bytes:
    """The bytes of an array; Python 2 wrote them as a string, which is read as latin-1."""
    return data.encode("latin1") if isinstance(data, str) else bytes(memoryview(data))


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """How Python 3 writes bytes into pickles of protocol 2 and older."""
    if encoding != "latin1":
        raise pickle.UnpicklingError(f"bytes in the encoding {encoding}")
    return text.encode("latin1")


def _new(cls: type, *_: object) -> object:
    """How old protocols make an object of a class: only stand-ins are made so."""
    if not issubclass(cls, Kept):
        raise pickle.UnpicklingError(f"an object of the class {cls.__name__}")
    return cls()


_MULTIARRAY = ("numpy.core.multiarray", "numpy._core.multiarray")
_NUMERIC = ("numpy.core.numeric", "numpy._core.numeric")
_BUILTINS = ("builtins", "__builtin__")
_SPARSE: dict[str, type] = {"csc": _Csc, "csr": _Csr, "coo": _Coo}
_ADMITTED: dict[tuple[str, str], Callable[..., Any]] = {
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Dtype,
    # The state that follows fills the array.
    **{(module, "_reconstruct"): lambda *_: _Array() for module in _MULTIARRAY},
    **{(module, "scalar"): lambda dtype, data=b"": _array_from_buffer(data, dtype, (), "C") for module in _MULTIARRAY},
    **{(module, "_frombuffer"): _array_from_buffer for module in _NUMERIC},
    ("_codecs", "encode"): _encode,
    **{(module, "_reconstructor"): _new for module in ("copyreg", "copy_reg")},
    **{(module, name): Kept for module in _BUILTINS for name in ("object", "set", "frozenset")},
    **{(module, "bytes"): lambda: b"" for module in _BUILTINS},
    ("collections", "OrderedDict"): mapping,
    **{
        (module.format(k), f"{k}_{suffix}"): stand_in
        for k, stand_in in _SPARSE.items()
        for module in ("scipy.sparse.{}", "scipy.sparse._{}")
        for suffix in ("matrix", "array")
    },
    ("chumpy", "Ch"): _Chumpy,
    ("chumpy.ch", "Ch"): _Chumpy,
    ("chumpy.reordering", "Select"): _ChumpySelection,
}


class ArrayUnpickler(RestrictedUnpickler):
    """Unpickler that admits arrays, sparse matrices, chumpy arrays and plain containers, and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        """The stand-in for what the pickle names. Raises InputError if it asks for anything outside the table; the
        message names it."""
        if (module, name) in _ADMITTED:
            return _ADMITTED[module, name]
        if module.split(".")[0] == "chumpy":
            return _ChumpyExpression
        raise InputError(
            f"the pickle asks for {f'{module}.{name}':.60}, which no body model needs and which could run code"
        )


def read_pickle(file: BinaryIO) -> dict[str, Any]:
    """The dictionary that a pickle holds; its values go through `as_array`. Raises InputError if the pickle is damaged,
    asks for something that is not admitted, or holds no dictionary.

    Args:
        file: Stands where the pickle begins, which fills the rest of it.
    """
    try:
        start = file.tell()
        size = file.seek(0, io.SEEK_END)
        file.seek(start)
        content = ArrayUnpickler(Stream(file, size, most=MAX_BYTES, line=MAX_BYTES)).load()
        if not isinstance(content, dict):
            raise InputError(f"the pickle holds a {type(content).__name__}, expected a dictionary of arrays")
        return {str(key): value for key, value in content.items()}
    except InputError:
        raise
    # A damaged or hostile stream can make the unpickler raise nearly anything; all of it means the same to the user.
    except Exception as error:
        raise InputError(f"the pickle cannot be read, it is damaged or incomplete ({str(error)[:80]})") from error
