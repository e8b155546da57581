"""Options of a clip and of its camera, in the library and on the command line. Imports nothing heavy."""

from dataclasses import dataclass, replace
from pathlib import Path

from fitting_core.config.choices import FocalRule, Up
from fitting_core.detect.detectors import DEFAULT

_AS_PUBLISHED = ("paper", "smplifyx")
"""Presets whose figures are compared with published ones: the focal length is estimated only on request."""


@dataclass(frozen=True, kw_only=True)
class ClipOptions:
    """Part of the clip, and how its files are read."""

    detector: str = DEFAULT
    """Detector of keypoints in the video if none are given: a name in `DETECTORS`, or the path of an ONNX model of the
    RTMPose family."""
    person: int | None = None
    """Index of the person, from 0, in the first frame with at least that many people; tracked from there."""
    first_frame: int | None = None
    """Number of the first frame to fit, from 0."""
    last_frame: int | None = None
    """Number of the last frame to fit."""
    frame_rate: float | None = None
    """Frames per second."""
    keypoint_scale: str = "auto"
    """Scale of the keypoint coordinates, as OpenPose's --keypoint_scale."""
    image_size: tuple[int, int] | None = None
    """Image size in pixels, if there is no video."""


@dataclass(frozen=True, kw_only=True)
class CameraOptions:
    """The camera. The first three options and the camera file exclude each other."""

    focal_length: float | FocalRule | None = None
    """Focal length in pixels. auto: from the metadata of photographs or a phone's video, or else estimated from
    the person's motion and proportions; diagonal: the image diagonal, equivalent to 43 mm."""
    fov: float | None = None
    """Horizontal field of view in degrees."""
    focal_length_35mm: float | None = None
    """35 mm equivalent focal length in millimetres, as phones and cameras state it."""
    center: tuple[float, float] | None = None
    """Principal point in pixels."""
    camera: Path | None = None
    """Calibration file, with lens distortion, position and path: npz, TOML of Pose2Sim or caliscope,
    OpenCV's YAML, XML or JSON, a transforms.json, or COLMAP's cameras.txt."""
    camera_name: str | None = None
    """Name of the camera in the file."""
    camera_unit: float | None = None
    """Unit of the file's world, in metres: 0.001 for millimetres."""
    camera_up: Up | None = None
    """Up direction in the file's world."""

    def for_preset(self, preset: str) -> "CameraOptions":
        """With the image's diagonal if no focal length is given and the preset follows a paper; otherwise unchanged.

        Args:
            preset: A name in `PRESETS`, from which the fit's configuration starts.
        """
        given = (self.focal_length, self.fov, self.focal_length_35mm, self.camera)
        if preset not in _AS_PUBLISHED or any(value is not None for value in given):
            return self
        return replace(self, focal_length="diagonal")
