"""What a correction of depth does to a limb that lies on the wrong side of its shoulder or hip.

A clip of the motion suite is fitted, and one limb at a time is mirrored in depth for some frames, in which phase 3 then
settles. Then it is corrected as in the review app: the worst frame is mirrored back, and those around it follow; or the
whole range is put in front or behind, as the truth has it. Errors are how far elbow and wrist, or knee and ankle, are
from the truth in depth, relative to the pelvis. Limbs count whose end is 15 cm before or behind their root, and that
stay on the wrong side as long as nothing is said.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.motion_suite.clips import MotionClipMade, make_motion, motion_sequences
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig, without_collisions
from fitting_core.fit.events import drained
from fitting_core.fit.fitting import fit_clip, rerun_events
from fitting_core.fit.fused import ready
from fitting_core.fit.phases.limb_flips import LIMBS, LimbFlips
from fitting_core.fit.phases.limb_flips import Limb as TwoBones
from fitting_core.fit.stages import Stages
from fitting_core.keypoints import INDEX
from tcfit_app.fitting.jobs import around
from tcfit_app.fitting.live import LIVE_REACH
from tcfit_app.review.gestures.depths import LimbPoints, SeenBody, Way, limbs_of
from tests.samples.excerpts import picked

DEEP = 0.15
"""Metres of depth from its root that a limb's end must have in the middle of the range."""


@dataclass(frozen=True, kw_only=True)
class DepthEdits:
    """Which clips, and how long limbs are mirrored."""

    clips: int = 10
    """Of the suite's tuning half, evenly spread, where legs are in the image."""
    frames: int = 60
    """Of each clip."""
    mirrored: int = 15
    """Frames in the middle, in which limbs are on the wrong side."""
    presets: tuple[str, ...] = ("tcfit", "paper")
    """Configurations, whose last stage follows the edits."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Case:
    """A fit with a limb on the wrong side."""

    clip: Clip
    body: BodyModel
    config: FitConfig
    limb: LimbPoints
    params: BodyParams
    frames: range
    """In which it is there."""
    true: Float[np.ndarray, "T 137"]
    """Depths behind the pelvis, metres."""

    @property
    def side(self) -> Literal["front", "behind"]:
        """Where the limb's end truly is in the middle of the range."""
        middle = self.frames[len(self.frames) // 2]
        return "front" if self.true[middle, self.limb[2]] < self.true[middle, self.limb[0]] else "behind"

    def sent(self, frames: range, way: Way) -> Clip:
        """The clip with the limb sent to a side, from where it is."""
        which = np.array(frames)
        params = self.params[list(frames)]
        seen = SeenBody(
            points=keypoints_in_space(self.body, params)[0],
            pelvis=joints_in_space(self.body, params)[:, JOINT["pelvis"], 2],
            keypoints=self.clip.keypoints[which],
            camera=self.clip.camera,
            swapped=[()] * len(frames),
        )
        depth = self.clip.keypoints.told_depth.copy()
        depth[np.ix_(frames, self.limb[1:])] = seen.sent(self.limb, way)
        return replace(self.clip, keypoints=replace(self.clip.keypoints, depth=depth))

    def followed(self, clip: Clip, frames: range) -> BodyParams:
        """The fit of these frames and those around, again."""
        params = self.params
        for window in around(frames, LIVE_REACH, len(clip)):
            params = drained(rerun_events(clip, self.body, self.config, params, window)).params
        return params

    def errors(self, params: BodyParams) -> Float[np.ndarray, "T"]:
        """Of the limb, centimetres."""
        off = _depths(self.body, params)[:, self.limb[1:]] - self.true[:, self.limb[1:]]
        return 100 * abs(off).mean(1)


def run(options: DepthEdits) -> None:
    """Every clip, every limb."""
    ready.use(threads=options.common.threads)
    body = options.common.load_body()
    found: dict[str, list[dict[str, float]]] = {preset: [] for preset in options.presets}
    kept: dict[str, list[bool]] = {preset: [] for preset in options.presets}
    for made in _clips(options.clips):
        clip = picked(made.clip, range(min(options.frames, len(made.clip))))
        truth = _depths(made.body, made.truth.params[slice(0, len(clip))])
        params = fit_clip(clip, body, PRESETS["tcfit"]).last.params
        for preset in options.presets:
            for case in _cases(clip, body, PRESETS[preset], params, truth, options.mirrored):
                settled = replace(case, params=case.followed(case.clip, case.frames))
                there = slice(case.frames.start, case.frames.stop)
                wrong = settled.errors(settled.params)[there].mean() > 2 * case.errors(params)[there].mean() + 5
                kept[preset].append(wrong)
                if wrong:
                    found[preset].append(_measured(settled, params))
        progress(f"{made.clip.name}: " + ", ".join(f"{preset} {len(rows)}" for preset, rows in found.items()))
    rows = [row for preset in options.presets for row in _rows(preset, kept[preset], found[preset])]
    report(options, {f"Limbs mirrored in depth for {options.mirrored} frames": rows})


def _clips(count: int) -> Iterator[MotionClipMade]:
    fitting = [s.name for s in motion_sequences().values() if s.half == "tuning" and s.shot.cut in ("whole", "knee")]
    for i in np.unique(np.linspace(0, len(fitting) - 1, count).round().astype(int)):
        yield make_motion(motion_sequences()[fitting[i]])


def _cases(
    clip: Clip, body: BodyModel, config: FitConfig, params: BodyParams, truth: Float[np.ndarray, "T 137"], frames: int
) -> Iterator[_Case]:
    """Each limb that reaches deep enough, on the wrong side."""
    middle = len(clip) // 2
    which = range(middle - frames // 2, middle - frames // 2 + frames)
    config = replace(without_collisions(config), solver="lm", temporal=replace(config.temporal, stages=(5,)))
    for bones in LIMBS.values():
        (limb,) = limbs_of([INDEX[bones.joints[2]]])
        if abs(truth[middle, limb[2]] - truth[middle, limb[0]]) < DEEP:
            continue
        wrong = params.with_frames(which, _mirrored(clip, body, config, params[list(which)], bones))
        yield _Case(clip=clip, body=body, config=config, limb=limb, params=wrong, frames=which, true=truth)


def _mirrored(clip: Clip, body: BodyModel, config: FitConfig, params: BodyParams, limb: TwoBones) -> BodyParams:
    part = replace(clip, keypoints=clip.keypoints[: len(params)])
    stages = Stages.of(part.keypoints, part.camera, body, replace(config, pose_prior="axis_angle"))
    pose = LimbFlips(stages).flipped(stages.parametrisation.from_params(params), limb, upper=True, lower=True)
    return replace(params, body_pose=pose.to(params.body_pose))


def _measured(case: _Case, before: BodyParams) -> dict[str, float]:
    """Mean errors in centimetres, by what was done and where they are taken."""
    worst = case.frames.start + int(case.errors(case.params)[case.frames.start : case.frames.stop].argmax())
    frame = range(worst, worst + 1)
    (window,) = around(frame, LIVE_REACH, len(case.clip))
    one = case.followed(case.sent(frame, "mirror"), frame)
    whole = case.followed(case.sent(case.frames, case.side), case.frames)
    errors = {
        "unspoilt": case.errors(before),
        "wrong": case.errors(case.params),
        "one frame": case.errors(one),
        "range": case.errors(whole),
    }
    parts = {"the frame": frame, "the 7 frames": window, "all": case.frames}
    return {f"{name}, {title}": float(e[list(w)].mean()) for name, e in errors.items() for title, w in parts.items()}


_DONE = {
    "unspoilt": "the fit before a limb was mirrored",
    "wrong": "mirrored: what the user finds",
    "one frame": "the worst frame mirrored back",
    "range": "the range put in front or behind",
}


def _rows(preset: str, kept: list[bool], found: list[dict[str, float]]) -> Iterator[Row]:
    for name, title in _DONE.items():
        row: dict[str, str | float | None] = {"preset": preset, "limbs": f"{sum(kept)} of {len(kept)}", "what": title}
        for part in ("the frame", "the 7 frames", "all"):
            values = [values[f"{name}, {part}"] for values in found]
            row[f"{part}, cm"] = float(np.mean(values)) if values else None
        yield row


def _depths(body: BodyModel, params: BodyParams) -> Float[np.ndarray, "T 137"]:
    """Behind the pelvis, metres."""
    with torch.no_grad():
        return keypoints_in_space(body, params)[0][..., 2] - joints_in_space(body, params)[:, JOINT["pelvis"], 2:]


if __name__ == "__main__":
    start(DepthEdits, run)
