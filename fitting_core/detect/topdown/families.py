"""Which model a file holds, and opening it: one line for each family."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from fitting_core.detect.onnx_model import OnnxModel, what_it_is
from fitting_core.detect.topdown import rtmdet, simcc, yolox
from fitting_core.detect.topdown.boxes import BoxModel
from fitting_core.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Family:
    """Models of one kind."""

    title: str
    finds: Literal["points", "boxes"]
    recognises: Callable[[OnnxModel], bool]
    make: Callable[[OnnxModel], Any]


FAMILIES: dict[str, Family] = {
    "simcc": Family(title="RTMPose, DWPose, RTMW", finds="points", recognises=simcc.recognises, make=simcc.SimCC),
    "rtmdet": Family(title="RTMDet", finds="boxes", recognises=rtmdet.recognises, make=rtmdet.make),
    "yolox": Family(title="YOLOX", finds="boxes", recognises=yolox.recognises, make=yolox.make),
}
"""By name; the first that recognises a model runs it."""


def load_pose_model(path: Path, *, provider: str = "cpu", threads: int = 0) -> simcc.SimCC:
    """Open a whole-body model. Raises InputError if there is no such file, it is not an ONNX model, or of another kind,
    which the message names."""
    return _load(path, "points", provider, threads)


def load_box_model(path: Path, *, provider: str = "cpu", threads: int = 0) -> BoxModel:
    """Open a model that finds people. Raises InputError as `load_pose_model`."""
    return _load(path, "boxes", provider, threads)


def family_of(model: OnnxModel) -> Family | None:
    """The family that a model belongs to."""
    return next((family for family in FAMILIES.values() if family.recognises(model)), None)


def _load(path: Path, finds: Literal["points", "boxes"], provider: str, threads: int) -> Any:
    model = OnnxModel(path, provider=provider, threads=threads)
    family = family_of(model)
    if family is not None and family.finds == finds:
        return family.make(model)
    if finds == "points":
        raise simcc.wrong_model(model)
    known = " or ".join(f.title for f in FAMILIES.values() if f.finds == "boxes")
    raise InputError(
        f"{path}: is {what_it_is(model)}. Expected a detector of people: {known}, with outputs dets and labels, or as "
        "exported without non-maximum suppression."
    )
