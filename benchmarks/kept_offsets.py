"""What corrections kept for a whole clip gain: a simulated user who corrects the limbs' joints in a few frames.

Depths and places of the 12 limb joints come from the truth, with noise. All figures are of frames that were not
corrected and are not beside one that was: of the fit as it is; fitted again with the depths kept for the whole clip;
and with depths and places.

    python -m benchmarks.kept_offsets                    squat, walk_ts and two clips of the motion suite
    python -m benchmarks.kept_offsets --only cam03 cam04
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int
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
from fitting_core.keypoints import KeptOffset
from fitting_core.measure.limbs import HIPS, Limbs, limb_pa_mpjpe, turned
from fitting_core.measure.pairing import LIMB_JOINTS
from fitting_core.results.fit_result import FitResult

_NOISE = 0.02
"""Metres: standard deviation of a user's depths and places, along each axis."""
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


def _true(body: BodyModel, fit: FitResult, true: Limbs) -> Float[np.ndarray, "T 12 3"]:
    """Where the limbs' keypoints are in camera space, which are not quite at the joints; hips as in the fit."""
    joints, points = joints_in_space(body, fit.last.params), keypoints_in_space(body, fit.last.params)[0]
    return points[:, kp.LIMBS] + metrics.rooted(true, HIPS) - metrics.rooted(joints[:, LIMB_JOINTS], HIPS)


def _figures(body: BodyModel, fit: FitResult, true: Limbs, judged: Bool[np.ndarray, "T"]) -> str:
    found, true = joints_in_space(body, fit.last.params)[judged][:, LIMB_JOINTS], true[judged]
    return f"{np.nanmean(limb_pa_mpjpe(found, true)):.1f} / {metrics.mpjpe(found, true, HIPS).mean():.1f}"


def _corrected(
    clip: Clip,
    depths: Float[np.ndarray, "T 12"],
    xy: Float[np.ndarray, "T 12 2"],
    at: Int[np.ndarray, "n"],
    *,
    places: bool,
) -> Clip:
    """The clip with what a user states in some frames, and keeps."""
    given, cells = clip.keypoints, (at[:, None], kp.LIMBS)
    told, moved, by_hand = given.told_depth.copy(), given.xy.copy(), given.placed.copy()
    told[cells] = depths[at]
    if places:
        moved[cells], by_hand[cells] = xy[at], True
    kept = tuple(
        KeptOffset(
            keypoint=k,
            frames=tuple(range(len(clip))),
            depths={frame: float(depths[frame, column]) for frame in at.tolist()},
            shifts={
                frame: tuple((xy[frame, column] - given.xy[frame, k]).tolist())
                for frame in at.tolist()
                if places and given.confidence[frame, k] > 0
            },
        )
        for column, k in enumerate(kp.LIMBS)
    )
    return replace(clip, keypoints=replace(given, xy=moved, by_hand=by_hand, depth=told, kept=kept))


def _rows(name: str, counts: Iterable[int], body: BodyModel) -> Iterable[Row]:
    clip, fit, true = _read(name, body)
    config = replace(fit.config, solver="lm", temporal=replace(fit.config.temporal, stages=(5,)))
    place = _true(body, fit, true) + np.random.default_rng(0).normal(0, _NOISE, (len(clip), len(kp.LIMBS), 3))
    depths = place[..., 2] - joints_in_space(body, fit.last.params)[:, [JOINT["pelvis"]], 2]
    xy = place[..., :2] / place[..., 2:] * clip.camera.focal + clip.camera.center
    known = np.logical_and.reduce(np.isfinite(true), (1, 2))
    for count in counts:
        at = np.flatnonzero(known)[((np.arange(count) + 0.5) / count * known.sum()).astype(int)]
        judged = np.logical_and(known, (abs(np.arange(len(clip))[:, None] - at) > _REACH).all(1))
        yield {"clip": name, "frames": str(count), "before": _figures(body, fit, true, judged)} | {
            what: _figures(
                body,
                refit(_corrected(clip, depths, xy, at, places=places), body, fit, range(len(clip)), config=config),
                true,
                judged,
            )
            for what, places in (("depths kept", False), ("depths and places kept", True))
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
