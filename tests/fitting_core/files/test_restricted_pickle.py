"""The one unpickler for strangers' files: what it counts, and what it makes of plain content."""

import io
import pickle
from typing import Any

import pytest

from fitting_core.errors import InputError
from fitting_core.files import restricted_pickle
from fitting_core.files.restricted_pickle import RestrictedUnpickler, Stream


class Plain(RestrictedUnpickler):
    """Admits nothing by name."""

    def find_class(self, module: str, name: str) -> Any:
        raise InputError(f"asks for {module}.{name}")


def unpickled(data: bytes) -> Any:
    return Plain(Stream(io.BytesIO(data), len(data), most=2**20)).load()


CONTENT = {"a": [1, 2.5, None, True, ("b", b"c")], 7: {"d": "ü" * 300}, "e": (1, 2, 3, 4), "f": -(2**70)}


@pytest.mark.parametrize("protocol", range(2, pickle.HIGHEST_PROTOCOL + 1))
def test_plain_content_is_what_it_was(protocol: int):
    if protocol > 2:  # which names a function that makes bytes
        assert unpickled(pickle.dumps(CONTENT, protocol)) == CONTENT
    text = {"a": [1, 2.5, ("b",)], "c": {}}
    assert unpickled(pickle.dumps(text, protocol)) == text


@pytest.mark.parametrize(
    "code", [b"]", b"}", b"\x8f", b"\x85", b"(", b"\x8c\x02ab", b"\x94", b"q\x01", b"\x8a\x09" + b"9" * 9]
)
def test_objects_are_counted(monkeypatch: pytest.MonkeyPatch, code: bytes):
    """Whatever takes more memory than it has bytes."""
    monkeypatch.setattr(restricted_pickle, "_MOST", 100)
    assert unpickled(b"\x80\x04N" + code * 100 + b"N.") is None
    with pytest.raises(InputError, match="holds more than 100 objects"):
        unpickled(b"\x80\x04N" + code * 101 + b"N.")


@pytest.mark.parametrize("code", [b"N0", b"K\x000", b"0N", b"\x89N00"])
def test_codes_that_make_nothing_are_counted(monkeypatch: pytest.MonkeyPatch, code: bytes):
    """They take no memory, and the time of hundreds of millions from a small packed file."""
    monkeypatch.setattr(restricted_pickle, "_MOST", 100)
    assert unpickled(b"\x80\x04N" + code * 20 + b".") is None
    with pytest.raises(InputError, match="holds more than 100 codes"):
        unpickled(b"\x80\x04N" + code * 100 + b".")


def test_a_small_packed_file_has_fewer_objects():
    stream = Stream(io.BytesIO(b"\x80\x04N" + b"]" * 9 + b"."), None, most=128 * 8)
    with pytest.raises(InputError, match="holds more than 8 objects"):
        Plain(stream).load()


def test_no_more_is_read_than_may_be():
    with pytest.raises(InputError, match="holds more than"):
        unpickled(b"\x80\x04B" + (2**21).to_bytes(4, "little") + bytes(2**21) + b".")
