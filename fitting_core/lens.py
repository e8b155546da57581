"""Lens distortion and its inverse: keypoints and frames are straightened once, when they are read.

Everything behind that sees a pinhole camera. The model is OpenCV's (docs.opencv.org, module calib3d), without tilted
sensors: with x, y on the plane at distance 1 and r² = x² + y²,

    x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶) + 2 p1 x y + p2 (r² + 2 x²) + s1 r² + s2 r⁴
    y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶) + p1 (r² + 2 y²) + 2 p2 x y + s3 r² + s4 r⁴
"""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from fitting_core.camera import COEFFICIENTS, Lens
from fitting_core.keypoints import Keypoints

_ROUNDS = 30
_STEP = 1e-6
_BACK = 0.01
"""Pixels to which a straightened point must come back to where it was filmed."""
_FARTHEST, _OF_REACH = 5.0, 0.99
"""On the plane at distance 1, 79 degrees off the axis; and what of the way to a fold is used, where no slope is 0."""
_OUTSIDE = -10
"""Pixels before the first one, where no picture is."""
_PIXEL_MIDDLE = 0.5
"""Coordinates count from the image's corner, and an array's from the middle of its first pixel."""


def filmed(lens: Lens, xy: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
    """Where points of the straightened picture were filmed, pixels."""
    focal, center = np.array(lens.focal), np.array(lens.center)
    return _bent((xy - center) / focal, lens.distortion) * focal + center


def straightened(lens: Lens, xy: Float[np.ndarray, "*n 2"]) -> tuple[Float[np.ndarray, "*n 2"], Bool[np.ndarray, "*n"]]:
    """Where filmed points are in the straightened picture, pixels, and which of them are anywhere.

    By Newton's method. Far out, coefficients often describe a lens that folds its picture: no point is filmed there.
    What is nowhere stays where it is.
    """
    focal, center = np.array(lens.focal), np.array(lens.center)
    wanted, reach = (xy - center) / focal, _reach(lens)
    at = _within(wanted, reach)
    for _ in range(_ROUNDS):
        off = wanted - _bent(at, lens.distortion)
        at = _within(at + np.linalg.solve(_slope(at, lens.distortion), off[..., None])[..., 0], reach)
    off = np.abs((_bent(at, lens.distortion) - wanted) * focal).max(-1)
    found = off < _BACK
    return np.where(found[..., None], at * focal + center, xy), found


def straightened_keypoints(keypoints: Keypoints, lens: Lens | None) -> tuple[Keypoints, tuple[str, ...]]:
    """Filmed keypoints in the straightened picture, and notes on them; those that are nowhere are not detected.

    Args:
        keypoints: Of the pictures as they were filmed.
        lens: None for one that bends nothing.
    """
    if lens is None:
        return keypoints, ()
    detected = keypoints.confidence > 0
    xy, found = straightened(lens, keypoints.xy)
    lost = detected & ~found
    notes = (f"{lost.sum()} keypoints lie where the lens's distortion is not known; they do not count.",)
    straight = replace(
        keypoints,
        xy=np.where(detected[..., None], xy, keypoints.xy),
        confidence=np.where(lost, 0.0, keypoints.confidence),
    )
    return straight, notes if lost.any() else ()


def filmed_keypoints(keypoints: Keypoints, lens: Lens | None) -> Keypoints:
    """Keypoints of the straightened picture where they are in the pictures as they were filmed."""
    if lens is None:
        return keypoints
    detected = keypoints.confidence[..., None] > 0
    return replace(keypoints, xy=np.where(detected, filmed(lens, keypoints.xy), keypoints.xy))


def share_straightened(lens: Lens, size: tuple[int, int]) -> float:
    """Share of a filmed picture's points that are somewhere in the straightened one.

    Args:
        lens: The lens.
        size: Width and height in pixels.
    """
    axes = (np.linspace(0, side, 33) for side in size)
    grid = np.stack(np.meshgrid(*axes), -1)
    return float(straightened(lens, grid)[1].mean())


class Straightener:
    """Makes straightened pictures of filmed ones, of the same size; black where nothing was filmed.

    It keeps a table of 6 bytes for each pixel.
    """

    def __init__(self, lens: Lens, size: tuple[int, int]) -> None:
        (fx, fy), (cx, cy) = lens.focal, lens.center
        matrix = np.array([[fx, 0, cx - _PIXEL_MIDDLE], [0, fy, cy - _PIXEL_MIDDLE], [0, 0, 1]])
        whole, part = cv2.initUndistortRectifyMap(matrix, _all(lens.distortion), np.eye(3), matrix, size, cv2.CV_16SC2)
        across, along = (
            ((np.arange(side) + _PIXEL_MIDDLE - c) / f) ** 2
            for side, c, f in zip(size, (cx, cy), (fx, fy), strict=True)
        )
        whole[across + along[:, None] > _reach(lens) ** 2] = _OUTSIDE
        self._maps = whole, part

    def __call__(self, image: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "H W 3"]:
        """The straightened picture."""
        return cv2.remap(image, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)


def _reach(lens: Lens) -> float:
    """Largest radius (on z = 1) up to which the distortion is monotonic.

    Beyond it a polynomial comes back into the picture, as a ghost of its middle.
    """
    k1, k2, _, _, k3, k4, k5, k6, *_ = _all(lens.distortion)
    radius = np.linspace(0, _FARTHEST, 4001)
    r = radius**2
    falling = np.diff(radius * (1 + r * (k1 + r * (k2 + r * k3))) / (1 + r * (k4 + r * (k5 + r * k6)))) <= 0
    return _OF_REACH * float(radius[np.argmax(falling)]) if falling.any() else _FARTHEST


def _within(at: Float[np.ndarray, "*n 2"], reach: float) -> Float[np.ndarray, "*n 2"]:
    """Points with their radius limited to that."""
    return at * np.minimum(1.0, reach / np.maximum(np.linalg.norm(at, axis=-1, keepdims=True), 1e-9))


def _all(distortion: tuple[float, ...]) -> Float[np.ndarray, "12"]:
    """All coefficients of the formula."""
    return np.pad(np.array(distortion, float), (0, COEFFICIENTS[-1] - len(distortion)))


def _bent(at: Float[np.ndarray, "*n 2"], distortion: tuple[float, ...]) -> Float[np.ndarray, "*n 2"]:
    """The formula above."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = _all(distortion)
    x, y = at[..., 0], at[..., 1]
    r = x * x + y * y
    scale = (1 + r * (k1 + r * (k2 + r * k3))) / (1 + r * (k4 + r * (k5 + r * k6)))
    return np.stack(
        [
            x * scale + 2 * p1 * x * y + p2 * (r + 2 * x * x) + r * (s1 + r * s2),
            y * scale + p1 * (r + 2 * y * y) + 2 * p2 * x * y + r * (s3 + r * s4),
        ],
        -1,
    )


def _slope(at: Float[np.ndarray, "*n 2"], distortion: tuple[float, ...]) -> Float[np.ndarray, "*n 2 2"]:
    """Its Jacobian, by central differences."""
    steps = _STEP * np.eye(2)
    return np.stack([(_bent(at + step, distortion) - _bent(at - step, distortion)) / (2 * _STEP) for step in steps], -1)
