"""The options of `tcfit detect`. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, UseAppendAction, arg

from fitting_core.detect.detectors import DEFAULT
from tcfit_app.options.fit import DETECTOR_NAMES, JsonLines, shown


@dataclass(frozen=True, kw_only=True)
class DetectOptions:
    """Find everybody's keypoints in a video, and write them as OpenPose JSON, for other programs or to look at.

    `tcfit fit`, `new`, `review` and `batch` find keypoints by themselves where none are given. What has been found is
    kept for them and for the next time. After Ctrl-C the same command goes on with the frames that are left.
    """

    video: Annotated[
        Positional[Path | None], arg(metavar="VIDEO", help_behavior_hint="(required, except with --list or --download)")
    ] = None
    """A video file or a folder of images."""
    detector: Annotated[str, shown("NAME|POSE.onnx", DEFAULT, DETECTOR_NAMES)] = DEFAULT
    boxes: Annotated[str | None, shown("NAME|BOX.onnx", "that of the detector; of an ONNX model none")] = None
    """For models of the RTMPose family: what finds people, RTMDet or YOLOX. Without it, one person is followed from
    frame to frame, who should fill much of the first one."""
    out: Annotated[Path | None, shown("DIR", "the video's name with _keypoints, in this folder")] = None
    """Folder for the JSON files. Those of the same video are replaced."""
    first_frame: Annotated[int | None, shown("N", "the first")] = None
    """Number of the first frame, from 0."""
    last_frame: Annotated[int | None, shown("N", "the last")] = None
    """Number of the last frame."""
    provider: Annotated[str, arg(metavar="{cpu,cuda}")] = "cpu"
    """Where models of the RTMPose family run; cuda needs onnxruntime-gpu."""
    batch: int = 8
    """Frames that go through such a model at once. The result does not depend on it."""
    threads: Annotated[int, shown("N", "what suits this computer")] = 0
    """Of each network or model."""
    restart: bool = False
    """Do not take what was found before, but start anew."""
    json: JsonLines = False
    list: bool = False
    """Show the detectors and the models that can be downloaded, their licences, and what is here."""
    download: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="NAME", help_behavior_hint="(repeatable)")] = ()
    """Fetch all that a detector needs, or a model, from its publisher, after you have agreed."""
    yes: bool = False
    """With --download: agree beforehand."""
