"""Unpickling untrusted files: only whitelisted types are built, no code runs, and memory is bounded."""

import gc
import io
import pickle
from abc import abstractmethod
from collections.abc import Callable, Iterable
from typing import Any, BinaryIO, ClassVar

from fitting_core.errors import InputError

Load = Callable[[], bytes]
"""Gives bytes that were left in a file."""
_MOST = 2**23
"""Of a file's objects, and of its other codes. Containers, texts and numbered objects of a byte each take a hundred in
memory, 1 GB in all; other codes take a millionth of a second each, and a packed 0.3 MB could hold 300 million."""
_BYTES = 128
"""Of what may be read, for each object and for each other code. Results have arrays beside them."""
_LINE = 2**16


class Stream:
    """A file read from front to back. It has no `peek`: an unpickler must not read ahead of arrays in the file.

    Args:
        file: Opened for reading.
        size: Bytes that it has; None: it is unpacked as it is read, and cannot go back.
        most: Bytes that are read into memory.
        line: Bytes of a line; pickles of protocol 0 have arrays in one.
    """

    def __init__(self, file: BinaryIO, size: int | None, *, most: int, line: int = _LINE) -> None:
        self._file, self._size, self._most, self._line = file, size, most, line
        self.left = most
        """Bytes that may still be read into memory."""
        self.counted_most = min(most // _BYTES, _MOST)
        """Objects, and other codes, that the pickles in it may have."""
        self.counts = {"objects": 0, "codes": 0}
        """Number of objects so far."""

    def read(self, count: int) -> bytes:
        """Read `count` bytes, or the rest. Raises InputError above the limit of a file."""
        if count > _LINE and self._size is not None:
            count = min(count, max(self._size - self._file.tell(), 0))
        if count > self.left:
            raise InputError(f"holds more than {self._most / 2**30:.1f} GB, which no result of its size does")
        data = self._file.read(count)
        self.left -= len(data)
        return data

    def readline(self) -> bytes:
        """Up to the end of a line."""
        data = self._file.readline(min(self._line, self.left))
        self.left -= len(data)
        return data

    def take(self, count: int) -> Load:
        """The next `count` bytes: in memory if the file is packed, otherwise read from the file on demand.
        Raises InputError if the file ends before."""
        if self._size is None:
            data = self.read(count)
            if len(data) < count:
                raise InputError(f"ends in an array of {count} bytes; it was cut off")
            return lambda: data
        start = self._file.tell()
        if count > self._size - start:
            raise InputError(f"ends in an array of {count} bytes; it was cut off")
        self._file.seek(count, io.SEEK_CUR)

        def load() -> bytes:
            self._file.seek(start)
            return self._file.read(count)

        return load


class Kept:
    """Stands in for an object of a library that is not needed: keeps the state, runs nothing of it."""

    title = "object"

    def __init__(self, *arguments: object) -> None:
        self.state: dict[str, Any] = {}

    def __setstate__(self, state: object) -> None:
        self.state = dict(state) if isinstance(state, dict) else {}

    def array(self) -> Any:
        """Its numbers, as an array of numpy."""
        raise NotImplementedError


_PLAIN = (str, bytes, int, float, type(None), Kept, type)
"""What keys may be: nothing that is hashed by what it holds."""


def mapping(entries: object = (), *_: object) -> dict[Any, Any]:
    """A dictionary of any kind, begun with these pairs; more may follow. Raises InputError if a key is not one that
    `RestrictedUnpickler` allows."""
    found: dict[Any, Any] = {}
    for pair in entries if isinstance(entries, list | tuple) else ():
        if isinstance(pair, list | tuple) and len(pair) == 2:
            _put(found, *pair)
    return found


class RestrictedUnpickler(pickle._Unpickler):
    """Unpickler that makes what `find_class` admits and plain containers, and nothing else.

    It is Python's own in Python: the one in C reads ahead, allocates memory for any memo number, and cannot be
    restricted. Keys are names, numbers and stand-ins: a tuple could hold itself so often that
    its hash takes for ever. Sets, whose elements are hashed too, become a stand-in without them. Nothing of the file
    becomes an attribute of an object that is not a stand-in.
    """

    def __init__(self, stream: Stream) -> None:
        super().__init__(stream, encoding="latin1")  # pyright: ignore[reportArgumentType]
        self.stream = stream
        self.stack: list[Any]

    def load(self) -> Any:
        """Read the next pickle. Looking for garbage meanwhile would take as long again: each object may still be
        wanted."""
        looking = gc.isenabled()
        gc.disable()
        try:
            return super().load()
        finally:
            if looking:
                gc.enable()

    @abstractmethod
    def find_class(self, module: str, name: str) -> Any:
        """What stands for what the pickle names; or raises InputError, which says what that is."""

    def persistent_load(self, pid: object) -> Any:
        """What lies outside the pickle; raises InputError where nothing may."""
        raise InputError(f"the pickle refers to an object outside the file (a {type(pid).__name__})")

    def built(self, stand_in: Kept) -> object:
        """What becomes of a stand-in that has its state."""
        return stand_in

    def _build(self) -> None:
        state, instance = self.stack.pop(), self.stack[-1]
        if isinstance(instance, Kept):
            instance.__setstate__(state)
            self.stack[-1] = self.built(instance)

    def _set_item(self) -> None:
        value, key = self.stack.pop(), self.stack.pop()
        _put(self.stack[-1], key, value)

    def _set_items(self) -> None:
        self._put_all(self.stack_of_mark())

    def _dict(self) -> None:
        items = self.stack_of_mark()
        self.stack.append({})
        self._put_all(items)

    def _put_all(self, items: list[Any]) -> None:
        for key, value in zip(items[::2], items[1::2], strict=True):
            _put(self.stack[-1], key, value)

    def _bytes(self) -> None:
        count = int.from_bytes(self._exactly(8), "little")
        self.stack.append(self._exactly(count))

    def _set(self) -> None:
        self.stack.append(Kept())

    def _frozen_set(self) -> None:
        self.stack_of_mark()
        self._set()

    def stack_of_mark(self) -> list[Any]:
        """Pop the objects above the last mark, and the mark."""
        return self.pop_mark()  # pyright: ignore[reportAttributeAccessIssue]

    def _exactly(self, count: int) -> bytes:
        if len(data := self.read(count)) < count:  # pyright: ignore[reportAttributeAccessIssue]
            raise EOFError("the pickle ends early")
        return data

    dispatch: ClassVar[dict[int, Any]] = {
        **pickle._Unpickler.dispatch,
        pickle.BUILD[0]: _build,
        pickle.SETITEM[0]: _set_item,
        pickle.SETITEMS[0]: _set_items,
        pickle.DICT[0]: _dict,
        pickle.EMPTY_SET[0]: _set,
        pickle.ADDITEMS[0]: stack_of_mark,
        pickle.FROZENSET[0]: _frozen_set,
        pickle.BYTEARRAY8[0]: _bytes,
    }


def _put(target: object, key: object, value: object) -> None:
    if isinstance(target, Kept):  # a mapping of a kind that is not needed
        return
    if not isinstance(target, dict) or not isinstance(key, _PLAIN):
        raise InputError(f"has an entry under a {type(key).__name__}, expected names and numbers")
    target[key] = value


def _counted(objects: Iterable[bytes]) -> None:
    """Let all of a pickle's codes count, these as objects."""
    makers = {code[0] for code in objects}

    def counting(kind: str, handler: Callable[[RestrictedUnpickler], None]) -> Callable[[RestrictedUnpickler], None]:
        def load(self: RestrictedUnpickler) -> None:
            stream = self.stream
            stream.counts[kind] += 1
            if stream.counts[kind] > stream.counted_most:
                raise InputError(
                    f"the pickle holds more than {stream.counted_most} {kind}, expected those of a clip or a body"
                )
            handler(self)

        return load

    for code, handler in RestrictedUnpickler.dispatch.items():
        RestrictedUnpickler.dispatch[code] = counting("objects" if code in makers else "codes", handler)


_counted((
    pickle.EMPTY_LIST, pickle.LIST, pickle.EMPTY_DICT, pickle.DICT, pickle.EMPTY_SET, pickle.FROZENSET,
    pickle.TUPLE, pickle.TUPLE1, pickle.TUPLE2, pickle.TUPLE3, pickle.REDUCE, pickle.NEWOBJ, pickle.NEWOBJ_EX,
    pickle.OBJ, pickle.INST, pickle.MARK, pickle.PUT, pickle.BINPUT, pickle.LONG_BINPUT, pickle.MEMOIZE,
    pickle.STRING, pickle.BINSTRING, pickle.SHORT_BINSTRING, pickle.UNICODE, pickle.BINUNICODE,
    pickle.SHORT_BINUNICODE, pickle.BINUNICODE8, pickle.BINBYTES, pickle.SHORT_BINBYTES, pickle.BINBYTES8,
    pickle.LONG, pickle.LONG1, pickle.LONG4,
))  # fmt: skip
