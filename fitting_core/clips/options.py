"""Options of a clip and of its camera, in the library and on the command line. Imports nothing heavy."""

from dataclasses import dataclass, replace
from pathlib import Path

from fitting_core.config.choices import FocalRule, Up
from fitting_core.detect.detectors import DEFAULT

_AS_PUBLISHED = ("paper", "smplifyx")
"""Presets whose figures are compared with published ones: the focal length is estimated only on request."""


@dataclass(frozen=True, kw_only=True)
class ClipOptions:
    """Which part of the clip to fit, and how to read its files."""

    detector: str = DEFAULT
    """Detector of keypoints in the video if none are given: a name in `DETECTORS`, or the path of an ONNX model of the
    RTMPose family."""
    person: int | None = None
    """Index, from 0, of a person in the first frame whose list of people has it; followed from there."""
    first_frame: int | None = None
    """Number of the first frame to fit, from 0."""
    last_frame: int | None = None
    """Number of the last frame to fit."""
    frame_rate: float | None = None
    """Frames per second."""
    keypoint_scale: str = "auto"
    """What keypoint coordinates are relative to, as in OpenPose's --keypoint_scale."""
    image_size: tuple[int, int] | None = None
    """Image size in pixels, if there is no video."""


@dataclass(frozen=True, kw_only=True)
class CameraOptions:
    """The camera. Give at most one of the first three, or a camera file."""

    focal_length: float | FocalRule | None = None
    """Focal length in pixels. auto: from the metadata of photographs or a phone's video, or else estimated from how the
    person moves and looks; diagonal: as long as the image's diagonal, a 43 mm equivalent."""
    fov: float | None = None
    """Horizontal field of view in degrees."""
    focal_length_35mm: float | None = None
    """35 mm equivalent focal length in millimetres, as phones and cameras state it."""
    center: tuple[float, float] | None = None
    """Principal point in pixels."""
    camera: Path | None = None
    """A calibration, with the lens's distortion, the camera's place and its path: npz, TOML of Pose2Sim or caliscope,
    OpenCV's YAML, XML or JSON, a transforms.json, or COLMAP's cameras.txt."""
    camera_name: str | None = None
    """Which camera of that file."""
    camera_unit: float | None = None
    """Length in metres of one unit of that file's world: 0.001 for millimetres."""
    camera_up: Up | None = None
    """The axis of that file's world that points up."""

    def for_preset(self, preset: str) -> "CameraOptions":
        """With the image's diagonal if no focal length is given and the preset follows a paper; otherwise unchanged.

        Args:
            preset: A name in `PRESETS`, from which the fit's configuration starts.
        """
        given = (self.focal_length, self.fov, self.focal_length_35mm, self.camera)
        if preset not in _AS_PUBLISHED or any(value is not None for value in given):
            return self
        return replace(self, focal_length="diagonal")
