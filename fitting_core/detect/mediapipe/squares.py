"""Squares of an image, which may be turned: what a network is shown, and where its points lie in the image.

Points count from the corner of the image's first pixel, as everywhere in tcfit's detectors; OpenCV counts from its
middle. MediaPipe leaves that half pixel of the network's picture out, which puts its points 2 to 3 pixels of a large
image too far right and down: plain and mirrored picture then differ by 0.41 pixels, in place of 0.07.
"""

from dataclasses import dataclass, replace
from typing import Self

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

_WORTH_SHRINKING = 1.5
"""How many times as wide as the network's picture a square is from which it is shrunk by area first."""
_MOST_SHRUNK = 8
_BYTE = np.float32(1 / 255)

Image = UInt8[np.ndarray, "H W 3"]
"""RGB."""


@dataclass(frozen=True)
class Square:
    """Part of an image, in pixels."""

    x: float
    y: float
    """Its centre."""
    side: float
    angle: float = 0.0
    """How far the content is turned clockwise from upright, radians."""

    @property
    def box(self) -> Float[np.ndarray, "4"]:
        """Left, top, right and bottom, as if it were not turned."""
        half = self.side / 2
        return np.array([self.x - half, self.y - half, self.x + half, self.y + half])

    def turned(self, dx: np.ndarray | float, dy: np.ndarray | float) -> tuple[np.ndarray | float, np.ndarray | float]:
        """A vector of its own axes in those of the image."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        return dx * c - dy * s, dx * s + dy * c

    def scaled(self, factor: float, *, up: float = 0.0) -> Self:
        """Moved up along its own axis by a share of its side, then enlarged about its centre."""
        dx, dy = self.turned(0.0, -up * self.side)
        return replace(self, x=float(self.x + dx), y=float(self.y + dy), side=self.side * factor)

    def at_least(self, side: float) -> Self:
        """The same with no smaller a side."""
        return replace(self, side=max(self.side, side))

    def to_image(self, points: Float[np.ndarray, "*n 2"], size: float) -> Float[np.ndarray, "*n 2"]:
        """Points of a picture of this square, which is `size` pixels wide, as pixels of the image."""
        own = (points / size - 0.5) * self.side
        x, y = self.turned(own[..., 0], own[..., 1])
        return np.stack([x + self.x, y + self.y], -1)

    def share_inside(self, image: Image) -> float:
        """How much of it the image holds, 0 to 1."""
        low, high = np.maximum(self.box[:2], 0), np.minimum(self.box[2:], image.shape[1::-1])
        return float(np.clip(high - low, 0, None).prod() / max(self.side, 1e-9) ** 2)


def of_box(box: Float[np.ndarray, "4"], angle: float = 0.0) -> Square:
    """The square about a box's centre, as wide as its longer side."""
    middle = (box[:2] + box[2:]) / 2
    return Square(float(middle[0]), float(middle[1]), float((box[2:] - box[:2]).max()), angle)


def around(points: Float[np.ndarray, "n 2"], angle: float = 0.0) -> Square:
    """The smallest square, turned by an angle, that holds some points."""
    c, s = np.cos(angle), np.sin(angle)
    middle = (points.min(0) + points.max(0)) / 2
    own = (points - middle) @ np.array([[c, -s], [s, c]])
    low, high = own.min(0), own.max(0)
    square = Square(float(middle[0]), float(middle[1]), float((high - low).max()), angle)
    dx, dy = square.turned(*((low + high) / 2))
    return replace(square, x=float(square.x + dx), y=float(square.y + dy))


def turn_from(start: Float[np.ndarray, "2"], end: Float[np.ndarray, "2"], *, should_be: float) -> float:
    """How far the arrow between two points is turned clockwise from a direction (degrees; 90: up in the image)."""
    angle = np.deg2rad(should_be) - np.arctan2(-(end[1] - start[1]), end[0] - start[0])
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def picture(
    image: Image, square: Square, size: int, *, border: int = cv2.BORDER_REPLICATE
) -> Float32[np.ndarray, "size size 3"]:
    """A square of an RGB image as a network's picture, 0 to 1.

    A square that is much larger than the picture is shrunk by the mean of its pixels, which keeps fine structure.
    """
    image, origin, factor = _shrunk(image, square, size)
    corners = np.array([[0, 0], [size, 0], [0, size]], np.float32)
    seen = (square.to_image(corners, size) - origin) / factor - 0.5
    matrix = cv2.getAffineTransform(seen.astype(np.float32), corners - 0.5)
    return cv2.warpAffine(image, matrix, (size, size), flags=cv2.INTER_LINEAR, borderMode=border) * _BYTE


def _shrunk(image: Image, square: Square, size: int) -> tuple[UInt8[np.ndarray, "h w 3"], Float[np.ndarray, "2"], int]:
    """What a square needs of an image, where it begins in it, and by what whole number it was shrunk."""
    factor = min(_MOST_SHRUNK, int(square.side / size)) if square.side > _WORTH_SHRINKING * size else 1
    if factor == 1:
        return image, np.zeros(2), 1
    reach = square.side * np.sqrt(0.5) + factor
    height, width = image.shape[:2]
    left, right = (int(np.clip(square.x + by, 0, width)) for by in (-reach, reach))
    top, bottom = (int(np.clip(square.y + by, 0, height)) for by in (-reach, reach))
    across, down = max(1, (right - left) // factor), max(1, (bottom - top) // factor)
    left, top = min(left, width - factor), min(top, height - factor)
    part = image[top : top + down * factor, left : left + across * factor]
    return cv2.resize(part, (across, down), interpolation=cv2.INTER_AREA), np.array([left, top], float), factor
