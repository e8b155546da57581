"""The hierarchy of a BVH file without its motion. The rest pose is given by its offsets, with no rotation."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fitting_core.animation.rigs.skeleton import Skeleton
from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file

_MOST = 64 * 2**20
"""Bytes of a BVH that are read for its skeleton."""
_JOINTS = 4096
_CHANNELS = {f"{axis}{kind}" for axis in "XYZ" for kind in ("position", "rotation")}


@dataclass
class _Found:
    """What has been read so far."""

    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float]] = field(default_factory=list)


def read_bvh_skeleton(path: Path) -> Skeleton:
    """Read the joints of a BVH file. Raises InputError if it cannot be read, or its hierarchy is not valid."""
    try:
        text = regular_file(path, most=_MOST).read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}).") from error
    head = re.split(r"^\s*MOTION\s*$", text, maxsplit=1, flags=re.MULTILINE)[0]
    words = iter(head.split())
    found = _Found()
    try:
        _read(words, found)
    except ValueError as error:
        raise InputError(
            f"{path}: is not a readable BVH: {error}. Expected HIERARCHY, ROOT, OFFSET and CHANNELS as any "
            "program writes; export the skeleton again."
        ) from None
    except StopIteration:
        raise InputError(f"{path}: ends in the middle of its hierarchy. Export the skeleton again.") from None
    local = np.tile(np.eye(4), (len(found.names), 1, 1))
    local[:, :3, 3] = found.offsets
    names = tuple(found.names)
    return Skeleton(names=names, parents=np.array(found.parents), local=local, offered=names, source=str(path))


def _read(words: Iterator[str], found: _Found) -> None:
    """Fill `found`; ValueError says what is wrong, StopIteration that the file ended early."""
    if (first := next(words, "")) != "HIERARCHY":
        raise ValueError(f"it begins with {first[:40]!r}, not HIERARCHY")
    above: list[int] = []
    for word in words:
        if word in ("ROOT", "JOINT"):
            if (word == "ROOT") == bool(above):
                raise ValueError(f"{word} stands {'inside' if above else 'outside'} of a joint")
            above.append(_begin(_name(words), above[-1] if above else -1, found))
        elif word == "End":
            _expect(words, "Site")
            _expect(words, "{")
            _expect(words, "OFFSET")
            _inside(above, word)
            _numbers(words)
            _expect(words, "}")
        elif word == "OFFSET":
            found.offsets[_inside(above, word)] = _numbers(words)
        elif word == "CHANNELS":
            _inside(above, word)
            _channels(words)
        elif word == "}":
            _inside(above, word)
            above.pop()
        else:
            raise ValueError(f"it has {word[:40]!r} where a joint or its offset is expected")
    if above:
        raise StopIteration
    if not found.names:
        raise ValueError("it has no joints")


def _name(words: Iterator[str]) -> str:
    """A joint's name and the brace after it: some programs write blanks in names."""
    found = []
    while (word := next(words)) != "{":
        if word in ("OFFSET", "CHANNELS", "}"):
            raise ValueError(f"it has {word!r} where '{{' is expected")
        found.append(word)
    return " ".join(found) or "joint"


def _begin(name: str, parent: int, found: _Found) -> int:
    if len(found.names) >= _JOINTS:
        raise ValueError(f"it has more than {_JOINTS} joints")
    found.names.append(name)
    found.parents.append(parent)
    found.offsets.append([0.0, 0.0, 0.0])
    return len(found.names) - 1


def _inside(above: list[int], word: str) -> int:
    if not above:
        raise ValueError(f"{word!r} stands outside of a joint")
    return above[-1]


def _expect(words: Iterator[str], wanted: str) -> None:
    if (word := next(words)) != wanted:
        raise ValueError(f"it has {word[:40]!r} where {wanted!r} is expected")


def _numbers(words: Iterator[str]) -> list[float]:
    numbers = [float(next(words)) for _ in range(3)]
    if not np.isfinite(numbers).all():
        raise ValueError("an offset is not finite")
    return numbers


def _channels(words: Iterator[str]) -> None:
    for _ in range(int(next(words))):
        if (word := next(words)).capitalize() not in _CHANNELS:
            raise ValueError(f"it has the channel {word[:40]!r}")
