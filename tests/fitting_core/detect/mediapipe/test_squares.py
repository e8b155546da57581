"""Squares of images: where points of a picture lie in the image, also turned and shrunk."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fitting_core.detect.mediapipe.squares import Square, around, picture

numbers = st.floats(-300, 300)


def spot(x: float, y: float, size: tuple[int, int] = (640, 480), sigma: float = 6.0) -> np.ndarray:
    """A bright spot about a point that counts from the corner of the first pixel."""
    columns, rows = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    bright = 255 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * sigma**2))
    return np.repeat(bright[..., None], 3, -1).round().astype(np.uint8)


def centre(shown: np.ndarray) -> np.ndarray:
    """Of the brightness of a picture, counted from the corner of its first pixel."""
    bright = shown[..., 0].astype(float)
    columns, rows = np.meshgrid(np.arange(bright.shape[1]) + 0.5, np.arange(bright.shape[0]) + 0.5)
    return np.array([(bright * columns).sum(), (bright * rows).sum()]) / bright.sum()


@pytest.mark.parametrize("square", [
    Square(320, 240, 256), Square(311.3, 236.7, 150), Square(320, 240, 300, 0.7), Square(300, 250, 460, -2.0),
    Square(330, 230, 700, 0.3), Square(320.4, 240.2, 1100),
])  # fmt: skip
def test_points_of_a_picture_lie_where_the_image_has_them(square: Square):
    x, y = 331.0, 252.5
    found = square.to_image(centre(picture(spot(x, y), square, 256)), 256)
    # OpenCV interpolates at steps of 1/32 of the picture's pixels, which are up to 4 of the image's.
    assert np.abs(found - [x, y]).max() < max(0.1, square.side / 256 / 24)


def test_mirrored_pictures_agree():
    """No half pixel goes to one side."""
    square, image = Square(320, 240, 700), spot(340, 250)
    plain = centre(picture(image, square, 256))
    mirrored = centre(picture(image, square, 256)[:, ::-1])
    assert abs(plain[0] - (256 - mirrored[0])) < 1e-6


def test_large_squares_keep_fine_structure():
    """Lines a pixel wide are grey, and not there or away by chance."""
    image = np.zeros((1024, 1024, 3), np.uint8)
    image[:, ::4] = 255
    shown = picture(image, Square(512, 512, 1024), 128)
    assert abs(shown.mean() - 0.25) < 0.01 and shown.std() < 0.02


@pytest.mark.parametrize(
    "square", [Square(0, 0, 900), Square(640, 480, 900, 0.5), Square(-2000, 100, 800), Square(5, 5, 1)]
)
def test_squares_reach_over_the_border(square: Square):
    shown = picture(spot(320, 240), square, 64)
    assert shown.shape == (64, 64, 3) and np.isfinite(shown).all() and shown.min() >= 0 and shown.max() <= 1


@given(points=st.lists(st.tuples(numbers, numbers), min_size=2, max_size=9, unique=True), angle=st.floats(-3, 3))
def test_the_smallest_square_around_points_holds_them(points: list[tuple[float, float]], angle: float):
    xy = np.array(points)
    square = around(xy, angle)
    c, s = np.cos(angle), np.sin(angle)
    own = (xy - [square.x, square.y]) @ np.array([[c, -s], [s, c]])
    assert np.abs(own).max() <= square.side / 2 + 1e-6
    assert np.isclose((own.max(0) - own.min(0)).max(), square.side)
