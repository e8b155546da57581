"""The embedded detector's networks beside what TensorFlow Lite makes of the files that they come from.

    python -m benchmarks.detector_networks PACKAGES... --videos VIDEO... [--crops 50]

PACKAGES are the wheel and the npm package of docs/keypoints.md; the networks must be installed (`tcfit models add
mediapipe`). The package ai-edge-litert runs the `.tflite` files; without it only onnxruntime's times are shown.
"""

import argparse
from pathlib import Path

from fitting_core.detect.mediapipe.networks import NETWORKS, Network, is_installed
from fitting_core.detect.mediapipe.packages import tflite_path, unpack
from fitting_core.files.atomic import scratch_folder
from tests.samples.network_answers import (
    Answers,
    crops,
    difference,
    has_tflite,
    onnxruntime_answers,
    tflite_answers,
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("packages", nargs="*", type=Path)
    parser.add_argument("--videos", nargs="*", type=Path, default=[])
    parser.add_argument("--crops", type=int, default=50)
    given = parser.parse_args()
    print("| network | largest difference by output (TFLite's between its own kernels) | ms TFLite | onnxruntime |")
    print("|---|---|---|---|")
    with scratch_folder() as folder:
        for package in given.packages:
            unpack(package, folder)
        for name in filter(is_installed, NETWORKS):
            images = crops(given.videos, Network(name).size, given.crops)
            ours = onnxruntime_answers(name, images)
            path = tflite_path(name, folder)
            if has_tflite() and path.is_file():
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
