"""Error bars beside true errors: the table that widens deviations, fitted on one half of the motion suite and on real
clips, and how many errors lie within them, by part of the body.

    python -m benchmarks.error_bars --half tuning --write      # fits 30 clips, then writes the table
    python -m benchmarks.error_bars --half real --write        # then what lasts over real clips
    python -m benchmarks.error_bars --half untouched           # measures with the table as it is
    python -m benchmarks.error_bars --half kept                # the same on a real view that is kept apart

To be done again whenever the lifter, the weights or the pose prior change.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize
from tyro.conf import OmitArgPrefixes

from benchmarks.accuracy_sets import PHONES, in_time, opencap, phone_clip
from benchmarks.clips import read
from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.motion_suite.clips import MotionClipMade, make_motion, motion_sequences
from evaluation.synthetic.motion_suite.depth_figures import LIMB_JOINTS
from fitting_core import keypoints as kp
from fitting_core.body.markers.joint_centres import joint_centres_in_space
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space
from fitting_core.clip import Clip
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.grounded import holding_feet
from fitting_core.fit.stages import Stages
from fitting_core.fit.uncertainty import measured
from fitting_core.fit.uncertainty.calibration import part_of
from fitting_core.fit.uncertainty.deviations import deviations
from fitting_core.measure.angles.joint_angles import joint_angles
from fitting_core.measure.limbs import HIPS, Limbs, turned
from fitting_core.motion import Motion
from fitting_core.results.error_bars import ANGLES, DIRECTIONS, JOINTS, WIDER, ErrorBars

PELVIS = JOINT["pelvis"]
INSIDE = np.array([0.68, 0.95])
"""Shares of the errors that are to lie within one error bar, and within WIDER of them."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Clips, and whether the table is written."""

    half: Literal["tuning", "untouched", "real", "kept"] = "untouched"
    write: bool = False
    """Fit the table to this half, or what lasts to these real clips, and write it."""
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

    def widened(self, factor: float, least: float, lasting: float = 0.0) -> Float[np.ndarray, "n"]:
        """The error bars."""
        return np.hypot(np.hypot(factor * self.deviation, least), lasting)


Samples = dict[tuple[str, str], list[Sample]]
"""By part of the body, and direction or "angle"."""


REAL = {"real": ("squat", "walk_ts", "cam03"), "kept": ("cam04",)}
"""Clips by the name of the half."""


def fitted(body: BodyModel, clip: Clip) -> tuple[BodyParams, ErrorBars]:
    """A fit's parameters, and the deviations that the normal equations have."""
    config = PRESETS[DEFAULT_PRESET]
    fit = fit_clip(clip, body, config)
    params, stages = fit.last.params, Stages.of_clip(clip, body, config, size=fit.size)
    stages = holding_feet(stages, params, fit.grounding) or stages
    return params, deviations(stages, stages.parametrisation.from_params(params))


def measure(body: BodyModel, made: MotionClipMade, found: Samples) -> None:
    """Fit a clip and add its samples."""
    params, bars = fitted(body, made.clip)
    joints, true = joints_in_space(body, params), made.truth.joints
    for key, sample in (*_of_joints(bars, joints, true), *_of_angles(bars, body, params, made)):
        found.setdefault(key, []).append(sample)


def real_clips(name: str) -> Iterator[tuple[Clip, Callable[[Limbs], Limbs]]]:
    """A clip with each source of keypoints that it has, and its true limb joints in the space of the fit's."""
    if name in PHONES:
        clip, reference = phone_clip(name, quick=True), opencap(name)
        yield clip, lambda found: turned(found, in_time(found, clip, reference)[0])
        return
    for detected in (False, True):
        sample = read(name, detected=detected)
        assert sample.truth is not None
        limbs = sample.truth[:, kp.LIMBS]
        yield sample.clip, lambda found, limbs=limbs: limbs


def measure_real(body: BodyModel, name: str, found: Samples) -> None:
    """Fit a real clip and add samples of its limbs, relative to the middle of the hips; with each source of keypoints
    that it has."""
    for clip, truth in real_clips(name):
        params, bars = fitted(body, clip)
        joints = joints_in_space(body, params)[:, : len(JOINTS)]
        if name in PHONES:
            joints[:, LIMB_JOINTS] = joint_centres_in_space(body, params)  # as the markers have them
        limbs = joints[:, LIMB_JOINTS]
        own, true = limbs[:, HIPS].mean(1, keepdims=True), truth(limbs)
        moved = np.full_like(joints, np.nan)
        moved[:, LIMB_JOINTS] = true - true[:, HIPS].mean(1, keepdims=True) + own
        moved[:, PELVIS] = joints[:, PELVIS]
        for key, sample in _of_joints(bars, joints, moved):
            there = np.isfinite(sample.error)
            if there.any():
                known = Sample(deviation=sample.deviation[there], error=sample.error[there])
                found.setdefault(key, []).append(known)


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


def _loss(error: Float[np.ndarray, "n"], bars: Float[np.ndarray, "n"]) -> float:
    over = error[:, None] - bars[:, None] * [1.0, WIDER]
    return float((np.maximum(INSIDE * over, (INSIDE - 1) * over) / [1.0, WIDER]).mean())


def _lasting(sample: Sample, factor: float, least: float) -> float:
    """The lasting error, metres, by the same regression as `_fitted`."""
    choices = np.arange(0.0, 0.2, 0.001).round(3).tolist()
    return min(choices, key=lambda lasting: _loss(sample.error, sample.widened(factor, least, lasting)))


def _fitted(sample: Sample) -> tuple[float, float]:
    """Factor and least error by quantile regression (Koenker and Bassett, Econometrica 46 (1978) 33): one error bar is
    to be the 68 % quantile of the errors, and WIDER of them the 95 % one."""
    scale = np.quantile(sample.error, INSIDE[0])

    def loss(logarithms: np.ndarray) -> float:
        bars = sample.widened(*(np.exp(logarithms) * (scale / np.median(sample.deviation), scale)))
        return _loss(sample.error, bars) / scale

    best = min((minimize(loss, at, method="Nelder-Mead") for at in ((0.0, -1.0), (-1.0, 0.0))), key=lambda r: r.fun)
    factor, least = np.exp(best.x) * (scale / np.median(sample.deviation), scale)
    return round(float(f"{factor:.3g}"), 3), round(float(least), 4)


def _write(tables: dict[str, dict[str, tuple]]) -> None:
    """Into `measured`, by name."""
    path = Path(measured.__file__)
    text = path.read_text()
    for name, table in tables.items():
        begin = text.index(f"{name} = {{")
        end = text.index("\n}", begin) + len("\n}")
        text = f"{text[:begin]}{name} = {_lines(table)}{text[end:]}"
    path.write_text(text)


def _by_part(table: dict[tuple[str, str], Any]) -> dict[str, tuple]:
    """Of joints: by part, along and across."""
    return {part: tuple(table[part, d] for d in DIRECTIONS) for part, name in table if name == "along"}


def _lines(table: dict[str, tuple]) -> str:
    return "{\n" + "".join(f'    "{name}": {values},\n' for name, values in table.items()) + "}"


def _rows(samples: dict[tuple[str, str], Sample], table: dict[tuple[str, str], tuple[float, ...]]) -> list[Row]:
    rows = []
    for (part, what), sample in samples.items():
        bars = sample.widened(*table[part, what])
        unit, scale = ("°", 1.0) if what == "angle" else ("mm", 1e3)
        inside = [100 * float((sample.error <= times * bars).mean()) for times in (1.0, WIDER)]
        row = {"part": part, "direction": what, "unit": unit, "median error bar": scale * float(np.median(bars))}
        row |= {"68 % of the errors": scale * float(np.quantile(sample.error, INSIDE[0]))}
        rows.append(row | {"within one, %": inside[0], f"within {WIDER:g}, %": inside[1]})
    return rows


def _known() -> dict[tuple[str, str], tuple[float, float, float]]:
    """The table as it is: factor, least and lasting error."""
    table = {(part, "angle"): (*row, 0.0) for part, row in measured.OF_ANGLES.items()}
    for part, rows in measured.OF_JOINTS.items():
        lasting = measured.LASTING[measured.LIKE.get(part, part)]
        table |= {(part, d): (*row, more) for d, row, more in zip(DIRECTIONS, rows, lasting, strict=True)}
    return table


def run(options: Options) -> None:
    """Fits every clip of the half."""
    body, found, real = options.common.load_body(), Samples(), options.half in REAL
    names = [sequence.name for sequence in motion_sequences().values() if sequence.half == options.half]
    for name in REAL.get(options.half, names):
        progress(name)
        measure_real(body, name, found) if real else measure(body, make_motion(motion_sequences()[name]), found)
    samples, table = {key: Sample.together(parts) for key, parts in found.items()}, dict(_known())
    if options.write and real:
        lasting = {key: _lasting(sample, *table[key][:2]) for key, sample in samples.items()}
        _write({"LASTING": _by_part(lasting)})
        table |= {key: (*table[key][:2], value) for key, value in lasting.items()}
    elif options.write:
        table = {key: _fitted(sample) for key, sample in samples.items()}
        angles = {part: row for (part, what), row in table.items() if what == "angle"}
        _write({"OF_JOINTS": _by_part(table), "OF_ANGLES": angles})
    report(options, {f"Error bars, {options.half}": _rows(samples, table)})


if __name__ == "__main__":
    start(Options, run)
