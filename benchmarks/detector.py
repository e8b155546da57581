"""The embedded detector on real clips: how right its confidences are, hands that signers show, speed and memory.

Measure speed on a computer that does nothing else.
"""

import itertools
import resource
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes

from benchmarks.clips import data_folder
from benchmarks.report import Common, Row, progress, report, start
from fitting_core.detect.detecting import Detected, Detection
from fitting_core.detect.detectors import find_detector
from fitting_core.detect.stored import StoredDetection
from fitting_core.keypoints import BODY, FACE, LEFT_HAND, RIGHT_HAND
from fitting_core.video.frames import FrameSource

CLIPS = (
    "balancing/cam03",
    "balancing/cam04",
    "signs/gebaerden",
    "signs/psychologie",
    "opencap/walk_ts",
)
HANDS = {"left": LEFT_HAND, "right": RIGHT_HAND}
SHOWN = {
    ("signs/gebaerden", "left"): range(62, 102),
    ("signs/gebaerden", "right"): range(63, 106),
    ("signs/psychologie", "right"): range(66, 113),
}
"""Frames in which a viewer of the video sees a hand."""
EDGES = (0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.01)
SEEN = 0.1
"""Confidence from which a hand counts as found."""


@dataclass(frozen=True, kw_only=True)
class DetectorOnClips:
    """What to detect with."""

    detectors: tuple[str, ...] = ("mediapipe", "mediapipe-fast")
    """Names in fitting_core.detect.detectors.DETECTORS."""
    frames: int = 10_000
    """Of each clip, at most."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def run(clip: str, name: str, most: int) -> tuple[Detected, float]:
    """What a detector finds in a clip, and in how many seconds, the networks' opening left out."""
    with FrameSource(data_folder() / clip / "video.mp4") as source, tempfile.TemporaryDirectory() as folder:
        made = Detection(source=source, frames=range(min(most, len(source))), detector=find_detector(name))
        start = time.perf_counter()
        *_, found = made.events(StoredDetection(made.settings(), Path(folder)))
        assert isinstance(found, Detected)
        return found, time.perf_counter() - start


def most_prominent(found: Detected) -> Float[np.ndarray, "T 137 3"]:
    """The largest and most confident person of each frame; zeros without one."""
    points = np.zeros((len(found.people), 137, 3))
    for t, people in enumerate(found.people):
        if len(people):
            points[t] = max(people, key=lambda one: np.ptp(one[BODY, 1]) * one[BODY, 2].sum())
    return points


def errors(clip: str, points: Float[np.ndarray, "T 137 3"]) -> Float[np.ndarray, "T 25"]:
    """Distance of the body's points from the triangulated ones, in % of the person's extent in the image."""
    folder = data_folder() / "balancing"
    with np.load(folder / "reference_3d.npz", allow_pickle=False) as file:
        world = file["points"]
    with np.load(data_folder() / clip / "camera.npz", allow_pickle=False) as camera:
        seen = (world @ camera["R"].T + camera["t"].reshape(3)) @ camera["K"].T
    true = (seen[..., :2] / seen[..., 2:])[: len(points)]
    extent = np.nanmax(np.nanmax(true, 1) - np.nanmin(true, 1), 1)
    return 100 * np.linalg.norm(points[:, BODY, :2] - true, axis=-1) / extent[:, None]


def measure(options: DetectorOnClips) -> None:
    """Detect and print the tables."""
    tables: dict[str, list[Row]] = {}
    for name in options.detectors:
        speeds, hands, sure, off = [], [], [], []
        for clip in CLIPS:
            progress(f"{name}: {clip}")
            found, seconds = run(clip, name, options.frames)
            points = most_prominent(found)
            face = 100 * float((points[:, FACE, 2].max(1) > SEEN).mean())
            speeds.append({"clip": clip, "frames/s": len(points) / seconds, "face found %": face})
            hands += hand_rows(clip, points)
            if clip.startswith("balancing"):
                sure.append(points[:, BODY, 2])
                off.append(errors(clip, points))
        tables |= {
            f"{name}: frames a second": speeds,
            f"{name}: hands that the video shows": hands,
            f"{name}: confidence, and distance from the reference": calibration(
                np.concatenate(sure), np.concatenate(off)
            ),
        }
    report(options, tables)
    progress(f"most memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


def hand_rows(clip: str, points: Float[np.ndarray, "T 137 3"]) -> list[Row]:
    """A row for each hand of a clip of which is known when the video shows it."""
    rows = []
    for (where, side), frames in SHOWN.items():
        if where == clip:
            there = points[:, HANDS[side], 2].max(1) > SEEN
            shown = [t for t in frames if t < len(points)]
            found, false = there[shown].sum(), there.sum() - there[shown].sum()
            rows.append({"hand": f"{clip}, {side}", "found": f"{found} of {len(shown)}", "in other frames": str(false)})
    return rows


def calibration(sure: Float[np.ndarray, "n 25"], off: Float[np.ndarray, "n 25"]) -> list[Row]:
    """A row for each band of confidence."""
    rows = []
    for low, high in itertools.pairwise(EDGES):
        own = off[(sure >= low) & (sure < high) & np.isfinite(off)]
        if len(own):
            median, most = np.percentile(own, [50, 90])
            band = f"{low:.2f} to {min(high, 1):.2f}"
            rows.append(
                {
                    "confidence": band,
                    "points": str(len(own)),
                    "median %": float(median),
                    "90 % are below %": float(most),
                }
            )
    return rows


if __name__ == "__main__":
    start(DetectorOnClips, measure)
