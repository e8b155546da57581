"""Unstated facts of a camera: its focal length, read from its files; a path's scale."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from fitting_core.camera import Camera, FocalFrom, PathScale, focal_from_35mm
from fitting_core.keypoints import Keypoints
from fitting_core.lens import straightened_keypoints
from fitting_core.video.decoding import told_35mm
from fitting_core.video.images import IMAGE_SUFFIXES, focal_35mm, image_files

_LENSES_MM = (5.0, 2000.0)
"""Plausible 35 mm equivalents in a file; others are mistakes."""


def told_by_files(camera: Camera, images: Path | None) -> Camera | None:
    """The camera with the focal length stored in a clip's photographs or video; None: none, or several."""
    if images is None:
        return None
    if images.is_dir() or images.suffix.lower() in IMAGE_SUFFIXES:
        files, who = image_files(images) or (images,), "stated by the images"
        # The first and the last: a zoom between them, or a folder put together from several cameras, is not one lens.
        lengths = {focal_35mm(file) for file in (files[0], files[-1])}
    else:
        lengths, who = {told_35mm(images)}, "stated by the video"
    millimetres = lengths.pop()
    if lengths or millimetres is None or not _LENSES_MM[0] <= millimetres <= _LENSES_MM[1]:
        return None
    focal = focal_from_35mm(millimetres, camera.size)
    source = f"35 mm equivalent of {millimetres:g} mm, {who}"
    return replace(camera, focal=(focal, focal), focal_from=FocalFrom.PHOTOGRAPHS, source=source)


def scale_by(keypoints: Keypoints, frame_rate: float) -> Callable[[Camera], PathScale | None]:
    """Returns a function that estimates the scale of a moving camera's path.

    Args:
        keypoints: Of the whole clip, as filmed, with distortion.
        frame_rate: Frames per second.
    """

    def scale_of(camera: Camera) -> PathScale | None:
        from fitting_core.ground.path_scale import estimate_path_scale  # loads torch

        straight, _ = straightened_keypoints(keypoints, camera.lens)
        return estimate_path_scale(straight.xy, straight.confidence, camera, frame_rate)

    return scale_of
