"""The colours of meanings: seen on every ground of the page, and distinct with colour-deficient vision too."""

import re
from itertools import combinations

import cv2
import numpy as np
import pytest

from fitting_core.keypoints import GROUPS
from fitting_core.render.colors import COLORS
from tcfit_app.review.browser.channel import web_files

THEME = web_files()["/tcfit/theme.js"].decode()
GROUNDS = {ground: re.findall(rf'\b{ground}: "(#\w+)"', THEME) for ground in ("surface", "stage", "menu", "button")}
VISIONS = {
    "normal": np.eye(3),
    "protanopia": np.array([[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]]),
    "deuteranopia": np.array([[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]]),
    "tritanopia": np.array([[1.2555, -0.0767, -0.1788], [-0.0784, 0.9308, 0.1476], [0.0047, 0.6914, 0.3039]]),
}
"""Linear RGB as it is seen, by Machado, Oliveira and Fernandes (2009)."""


def linear(color: str) -> np.ndarray:
    channels = np.frombuffer(bytes.fromhex(color[1:]), np.uint8) / 255
    return np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)


def contrast(one: str, other: str) -> float:
    """By WCAG 2."""
    low, high = sorted(float(linear(color) @ (0.2126, 0.7152, 0.0722)) for color in (one, other))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", [0, 1], ids=["dark", "light"])
@pytest.mark.parametrize("meaning", COLORS)
def test_every_colour_stands_out_from_every_ground(meaning: str, theme: int):
    for ground, pair in GROUNDS.items():
        assert contrast(COLORS[meaning][theme], pair[theme]) >= 3, ground


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("theme", [0, 1], ids=["dark", "light"])
@pytest.mark.parametrize("shown", [tuple(GROUPS), ("fit", "beside")], ids=["keypoints", "fits"])
def test_what_is_shown_together_is_told_apart(shown: tuple[str, ...], theme: int, vision: str):
    seen = np.array([VISIONS[vision] @ linear(COLORS[meaning][theme]) for meaning in shown])
    encoded = np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * np.maximum(seen, 0.0) ** (1 / 2.4) - 0.055)
    lab = cv2.cvtColor(encoded.clip(0, 1).astype(np.float32)[None], cv2.COLOR_RGB2LAB)[0]
    assert min(np.linalg.norm(a - b) for a, b in combinations(lab, 2)) > (19 if len(shown) > 2 else 50)
