"""The options of `tcfit detect`. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from fitting_core.detect.detectors import DEFAULT
from tcfit_app.options.fit import DETECTOR_NAMES, JsonLines, shown


@dataclass(frozen=True, kw_only=True)
class DetectOptions:
    """Detect the keypoints of all people in a video, and write them as OpenPose JSON.

    `tcfit fit`, `new`, `review` and `batch` detect keypoints themselves if none are given. Detections are cached for
    all commands. After Ctrl-C, the same command continues with the remaining frames.
    """

    video: Annotated[Positional[Path | None], arg(metavar="VIDEO", help_behavior_hint="(required)")] = None
    """A video file or a folder of images."""
    detector: Annotated[str, shown("NAME|POSE.onnx", DEFAULT, DETECTOR_NAMES)] = DEFAULT
    boxes: Annotated[str | None, shown("NAME|BOX.onnx", "that of the detector; none for an ONNX model")] = None
    """Person detector for models of the RTMPose family: RTMDet or YOLOX. Without it, one person is followed, who must
    fill much of the first frame."""
    out: Annotated[Path | None, shown("DIR", "the video's name with _keypoints, in this folder")] = None
    """Folder for the JSON files. Files of the same video are replaced."""
    first_frame: Annotated[int | None, shown("N", "the first")] = None
    """Number of the first frame, from 0."""
    last_frame: Annotated[int | None, shown("N", "the last")] = None
    """Number of the last frame."""
    provider: Annotated[str, arg(metavar="{cpu,cuda}")] = "cpu"
    """Device for models of the RTMPose family. cuda needs onnxruntime-gpu."""
    threads: Annotated[int, shown("N", "chosen for this computer")] = 0
    """Number of threads of each network."""
    json: JsonLines = False
