"""What a user may say of a clip and of its camera, in the library and on the command line. Imports nothing heavy."""

from dataclasses import dataclass, replace
from pathlib import Path

from fitting_core.camera import FocalRule, Up
from fitting_core.detect.detectors import DEFAULT

_AS_PUBLISHED = ("paper", "smplifyx")
"""Presets whose figures are compared with those of others: the focal length is not estimated unless asked for."""


@dataclass(frozen=True, kw_only=True)
class ClipOptions:
    """Which part of the clip, and how its files are read."""

    detector: str = DEFAULT
    """What finds keypoints in the video where none are given: a name in `DETECTORS`, or the path of an ONNX model of
    the RTMPose family."""
    person: int | None = None
    """Whoever has this place, from 0, in the first frame whose list of people has it; followed from there."""
    first_frame: int | None = None
    """Number of the first frame to fit, from 0."""
    last_frame: int | None = None
    """Number of the last frame to fit."""
    frame_rate: float | None = None
    """Frames per second."""
    keypoint_scale: str = "auto"
    """What keypoint coordinates are relative to, as OpenPose's --keypoint_scale."""
    image_size: tuple[int, int] | None = None
    """Image size in pixels, where there is no video."""


@dataclass(frozen=True, kw_only=True)
class CameraOptions:
    """The camera. Give at most one of the first three, or a camera file."""

    focal_length: float | FocalRule | None = None
    """Focal length in pixels. auto: what photographs or a phone's video tell, or else an estimate from how the person
    moves and looks; diagonal: as long as the image's diagonal, a 43 mm equivalent."""
    fov: float | None = None
    """Horizontal field of view in degrees."""
    focal_length_35mm: float | None = None
    """Focal length in millimetres on 35 mm film, as phones and cameras state it."""
    center: tuple[float, float] | None = None
    """Principal point in pixels."""
    camera: Path | None = None
    """A calibration, with the lens's distortion, the camera's place and its path: npz, TOML of Pose2Sim or caliscope,
    OpenCV's YAML, XML or JSON, a transforms.json, or COLMAP's cameras.txt."""
    camera_name: str | None = None
    """Which camera of that file."""
    camera_unit: float | None = None
    """Length of one unit of that file's world: 0.001 where it is in millimetres."""
    camera_up: Up | None = None
    """The axis of that file's world that points up."""

    def for_preset(self, preset: str) -> "CameraOptions":
        """With the image's diagonal where no focal length is given and the preset follows a paper; else as they are.

        Args:
            preset: A name in `PRESETS`, from which the fit's configuration starts.
        """
        given = (self.focal_length, self.fov, self.focal_length_35mm, self.camera)
        if preset not in _AS_PUBLISHED or any(value is not None for value in given):
            return self
        return replace(self, focal_length="diagonal")
