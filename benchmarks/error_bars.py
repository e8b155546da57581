"""Error bars beside true errors: the table that widens deviations, fitted on one half of the motion suite, and how many
errors lie within them, by part of the body.

    python -m benchmarks.error_bars --half tuning --write      # fits 30 clips, then writes the table
    python -m benchmarks.error_bars --half untouched           # measures with the table as it is

To be done again whenever the lifter, the weights or the pose prior change.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.motion_suite.clips import MotionClipMade, make_motion, motion_sequences
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.grounded import holding_feet
from fitting_core.fit.stages import Stages
from fitting_core.fit.uncertainty import measured
from fitting_core.fit.uncertainty.calibration import part_of
from fitting_core.fit.uncertainty.deviations import deviations
from fitting_core.measure.angles.joint_angles import joint_angles
from fitting_core.motion import Motion
from fitting_core.results.error_bars import ANGLES, DIRECTIONS, JOINTS, WIDER, ErrorBars

PELVIS = JOINT["pelvis"]
INSIDE = np.array([0.68, 0.95])
"""Shares of the errors that are to lie within one error bar, and within WIDER of them."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Clips, and whether the table is written."""

    half: Literal["tuning", "untouched"] = "untouched"
    write: bool = False
    """Fit the table to this half and write it."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample:
    """What was off in some frames, and the deviations that the normal equations have."""

    deviation: Float[np.ndarray, "n"]
    error: Float[np.ndarray, "n"]
    """Its size, of one component."""

    @staticmethod
    def together(parts: list["Sample"]) -> "Sample":
        """One of all."""
        return Sample(**{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])})

    def widened(self, factor: float, least: float) -> Float[np.ndarray, "n"]:
        """The error bars."""
        return np.hypot(factor * self.deviation, least)


Samples = dict[tuple[str, str], list[Sample]]
"""By part of the body, and direction or "angle"."""


def measure(body: BodyModel, made: MotionClipMade, found: Samples) -> None:
    """Fit a clip and add its samples."""
    config, clip = PRESETS[DEFAULT_PRESET], made.clip
    fit = fit_clip(clip, body, config)
    params, stages = fit.last.params, Stages.of_clip(clip, body, config, size=fit.size)
    stages = holding_feet(stages, params, fit.grounding) or stages
    bars = deviations(stages, stages.parametrisation.from_params(params))
    joints, true = joints_in_space(body, params), made.truth.joints
    for key, sample in (*_of_joints(bars, joints, true), *_of_angles(bars, body, params, made)):
        found.setdefault(key, []).append(sample)


def _of_joints(bars: ErrorBars, joints: np.ndarray, true: np.ndarray) -> Iterator[tuple[tuple[str, str], Sample]]:
    ray = joints / np.linalg.norm(joints, axis=-1, keepdims=True)
    error = (joints - joints[:, [PELVIS]]) - (true - true[:, [PELVIS]])
    along = (error * ray).sum(-1)
    right = np.cross([0.0, 1.0, 0.0], ray)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    beside = np.stack([(error * axis).sum(-1) for axis in (right, np.cross(ray, right))], -1)
    for i, name in enumerate(JOINTS):
        if i == PELVIS:
            continue
        for direction, off in zip(DIRECTIONS, (along[:, i, None], beside[:, i]), strict=True):
            deviation = np.broadcast_to(bars.joints[:, i, DIRECTIONS.index(direction), None], off.shape)
            yield (part_of(name), direction), Sample(deviation=deviation.ravel(), error=abs(off).ravel())


def _of_angles(
    bars: ErrorBars, body: BodyModel, params: BodyParams, made: MotionClipMade
) -> Iterator[tuple[tuple[str, str], Sample]]:
    found, true = (
        joint_angles(
            Motion(body=b, params=p, camera=made.clip.camera, frame_rate=made.clip.frame_rate, name=made.clip.name)
        )
        for b, p in ((body, params), (made.body, made.truth.params))
    )
    for i, name in enumerate(ANGLES):
        off = abs((found[name] - true[name] + 180) % 360 - 180)
        there = np.isfinite(off)
        yield (part_of(name), "angle"), Sample(deviation=bars.angles[there, i], error=off[there])


def _fitted(sample: Sample) -> tuple[float, float]:
    """Factor and least error by quantile regression (Koenker and Bassett, Econometrica 46 (1978) 33): one error bar is
    to be the 68 % quantile of the errors, and WIDER of them the 95 % one."""
    scale = np.quantile(sample.error, INSIDE[0])

    def loss(logarithms: np.ndarray) -> float:
        bars = sample.widened(*(np.exp(logarithms) * (scale / np.median(sample.deviation), scale)))
        over = sample.error[:, None] - bars[:, None] * [1.0, WIDER]
        return float((np.maximum(INSIDE * over, (INSIDE - 1) * over) / [1.0, WIDER]).mean() / scale)

    best = min((minimize(loss, at, method="Nelder-Mead") for at in ((0.0, -1.0), (-1.0, 0.0))), key=lambda r: r.fun)
    factor, least = np.exp(best.x) * (scale / np.median(sample.deviation), scale)
    return round(float(f"{factor:.3g}"), 3), round(float(least), 4)


def _write(table: dict[tuple[str, str], tuple[float, float]]) -> None:
    joints = {part: tuple(table[part, d] for d in DIRECTIONS) for part, name in table if name == "along"}
    angles = {part: table[part, name] for part, name in table if name == "angle"}
    text = Path(measured.__file__).read_text()
    head = text[: text.index("OF_JOINTS")]
    note = '"""By part of the body: factor and least error in metres, along the ray and across it."""'
    other = '"""By angle: factor and least error in degrees."""'
    content = f"{head}OF_JOINTS = {_lines(joints)}\n{note}\nOF_ANGLES = {_lines(angles)}\n{other}\n"
    Path(measured.__file__).write_text(content)


def _lines(table: dict[str, tuple]) -> str:
    return "{\n" + "".join(f'    "{name}": {values},\n' for name, values in table.items()) + "}"


def _rows(samples: dict[tuple[str, str], Sample], table: dict[tuple[str, str], tuple[float, float]]) -> list[Row]:
    rows = []
    for (part, what), sample in samples.items():
        bars = sample.widened(*table[part, what])
        unit, scale = ("°", 1.0) if what == "angle" else ("mm", 1e3)
        inside = [100 * float((sample.error <= times * bars).mean()) for times in (1.0, WIDER)]
        row = {"part": part, "direction": what, "unit": unit, "median error bar": scale * float(np.median(bars))}
        row |= {"68 % of the errors": scale * float(np.quantile(sample.error, INSIDE[0]))}
        rows.append(row | {"within one, %": inside[0], f"within {WIDER:g}, %": inside[1]})
    return rows


def run(options: Options) -> None:
    """Fits every clip of the half."""
    body, found = options.common.load_body(), Samples()
    sequences = [sequence for sequence in motion_sequences().values() if sequence.half == options.half]
    for number, sequence in enumerate(sequences, 1):
        progress(f"{number} of {len(sequences)}: {sequence.name}")
        measure(body, make_motion(sequence), found)
    samples = {key: Sample.together(parts) for key, parts in found.items()}
    if options.write:
        table = {key: _fitted(sample) for key, sample in samples.items()}
        _write(table)
    else:
        table = {
            (part, d): row for part, rows in measured.OF_JOINTS.items() for d, row in zip(DIRECTIONS, rows, strict=True)
        }
        table |= {(part, "angle"): row for part, row in measured.OF_ANGLES.items()}
    report(options, {f"Error bars, {options.half} half": _rows(samples, table)})


if __name__ == "__main__":
    start(Options, run)
