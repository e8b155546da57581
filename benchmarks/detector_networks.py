"""The embedded detector's networks beside what TensorFlow Lite makes of the files that they come from.

    python -m benchmarks.detector_networks PACKAGES... --videos VIDEO... [--crops 50]

PACKAGES are the wheel and the npm package of docs/keypoints.md; the networks must be installed (`tcfit models add
mediapipe`). The package ai-edge-litert runs the `.tflite` files; without it only onnxruntime's times are shown.
"""

import argparse
import importlib
import importlib.util
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Float32

from fitting_core.detect.mediapipe.networks import NETWORKS, Network, is_installed
from fitting_core.detect.mediapipe.packages import tflite_path, unpack
from fitting_core.files.atomic import scratch_folder
from fitting_core.video.frames import FrameSource

LITERT = "ai_edge_litert"


@dataclass(frozen=True, kw_only=True)
class Answers:
    """What a network says of images."""

    by_output: dict[str, np.ndarray]
    milliseconds: float
    """Of one image, one thread: the median."""


def onnxruntime_answers(name: str, images: Float32[np.ndarray, "N H W 3"]) -> Answers:
    """Of an installed network."""
    names = [output.name for output in Network(name)._session.get_outputs()]
    return _timed(Network(name, outputs=names).__call__, names, images)


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


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("packages", nargs="*", type=Path)
    parser.add_argument("--videos", nargs="*", type=Path, default=[])
    parser.add_argument("--crops", type=int, default=50)
    given = parser.parse_args()
    beside = bool(given.packages) and importlib.util.find_spec(LITERT) is not None
    print("| network | largest difference by output (TFLite's between its own kernels) | ms TFLite | onnxruntime |")
    print("|---|---|---|---|")
    with scratch_folder() as folder:
        for package in given.packages:
            unpack(package, folder)
        for name in filter(is_installed, NETWORKS):
            images = crops(given.videos, Network(name).size, given.crops)
            ours = onnxruntime_answers(name, images)
            path = tflite_path(name, folder)
            if beside and path.is_file():
                theirs, plain = tflite_answers(path, images), tflite_answers(path, images, plain=True)
                print(_row(name, ours, theirs, plain), flush=True)
            else:
                print(f"| {name} | | | {ours.milliseconds:.1f} |", flush=True)


def _row(name: str, ours: Answers, theirs: Answers, plain: Answers) -> str:
    found = (
        f"{output} {difference(ours.by_output[output], value):.0e} ({difference(plain.by_output[output], value):.0e})"
        for output, value in theirs.by_output.items()
    )
    return f"| {name} | {', '.join(found)} | {theirs.milliseconds:.1f} | {ours.milliseconds:.1f} |"


if __name__ == "__main__":
    main()
