"""Fits of the tiny body whose figures are known: a still person whose keypoints lie just where the body has them."""

from dataclasses import replace

import numpy as np
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import project
from fitting_core.keypoints import Keypoints
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.analysis.posed_fit import PosedFit
from tests.samples.scenes import CAMERA, clip_of, noisy, random_params


def keypoints_of(body: BodyModel, params: BodyParams) -> Keypoints:
    """Exact projections with confidence 1: as `tests.samples.scenes.keypoints_of`, which takes a second."""
    points, exists = keypoints_in_space(body, params)
    xy = np.zeros((*points.shape[:2], 2))
    xy[:, exists] = project(CAMERA, torch.as_tensor(points[:, exists])).numpy()
    return Keypoints(xy=xy, confidence=np.tile(exists * 1.0, (len(params), 1)))


def still_params(frames: int) -> BodyParams:
    one = random_params(1, size=0.15)
    return one[[0] * frames]


def fit_of(body: BodyModel, params: BodyParams, keypoints: Keypoints | None = None) -> PosedFit:
    """A fit with exact keypoints, or others."""
    clip = clip_of(keypoints or keypoints_of(body, params))
    return PosedFit.posed(replace(clip, camera=CAMERA), params, Meshes(body))


def still_fit(body: BodyModel, frames: int = 40, *, pixels: float = 1.0) -> PosedFit:
    """A still person and a detector with some noise and confidences between 0.65 and 1."""
    params = still_params(frames)
    keypoints = noisy(keypoints_of(body, params), pixels)
    seen = keypoints.confidence > 0
    return fit_of(body, params, replace(keypoints, confidence=np.where(seen, 0.5 + 0.5 * keypoints.confidence, 0)))


def with_keypoints(fit: PosedFit, xy: np.ndarray | None = None, confidence: np.ndarray | None = None) -> PosedFit:
    """The same poses over other keypoints."""
    old = fit.clip.keypoints
    changed = Keypoints(
        xy=old.xy if xy is None else xy, confidence=old.confidence if confidence is None else confidence
    )
    return PosedFit.posed(replace(fit.clip, keypoints=changed), fit.params, fit.meshes, frame_cost=fit.frame_cost)


def displaced(fit: PosedFit, frames: slice | int, joints: list[int] | str, by: tuple[float, float]) -> PosedFit:
    """Keypoints at a distance in pixels from where they are."""
    xy = fit.clip.keypoints.xy.copy()
    chosen = [kp.INDEX[joints]] if isinstance(joints, str) else joints
    for joint in chosen:
        xy[frames, joint] += by
    return with_keypoints(fit, xy=xy)
