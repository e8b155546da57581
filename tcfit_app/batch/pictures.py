"""A small picture of each clip for the batch's report: the fit over its most suspicious frame."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from fitting_core.body.model import BodyModel
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.render.overlay import draw_keypoints
from fitting_core.results.fit_result import FitResult
from fitting_core.video.frames import FrameSource
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.suspicion import Suspect, review_queue
from tcfit_app.evaluation.worst_frames import PlacedBody, camera_around, in_software, placed_body
from tcfit_app.project.picture import GROUND, SIZE, as_jpeg, keep

_SHARPNESS = 2
"""It is drawn so many times as large, and reduced."""
_COLOR = (0.16, 0.40, 0.78)
_OPACITY = 0.6
"""Of the body, so that the person stays to be seen."""
_NEAREST = 0.1
"""Metres: a body nearer to the camera, or behind it, is not drawn."""


def suspects(fit: FitResult, clip: Clip, body: BodyModel) -> tuple[Suspect, ...]:
    """The entries that a fit would have in the review queue, the worst first."""
    return review_queue(PosedFit.of(clip, fit, Meshes(body))).left


def write_picture(path: Path, fit: FitResult, clip: Clip, body: BodyModel, *, frame: int) -> None:
    """Write a JPEG of the body over its frame, cut to the person. Raises OSError if it cannot be written.

    Args:
        path: The file; its folder is made.
        fit: Its last phase is drawn.
        clip: Its images lie below, if it has any that can be read, and its keypoints above.
        body: With which it was fitted.
        frame: Counted from the clip's first as 0.
    """
    placed = placed_body(body, fit.last.params, frame, _COLOR)
    drawn = placed.vertices[:, 2].min() > _NEAREST
    size = (_SHARPNESS * SIZE[0], _SHARPNESS * SIZE[1])
    camera = camera_around(_in_the_image(placed, fit.camera), fit.camera, size=size) if drawn else fit.camera
    image = _ground(clip, fit.camera, camera, frame)
    if drawn:
        over = in_software(placed, camera, image)
        image = cv2.addWeighted(over, _OPACITY, image, 1 - _OPACITY, 0)
        factor = np.array(camera.focal) / fit.camera.focal
        xy = (clip.keypoints.xy[frame] - fit.camera.center) * factor + camera.center
        draw_keypoints(image, xy, clip.keypoints.confidence[frame])
    keep(path, as_jpeg(image))


def _in_the_image(body: PlacedBody, camera: Camera) -> PlacedBody:
    """Without what the image cuts off, such as a signer's legs; all of it if nothing is left."""
    pixels = body.vertices[:, :2] / body.vertices[:, 2:] * camera.focal + camera.center
    inside = ((pixels >= 0) & (pixels < camera.size)).all(1)
    return replace(body, vertices=body.vertices[inside]) if inside.any() else body


def _ground(clip: Clip, own: Camera, cut: Camera, frame: int) -> UInt8[np.ndarray, "H W 3"]:
    """What the cut camera sees of the frame's image; plain where there is none."""
    plain = np.full((*cut.size[::-1], 3), GROUND, np.uint8)
    if clip.source is None:
        return plain
    try:
        with FrameSource(clip.source) as source:
            image = source.frame(clip.first_frame + frame)
    except InputError:  # The fit needs no images, so one that cannot be decoded is no reason to fail.
        return plain
    factor = np.array(cut.focal) / own.focal
    shift = np.array(cut.center) - factor * own.center
    moved = np.array([[factor[0], 0, shift[0]], [0, factor[1], shift[1]]])
    return cv2.warpAffine(image, moved, cut.size, flags=cv2.INTER_AREA, borderValue=GROUND)
