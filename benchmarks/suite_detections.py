"""The suite's simulated detections beside OpenPose's real ones on the balancing clips, whose truth is a triangulation.

    python -m benchmarks.suite_detections

Pixels are those of an image in which the person is as tall as in the suite's at 720 pixels height. The triangulation is
itself off by 2 to 3 cm, about 6 to 9 of these pixels, which the real errors contain.
"""

from collections.abc import Iterator

import numpy as np
import tyro
from jaxtyping import Float

from benchmarks import clips
from evaluation.synthetic.suite import LEVELS, SEQUENCES, make_sequence
from fitting_core.keypoints import BODY, Keypoints

_REAL = ("cam03", "cam04")
_PERSON = 520.0
"""Height in pixels of a standing person of the suite in an image of 720 pixels height."""
_BANDS = ((0.05, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 1.01))
_ASTRAY = 60.0
"""Pixels beyond which a detection is a swap or another person's, and no noise."""
Figures = dict[str, float]


def figures(found: Keypoints, truth: Float[np.ndarray, "T 25 2"], pixels: float) -> Figures:
    """Errors of the body's points, those that last and those that are new in each frame, and what is missing.

    Args:
        found: As detected.
        truth: Where the points are, pixels.
        pixels: From the image's pixels to those of the table.
    """
    error = pixels * (found.xy[:, BODY] - truth)
    confidence = found.confidence[:, BODY]
    seen, distance = confidence > 0, np.linalg.norm(error, axis=2)
    noise = np.where((seen & (distance < _ASTRAY))[..., None], error, np.nan)
    result = {
        "median": float(np.median(distance[seen])),
        "p95": float(np.percentile(distance[seen], 95)),
        "astray %": float(100 * (distance[seen] >= _ASTRAY).mean()),
        "new each frame": float(np.sqrt(np.nanmean(np.diff(noise, axis=0) ** 2) / 2)),
        "missing %": float(100 * (1 - seen.mean())),
        "confidence %": float(100 * np.median(confidence[seen])),
    }
    for low, high in _BANDS:
        band = seen & (confidence >= low) & (confidence < high)
        result[f"at {low:.2f}-"] = float(np.median(distance[band])) if band.sum() > 20 else np.nan
    return result


def _real() -> Iterator[tuple[str, Figures]]:
    for name in _REAL:
        sample = clips.read(name)
        assert sample.truth is not None
        camera = sample.clip.camera
        xy = sample.truth[..., :2] / sample.truth[..., 2:] * camera.focal + camera.center
        yield f"OpenPose {name}", figures(sample.clip.keypoints, xy, float(_PERSON / np.ptp(xy[..., 1], axis=1).mean()))


def _simulated(motion: str, level: str) -> Figures:
    made = [make_sequence(s, level) for s in SEQUENCES.values() if s.motion == motion]
    rows = [figures(m.clip.keypoints, m.truth.keypoints[:, BODY], 720 / m.truth.camera.size[1]) for m in made]
    columns = {name: [row[name] for row in rows if np.isfinite(row[name])] for name in rows[0]}
    return {name: float(np.mean(values)) if values else np.nan for name, values in columns.items()}


def main() -> None:
    """Print a line for each real clip, and one for each motion and level."""
    rows = dict(_real())
    motions = dict.fromkeys(s.motion for s in SEQUENCES.values())
    rows |= {f"{motion} {level}": _simulated(motion, level) for motion in motions for level in LEVELS}
    columns = list(next(iter(rows.values())))
    print(f"{'':18}" + "".join(f"{column:>{max(8, len(column) + 2)}}" for column in columns))
    for name, row in rows.items():
        print(f"{name:18}" + "".join(f"{row[column]:>{max(8, len(column) + 2)}.1f}" for column in columns))


if __name__ == "__main__":
    tyro.cli(main)
