"""Read the arrays of a pickled body model without running what the pickle asks for.

Body models come as pickles of Python 2 and 3 that hold numpy arrays, scipy sparse matrices and chumpy arrays. The
unpickler below admits these and plain containers by name and refuses everything else; sparse and chumpy objects become
stand-ins that only keep their state, so neither chumpy nor a scipy of the file's time is needed.
"""

import pickle
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, BinaryIO

import numpy as np
import scipy.sparse

from fitting_core.errors import InputError

MAX_ELEMENTS = 2**28
"""Elements of the largest matrix that a stand-in may unfold to, 2 GB of float64; a body needs some 16 million."""


class _Kept:
    """Stands in for an object of a library that is not needed: keeps the state, runs nothing of it."""

    title = "chumpy array"

    def __init__(self, *arguments: object) -> None:
        self.state: dict[str, Any] = {}

    def __setstate__(self, state: object) -> None:
        self.state = dict(state) if isinstance(state, dict) else {}

    def array(self) -> np.ndarray:
        raise NotImplementedError


class _Chumpy(_Kept):
    """A chumpy array that holds its numbers."""

    def array(self) -> np.ndarray:
        return as_array(self.state["x"])


class _ChumpySelection(_Kept):
    """Elements of another chumpy array: how SMPL files cut their shape directions to 10."""

    def array(self) -> np.ndarray:
        selected = as_array(self.state["a"]).reshape(-1)[as_array(self.state["idxs"])]
        return selected.reshape(tuple(int(n) for n in self.state.get("preferred_shape", selected.shape)))


class _ChumpyExpression(_Kept):
    """Any other chumpy object: what models hold for their own computations (J, v_posed), never read here."""

    def array(self) -> np.ndarray:
        raise InputError("a chumpy expression that would have to be computed, expected numbers")


class _Sparse(_Kept):
    """A scipy sparse matrix of compressed or coordinate form."""

    title = "sparse matrix"
    layout: Callable[..., Any]

    def array(self) -> np.ndarray:
        shape = tuple(int(n) for n in self.state.get("_shape", self.state.get("shape", ())))
        if len(shape) != 2 or min(shape) < 0 or shape[0] * shape[1] > MAX_ELEMENTS:
            raise InputError(f"a sparse matrix of shape {shape}, expected two sides, at most {MAX_ELEMENTS} elements")
        matrix = type(self).layout(self._parts(), shape=shape)
        # Compressed forms do not check their indices otherwise, and an index outside would write outside the array.
        matrix.check_format(full_check=True)
        return matrix.toarray()

    def _parts(self) -> tuple[Any, ...]:
        return tuple(np.asarray(self.state[k]) for k in ("data", "indices", "indptr"))


class _Csc(_Sparse):
    layout = scipy.sparse.csc_matrix


class _Csr(_Sparse):
    layout = scipy.sparse.csr_matrix


class _Coo(_Sparse):
    @staticmethod
    def layout(parts: tuple[Any, ...], *, shape: tuple[int, ...]) -> Any:
        return scipy.sparse.coo_matrix(parts, shape=shape).tocsr()

    def _parts(self) -> tuple[Any, ...]:
        coordinates = self.state["coords"] if "coords" in self.state else (self.state["row"], self.state["col"])
        return np.asarray(self.state["data"]), tuple(np.asarray(c) for c in coordinates)


def as_array(value: object) -> np.ndarray:
    """Numbers of an unpickled value: an array, a list of numbers, a sparse matrix (dense here) or a chumpy array.

    Raises:
        InputError: A stand-in whose state is not understood; the message starts with what it holds.
    """
    if not isinstance(value, _Kept):
        return np.asarray(value)
    try:
        return value.array()
    except (KeyError, ValueError, TypeError, IndexError, RecursionError) as error:
        raise InputError(f"a {value.title} that is damaged ({error})") from error


def _empty_array(*_: object) -> np.ndarray:
    """What numpy's _reconstruct does, without the choice of type and size: the state that follows brings both."""
    return np.ndarray.__new__(np.ndarray, (0,), "b")


def _array_from_buffer(buffer: Any, dtype: np.dtype, shape: tuple[int, ...], order: str) -> np.ndarray:
    return np.frombuffer(buffer, dtype=dtype).reshape(shape, order="F" if order == "F" else "C")


def _scalar(dtype: np.dtype, data: Any = b"") -> Any:
    """A numpy scalar from its bytes; Python 2 wrote them as a latin-1 string."""
    return np.frombuffer(data.encode("latin1") if isinstance(data, str) else data, dtype=dtype)[0]


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """How Python 3 writes bytes into pickles of protocol 2 and older."""
    if encoding != "latin1":
        raise pickle.UnpicklingError(f"bytes in the encoding {encoding}")
    return text.encode("latin1")


def _new(cls: type, *_: object) -> object:
    """How old protocols make an object of a class: only stand-ins are made so."""
    if not issubclass(cls, _Kept):
        raise pickle.UnpicklingError(f"an object of the class {cls.__name__}")
    return cls()


_MULTIARRAY = ("numpy.core.multiarray", "numpy._core.multiarray")
_NUMERIC = ("numpy.core.numeric", "numpy._core.numeric")
_SPARSE: dict[str, type] = {"csc": _Csc, "csr": _Csr, "coo": _Coo}
_ADMITTED: dict[tuple[str, str], Callable[..., Any]] = {
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    **{(module, "_reconstruct"): _empty_array for module in _MULTIARRAY},
    **{(module, "scalar"): _scalar for module in _MULTIARRAY},
    **{(module, "_frombuffer"): _array_from_buffer for module in _NUMERIC},
    ("_codecs", "encode"): _encode,
    ("copyreg", "_reconstructor"): _new,
    ("builtins", "object"): object,
    ("builtins", "set"): set,
    ("builtins", "frozenset"): frozenset,
    ("builtins", "bytearray"): bytearray,
    ("collections", "OrderedDict"): OrderedDict,
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


class ArrayUnpickler(pickle.Unpickler):
    """Unpickler that admits arrays, sparse matrices, chumpy arrays and plain containers, and nothing else."""

    def __init__(self, file: BinaryIO) -> None:
        super().__init__(file, encoding="latin1")

    def find_class(self, module: str, name: str) -> Any:
        """The stand-in for what the pickle names.

        Raises:
            InputError: It asks for anything outside the table; the message names it.
        """
        if (module, name) in _ADMITTED:
            return _ADMITTED[module, name]
        if module.split(".")[0] == "chumpy":
            return _ChumpyExpression
        raise InputError(f"the pickle asks for {module}.{name}, which no body model needs and which could run code")

    def persistent_load(self, pid: object) -> Any:
        """Nothing outside the file is loaded.

        Raises:
            InputError: Always.
        """
        raise InputError(f"the pickle refers to an object outside the file ({pid!r:.40})")


def read_pickle(file: BinaryIO) -> dict[str, Any]:
    """The dictionary that a pickle holds; its values go through `as_array`.

    Raises:
        InputError: The pickle is damaged, asks for something that is not admitted, or holds no dictionary.
    """
    try:
        content = ArrayUnpickler(file).load()
    except InputError:
        raise
    # A damaged or hostile stream can make the unpickler raise nearly anything; all of it means the same to the user.
    except Exception as error:
        raise InputError(f"the pickle cannot be read, it is damaged or incomplete ({error})") from error
    if not isinstance(content, dict):
        raise InputError(f"the pickle holds a {type(content).__name__}, expected a dictionary of arrays")
    return {str(key): value for key, value in content.items()}
