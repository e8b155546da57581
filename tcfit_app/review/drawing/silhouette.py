"""The detected silhouette of the person, as outlines over the picture."""

import cv2
import numpy as np
from jaxtyping import Bool, Float

from fitting_core.camera import Camera, Lens
from fitting_core.lens import straightened
from tcfit_app.review.browser.page_states import Silhouette, pixel_pairs
from tcfit_app.review.tab.tab import Tab

_SMOOTHED = 0.8
"""Tolerance of an outline in mask pixels: the mask's border is stepped."""
_SHORTEST = 3
"""Maximum number of an outline's corners."""


class SilhouettePart:
    """Draws it if wanted and known; called repeatedly, it sends only changes."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab

    def draw(self) -> None:
        """Send what changed."""
        tab, state, clip = self._tab, self._tab.state, self._tab.session.project.footage
        known = clip.silhouettes if state.silhouette and state.mode != "space" else None
        if known is None:
            return tab.channel.send("silhouette", None)
        frame, key = state.frame, (state.frame, tab.session.project.keypoints_version)
        tab.channel.send("silhouette", tab.once("silhouette", key, lambda: silhouette(known.mask(frame), clip.camera)))


def silhouette(mask: Bool[np.ndarray, "h w"] | None, camera: Camera) -> Silhouette | None:
    """A mask's outlines for the page, if any."""
    found = [] if mask is None else outlines(mask, camera.size, camera.lens)
    return Silhouette(lines=tuple(map(pixel_pairs, found))) if found else None


def outlines(mask: Bool[np.ndarray, "h w"], size: tuple[int, int], lens: Lens | None) -> list[Float[np.ndarray, "n 2"]]:
    """The borders of a mask and of its holes, in pixels of the undistorted picture.

    Args:
        mask: Of the distorted picture, see `Silhouettes`.
        size: Width and height of the picture.
        lens: Of its camera.
    """
    borders, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    scale = np.array(size) / mask.shape[::-1]
    lines = []
    for border in borders:
        corners = cv2.approxPolyDP(border, _SMOOTHED, True)[:, 0].astype(float)
        points = (corners + 0.5) * scale - 0.5
        if lens is not None:
            points, there = straightened(lens, points)
            points = points[there]
        if len(points) >= _SHORTEST:
            lines.append(points)
    return lines
