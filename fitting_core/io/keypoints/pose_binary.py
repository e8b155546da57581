"""The binary `.pose` file of pose-format (https://github.com/sign-language-processing/pose), versions 0.1 and 0.2.

All numbers are little-endian; texts are UTF-8 with their length in front (16 bits).

| part | content |
|---|---|
| header | version (float32); width, height, depth (uint16); number of components (uint16), and each of these |
| component | name, format such as "XYC"; numbers of points, limbs and colours (uint16); their names; limbs \
as pairs of points, colours as red, green, blue (uint16) |
| body 0.2 | frames per second (float32), frames (uint32), people (uint16) |
| body 0.1 | frames per second, frames, people (uint16); frames overflow, so their number follows from the file's size |
| data | float32 (frames, people, points, dimensions), then confidence (frames, people, points) |

Not read by pose-format: 0.15 accepts bytes behind the data, NaN frames per second and 10^9 frames without people.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import regular_file

VERSIONS = (0.1, 0.2)
_MAX_FRAMES = 10_000_000
"""4 days at 30 frames per second. Frames without people take no bytes, so the file's size does not limit them."""
_MAX_FRAME_RATE = 2000.0


@dataclass(frozen=True, kw_only=True)
class Component:
    """A named group of points, such as a hand."""

    name: str
    points: tuple[str, ...]
    format: str = "XYC"
    """A letter for each dimension, the confidence last."""
    limbs: tuple[tuple[int, int], ...] = ()
    """Pairs of points to draw a line between."""
    colors: tuple[tuple[int, int, int], ...] = ((255, 0, 0),)


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseFile:
    """The content of a `.pose` file."""

    components: tuple[Component, ...]
    size: tuple[int, int]
    """Width and height in pixels; 0 if unknown."""
    frame_rate: float
    """Frames per second; 0 if unknown."""
    data: Float[np.ndarray, "T P K D"]
    """Positions of all components' points; the first two dimensions are x and y."""
    confidence: Float[np.ndarray, "T P K"]


def starts_as_pose(start: bytes) -> bool:
    """Whether a file with this start has the version number of a `.pose` file."""
    return any(start.startswith(struct.pack("<f", version)) for version in VERSIONS)


def read_pose_file(path: Path) -> PoseFile:
    """Read a `.pose` file as it is. Raises InputError if it is missing, damaged, of another version, or its counts do
    not match its size."""
    try:
        content = regular_file(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
    try:
        return _parsed(_Bytes(content))
    except _Damaged as error:
        raise InputError(
            f"{path}: {error}. Expected a .pose file of pose-format 0.1 or 0.2; write it again."
        ) from error


def write_pose_file(path: Path, pose: PoseFile) -> None:
    """Write version 0.2, which pose-format reads; an existing file is replaced atomically. Raises InputError if width
    or height do not fit the format."""
    if not all(0 <= side < 2**16 for side in pose.size):
        raise InputError(
            f"{path.name}: images of {pose.size[0]} x {pose.size[1]}; .pose files hold up to 65535 pixels."
        )
    frames, people = pose.data.shape[:2]
    header = [struct.pack("<fHHHH", VERSIONS[-1], *pose.size, 0, len(pose.components))]
    header += [_packed(component) for component in pose.components]
    body = struct.pack("<fIH", pose.frame_rate, frames, people)
    with replacing(path) as draft, draft.open("wb") as file:
        file.write(b"".join([*header, body]))
        file.write(pose.data.astype("<f4").tobytes())
        file.write(pose.confidence.astype("<f4").tobytes())


class _Damaged(ValueError):
    """What is wrong with the bytes, in words."""


class _Bytes:
    """Reads numbers and texts in sequence, never past the end."""

    def __init__(self, content: bytes) -> None:
        self._content, self._place = content, 0

    @property
    def left(self) -> int:
        return len(self._content) - self._place

    def take(self, count: int, what: str) -> bytes:
        if count > self.left:
            raise _Damaged(f"ends within {what}, after {len(self._content)} bytes: it is cut off or not a .pose file")
        self._place += count
        return self._content[self._place - count : self._place]

    def numbers(self, form: str, what: str) -> tuple:
        return struct.unpack(f"<{form}", self.take(struct.calcsize(f"<{form}"), what))

    def text(self, what: str) -> str:
        (length,) = self.numbers("H", what)
        try:
            return self.take(length, what).decode("utf-8")
        except UnicodeDecodeError as error:
            raise _Damaged(f"{what} is not UTF-8 text ({error.reason})") from error


def _parsed(content: _Bytes) -> PoseFile:
    (stated,) = content.numbers("f", "its version")
    version = next((v for v in VERSIONS if math.isclose(stated, v, abs_tol=1e-6)), None)
    if version is None:
        raise _Damaged(f"starts with the version {stated:g}, expected 0.1 or 0.2")
    width, height, _, count = content.numbers("HHHH", "its header")
    components = tuple(_component(content, k) for k in range(count))
    if not components:
        raise _Damaged("has no components")
    points = sum(len(component.points) for component in components)
    dimensions = max(len(component.format) for component in components) - 1
    rate, frames, people = _BODIES[version](content, 4 * points * (dimensions + 1))
    if not (math.isfinite(rate) and 0 <= rate <= _MAX_FRAME_RATE):
        raise _Damaged(f"has {rate:g} frames per second, expected 0 (not known) to {_MAX_FRAME_RATE:g}")
    return PoseFile(
        components=components,
        size=(width, height),
        frame_rate=rate,
        data=_array(content, (frames, people, points, dimensions)),
        confidence=_array(content, (frames, people, points)),
    )


def _component(content: _Bytes, k: int) -> Component:
    what = f"component {k}"
    name, form = content.text(f"the name of {what}"), content.text(f"the format of {what}")
    if not (form.startswith("XY") and form.endswith("C") and len(form) <= 8):
        raise _Damaged(f"{what} has the format {form!r:.20}, expected XYC or XYZC")
    points, limbs, colors = content.numbers("HHH", what)
    return Component(
        name=name,
        format=form,
        points=tuple(content.text(f"a name of {what}") for _ in range(points)),
        limbs=tuple(content.numbers("HH", f"the limbs of {what}") for _ in range(limbs)),
        colors=tuple(content.numbers("HHH", f"the colours of {what}") for _ in range(colors)),
    )


def _body_1(content: _Bytes, point_bytes: int) -> tuple[float, int, int]:
    """Frames per second, frames and people of version 0.1."""
    rate, frames, people = content.numbers("HHH", "its counts")
    each = people * point_bytes
    if each and content.left % each:
        raise _Damaged(f"has {content.left} bytes of points, not a multiple of {each}, a frame: it is cut off")
    return float(rate), content.left // each if each else frames, people


def _body_2(content: _Bytes, point_bytes: int) -> tuple[float, int, int]:
    rate, frames, people = content.numbers("fIH", "its counts")
    if frames > _MAX_FRAMES or frames * people * point_bytes != content.left:
        raise _Damaged(
            f"says that it has {frames} frames of {people} people, which take {frames * people * point_bytes} bytes, "
            f"but {content.left} follow: it is cut off or damaged"
        )
    return rate, frames, people


_BODIES: dict[float, Callable[[_Bytes, int], tuple[float, int, int]]] = {0.1: _body_1, 0.2: _body_2}


def _array(content: _Bytes, shape: tuple[int, ...]) -> np.ndarray:
    return np.frombuffer(content.take(4 * math.prod(shape), "its points"), "<f4").reshape(shape).astype(np.float64)


def _packed(component: Component) -> bytes:
    counts = struct.pack("<HHH", len(component.points), len(component.limbs), len(component.colors))
    limbs = [struct.pack("<HH", *limb) for limb in component.limbs]
    colors = [struct.pack("<HHH", *color) for color in component.colors]
    names = [_text(name) for name in component.points]
    return b"".join([_text(component.name), _text(component.format), counts, *names, *limbs, *colors])


def _text(value: str) -> bytes:
    encoded = value.encode("utf-8")
    return struct.pack("<H", len(encoded)) + encoded
