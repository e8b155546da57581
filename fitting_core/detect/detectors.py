"""The table of detectors, by the names that users give."""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from fitting_core.detect.known_models import KNOWN_MODELS, KnownModel, find_model, is_here
from fitting_core.errors import InputError

if TYPE_CHECKING:  # the command line knows the names without loading numpy
    from fitting_core.detect.part import Detector

DEFAULT = "mediapipe"
_BOXES = "rtmdet-nano"
"""Finds the people for models of the RTMPose family unless another box model is given."""


@dataclass(frozen=True, kw_only=True)
class Known:
    """A detector that users can name."""

    title: str
    make: Callable[[str, "Running"], "Detector"]
    is_here: Callable[[], bool]
    """Whether everything that it needs is on this computer."""
    models: tuple[str, ...] = ()
    """Names of the required KNOWN_MODELS."""

    def lacking(self) -> list[KnownModel]:
        """Those of its known models that are not on this computer."""
        return [KNOWN_MODELS[name] for name in self.models if not is_here(name)]


@dataclass(frozen=True, kw_only=True)
class Running:
    """How models of the RTMPose family are run. MediaPipe's networks are small, and take `threads` alone."""

    boxes: str | None = None
    """Box model, by path or name; None: that of the table."""
    provider: str = "cpu"
    """Or cuda, which needs onnxruntime-gpu."""
    batch: int = 8
    """Frames in a model's batch; the result does not depend on it."""
    threads: int = 0
    """0: one for each core."""


def _mediapipe(name: str, running: Running) -> "Detector":
    from fitting_core.detect.mediapipe.detector import MediaPipe

    return MediaPipe(name, thorough=name == DEFAULT, threads=running.threads)


def _networks_are_here() -> bool:
    from fitting_core.detect.mediapipe import networks

    return not networks.missing()


def top_down(name: str, pose: str, running: Running) -> "Detector":
    """A model of the RTMPose family, by path or name. Raises InputError if it is not here, or something else."""
    from fitting_core.detect.topdown.detector import TopDown
    from fitting_core.detect.topdown.families import load_box_model, load_pose_model

    threads = running.threads or os.cpu_count() or 1
    opened = load_pose_model(find_model(pose), provider=running.provider, threads=threads)
    boxes = running.boxes and load_box_model(find_model(running.boxes), provider=running.provider, threads=threads)
    return TopDown(name, opened, boxes or None, batch=running.batch)


def _of_family(name: str, title: str) -> Known:
    def make(name: str, running: Running) -> "Detector":
        return top_down(name, name, running if running.boxes else replace(running, boxes=_BOXES))

    models = (name, _BOXES)
    return Known(title=title, make=make, is_here=lambda: all(map(is_here, models)), models=models)


DETECTORS: dict[str, Known] = {
    "mediapipe": Known(title="MediaPipe, most accurate", make=_mediapipe, is_here=_networks_are_here),
    "mediapipe-fast": Known(title="MediaPipe, twice as fast", make=_mediapipe, is_here=_networks_are_here),
    "dwpose-m": _of_family("dwpose-m", "DWPose-m with RTMDet-nano"),
    "dwpose-l": _of_family("dwpose-l", "DWPose-l with RTMDet-nano"),
    "rtmw-l": _of_family("rtmw-l", "RTMW-l with RTMDet-nano"),
}
"""By name. Anything else that is given is the path of a model of the RTMPose family."""


def find_detector(name: str = DEFAULT, running: Running | None = None) -> "Detector":
    """Open a detector.

    Args:
        name: In `DETECTORS`, or the path of an ONNX model of the RTMPose family.
        running: How models of that family are run.

    Raises:
        InputError: There is no such detector, or something that it needs is not on this computer.
    """
    running = running or Running()
    if (known := DETECTORS.get(name)) is not None:
        return known.make(name, running)
    if not name.lower().endswith(".onnx") and not Path(name).expanduser().exists():
        raise InputError(
            f"detector {name!r} is not known; expected one of {', '.join(DETECTORS)}, or the path of an ONNX model."
        )
    return top_down(Path(name).name, name, running)
