"""What networks say of images: as TensorFlow Lite runs them, and as onnxruntime does once they are converted."""

import importlib
import importlib.util
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Float32

from fitting_core.detect.mediapipe import networks
from fitting_core.detect.mediapipe.networks import IMAGES
from fitting_core.video.frames import FrameSource

LITERT = "ai_edge_litert"
"""The module that runs .tflite files."""


def has_tflite() -> bool:
    """Whether it is installed."""
    return importlib.util.find_spec(LITERT) is not None


@dataclass(frozen=True, kw_only=True)
class Answers:
    """What a network says of images."""

    by_output: dict[str, np.ndarray]
    milliseconds: float
    """Of one image, one thread: the median."""


def onnxruntime_answers(name: str, images: Float32[np.ndarray, "N H W 3"]) -> Answers:
    """Of an installed network."""
    session = networks.open_session(networks.content(name))
    names = [output.name for output in session.get_outputs()]
    return _timed(lambda image: list(map(np.asarray, session.run(names, {IMAGES: image}))), names, images)


def tflite_answers(path: Path, images: Float32[np.ndarray, "N H W 3"], *, plain: bool = False) -> Answers:
    """Of a .tflite file, through TensorFlow Lite with the kernels that it takes by itself, or its plain ones."""
    litert = importlib.import_module(f"{LITERT}.interpreter")
    kinds = litert.OpResolverType
    kernels = kinds.BUILTIN_WITHOUT_DEFAULT_DELEGATES if plain else kinds.AUTO
    interpreter = litert.Interpreter(str(path), num_threads=1, experimental_op_resolver_type=kernels)
    interpreter.allocate_tensors()
    place, outputs = interpreter.get_input_details()[0]["index"], interpreter.get_output_details()

    def run(image: np.ndarray) -> list[np.ndarray]:
        interpreter.set_tensor(place, image)
        interpreter.invoke()
        return [interpreter.get_tensor(output["index"]) for output in outputs]

    return _timed(run, [output["name"] for output in outputs], images)


def difference(found: Float[np.ndarray, "N ..."], expected: Float[np.ndarray, "N ..."]) -> float:
    """The largest, as a share of the largest value; of a probability that is under 0.01 everywhere, of 0.01."""
    return float(np.abs(found - expected).max() / max(np.abs(expected).max(), 0.01))


def crops(videos: Sequence[Path], size: int, count: int, *, seed: int = 0) -> Float32[np.ndarray, "N S S 3"]:
    """Random squares of random frames, RGB, 0 to 1; noise without videos."""
    rng = np.random.default_rng(seed)
    if not videos:
        return rng.random((count, size, size, 3), np.float32)
    found = []
    for number in range(count):
        with FrameSource(videos[number % len(videos)]) as source:
            frame = source.frame(int(rng.integers(len(source))))
        side = int(min(frame.shape[:2]) * rng.uniform(0.3, 1.0))
        top, left = (int(rng.integers(length - side + 1)) for length in frame.shape[:2])
        found.append(
            cv2.resize(frame[top : top + side, left : left + side], (size, size), interpolation=cv2.INTER_AREA)
        )
    return np.stack(found).astype(np.float32) / 255


def _timed(run: Callable[[np.ndarray], list[np.ndarray]], names: list[str], images: np.ndarray) -> Answers:
    run(images[:1])
    seconds, answers = [], []
    for image in images:
        begun = time.perf_counter()
        answers.append([np.array(answer) for answer in run(image[None])])
        seconds.append(time.perf_counter() - begun)
    by_output = {name: np.concatenate([answer[k] for answer in answers]) for k, name in enumerate(names)}
    return Answers(by_output=by_output, milliseconds=1000 * float(np.median(seconds)))
