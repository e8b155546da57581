"""Drawings that depend on neighbouring frames: the paths of selected keypoints, and the focus of a close-up."""

import numpy as np
from jaxtyping import Bool, Float

from fitting_core.camera import Camera
from fitting_core.keypoints import COUNT, GROUPS
from tcfit_app.review.browser.page_states import Focus, Path, Trail, pixel_pairs
from tcfit_app.review.scene.layers import RUN_COLORS, css
from tcfit_app.review.tab.on_show import SLOTS, OnShow, Slot
from tcfit_app.review.tab.state import HELD_BY, Part
from tcfit_app.review.tab.tab import Tab

TRAIL_REACH = 5
"""Frames on a path before and after the one on show."""
_SMOOTHED = 2.0
"""Standard deviation in frames of the smoothing that steadies a close-up: detections jitter."""
_SEEN = 8
"""Frames before and after that the smoothing uses."""


class AroundPart:
    """Draws one tab's paths, and moves its close-up; called repeatedly, it sends only changes."""

    def __init__(self, tab: Tab) -> None:
        self._tab, self._data = tab, tab.data

    def draw(self, shown: OnShow) -> None:
        """Send what changed."""
        self._draw_focus()
        self._draw_trail(shown)

    def _draw_focus(self) -> None:
        tab, state = self._tab, self._tab.state
        part, project = state.close_up, tab.session.project
        if part is None:
            return tab.channel.send("focus", None)
        key = part, state.frame, project.keypoints_version
        if (focus := tab.once("focus", key, lambda: self._focus(part))) is not None:  # otherwise it stays put
            tab.channel.send("focus", focus)

    def _focus(self, part: Part) -> Focus | None:
        tab, state = self._tab, self._tab.state
        corrected, frames = tab.session.project.corrected, _frames(state.frame, _SEEN, tab.length)
        near = slice(frames.start, frames.stop)
        for group in (GROUPS[part], [HELD_BY[part]]):
            there = corrected.confidence[near, group] > 0
            found = followed(corrected.xy[near, group], there, state.frame - frames.start)
            if found is not None:
                return Focus(x=float(found[0]), y=float(found[1]))
        return None

    def _draw_trail(self, shown: OnShow) -> None:
        tab, state = self._tab, self._tab.state
        joints = state.selection if state.trail and state.mode != "space" else ()
        if not joints:
            return tab.channel.send("trail", None)
        fits = tuple(fit.version for place in shown.places for side in place if (fit := shown.fit(side)) is not None)
        key = state.frame, joints, shown.places, tab.session.project.keypoints_version, shown.revision, fits
        tab.channel.send("trail", tab.once("trail", key, lambda: self._trail(shown, joints)))

    def _trail(self, shown: OnShow, joints: tuple[int, ...]) -> Trail:
        frames = _frames(shown.frame, TRAIL_REACH, self._tab.length)
        fitted = [self._fitted(shown, place[0], frames)[:, list(joints)] if place else None for place in shown.places]
        return Trail(
            now=shown.frame - frames.start,
            detected=tuple(self._detected(joint, frames) for joint in joints),
            fitted=tuple(() if points is None else tuple(map(_path, points.swapaxes(0, 1))) for points in fitted),
            colors=tuple(css(RUN_COLORS[SLOTS.index(place[0])]) if place else "" for place in shown.places),
        )

    def _detected(self, joint: int, frames: range) -> Path:
        corrected, part = self._tab.session.project.corrected, slice(frames.start, frames.stop)
        xy = corrected.xy[part, joint].astype(float)
        return _path(np.where(corrected.confidence[part, joint, None] > 0, xy, np.nan))

    def _fitted(self, shown: OnShow, side: Slot, frames: range) -> Float[np.ndarray, "t 137 2"]:
        """Pixels of a body's keypoints, NaN where missing."""
        fit = shown.fit(side)
        pixels = np.full((len(frames), COUNT, 2), np.nan)
        if fit is None:
            return pixels
        for frame in (frame for frame in frames if fit.has(frame)):
            live = shown.live_of(side) if frame == shown.frame else None
            pixels[frame - frames.start] = in_image(self._data.keypoints(fit, frame, live), fit.camera)
        return pixels


def _frames(frame: int, reach: int, length: int) -> range:
    return range(max(frame - reach, 0), min(frame + reach + 1, length))


def _path(xy: Float[np.ndarray, "t 2"]) -> Path:
    known = np.isfinite(xy).all(axis=1).astype(bool)
    return tuple(pair if there else None for pair, there in zip(pixel_pairs(np.nan_to_num(xy)), known, strict=True))


def in_image(points: Float[np.ndarray, "n 3"], camera: Camera) -> Float[np.ndarray, "n 2"]:
    """Pixels of points in camera space; NaN behind the camera."""
    z = np.where(points[:, 2:] > 0.01, points[:, 2:], np.nan)
    return points[:, :2] / z * np.array(camera.focal) + np.array(camera.center)


def followed(xy: Float[np.ndarray, "t K 2"], there: Bool[np.ndarray, "t K"], now: int) -> Float[np.ndarray, "2"] | None:
    """The centre of keypoints at one frame, smoothed over frames; None without keypoints."""
    seen = np.flatnonzero(there.any(1))
    if not len(seen):
        return None
    middles = np.array([xy[t][there[t]].mean(0) for t in seen])
    weights = np.exp(-0.5 * ((seen - now) / _SMOOTHED) ** 2) + 1e-9
    return weights @ middles / weights.sum()
