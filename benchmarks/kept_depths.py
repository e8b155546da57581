"""What depths that are kept for a whole clip gain: a user who corrects the limbs' joints in a few frames, simulated.

Depths of the 12 limb joints come from the truth, with noise. As a user would see them: the fit as it is; fitted again
around the corrected frames, as edits are; and fitted again with the corrections kept for the whole clip.

    python -m benchmarks.kept_depths                    squat, walk_ts and two clips of the motion suite
    python -m benchmarks.kept_depths --only cam03 cam04
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int
from tyro.conf import OmitArgPrefixes

from benchmarks.accuracy_sets import in_time, opencap, phone_clip
from benchmarks.clips import read
from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.motion_suite.clips import make_motion, motion_sequences
from fitting_core import keypoints as kp
from fitting_core import metrics
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.refitting import refit
from fitting_core.keypoints import KeptDepth
from fitting_core.measure.limbs import HIPS, Limbs, limb_pa_mpjpe, turned
from fitting_core.measure.pairing import LIMB_JOINTS
from fitting_core.results.fit_result import FitResult

_NOISE = 0.02
"""Metres: standard deviation of a user's depths."""
_REACH = 3
"""Frames on each side that the app fits again after an edit."""


@dataclass(frozen=True, kw_only=True)
class KeptBenchmark:
    """What to measure."""

    only: tuple[str, ...] = ("squat", "walk_ts", "05_13_1", "13_15_1")
    frames: tuple[int, ...] = (1, 2, 5)
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def _read(name: str, body: BodyModel) -> tuple[Clip, FitResult, Limbs]:
    """A clip, its fit, and the true limb joints, along the camera's axes."""
    config = PRESETS["tcfit"]
    if name in motion_sequences():
        made = make_motion(motion_sequences()[name], focal="true")
        return made.clip, fit_clip(made.clip, body, config), made.truth.joints[:, LIMB_JOINTS]
    if name.startswith("cam"):
        sample = read(name)
        assert sample.truth is not None
        return sample.clip, fit_clip(sample.clip, body, config), sample.truth[:, kp.LIMBS]
    clip = phone_clip(name, quick=False)
    fit = fit_clip(clip, body, config)
    found = joints_in_space(body, fit.last.params)[:, LIMB_JOINTS]
    return clip, fit, turned(found, in_time(found, clip, opencap(name))[0])


def _depths(body: BodyModel, fit: FitResult, true: Limbs) -> Float[np.ndarray, "T 12"]:
    """The limbs' true depths behind the pelvis, of keypoints, which are not quite at the joints."""
    joints, points = joints_in_space(body, fit.last.params), keypoints_in_space(body, fit.last.params)[0]
    found = joints[:, LIMB_JOINTS]
    apart = metrics.rooted(true, HIPS) - metrics.rooted(found, HIPS)
    return apart[..., 2] + points[:, kp.LIMBS, 2] - joints[:, [JOINT["pelvis"]], 2]


def _figures(body: BodyModel, fit: FitResult, true: Limbs) -> str:
    found = joints_in_space(body, fit.last.params)[:, LIMB_JOINTS]
    there = np.isfinite(true).all((1, 2))
    return f"{np.nanmean(limb_pa_mpjpe(found, true)):.1f} / {metrics.mpjpe(found[there], true[there], HIPS).mean():.1f}"


def _corrected(clip: Clip, depths: Float[np.ndarray, "T 12"], at: Int[np.ndarray, "n"], *, kept: bool) -> Clip:
    told = clip.keypoints.told_depth.copy()
    told[at[:, None], kp.LIMBS] = depths[at]
    whole = tuple(range(len(clip)))
    offsets = tuple(
        KeptDepth(keypoint=k, frames=whole, depths=dict(zip(at.tolist(), depths[at, column].tolist(), strict=True)))
        for column, k in enumerate(kp.LIMBS)
    )
    return replace(clip, keypoints=replace(clip.keypoints, depth=told, kept=offsets if kept else ()))


def _rows(name: str, counts: Iterable[int], body: BodyModel) -> Iterable[Row]:
    clip, fit, true = _read(name, body)
    config = replace(fit.config, solver="lm", temporal=replace(fit.config.temporal, stages=(5,)))
    depths = _depths(body, fit, true) + np.random.default_rng(0).normal(0, _NOISE, (len(clip), len(kp.LIMBS)))
    known, before = np.flatnonzero(np.isfinite(true).all((1, 2))), _figures(body, fit, true)
    for count in counts:
        at = known[((np.arange(count) + 0.5) / count * len(known)).astype(int)]
        around = [range(max(0, frame - _REACH), min(len(clip), frame + _REACH + 1)) for frame in at.tolist()]
        edited = refit(_corrected(clip, depths, at, kept=False), body, fit, *around, config=config)
        again = refit(_corrected(clip, depths, at, kept=True), body, fit, range(len(clip)), config=config)
        yield {
            "clip": name,
            "frames": str(count),
            "before": before,
            "corrected": _figures(body, edited, true),
            "kept": _figures(body, again, true),
        }


def run(options: KeptBenchmark) -> None:
    """Fit, correct and judge."""
    body, rows = options.common.load_body(), list[Row]()
    for name in options.only:
        for row in _rows(name, options.frames, body):
            rows.append(row)
            progress(" | ".join(map(str, row.values())))
    report(options, {"Corrections kept for the whole clip: PA-MPJPE / MPJPE, mm": rows})


if __name__ == "__main__":
    start(KeptBenchmark, run)
