"""A fit together with its keypoints: the input of curves, review queue and figures."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from fitting_core.body.model import JOINT
from fitting_core.body.params import BodyParams
from fitting_core.camera import project
from fitting_core.clip import Clip
from fitting_core.fit.evidence.sides import PAIRED, unswapped
from fitting_core.ground.grounding import Grounding
from fitting_core.io.summary import counted_keypoints
from fitting_core.metrics import reprojection_errors
from fitting_core.motion import Motion
from fitting_core.results.error_bars import ErrorBars
from fitting_core.results.fit_result import FitResult, PhaseResult
from tcfit_app.analysis.meshes import Meshes

_NEAR = 0.01
"""Metres: points closer to the camera's plane, or behind it, are not visible."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedFit:
    """The poses of a fit over a clip. Positions are evaluated lazily.

    Thread-safe: two concurrent requests evaluate twice, with the same result.
    """

    clip: Clip
    """With the current keypoints, and the fit's camera."""
    params: BodyParams
    meshes: Meshes
    space: Literal["body", "camera"] = "camera"
    """In which the fit's temporal term compares joints (`Temporal.space`)."""
    tracked: Bool[np.ndarray, "137"]
    """Keypoints detected in any frame of the whole clip."""
    bad: Bool[np.ndarray, "T 137"]
    """Keypoints marked bad by a person (`Corrected.bad`); their confidence is 0."""
    frame_cost: Float[np.ndarray, "T"] | None = None
    """E_o of each frame, if the phase of these parameters recorded it."""
    error_bars: ErrorBars | None = None
    """Error bars of joints and angles; None if unknown."""
    there: Bool[np.ndarray, "T"] | None = None
    """Frames with a pose; None: all. Nothing is measured in the others."""
    grounding: Grounding | None = None
    """Floor and contacts of the feet; None if unknown."""
    size: float | None = None
    """`FitResult.size`; None if unknown, and of phase 1, which does not have it yet."""

    @staticmethod
    def of(
        clip: Clip,
        fit: FitResult,
        meshes: Meshes,
        *,
        phase: PhaseResult | None = None,
        bad: Bool[np.ndarray, "T 137"] | None = None,
        there: Bool[np.ndarray, "T"] | None = None,
    ) -> "PosedFit":
        """One phase of a run, by default its last.

        Args:
            clip: `Project.clip`, with corrected keypoints.
            fit: The run; its camera is used.
            meshes: For the body it was fitted with.
            phase: One of the fit's.
            bad: `Project.corrected.bad`; None: no keypoints are bad.
            there: Frames with a pose; None: all.
        """
        chosen = phase or fit.last
        space = fit.config.temporal.space
        seen = replace(clip, camera=fit.camera)
        if there is not None:
            seen = replace(
                seen, keypoints=replace(seen.keypoints, confidence=seen.keypoints.confidence * there[:, None])
            )
        found = PosedFit.posed(seen, chosen.params, meshes, space=space, bad=bad, frame_cost=chosen.frame_cost)
        size = fit.size if chosen.phase > 1 else None
        return replace(found, there=there, error_bars=chosen.error_bars, grounding=fit.grounding, size=size)

    @staticmethod
    def posed(
        clip: Clip,
        params: BodyParams,
        meshes: Meshes,
        *,
        space: Literal["body", "camera"] = "camera",
        bad: Bool[np.ndarray, "T 137"] | None = None,
        frame_cost: Float[np.ndarray, "T"] | None = None,
    ) -> "PosedFit":
        """Any parameters over a whole clip, such as those of a window just fitted."""
        assert len(clip) == len(params)
        tracked = np.asarray((clip.keypoints.confidence > 0).any(0))
        marked = np.zeros(clip.keypoints.confidence.shape, bool) if bad is None else bad
        return PosedFit(
            clip=clip, params=params, meshes=meshes, space=space, tracked=tracked, bad=marked, frame_cost=frame_cost
        )

    def __len__(self) -> int:
        return len(self.params)

    @property
    def motion(self) -> Motion:
        """In camera space."""
        body, clip = self.meshes.body, self.clip
        return Motion(body=body, params=self.params, camera=clip.camera, frame_rate=clip.frame_rate, name=clip.name)

    @cached_property
    def joints(self) -> Float[np.ndarray, "T 55 3"]:
        """The kinematic joints in camera space, metres."""
        return self.meshes.joints(self.params)

    @property
    def joints_in_body(self) -> Float[np.ndarray, "T 55 3"]:
        """The same without the camera's translation; rotated to still space (see `CameraPath`)."""
        return self.clip.camera.turned_to_still(self.joints - self.params.camera_translation.numpy()[:, None])

    @property
    def still_joints(self) -> Float[np.ndarray, "T 55 3"]:
        """The joints in still space, which does not move with the camera; metres."""
        return self.clip.camera.to_still(self.joints)

    @property
    def compared_joints(self) -> Float[np.ndarray, "T 55 3"]:
        """The joints as the fit's temporal term compares them."""
        return self.still_joints if self.space == "camera" else self.joints_in_body

    @cached_property
    def points(self) -> Float[np.ndarray, "T 137 3"]:
        """The body's keypoints in camera space, metres; NaN for missing ones."""
        return self.meshes.keypoints(self.params)

    @cached_property
    def projected(self) -> Float[np.ndarray, "T 137 2"]:
        """Pixels of the body's keypoints; NaN for missing ones and those behind the camera."""
        hidden = ~(self.points[..., 2] >= _NEAR)
        pixels = project(self.clip.camera, torch.as_tensor(np.where(hidden[..., None], 1.0, self.points))).numpy()
        pixels[hidden] = np.nan
        return pixels

    @cached_property
    def counted(self) -> Bool[np.ndarray, "T 137"]:
        """Keypoints with errors: those of summary.json that the body has."""
        return counted_keypoints(self.clip, self.meshes.body) & np.isfinite(self.projected).all(-1)

    @cached_property
    def errors(self) -> Float[np.ndarray, "T 137"]:
        """Reprojection errors in pixels; NaN for keypoints that are not counted."""
        errors = np.full(self.counted.shape, np.nan)
        errors[self.counted] = reprojection_errors(self.projected, self.clip.keypoints.xy, self.counted)
        return errors

    @cached_property
    def swapped_back(self) -> dict[str, Int[np.ndarray, "n"]]:
        """Frames in which the detector swapped left and right limbs and the fit unswapped them, by pair."""
        found = {}
        for name, frames in unswapped(self.clip.keypoints)[1].items():
            left, right, _ = PAIRED[name]
            ends, others = left[:2] + right[:2], right[:2] + left[:2]
            straight, crossed = self._apart(frames, ends, ends), self._apart(frames, ends, others)
            if (agrees := crossed < straight).any():
                found[name] = frames[agrees]
        return found

    def _apart(self, frames: np.ndarray, found: list[int], fitted: list[int]) -> Float[np.ndarray, "n"]:
        """Distances between detected and fitted keypoints, where both exist, summed per frame; pixels."""
        keypoints = self.clip.keypoints[frames]
        seen = keypoints.confidence[:, found] > 0
        off = keypoints.xy[:, found] - self.projected[frames][:, fitted]
        return np.where(seen, np.nan_to_num(np.linalg.norm(off, axis=-1)), 0).sum(1)

    @cached_property
    def with_own_sides(self) -> "PosedFit":
        """The same with keypoints unswapped where the fit did so."""
        keypoints, back = self.clip.keypoints, unswapped(self.clip.keypoints)[0]
        xy, confidence = keypoints.xy.copy(), keypoints.confidence.copy()
        for name, frames in self.swapped_back.items():
            left, right, others = PAIRED[name]
            at = np.ix_(frames, [*left, *right, *others[0], *others[1]])
            xy[at], confidence[at] = back.xy[at], back.confidence[at]
        return replace(self, clip=replace(self.clip, keypoints=replace(keypoints, xy=xy, confidence=confidence)))

    @cached_property
    def jumps(self) -> Float[np.ndarray, "T 55"]:
        """Length of each joint's second difference in time, mm per frame^2, in still space; NaN at both ends."""
        return second_differences(self.still_joints)

    @property
    def root(self) -> Float[np.ndarray, "T 3"]:
        """The pelvis in camera space, metres."""
        return self.joints[:, JOINT["pelvis"]]


def second_differences(points: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T K"]:
    """Length of 2 x_i - x_{i-1} - x_{i+1} in mm per frame^2 (points in metres); NaN for the first and last frame."""
    lengths = np.full(points.shape[:2], np.nan)
    if len(points) > 2:
        lengths[1:-1] = 1e3 * np.linalg.norm(np.diff(points, 2, axis=0), axis=-1)
    return lengths
