"""Places to look at a body from, and contact sheets: many pictures in one."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing

Image = UInt8[np.ndarray, "H W 3"]

_DISTANCE = 8.0  # times the extent: limbs nearly keep their lengths wherever they point
_GAP = 6
_CAPTION_HEIGHT = 18
_FONT, _FONT_SCALE, _INK = cv2.FONT_HERSHEY_SIMPLEX, 0.4, (40, 40, 40)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cell:
    """One place in a sheet."""

    picture: Image
    """RGB; all cells of a sheet may differ in size."""
    caption: str = ""


@dataclass(frozen=True, kw_only=True)
class View:
    """A place to look from, in the body's own world: x to the body's left, y up, z forward, metres."""

    center: tuple[float, float, float]
    """What is in the middle of the picture."""
    extent: float = 2.1
    """How many metres the shorter side of the picture shows there."""
    degrees: float = 0.0
    """0 sees the front of a body that faces +z, 90 its left side, 180 its back."""
    above: float = 0.0
    """Degrees by which the eye stands higher than the middle."""
    size: tuple[int, int] = (240, 320)
    """Width and height in pixels."""

    @property
    def _away(self) -> float:
        """Metres from the eye to the middle."""
        return _DISTANCE * self.extent

    @property
    def camera(self) -> Camera:
        """The camera that belongs to `camera_space`."""
        focal = min(self.size) * self._away / self.extent
        return Camera(focal=(focal, focal), center=(self.size[0] / 2, self.size[1] / 2), size=self.size)

    def camera_space(self, points: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "N 3"]:
        """Points in the camera's space: x right, y down, z away."""
        a, b = math.radians(self.degrees), math.radians(self.above)
        around = np.array([[math.cos(a), 0, -math.sin(a)], [0, 1, 0], [math.sin(a), 0, math.cos(a)]])
        over = np.array([[1, 0, 0], [0, math.cos(b), -math.sin(b)], [0, math.sin(b), math.cos(b)]])
        seen = (np.asarray(points, float) - self.center) @ (over @ around).T
        return seen * [1, -1, -1] + [0, 0, self._away]

    def pixels(self, points: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "N 2"]:
        """Where points appear."""
        seen, camera = self.camera_space(points), self.camera
        return seen[:, :2] / seen[:, 2:] * camera.focal + camera.center


def beside(pictures: Sequence[Image], gap: int = 0) -> Image:
    """Pictures in a row with white between them, and where they are not equally high."""
    height = max(len(picture) for picture in pictures)
    row = [np.pad(_padded(p, height, p.shape[1]), ((0, 0), (gap, 0), (0, 0)), constant_values=255) for p in pictures]
    return np.concatenate(row, 1)[:, gap:]


def sheet(cells: Sequence[Cell], columns: int) -> Image:
    """Cells row by row with their captions below; rows are as high, and columns as wide, as the largest cell."""
    assert cells and columns > 0
    height = max(len(cell.picture) for cell in cells)
    width = max(cell.picture.shape[1] for cell in cells)
    captioned = [_captioned(_padded(cell.picture, height, width), cell.caption) for cell in cells]
    blank = np.full_like(captioned[0], 255)
    captioned += [blank] * (-len(captioned) % columns)
    rows = [np.concatenate(captioned[i : i + columns], 1) for i in range(0, len(captioned), columns)]
    return np.concatenate(rows, 0)


def write_sheet(path: Path, cells: Sequence[Cell], columns: int) -> None:
    """Write a sheet as an image file (PNG by its name's ending). Raises InputError if the file cannot be written."""
    try:
        with replacing(path) as draft:
            written = cv2.imwrite(str(draft), sheet(cells, columns)[..., ::-1])
    except (OSError, cv2.error) as error:
        raise InputError(f"{path}: cannot be written as a picture ({error}). Give a name such as sheet.png.") from error
    if not written:
        raise InputError(f"{path}: cannot be written. Give a name such as sheet.png in a folder that exists.")


def _padded(picture: Image, height: int, width: int) -> Image:
    """The picture in the middle of a white one."""
    below, right = height - picture.shape[0], width - picture.shape[1]
    sides = ((below // 2, below - below // 2), (right // 2, right - right // 2), (0, 0))
    return np.pad(picture, sides, constant_values=255)


def _captioned(picture: Image, caption: str) -> Image:
    """The picture with a caption below it and a gap around both; a long caption is cut."""
    sides = ((_GAP // 2, _CAPTION_HEIGHT + _GAP // 2), (_GAP // 2, _GAP // 2), (0, 0))
    framed = np.pad(picture, sides, constant_values=255)
    while caption and cv2.getTextSize(caption, _FONT, _FONT_SCALE, 1)[0][0] > picture.shape[1]:
        caption = caption[:-1]
    cv2.putText(framed, caption, (_GAP, len(framed) - _GAP), _FONT, _FONT_SCALE, _INK, 1, cv2.LINE_AA)
    return framed
