"""What the review queue finds of errors that were put in, how high up, and how much of what it says is so.

Clips of the motion suite are seen by a good detector (or by the suite's own, whose errors are as large as measured ones
of real detectors), one error of a known kind is put into each copy of a clip
(`benchmarks.injected_errors`; a limb mirrored in depth is put into the fit), and the copy is fitted. An entry of the
queue finds the error if it is about its frames and one of its limbs. An error is harmless where the fit is hardly worse
for it. An entry is right if at its frame something about its limbs truly is wrong: the fit, in depth or in the image,
or the detections.
"""

import hashlib
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
import platformdirs
import torch
from jaxtyping import Bool, Float
from tyro.conf import OmitArgPrefixes

from benchmarks.injected_errors import ERRORS, Injected, Seen, clear_places, inject, trunk_of
from benchmarks.report import Common, Row, progress, report, start
from evaluation.suite_runs import done_tasks, fitted_body
from evaluation.synthetic.motion_suite.clips import MotionClipMade, make_motion, motion_sequences
from evaluation.synthetic.simulated_detector import Detector, detect
from evaluation.synthetic.suite import LEVELS
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig, without_collisions
from fitting_core.config.toml import as_plain
from fitting_core.files.npz import read_npz, write_npz
from fitting_core.fit.events import drained
from fitting_core.fit.fitting import fit_clip, rerun_events
from fitting_core.fit.fused import ready
from fitting_core.fit.phases.limb_flips import LIMBS, LimbFlips
from fitting_core.fit.stages import Stages
from fitting_core.keypoints import BODY, COUNT, HANDS, INDEX
from tcfit_app.analysis.body_regions import LIMB_OF
from tcfit_app.analysis.findings import FINDINGS
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.suspicion import Suspect, review_queue
from tcfit_app.fitting.jobs import around
from tcfit_app.fitting.live import LIVE_REACH

_DETECTORS = {"good": Detector(), "measured": LEVELS["normal"].detector}
FLIP = "flip"
KINDS = (*ERRORS, FLIP)
_FLIPPED = 15
"""Frames of a limb on the wrong side."""
_DEEP = 0.15
"""Metres of depth from its root that a limb's end must have, for a mirrored limb to be another one."""
_HARM = 0.03
"""Metres by which the spoilt fit must be worse than the unspoilt one, on average over the error's frames and points."""
_NEAR = 2
"""Frames beside an error in which an entry still finds it."""
_WRONG_IN_SPACE = 0.15
"""Metres, relative to the pelvis, from which a fitted keypoint is wrong."""
_WRONG_IN_IMAGE = {"body": 0.06, "hands": 0.03}
"""Metres across the view from which a fitted keypoint or a detection is wrong."""
_CONFIDENT = 0.2


@dataclass(frozen=True, kw_only=True)
class ReviewQueue:
    """Which clips, and how many errors."""

    half: Literal["tuning", "untouched"] = "tuning"
    detector: Literal["good", "measured"] = "good"
    errors: int = 5
    """Kinds that are put into each clip, one at a time, so that all kinds come equally often; 0: none."""
    clips: int = 30
    """Evenly spread over the half."""
    fits: Path = field(default_factory=lambda: platformdirs.user_cache_path("tcfit", appauthor=False) / "review-queue")
    """Folder in which fits stay, so that another queue needs no new ones."""
    misses: int = 10
    """How many of the worst errors that were not found are told."""
    jobs: int = 1
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True)
class Task:
    """One clip with the kinds of error that it gets."""

    sequence: str
    other: str
    """Whose detections stand for somebody else's."""
    kinds: tuple[str, ...]
    detector: str
    fits: Path


@dataclass(frozen=True, kw_only=True)
class Entry:
    """An entry of a queue, judged."""

    kind: str
    right: bool


@dataclass(frozen=True, kw_only=True)
class Trial:
    """An error that was put in, and what the queue says of it."""

    name: str
    kind: str
    """One of KINDS, or "none": the clip as it is."""
    harm: float
    """By which the fit is worse for it, metres."""
    rank: int | None
    """Of the first entry that finds it, from 1; None: it is not found."""
    by: str
    """The kind of that entry; empty if there is none."""
    before: bool
    """Whether the same place is an entry even without the error."""
    entries: tuple[Entry, ...]
    frames: int
    wrong: float
    """Share of all frames and limbs about which something truly is wrong."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """A fit beside the truth."""

    made: MotionClipMade
    fit: PosedFit

    @property
    def pixels(self) -> Float[np.ndarray, "T 1"]:
        """Of a metre across the view."""
        return self.made.truth.camera.focal[0] / np.maximum(self.made.truth.joints[:, JOINT["pelvis"], 2:], 0.1)

    @cached_property
    def errors(self) -> Float[np.ndarray, "T 137"]:
        """Of the fitted keypoints, relative to the pelvis, metres."""
        root = self.made.truth.joints[:, JOINT["pelvis"]]
        return np.linalg.norm(self.fit.points - self.fit.root[:, None] - _points(self.made) + root[:, None], axis=-1)

    @cached_property
    def wrong(self) -> Bool[np.ndarray, "T 137"]:
        """Keypoints about which something truly is wrong."""
        truth, keypoints = self.made.truth, self.fit.clip.keypoints
        least = np.full(COUNT, np.inf)
        least[BODY], least[HANDS] = _WRONG_IN_IMAGE["body"], _WRONG_IN_IMAGE["hands"]
        drawn = np.linalg.norm(self.fit.projected - truth.keypoints, axis=-1)
        detected = np.linalg.norm(keypoints.xy - truth.keypoints, axis=-1)
        trusted = keypoints.confidence > _CONFIDENT
        lost = _visible(self.made) & ~(keypoints.confidence > 0)
        off = (drawn > least * self.pixels) | ((detected > least * self.pixels) & trusted)
        return (np.nan_to_num(self.errors) > _WRONG_IN_SPACE) | off | lost

    def right(self, entry: Suspect) -> bool:
        """Whether an entry's limbs truly are wrong in its frame."""
        limbs = {LIMB_OF[joint] for joint in entry.joints}
        wrong = np.flatnonzero(self.wrong[entry.frame])
        return any(not limbs or LIMB_OF[joint] in limbs for joint in wrong.tolist())

    @property
    def share(self) -> float:
        """Of frames and limbs about which something truly is wrong."""
        limbs = sorted(set(LIMB_OF.values()))
        columns = [[joint for joint, limb in LIMB_OF.items() if limb == which] for which in limbs]
        return float(np.mean([self.wrong[:, own].any(1).mean() for own in columns]))


def run(options: ReviewQueue) -> None:
    """Put errors in, fit, look, and report."""
    names = [name for name, sequence in motion_sequences().items() if sequence.half == options.half]
    chosen = [names[i] for i in np.unique(np.linspace(0, len(names) - 1, options.clips).round().astype(int))]
    tasks = [_task(options, names, name, i) for i, name in enumerate(chosen)]
    trials: list[Trial] = []
    for task, found in done_tasks(run_task, tasks, jobs=options.jobs):
        trials += found
        progress(f"{task.sequence}: " + ", ".join(f"{t.kind} {t.rank or '-'}" for t in found if t.kind != "none"))
    put_in = [trial for trial in trials if trial.kind != "none"]
    report(
        options,
        {
            f"Errors put into the {options.half} half": [*_by_kind(put_in), _row("all", put_in)],
            "Entries, by what they say": list(_by_entry(trials)),
            "Clips as they are": _untouched([trial for trial in trials if trial.kind == "none"]),
            "The worst errors that were not found": list(_misses(put_in, options.misses)),
        },
    )


def _task(options: ReviewQueue, names: Sequence[str], name: str, number: int) -> Task:
    sequences = motion_sequences()
    same = [other for other in names if other != name and sequences[other].shot.size == sequences[name].shot.size]
    kinds = tuple(KINDS[(number * options.errors + i) % len(KINDS)] for i in range(options.errors))
    other = same[number % len(same)]
    return Task(sequence=name, other=other, kinds=kinds, detector=options.detector, fits=options.fits)


def run_task(task: Task) -> list[Trial]:
    """The clip as it is, and with each error."""
    torch.set_num_threads(1)
    ready.use(threads=1)
    made, body = seen_clip(task.sequence, task.detector), fitted_body()
    others = seen_clip(task.other, task.detector).clip.keypoints
    seen = Seen(keypoints=made.clip.keypoints, trunk=trunk_of(made.truth.keypoints), others=others)
    meshes = Meshes(body)
    params, cost = fitted_clip(task.fits, made.clip, body)
    clean = _judged(made, made.clip, params, cost, meshes)
    queue = review_queue(clean.fit).left
    trials = [_trial(task.sequence, "none", clean, queue, range(0), (), clean, queue)]
    for kind in task.kinds:
        rng = np.random.default_rng([zlib.crc32(task.sequence.encode()), KINDS.index(kind)])
        spoilt = _flipped(clean, seen, params, rng) if kind == FLIP else _injected(task, clean, seen, kind, rng)
        if spoilt is not None:
            judged, frames, joints = spoilt
            found = review_queue(judged.fit).left
            trials.append(_trial(task.sequence, kind, judged, found, frames, joints, clean, queue))
    return trials


_Spoilt = tuple[Judged, range, tuple[int, ...]]
"""A fit with an error, its frames and its keypoints."""


def _injected(task: Task, clean: Judged, seen: Seen, kind: str, rng: np.random.Generator) -> _Spoilt | None:
    injected: Injected | None = inject(kind, seen, rng)
    if injected is None:
        return None
    clip = replace(clean.made.clip, keypoints=injected.keypoints)
    params, cost = fitted_clip(task.fits, clip, clean.fit.meshes.body)
    return _judged(clean.made, clip, params, cost, clean.fit.meshes), injected.frames, injected.joints


def _flipped(clean: Judged, seen: Seen, params: BodyParams, rng: np.random.Generator) -> _Spoilt | None:
    """A limb mirrored in depth for some frames, in which the last phase has settled, and which it has not undone."""
    clip, body = clean.made.clip, clean.fit.meshes.body
    groups = {tuple(INDEX[joint] for joint in limb.joints): limb for limb in LIMBS.values()}
    for frames, joints in clear_places(seen, _FLIPPED, tuple(groups), rng):
        true = _points(clean.made)[frames[len(frames) // 2], :, 2]
        if abs(true[joints[2]] - true[joints[0]]) < _DEEP:
            continue
        config = _last_stage()
        part = replace(clip, keypoints=clip.keypoints[frames.start : frames.stop])
        stages = Stages.of(part.keypoints, part.camera, body, replace(config, pose_prior="axis_angle"))
        state = stages.parametrisation.from_params(params[list(frames)])
        pose = LimbFlips(stages).flipped(state, groups[joints], upper=True, lower=True)
        found = params.with_frames(frames, replace(params[list(frames)], body_pose=pose.to(params.body_pose)))
        for window in around(frames, LIVE_REACH, len(clip)):
            found = drained(rerun_events(clip, body, config, found, window)).params
        judged = _judged(clean.made, clip, found, None, clean.fit.meshes)
        if _harm(judged, clean, frames, joints[1:]) > _HARM:
            return judged, frames, joints[1:]
    return None


def _last_stage() -> FitConfig:
    config = PRESETS["tcfit"]
    return replace(without_collisions(config), solver="lm", temporal=replace(config.temporal, stages=(5,)))


def _trial(
    name: str,
    kind: str,
    judged: Judged,
    queue: Sequence[Suspect],
    frames: range,
    joints: tuple[int, ...],
    clean: Judged,
    before: Sequence[Suspect],
) -> Trial:
    rank = _rank(queue, frames, joints)
    return Trial(
        name=name,
        kind=kind,
        harm=_harm(judged, clean, frames, joints) if joints else 0.0,
        rank=rank,
        by=queue[rank - 1].kind if rank else "",
        before=_rank(before, frames, joints) is not None,
        entries=tuple(Entry(kind=entry.kind, right=judged.right(entry)) for entry in queue),
        frames=len(judged.fit),
        wrong=judged.share,
    )


def _rank(queue: Sequence[Suspect], frames: range, joints: Sequence[int]) -> int | None:
    """Of the first entry about some frames and limbs."""
    limbs = {LIMB_OF[joint] for joint in joints}
    for rank, entry in enumerate(queue, 1):
        near = entry.frames.start - _NEAR < frames.stop and frames.start < entry.frames.stop + _NEAR
        if near and (not entry.joints or limbs & {LIMB_OF[joint] for joint in entry.joints}):
            return rank
    return None


def _harm(judged: Judged, clean: Judged, frames: range, joints: Sequence[int]) -> float:
    at = np.ix_(frames, joints)
    return float(np.nanmean(judged.errors[at] - clean.errors[at]))


def seen_clip(name: str, detector: str) -> MotionClipMade:
    """A clip of the suite with hands and face, as a detector sees it."""
    sequence = motion_sequences()[name]
    made = make_motion(sequence)
    keypoints = detect(
        made.truth.keypoints,
        _visible(made),
        made.truth.exists,
        frame_rate=made.clip.frame_rate,
        height=made.truth.camera.size[1],
        failures=(),
        rng=np.random.default_rng([sequence.seed, 5]),
        detector=_DETECTORS[detector],
    )
    if detector == "measured":
        body = made.clip.keypoints
        keypoints.xy[:, BODY], keypoints.confidence[:, BODY] = body.xy[:, BODY], body.confidence[:, BODY]
    outside = ~_inside(made)
    keypoints = replace(
        keypoints,
        xy=np.where(outside[..., None], 0, keypoints.xy),
        confidence=np.where(outside, 0, keypoints.confidence),
    )
    return replace(made, clip=replace(made.clip, keypoints=keypoints))


def _inside(made: MotionClipMade) -> Bool[np.ndarray, "T 137"]:
    xy = made.truth.keypoints
    return np.asarray(((xy >= 0) & (xy < made.truth.camera.size)).all(-1))


def _visible(made: MotionClipMade) -> Bool[np.ndarray, "T 137"]:
    return made.truth.visible & _inside(made)


def _points(made: MotionClipMade) -> Float[np.ndarray, "T 137 3"]:
    """The true keypoints in camera space, metres."""
    return Meshes(made.body).keypoints(made.truth.params)


def _judged(
    made: MotionClipMade, clip: Clip, params: BodyParams, cost: Float[np.ndarray, "T"] | None, meshes: Meshes
) -> Judged:
    return Judged(made=made, fit=PosedFit.posed(clip, params, meshes, frame_cost=cost))


def fitted_clip(folder: Path, clip: Clip, body: BodyModel) -> tuple[BodyParams, Float[np.ndarray, "T"]]:
    """A fit and its cost by frame, from the folder if it was fitted before."""
    digest = hashlib.sha256(msgspec.json.encode([as_plain(PRESETS["tcfit"]), body.hash, clip.camera.focal]))
    for array in (clip.keypoints.xy, clip.keypoints.confidence):
        digest.update(np.ascontiguousarray(array).tobytes())
    path = folder / f"{clip.name}-{digest.hexdigest()[:16]}.npz"
    if path.is_file():
        stored = read_npz(path)
        params = BodyParams(**{f.name: torch.as_tensor(stored[f.name]) for f in fields(BodyParams)})
        return params, stored["frame_cost"]
    last = fit_clip(clip, body, PRESETS["tcfit"]).last
    folder.mkdir(parents=True, exist_ok=True)
    write_npz(
        path, {name: values.numpy() for name, values in vars(last.params).items()} | {"frame_cost": last.frame_cost}
    )
    return last.params, last.frame_cost


def _by_kind(trials: Sequence[Trial]) -> Iterator[Row]:
    for kind in KINDS:
        yield _row(kind, [trial for trial in trials if trial.kind == kind])


def _row(title: str, trials: Sequence[Trial]) -> Row:
    harmful = [trial for trial in trials if trial.harm > _HARM]
    harmless = [trial for trial in trials if trial.harm <= _HARM]
    ranks = [trial.rank for trial in harmful if trial.rank]
    return {
        "error": title,
        "harmful": str(len(harmful)),
        "found, %": _share([trial.rank is not None for trial in harmful]),
        "first in the queue, %": _share([trial.rank == 1 for trial in harmful]),
        "among the first 3, %": _share([(trial.rank or 9) <= 3 for trial in harmful]),
        "median rank": float(np.median(ranks)) if ranks else None,
        "an entry without it, %": _share([trial.before for trial in harmful]),
        "harmless": str(len(harmless)),
        "harmless found, %": _share([trial.rank is not None for trial in harmless]),
    }


def _by_entry(trials: Sequence[Trial]) -> Iterator[Row]:
    entries = [entry for trial in trials for entry in trial.entries]
    for kind in (*FINDINGS, "all"):
        own = [entry.right for entry in entries if kind in (entry.kind, "all")]
        yield {"what it says": kind, "entries": str(len(own)), "right, %": _share(own)}
    by_chance = float(np.average([t.wrong for t in trials], weights=[t.frames for t in trials]))
    yield {"what it says": "any frame and limb, by chance", "entries": None, "right, %": 100 * by_chance}


def _untouched(trials: Sequence[Trial]) -> list[Row]:
    frames, entries = sum(trial.frames for trial in trials), [entry for trial in trials for entry in trial.entries]
    wrong = sum(not entry.right for entry in entries)
    return [
        {
            "frames": str(frames),
            "entries a 100 frames": 100 * len(entries) / frames,
            "of those not right": 100 * wrong / frames,
        }
    ]


def _misses(trials: Sequence[Trial], count: int) -> Iterator[Row]:
    missed = [trial for trial in trials if trial.rank is None and trial.harm > _HARM]
    for trial in sorted(missed, key=lambda trial: -trial.harm)[:count]:
        yield {"clip": trial.name, "error": trial.kind, "worse by, cm": 100 * trial.harm}


def _share(found: Sequence[bool]) -> float | None:
    return 100 * float(np.mean(found)) if found else None


if __name__ == "__main__":
    start(ReviewQueue, run)
