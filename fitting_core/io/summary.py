"""summary.json: how a fit went, in numbers."""

import platform
from dataclasses import asdict, replace
from importlib import metadata
from typing import Any

import msgspec
import numpy as np
import torch
from jaxtyping import Bool, Float

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.clip import Clip
from fitting_core.config.toml import as_plain
from fitting_core.files.regular import legible
from fitting_core.ground.grounding import Grounding
from fitting_core.image_border import cut_off
from fitting_core.metrics import error_figures, jitter, reprojection_errors
from fitting_core.results.fit_result import FitResult

CONFIDENT = 0.3
"""Only keypoints with more confidence count in the reprojection error."""
_MEASURED = (1, 3)
"""Phases with their own poses; phase 2 only changes the shape."""
_PACKAGES = ("tcfit", "torch", "numpy")


def summary(fit: FitResult, clip: Clip, body: BodyModel, *, complete: bool, command: str) -> dict[str, Any]:
    """The content of summary.json; numbers that are not finite become null in JSON.

    The reprojection error is over keypoints of all groups that the body has, with a confidence above CONFIDENT.
    In any configuration, detections of parts that the image cuts off (image_border.cut_off) are left out, as
    their true place is unknown. So fits of one clip are always measured on the same keypoints.
    """
    measured = [p for p in fit.phases if p.phase in _MEASURED]
    counted = counted_keypoints(clip, body)
    return {
        "complete": complete,
        "clip": legible(clip.name),
        "frames": len(clip),
        "first_frame": clip.first_frame,
        "frame_rate": clip.frame_rate,
        "detector": clip.detector,
        "seconds": {f"phase{p.phase}": p.seconds for p in fit.phases} | {"total": sum(p.seconds for p in fit.phases)},
        "reprojection_px": {f"phase{p.phase}": reprojection(clip, body, p.params, counted) for p in measured},
        "jitter": {f"phase{p.phase}": _jitter(body, p.params, fit.camera) for p in measured},
        "objective": {f"phase{p.phase}": p.objective for p in fit.phases},
        "betas": fit.last.params.betas.mean(0).tolist(),
        "camera": {
            "focal": fit.camera.focal,
            "center": fit.camera.center,
            "size": fit.camera.size,
            "focal_from": fit.camera.focal_from,
            "source": fit.camera.source,
            "lens": msgspec.to_builtins(fit.camera.lens),
            "world": msgspec.to_builtins(fit.camera.world),
            "moves": fit.camera.path is not None,
        },
        "body": {
            "kind": body.kind,
            "gender": body.gender,
            "source": legible(body.source.name) if body.source else "",
            "hash": body.hash,
        },
        "ground": None if fit.grounding is None else _ground(fit.grounding),
        "start": None if fit.start is None else asdict(fit.start.about),
        "pose_prior": legible(fit.pose_prior),
        "warnings": [legible(warning) for warning in fit.warnings],
        "config": as_plain(replace(fit.config, pose_prior=legible(fit.config.pose_prior))),
        "versions": versions(),
        "command": legible(command),
    }


def _ground(grounding: Grounding) -> dict[str, Any]:
    gravity, ground = grounding.gravity, grounding.ground
    return {
        "text": grounding.text,
        "seen": ground is not None,
        "standing_share": grounding.contacts.share,
        "let_go_share": grounding.contacts.let_go_share,
        "camera_tilt_degrees": gravity.tilt,
        "gravity_deviation_degrees": gravity.deviation,
        "camera_height_m": None if ground is None else ground.offset,
    }


def counted_keypoints(clip: Clip, body: BodyModel) -> Bool[np.ndarray, "T 137"]:
    """Confident keypoints that are neither cut off by the image border nor overruled by a stated handshape."""
    inside = (cut_off(clip.keypoints, clip.camera) == 0).all(-1)
    return inside & (clip.keypoints.confidence > CONFIDENT) & ~clip.keypoints.overruled


def reprojection(
    clip: Clip, body: BodyModel, params: BodyParams, counted: Bool[np.ndarray, "T 137"]
) -> dict[str, float | int | None]:
    """`error_figures` in pixels, and over how many keypoints."""
    points, exists = keypoints_in_space(body, params)
    pixels = project(clip.camera, torch.as_tensor(points[:, exists])).numpy()
    errors, counted = np.full(counted.shape, np.nan), counted & exists
    errors[counted] = reprojection_errors(pixels, clip.keypoints.xy[:, exists], counted[:, exists])
    return {**error_figures(errors), "keypoints": int(counted.sum())}


def _jitter(body: BodyModel, params: BodyParams, camera: Camera) -> dict[str, float]:
    """Mean second difference of the 55 joints, with and without the camera translation, not the camera's own."""
    joints: Float[np.ndarray, "T 55 3"] = joints_in_space(body, params)
    in_body = camera.turned_to_still(joints - params.camera_translation.numpy()[:, None])
    return {"camera_space_mm_per_frame2": jitter(camera.to_still(joints)), "body_space_mm_per_frame2": jitter(in_body)}


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that affect a fit's result."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found
