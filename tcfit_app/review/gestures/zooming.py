"""Zooming: to the whole picture, the selected keypoints, a hand or the face."""

import numpy as np
from jaxtyping import Bool, Float

from fitting_core.errors import InputError
from fitting_core.keypoints import GROUPS, INDEX
from tcfit_app.review.scene.side_view import Direction
from tcfit_app.review.tab.on_show import SLOTS
from tcfit_app.review.tab.state import CLOSE_UPS, HELD_BY, Part
from tcfit_app.review.tab.tab import Tab

_LEAST, _MARGIN = 1 / 15, 1 / 5
"""The smallest region to zoom to, in image diagonals, and the margin around it, relative to its size."""
_ROOM = 1.6
"""The region of a close-up, relative to its subject, which is seldom exactly centred."""
_NONE_THERE = "None of the selected keypoints was detected in this frame: there is nothing to zoom to."


def show_whole(tab: Tab) -> None:
    """Show the whole picture, or in 3D the whole body."""
    if tab.state.mode != "space":  # in 3D the pictures keep their view, and so their close-up
        tab.set(close_up=None)
    tab.scene.cameras.reset()


def zoom_to_selection(tab: Tab) -> None:
    """Zoom to the selected keypoints. Raises InputError if none of them was detected."""
    if tab.state.mode == "space":
        return _zoom_in_space(tab)
    xy = _selected(tab)
    if not len(xy):
        raise InputError(_NONE_THERE)
    low, high = surroundings(xy, tab.session.project.footage.camera.size)
    tab.set(close_up=None)
    tab.scene.zoom_to((*low.tolist(), *high.tolist()))


def follow_selection(tab: Tab) -> None:
    """Centre the selected keypoints if the user has zoomed in, at the same scale."""
    if (
        tab.state.mode != "space"
        and tab.state.close_up is None
        and tab.scene.cameras.moved
        and len(xy := _selected(tab))
    ):
        tab.scene.centre(xy.mean(0))


def _selected(tab: Tab) -> Float[np.ndarray, "n 2"]:
    """The selected keypoints that are in the frame on show, pixels."""
    chosen = tab.session.project.corrected.at((tab.state.frame,), tuple(tab.state.selection))
    # Undetected keypoints are at (0, 0), and so are copies of them.
    return chosen.xy[(chosen.confidence > 0) | (chosen.edited & chosen.xy.any(-1))]


def _zoom_in_space(tab: Tab) -> None:
    shown, joints = tab.look(), list(tab.state.selection)
    bodies = [body for side in SLOTS if (body := shown.body(side)) is not None]
    points = [tab.data.keypoints(body)[joints] for body in bodies]
    if not any(np.isfinite(found).all(-1).any() for found in points):
        raise InputError("No fit on show has one of the selected keypoints: there is nothing to zoom to.")
    tab.scene.zoom_in_space(points)


def surroundings(xy: Float[np.ndarray, "n 2"], size: tuple[int, int]) -> Float[np.ndarray, "2 2"]:
    """A rectangle around points, with a margin clipped to the image: its least and greatest corners."""
    low, high = xy.min(0), xy.max(0)
    extent = float((high - low).max())
    margin = max((_LEAST * float(np.hypot(*size)) - extent) / 2, _MARGIN * extent)
    inside = np.array([np.maximum(low - margin, 0), np.minimum(high + margin, size)])
    return np.array([np.minimum(inside[0], low), np.maximum(inside[1], high)])


# --- close-ups ---


def show_close_up(tab: Tab, part: Part | None) -> None:
    """Follow a hand or the face from frame to frame, in Edit beside the video alone; None: show the whole picture."""
    if part is None:
        return show_whole(tab)
    if tab.state.mode == "space":
        raise InputError("Close-ups are for Edit and Compare: there the view can follow the picture.")
    corrected, group = tab.session.project.corrected, GROUPS[part]
    xy, there = corrected.xy[:, group], corrected.confidence[:, group] > 0
    size = usual_size(xy, there)
    if part not in followed_parts(tab):
        raise InputError(f"The {CLOSE_UPS[part].lower()} was not detected in any frame: there is nothing to follow.")
    tab.set(close_up=part, side_from=_near_side(tab, part))
    least = _LEAST * float(np.hypot(*tab.session.project.footage.camera.size))
    tab.scene.zoom_about_middle(max(_ROOM * size, least) if size else 2 * least)


def _near_side(tab: Tab, part: Part) -> Direction | int:
    """Where the side view of a close-up is seen from: a hand from its own side of the body, which would hide it."""
    now, corrected, ends = tab.state.side_from, tab.session.project.corrected, [HELD_BY[part], INDEX["neck"]]
    seen = (corrected.confidence[:, ends] > 0).all(1)
    if part == "face" or now not in ("left", "right") or not seen.any():
        return now
    wrist, neck = corrected.xy[seen][:, ends, 0].T
    return "left" if np.median(wrist - neck) < 0 else "right"


def followed_parts(tab: Tab) -> list[Part]:
    """The parts that were detected, or whose wrist or nose was."""
    confidence = tab.session.project.corrected.confidence
    return [part for part in CLOSE_UPS if confidence[:, GROUPS[part]].any() or confidence[:, HELD_BY[part]].any()]


def next_close_up(tab: Tab) -> None:
    """Cycle through the detected parts, then the whole picture."""
    ways: list[Part | None] = [None, *followed_parts(tab)]
    now = ways.index(tab.state.close_up) if tab.state.close_up in ways else 0
    if len(ways) == 1:
        raise InputError("Neither hands nor face were detected: there is nothing to follow.")
    show_close_up(tab, ways[(now + 1) % len(ways)])


def usual_size(xy: Float[np.ndarray, "T K 2"], there: Bool[np.ndarray, "T K"]) -> float | None:
    """Median longer side of the bounding box of keypoints, pixels; None without keypoints."""
    seen = there.sum(1) > 1
    if not seen.any():
        return None
    xy, there = xy[seen], there[seen][..., None]
    least, most = np.where(there, xy, np.inf).min(1), np.where(there, xy, -np.inf).max(1)
    return float(np.percentile((most - least).max(1), 75))
