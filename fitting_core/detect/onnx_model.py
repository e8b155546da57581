"""A neural network in an ONNX file: what goes in, what comes out, running it on images, and what it probably is."""

import hashlib
import os
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Literal

import numpy as np
from google.protobuf.message import DecodeError
from jaxtyping import Float32

from fitting_core.detect.onnx_file import Model
from fitting_core.detect.runtime import onnxruntime
from fitting_core.errors import InputError
from fitting_core.files.regular import refusal, regular_file

PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}
"""Where a model can run -> onnxruntime's name for it."""
_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
_ERRORS_ONLY = 3
"""onnxruntime's level of messages: its warnings, about graphs and cards, say nothing to a user."""
_FATAL_ONLY = 4
"""What goes wrong in a run is an exception."""
_LAST_OPERATOR = 20.0
"""Seconds that the operator under way has for its end after Ctrl-C."""
_CHANNELS = 3


@dataclass(frozen=True, kw_only=True)
class ModelTensor:
    """An input or output of a model."""

    name: str
    shape: tuple[int | None, ...]
    """None where any length will do."""
    type: str
    """As onnxruntime has it: "tensor(float)"."""

    def __str__(self) -> str:
        return f"{self.name} {' x '.join('any' if n is None else str(n) for n in self.shape) or '(one number)'}"


class OnnxModel:
    """A model that takes images, ready to run. Raises InputError if there is no such file or provider, the file is not
    an ONNX model, or its input is not an RGB image.

    Args:
        path: The ONNX file.
        provider: One of PROVIDERS.
        threads: On the CPU; 0: one for each core.
    """

    def __init__(self, path: Path, *, provider: str = "cpu", threads: int = 0) -> None:
        self.path, self.provider = path, provider
        self._session = _session(path, provider, threads)
        self.inputs = tuple(_tensor(given) for given in self._session.get_inputs())
        self.outputs = tuple(_tensor(given) for given in self._session.get_outputs())
        self.layout: Literal["NCHW", "NHWC"] = self._layout()

    @cached_property
    def sha256(self) -> str:
        """Of the file, as hexadecimal digits."""
        with self.path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    @property
    def size(self) -> tuple[int | None, int | None]:
        """Width and height of the images in pixels; None where any will do."""
        shape = self.inputs[0].shape
        return (shape[3], shape[2]) if self.layout == "NCHW" else (shape[2], shape[1])

    @property
    def batch(self) -> int | None:
        """How many images it takes at once; None: any number."""
        return self.inputs[0].shape[0]

    def describe(self) -> str:
        """Inputs and outputs in words, for messages."""
        taken, given = (", ".join(map(str, tensors)) for tensors in (self.inputs, self.outputs))
        return f"input {taken} ({self.layout}), output {given}"

    def run(self, images: Sequence[Float32[np.ndarray, "H W 3"]]) -> list[tuple[np.ndarray, ...]]:
        """Run it on images that are prepared as it wants them; for each image its outputs, in the model's order. Raises
        InputError if the model cannot be run; the message has onnxruntime's reason."""
        step = self.batch or max(1, len(images))
        results: list[tuple[np.ndarray, ...]] = []
        for start in range(0, len(images), step):
            some = np.stack(images[start : start + step])
            if missing := (self.batch or 0) - len(some):
                some = np.concatenate([some, np.zeros((max(0, missing), *some.shape[1:]), some.dtype)])
            outputs = self._outputs(some)
            results += [tuple(output[i] for output in outputs) for i in range(min(step, len(images) - start))]
        return results

    def _outputs(self, images: Float32[np.ndarray, "N H W 3"]) -> list[np.ndarray]:
        ordered = images.transpose(0, 3, 1, 2) if self.layout == "NCHW" else images
        fed = np.ascontiguousarray(ordered, dtype=_TYPES[self.inputs[0].type])
        try:
            outputs = _outputs_of(self._session, {self.inputs[0].name: fed})
        except Exception as error:  # onnxruntime's exceptions have no other common base
            raise InputError(f"{self.path}: cannot be run ({_first_line(error)}).") from error
        return [np.asarray(output) for output in outputs]

    def _layout(self) -> Literal["NCHW", "NHWC"]:
        shape = self.inputs[0].shape if self.inputs else ()
        if len(self.inputs) == 1 and len(shape) == 4 and self.inputs[0].type in _TYPES:
            if shape[1] == _CHANNELS:
                return "NCHW"
            if shape[3] == _CHANNELS:
                return "NHWC"
        found = ", ".join(f"{given} of {given.type}" for given in self.inputs) or "no input"
        raise InputError(
            f"{self.path}: takes {found}; expected one input, images of floating point numbers with {_CHANNELS} colour "
            "channels (any x 3 x height x width, or any x height x width x 3)."
        )


def _outputs_of(session: onnxruntime.InferenceSession, fed: dict[str, np.ndarray]) -> list[Any]:
    """`session.run` that Ctrl-C ends: onnxruntime does not look for signals, and a model may loop for years."""
    if threading.current_thread() is not threading.main_thread():  # which alone gets Ctrl-C
        return list(session.run(None, fed))
    options, answers = onnxruntime.RunOptions(), SimpleQueue[list[Any] | Exception]()
    options.log_severity_level = _FATAL_ONLY

    def work() -> None:
        try:
            answers.put(list(session.run(None, fed, options)))
        except Exception as error:
            answers.put(error)

    thread = threading.Thread(target=work, daemon=True, name="tcfit: onnxruntime")
    thread.start()
    try:
        answer = answers.get()
    except BaseException:
        options.terminate = True
        thread.join(_LAST_OPERATOR)  # a thread within onnxruntime would abort the process at its end
        raise
    if isinstance(answer, Exception):
        raise answer
    return answer


def _session(path: Path, provider: str, threads: int) -> onnxruntime.InferenceSession:
    if not path.exists():
        raise InputError(f"{path}: there is no such model file; expected an ONNX file (*.onnx).")
    if why := refusal(path, expected="an ONNX model (*.onnx)"):
        raise InputError(f"{path}: {why}.")
    check_provider(provider)
    options = onnxruntime.SessionOptions()
    options.log_severity_level = _ERRORS_ONLY
    options.intra_op_num_threads = threads or os.cpu_count() or 1
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=[PROVIDERS[provider]])
    except Exception as error:  # onnxruntime's exceptions have no other common base
        raise InputError(
            f"{path}: cannot be opened as an ONNX model ({path.stat().st_size} bytes; {_first_line(error)}). It may be "
            "of another format, or not fully copied."
        ) from error
    if PROVIDERS[provider] not in session.get_providers():
        raise InputError(
            f"{path}: cannot run on {provider}: onnxruntime has fallen back to {session.get_providers()[0]}. Its CUDA "
            "libraries are missing or of another version; use the CPU."
        )
    return session


def check_provider(provider: str) -> None:
    """Raises InputError if models cannot run there on this computer."""
    if provider not in PROVIDERS:
        raise InputError(f"provider is {provider!r}; expected one of {', '.join(PROVIDERS)}.")
    if PROVIDERS[provider] not in onnxruntime.get_available_providers():
        raise InputError(
            f"This computer's onnxruntime has no {PROVIDERS[provider]}. Install onnxruntime-gpu in place of "
            "onnxruntime for CUDA, or use the CPU."
        )


def _tensor(given: onnxruntime.NodeArg) -> ModelTensor:
    # Lengths that a model leaves open are texts, None, or in some exports 0 or -1.
    shape = tuple(n if isinstance(n, int) and n > 0 else None for n in given.shape)
    return ModelTensor(name=given.name, shape=shape, type=given.type)


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0].rstrip(".")[:300] if str(error).strip() else type(error).__name__


def consumers(path: Path, tensor: str) -> tuple[str, ...]:
    """The operators that take a tensor, such as ("Conv",), in the order of the file: onnxruntime does not tell. Raises
    InputError if the file is not an ONNX model, or cut off."""
    try:
        nodes = Model.FromString(regular_file(path).read_bytes()).graph.node
        return tuple(node.op_type for node in nodes if tensor in node.input)
    except (DecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not an ONNX model, or was not fully copied ({error}).") from error


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
    return f"{_kind(model.outputs)}: {model.describe()}"


def _kind(outputs: tuple[ModelTensor, ...]) -> str:
    shapes = [output.shape for output in outputs]
    ends = [shape[-1] for shape in shapes if len(shape) == 3]
    if {"dets", "labels"} <= {output.name for output in outputs} or 5 in ends or 85 in ends:
        return "a detector of boxes"
    if len(shapes) == len(ends) == 2 and shapes[0][1] == shapes[1][1] and (count := shapes[0][1]):
        return f"{_named(count)}, as SimCC"
    for channels in (shape[1] for shape in shapes if len(shape) == 4 and shape[1]):
        # OpenSeeFace has a map of the place and two of the offsets for each point.
        thirds = channels % 3 == 0 and channels // 3 in POINT_SETS
        return f"{_named(channels // 3 if thirds else channels)}, as heat maps"
    for length in (shape[1] for shape in shapes if len(shape) == 2 and shape[1]):
        for each in (3, 2):
            if length % each == 0 and length // each in POINT_SETS:
                return f"{_named(length // each)}, as coordinates"
    return "a model of an unknown kind"


def _named(count: int) -> str:
    known = POINT_SETS.get(count)
    return f"a model of {count} points" + (f", those of {known}" if known else "")
