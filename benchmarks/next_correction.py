"""How much the next corrections help, by the order in which the review queue offers them.

Clips of the motion suite are fitted to detections as noisy as measured ones. Then entries of the queue are corrected
one after the other: the true position of one body keypoint in the entry's worst frame is put in, and the frames around
it are fitted again, as in the review app. What is told is the mean error of the body's joints relative to the pelvis
over the whole clip.
"""

import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
import platformdirs
import torch
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, Row, progress, report, start
from benchmarks.review_queue import fitted_clip, seen_clip
from evaluation.suite_runs import done_tasks, fitted_body
from evaluation.synthetic.motion_suite.clips import MotionClipMade, motion_sequences
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS
from fitting_core.fit.events import drained
from fitting_core.fit.fused import ready
from fitting_core.fit.stages import Stages
from fitting_core.fit.uncertainty.calibration import error_bars
from fitting_core.keypoints import BODY
from fitting_core.results.error_bars import JOINTS
from tcfit_app.analysis.body_regions import LIMB_OF
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.suspicion import ORDERS, Suspect, review_queue
from tcfit_app.fitting.live import Correction, LiveCorrection

AFTER = (1, 3, 10)
"""Corrections after which errors are told."""
Place = tuple[int, int]
"""Frame and body keypoint of a correction."""


@dataclass(frozen=True, kw_only=True)
class NextCorrection:
    """Which clips."""

    half: Literal["tuning", "untouched"] = "tuning"
    clips: int = 12
    """Evenly spread over the twelve that `benchmarks.review_queue --clips 12` fits."""
    fits: Path = field(default_factory=lambda: platformdirs.user_cache_path("tcfit", appauthor=False) / "review-queue")
    """Folder in which fits stay: that of `benchmarks.review_queue`."""
    jobs: int = 1
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


Task = tuple[str, Path]
"""A sequence, and the folder of fits."""
Errors = dict[str, list[float]]
"""Millimetres by order: before, and after each of AFTER."""


def run(options: NextCorrection) -> None:
    """Correct every clip in every order."""
    names = [name for name, sequence in motion_sequences().items() if sequence.half == options.half]
    fitted = np.linspace(0, len(names) - 1, 12).round().astype(int)
    chosen = np.linspace(0, len(fitted) - 1, options.clips).round().astype(int)
    tasks = [(names[i], options.fits) for i in fitted[chosen]]
    found: list[Errors] = []
    for (name, _), errors in done_tasks(run_task, tasks, jobs=options.jobs):
        found.append(errors)
        progress(
            f"{name}: " + "; ".join(f"{order} {', '.join(f'{e:.1f}' for e in es)}" for order, es in errors.items())
        )
    report(options, {f"Joint error in mm, {len(found)} clips of the {options.half} half": list(_rows(found))})


def run_task(task: Task) -> Errors:
    """One clip."""
    torch.set_num_threads(1)
    ready.use(threads=1)
    name, fits = task
    made, body = seen_clip(name, "measured"), fitted_body()
    params, cost = fitted_clip(fits, made.clip, body)
    stages = Stages.of_clip(made.clip, body, PRESETS["tcfit"])
    bars = error_bars(stages, stages.parametrisation.from_params(params))
    fit = replace(PosedFit.posed(made.clip, params, Meshes(body), frame_cost=cost), error_bars=bars)
    queue = review_queue(fit).left
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    keys: dict[str, Callable[[Suspect], float]] = {
        "suspicion": lambda suspect: ORDERS["suspicion"](suspect)[0],
        "uncertainty": lambda suspect: ORDERS["uncertainty"](suspect)[0],
        "both, multiplied": lambda suspect: -suspect.score * suspect.unsure,
        "chance": lambda _: rng.random(),
    }
    errors: Errors = {}
    for order, key in keys.items():
        places = [place for s in sorted(queue, key=key) if (place := _place(s, made, fit)) is not None]
        errors[order] = list(_corrected(made, params, body, places))
    return errors


def _place(suspect: Suspect, made: MotionClipMade, fit: PosedFit) -> Place | None:
    """The body keypoint to correct for an entry: of those it names, or of its limbs, the one farthest off in the image,
    as somebody who looks at the frame sees it; None if none is in the image."""
    own = [joint for joint in suspect.joints if joint < BODY.stop]
    own = own or [joint for joint in range(BODY.stop) if LIMB_OF[joint] in suspect.about] or list(range(BODY.stop))
    true = made.truth.keypoints[suspect.frame, own]
    inside = ((true >= 0) & (true < made.truth.camera.size)).all(-1)
    off = np.linalg.norm(fit.projected[suspect.frame, own] - true, axis=-1)
    return (suspect.frame, own[int(np.nanargmax(np.where(inside, off, -1)))]) if inside.any() else None


def _corrected(made: MotionClipMade, params: BodyParams, body: BodyModel, places: Sequence[Place]) -> Iterator[float]:
    """The error before, and after so many corrections; after fewer if there are no more."""
    clip, done = made.clip, 0
    yield _error(made, params, body)
    for count in AFTER:
        for frame, joint in places[done:count]:
            clip, params = _moved(clip, params, body, frame, joint, made.truth.keypoints[frame, joint])
        done = count
        yield _error(made, params, body)


def _moved(
    clip: Clip, params: BodyParams, body: BodyModel, frame: int, joint: int, target: np.ndarray
) -> tuple[Clip, BodyParams]:
    correction = Correction(
        clip=clip, body=body, config=PRESETS["tcfit"], params=params, frame=frame, keypoints=(joint,)
    )
    refit = drained(LiveCorrection(correction, target[None]).release())
    return correction.edited(target[None]), refit.params


def _error(made: MotionClipMade, params: BodyParams, body: BodyModel) -> float:
    """Mean over frames and joints, millimetres."""
    found, true = joints_in_space(body, params)[:, : len(JOINTS)], made.truth.joints[:, : len(JOINTS)]
    root = JOINT["pelvis"]
    return 1e3 * float(np.linalg.norm(found - found[:, [root]] - true + true[:, [root]], axis=-1).mean())


def _rows(found: Sequence[Errors]) -> Iterator[Row]:
    for order in found[0]:
        before, *after = np.mean([errors[order] for errors in found], axis=0)
        yield {"order": order, "before": float(before)} | {
            f"less after {count}": float(before - value) for count, value in zip(AFTER, after, strict=True)
        }


if __name__ == "__main__":
    start(NextCorrection, run)
