"""The options of `tcfit detect`. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, UseAppendAction, arg

from tcfit_app.options.fit import shown


@dataclass(frozen=True, kw_only=True)
class DetectOptions:
    """Find the keypoints of one person in a video, with an ONNX model of yours.

    Models are whole-body ones of the RTMPose, DWPose and RTMW family, given by path, or by name after --download. The
    result is a folder of OpenPose JSON, which the other commands take as --keypoints. Ctrl-C keeps the frames that
    have been finished; the same command goes on with the rest.
    """

    video: Annotated[Positional[Path | None], arg(metavar="VIDEO", help_behavior_hint="(optional)")] = None
    """A video file or a folder of images."""
    model: Annotated[str | None, shown("POSE.onnx|NAME", "none; needed")] = None
    """Whole-body model, 133 points."""
    boxes: Annotated[str | None, shown("BOX.onnx|NAME", "none: the person is followed from frame to frame")] = None
    """Model that finds people: RTMDet or YOLOX. Without it, the person should fill much of the first frame."""
    out: Annotated[Path | None, shown("DIR", "the video's name with _keypoints, in this folder")] = None
    """Folder for the JSON files. Those of the same video are replaced."""
    first_frame: Annotated[int | None, shown("N", "the first")] = None
    """Number of the first frame, from 0."""
    last_frame: Annotated[int | None, shown("N", "the last")] = None
    """Number of the last frame."""
    person: int = 0
    """With --boxes: 0 follows the most prominent person, 1 the next."""
    provider: Annotated[str, arg(metavar="{cpu,cuda}")] = "cpu"
    """Where the models run; cuda needs onnxruntime-gpu."""
    batch: int = 8
    """Frames that go through a model at once. The result does not depend on it."""
    threads: Annotated[int, shown("N", "one for each core")] = 0
    """On the CPU."""
    restart: bool = False
    """Do not go on with what an earlier run has left, but start anew."""
    json: bool = False
    """Tell programs what happens: a JSON object for each line of the standard output."""
    list: bool = False
    """Show the models that can be downloaded, with their licences, and those that are here."""
    download: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="NAME", help_behavior_hint="(repeatable)")] = ()
    """Fetch a model from its publisher, after you have agreed."""
    yes: bool = False
    """With --download: agree beforehand."""
