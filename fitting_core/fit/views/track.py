"""What a view shows of the person at any time, as viewing rays."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from fitting_core import keypoints as kp
from fitting_core.clip import Clip
from fitting_core.fit.evidence.observations import lifted_keypoints
from fitting_core.fit.evidence.sides import unswapped
from fitting_core.ground.placing import place_on_rays, rays_of
from fitting_core.image_border import seen_confidence
from fitting_core.keypoints import SEEN
from fitting_core.lifting.clip_lifting import LiftedClip

_SMOOTH = 0.04
"""Seconds: standard deviation of the Gaussian weights. Interpolation between frames averages noise, so that without
smoothing offsets of half a frame agree best."""
_GAP = 0.2
"""Longest time in seconds over which a keypoint is interpolated."""
_BODY = kp.BODY.stop


@dataclass(frozen=True, kw_only=True, eq=False)
class Smoothed:
    """Values with slopes over time."""

    values: Float[np.ndarray, "T n 3"]
    slopes: Float[np.ndarray, "T n 3"]
    weights: Float[np.ndarray, "T n"]


class Track:
    """A clip's keypoints over time.

    Args:
        clip: With a camera that does not move.
        times: Seconds of its frames; None: at its frame rate.
    """

    def __init__(self, clip: Clip, times: Float[np.ndarray, "T"] | None = None) -> None:
        self.clip = clip
        self.times = np.arange(len(clip)) / clip.frame_rate if times is None else times - times[0]
        self.keypoints, _ = unswapped(clip.keypoints)
        confidence = np.where(self.keypoints.overruled, 0.0, seen_confidence(self.keypoints, clip.camera))
        self.confidence = np.where(confidence > SEEN, np.minimum(confidence, 1.0), 0.0)
        flat = rays_of(self.keypoints.xy, clip.camera)
        rays = np.concatenate([flat, np.ones_like(flat[..., :1])], -1)
        self.rays: Float[np.ndarray, "T 137 3"] = rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    @cached_property
    def lifted(self) -> LiftedClip:
        """Estimated from this view alone."""
        return lifted_keypoints(self.keypoints, self.clip.camera, self.clip.frame_rate)

    @cached_property
    def pelvis(self) -> Float[np.ndarray, "T 3"]:
        """In camera space, metres, if the person is as tall as the average adult."""
        rays = self.rays[:, :_BODY, :2] / self.rays[:, :_BODY, 2:]
        return place_on_rays(self.lifted.points, rays, self.confidence[:, :_BODY])[0]

    def nearest(self, times: Float[np.ndarray, "S"]) -> Int[np.ndarray, "S"]:
        """The nearest frames."""
        i, share, _ = self._between(times)
        return i + (share > 0.5)

    @cached_property
    def distance(self) -> float:
        """Median depth of the pelvis, metres."""
        return max(float(np.median(self.pelvis[:, 2])), 0.3)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return float(self.times[-1])

    @cached_property
    def smoothed(self) -> Smoothed:
        """Rays of body keypoints, by local linear regression (W. S. Cleveland, JASA 74, 1979) with Gaussian weights."""
        rays, confidence, count = self.rays[:, :_BODY], self.confidence[:, :_BODY], len(self.times)
        reach = int(np.ceil(2.5 * _SMOOTH / np.median(np.diff(self.times))))
        near = np.arange(count)[:, None] + np.arange(-reach, reach + 1)
        inside, near = (near >= 0) & (near < count), near.clip(0, count - 1)
        apart = (self.times[near] - self.times[:, None])[..., None]
        kernel = np.exp(-0.5 * (apart / _SMOOTH) ** 2) * inside[..., None]
        weight = kernel * confidence[near]
        total, first, second = (np.sum(weight * apart**power, axis=1) for power in range(3))
        mean = np.einsum("tkn,tknd->tnd", weight, rays[near]) / np.maximum(total, 1e-9)[..., None]
        moment = np.einsum("tkn,tknd->tnd", weight * apart, rays[near])
        centre = first / np.maximum(total, 1e-9)
        spread = second - centre * first
        enough = spread > 1e-3 * _SMOOTH**2 * total
        slopes = (moment - centre[..., None] * total[..., None] * mean) / np.where(enough, spread, 1.0)[..., None]
        slopes = np.where(enough[..., None], slopes, 0.0)
        return Smoothed(
            values=mean - centre[..., None] * slopes, slopes=slopes, weights=total / np.maximum(kernel.sum(1), 1e-9)
        )

    def smoothed_at(
        self, times: Float[np.ndarray, "S"]
    ) -> tuple[Float[np.ndarray, "S 25 3"], Float[np.ndarray, "S 25"]]:
        """Smoothed rays of body keypoints, by cubic Hermite interpolation, and their weights.

        Weights fall to 0 toward the ends: otherwise the sum of errors would jump with the offset.
        """
        i, share, there = self._between(times)
        s, x, step = self.smoothed, share[:, None, None], (self.times[i + 1] - self.times[i])[:, None, None]
        values = (1 + 2 * x) * (1 - x) ** 2 * s.values[i] + x * x * (3 - 2 * x) * s.values[i + 1]
        values += x * (1 - x) * step * ((1 - x) * s.slopes[i] - x * s.slopes[i + 1])
        ends = np.minimum(times, self.duration - times).clip(0.0, _GAP) / _GAP
        weights = (1 - share[:, None]) * s.weights[i] + share[:, None] * s.weights[i + 1]
        return values, weights * (ends * there)[:, None]

    def lifted_at(self, times: Float[np.ndarray, "S"]) -> tuple[Float[np.ndarray, "S 25 3"], Float[np.ndarray, "S 25"]]:
        """The lifter's points and their deviations in depth, linearly interpolated."""
        i, share, _ = self._between(times)
        points, spread = self.lifted.points, self.lifted.depth_deviation
        share = share[:, None]
        return (
            (1 - share[..., None]) * points[i] + share[..., None] * points[i + 1],
            (1 - share) * spread[i] + share * spread[i + 1],
        )

    def at(
        self, times: Float[np.ndarray, "S"]
    ) -> tuple[Float[np.ndarray, "S 137 3"], Float[np.ndarray, "S 137"], Bool[np.ndarray, "S 137"]]:
        """Rays, confidence, and whether a person placed the keypoint, linearly interpolated where both neighbours show
        it; else of the nearer one, if that is at the same time."""
        i, share, there = self._between(times)
        exact = (abs(share - share.round()) < 1e-3)[:, None]
        share = np.where(exact, share[:, None].round(), share[:, None])
        sure = self.confidence
        both = np.where(exact, np.where(share < 0.5, sure[i], sure[i + 1]) > 0, (sure[i] > 0) & (sure[i + 1] > 0))
        rays = (1 - share)[..., None] * self.rays[i] + share[..., None] * self.rays[i + 1]
        confidence = ((1 - share) * sure[i] + share * sure[i + 1]) * (both & there[:, None])
        placed = np.where(share < 0.5, self.keypoints.placed[i], self.keypoints.placed[i + 1])
        return rays, confidence, placed

    def _between(
        self, times: Float[np.ndarray, "S"]
    ) -> tuple[np.ndarray, Float[np.ndarray, "S"], Bool[np.ndarray, "S"]]:
        """The frame before, the share of the way to the next, and whether the clip shows that time."""
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        step = self.times[i + 1] - self.times[i]
        share = (times - self.times[i]) / step
        return i, share.clip(0.0, 1.0), (share > -1e-6) & (share < 1 + 1e-6) & (step < _GAP)
