"""What a model is that is not what was asked for, told by the shapes of its outputs."""

from collections.abc import Callable

from fitting_core.detect.onnx_model import OnnxModel, Tensor

POINT_SETS = {
    17: "a body (COCO)",
    21: "a hand",
    25: "a body (BODY_25)",
    26: "a body with feet (Halpe)",
    33: "a body (MediaPipe)",
    66: "a face (OpenSeeFace)",
    68: "a face (iBUG)",
    98: "a face (WFLW)",
    106: "a face (LaPa)",
    133: "the whole body (COCO-WholeBody)",
    136: "the whole body (Halpe)",
    468: "a face (MediaPipe)",
}
"""By their number, what points published models find."""


def what_it_is(model: OnnxModel) -> str:
    """What a model probably finds, and its inputs and outputs, for messages."""
    found = next((words for tell in _TELLS if (words := tell(model.outputs))), "a model of an unknown kind")
    return f"{found}: {model.describe()}"


def _boxes(outputs: tuple[Tensor, ...]) -> str:
    ends = [output.shape[-1] for output in outputs if len(output.shape) == 3]
    if {"dets", "labels"} <= {output.name for output in outputs} or 5 in ends or 85 in ends:
        return "a detector of boxes"
    return ""


def _simcc(outputs: tuple[Tensor, ...]) -> str:
    if len(outputs) == 2 and all(len(output.shape) == 3 for output in outputs):
        counts = {output.shape[1] for output in outputs}
        if len(counts) == 1 and (count := counts.pop()):
            return f"{_named(count)}, as SimCC"
    return ""


def _maps(outputs: tuple[Tensor, ...]) -> str:
    for output in outputs:
        if len(output.shape) == 4 and (channels := output.shape[1]):
            # OpenSeeFace has a map of the place and two of the offsets for each point.
            count = channels // 3 if channels % 3 == 0 and channels // 3 in POINT_SETS else channels
            return f"{_named(count)}, as heat maps"
    return ""


def _coordinates(outputs: tuple[Tensor, ...]) -> str:
    for output in outputs:
        if len(output.shape) == 2 and (length := output.shape[1]):
            for each in (3, 2):
                if length % each == 0 and length // each in POINT_SETS:
                    return f"{_named(length // each)}, as coordinates"
    return ""


def _named(count: int) -> str:
    known = POINT_SETS.get(count)
    return f"a model of {count} points" + (f", those of {known}" if known else "")


_TELLS: tuple[Callable[[tuple[Tensor, ...]], str], ...] = (_boxes, _simcc, _maps, _coordinates)
