"""Zooming to keypoints."""

import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError
from tcfit_app.review.tab.tab import Tab

_LEAST_MARGIN, _MARGIN = 1 / 12, 1 / 4
"""Around keypoints that are zoomed to: of the image's diagonal at least, and of their own extent."""


def zoom_to_selection(tab: Tab) -> None:
    """Zoom to the selected keypoints. Raises InputError without any that are in the picture."""
    if not tab.state.selection or tab.state.mode == "space":
        raise InputError("Select keypoints in Edit or A | B first: the view then zooms to them.")
    chosen = tab.session.project.corrected.at((tab.state.frame,), tuple(tab.state.selection))
    # Undetected ones lie at (0, 0), and so do copies of them.
    xy = chosen.xy[(chosen.confidence > 0) | (chosen.edited & chosen.xy.any(-1))]
    if not len(xy):
        raise InputError("None of the selected keypoints was detected in this frame: there is nothing to zoom to.")
    low, high = surroundings(xy, tab.session.project.clip.camera.size)
    tab.scene.zoom_to((*low.tolist(), *high.tolist()))


def surroundings(xy: Float[np.ndarray, "n 2"], size: tuple[int, int]) -> Float[np.ndarray, "2 2"]:
    """A rectangle around points, with a margin as far as the image goes: first its least, then its largest corner."""
    low, high = xy.min(0), xy.max(0)
    margin = max(_LEAST_MARGIN * float(np.hypot(*size)), _MARGIN * float((high - low).max()))
    inside = np.array([np.maximum(low - margin, 0), np.minimum(high + margin, size)])
    return np.array([np.minimum(inside[0], low), np.maximum(inside[1], high)])
