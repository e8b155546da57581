"""What a fit makes of another system's result that it begins with: the result itself, the fit without it, and with it.

Results are the truth of windows of the motion suite, disturbed as learned systems are: a bias of the pose and noise
that changes slowly and at once, a lag, limbs that jump, a wrong depth and focal length, the mean shape, and stretches
that are missing. They are written in TRAM's form and read as a user's would be. Errors count in the frames that it
has; those of the fits in the missing ones stand beside them. PA-MPJPE and MPJPE are of the 12 limb joints, jitter is
the mean second difference of the 22 joints of the body.
"""

import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation
from torch import Tensor
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.motion_suite.clips import MotionClipMade, make_motion, motion_sequences
from evaluation.synthetic.motion_suite.depth_figures import LIMB_JOINTS
from evaluation.synthetic.motion_suite.windows import HALVES
from fitting_core.body import rotations
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.errors import InputError
from fitting_core.fit.events import PhaseFinished
from fitting_core.fit.fitting import fit_events
from fitting_core.fit.fused import ready
from fitting_core.measure.pairing import BODY_JOINTS
from fitting_core.metrics import mpjpe, pa_mpjpe
from fitting_core.results.given_start import GivenStart
from fitting_core.starts.reading import read_start
from tests.samples.excerpts import picked

_HIPS = [LIMB_JOINTS.index(JOINT[f"{side}_hip"]) for side in ("left", "right")]
_WORSE = 1.0
"""Millimetres: a window in which a refined fit is worse than its start by more is counted."""


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """How far a learned result is from the truth."""

    bias: float
    """Degrees of each joint, the same in all frames (standard deviation about each axis, as of the next two)."""
    slow: float
    """Degrees that change within half a second."""
    fast: float
    """Degrees that change in each frame."""
    lag: int
    """Frames."""
    jumps: int
    """Limbs that are turned by 50 degrees at their root for six frames."""
    depth: float
    """Factor of the distance beyond that of the focal length."""
    focal: float
    """Factor of the focal length."""
    missing: int
    """Frames in the middle."""


DISTURBANCES: dict[str, Disturbance] = {
    "video": Disturbance(bias=3, slow=2.5, fast=0.3, lag=1, jumps=1, depth=1.1, focal=1.2, missing=8),
    "image": Disturbance(bias=3, slow=2.5, fast=1.5, lag=0, jumps=2, depth=1.2, focal=1.5, missing=4),
    "poor": Disturbance(bias=6, slow=5, fast=2, lag=2, jumps=3, depth=1.4, focal=0.6, missing=12),
}
"""A system that looks at whole videos, one that looks at single images, and one that errs twice as much."""


@dataclass(frozen=True, kw_only=True)
class GivenStarts:
    """Which windows, and how they are fitted."""

    half: Literal["tuning", "untouched"] = "untouched"
    """Of the suite."""
    clips: int = 8
    """Windows of it, evenly spread."""
    frames: int = 60
    """Of each, at most."""
    deviations: tuple[str, ...] = ("preset", "none")
    """How near fits are held to the start, a variant for each: metres, none, or as the preset has it."""
    preset: str = "tcfit"
    disturbances: tuple[str, ...] = tuple(DISTURBANCES)
    each: bool = False
    """A line for each window, too."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Found:
    """Joints of one way, against the true ones."""

    joints: Float[np.ndarray, "T 55 3"]
    made: MotionClipMade
    there: Bool[np.ndarray, "T"]
    seconds: tuple[float, float]
    """Of processor time: phase 1, and all."""

    def errors(self, frames: Bool[np.ndarray, "T"]) -> dict[str, float]:
        true = self.made.truth.joints[: len(self.joints)]
        limbs, known = self.joints[frames][:, LIMB_JOINTS], true[frames][:, LIMB_JOINTS]
        return {
            "PA-MPJPE, mm": float(pa_mpjpe(limbs, known).mean()),
            "MPJPE, mm": float(mpjpe(limbs, known, _HIPS).mean()),
        }

    def figures(self) -> dict[str, float]:
        """In the frames of the start, and PA-MPJPE in the others."""
        second = np.linalg.norm(np.diff(self.joints[:, BODY_JOINTS], 2, axis=0), axis=-1).mean(1)
        whole = self.there[2:] & self.there[1:-1] & self.there[:-2]
        found = self.errors(self.there) | {"jitter, mm/frame²": 1e3 * float(second[whole].mean())}
        if not self.there.all() and np.isfinite(self.joints[~self.there]).all():
            found["missing: PA-MPJPE, mm"] = self.errors(~self.there)["PA-MPJPE, mm"]
        return found | {"phase 1, CPU s": self.seconds[0], "CPU s": self.seconds[1]}


def run(options: GivenStarts) -> None:
    """Every window, every disturbance, every way."""
    ready.use(threads=options.common.threads)
    body, config = options.common.load_body(), PRESETS[options.preset]
    found: dict[tuple[str, str, str], dict[str, float]] = {}
    for name in _windows(options):
        made = make_motion(motion_sequences()[name])
        clip = picked(made.clip, range(min(options.frames, len(made.clip))))
        alone, seconds = _timed(clip, body, config, None)
        for kind in options.disturbances:
            theirs, given = _result(made, clip, body, DISTURBANCES[kind])
            there = np.asarray(np.isfinite(theirs).all((1, 2)))
            ways = {"start": (theirs, (0.0, 0.0)), "fit without": (alone, seconds)}
            for text in options.deviations:
                ways[_title(text)] = _timed(clip, body, _held(config, text), given)
            for way, (joints, spent) in ways.items():
                one = _Found(joints=joints, made=made, there=there, seconds=spent)
                found[name, kind, way] = one.figures()
            progress(f"{name}, {kind}: " + ", ".join(f"{w} {found[name, kind, w]['PA-MPJPE, mm']:.1f}" for w in ways))
    tables = {f"Starts like those of a system: {kind}": list(_rows(kind, found)) for kind in options.disturbances}
    if options.each:
        tables["Each window"] = [{"window": n, "start": k, "way": w, **values} for (n, k, w), values in found.items()]
    report(options, tables)


def _windows(options: GivenStarts) -> list[str]:
    if options.half not in HALVES:
        raise InputError(f"--half is {options.half}; expected one of {', '.join(HALVES)}.")
    names = [name for name, sequence in motion_sequences().items() if sequence.half == options.half]
    return [names[i] for i in np.unique(np.linspace(0, len(names) - 1, options.clips).round().astype(int))]


def _title(deviation: str) -> str:
    return {"preset": "refined", "none": "refined, not held"}.get(deviation, f"refined, held within {deviation} m")


def _held(config: FitConfig, deviation: str) -> FitConfig:
    if deviation == "preset":
        return config
    return replace(config, start_deviation=None if deviation == "none" else float(deviation))


def _timed(
    clip: Clip, body: BodyModel, config: FitConfig, given: GivenStart | None
) -> tuple[Float[np.ndarray, "T 55 3"], tuple[float, float]]:
    """Joints of a fit, and its seconds of processor time in phase 1 and in all."""
    begin = time.process_time()
    ended: list[PhaseFinished] = []
    seconds: list[float] = []
    for event in fit_events(clip, body, config, start=given):
        if isinstance(event, PhaseFinished):
            ended.append(event)
            seconds.append(time.process_time() - begin)
    return joints_in_space(body, ended[-1].result.params), (seconds[0], seconds[-1])


def _rows(kind: str, found: dict[tuple[str, str, str], dict[str, float]]) -> Iterator[Row]:
    """Means over the windows, and in how many of them a way is worse than the start."""
    names = list(dict.fromkeys(name for name, one, _ in found if one == kind))
    for way in dict.fromkeys(way for _, one, way in found if one == kind):
        own = [found[name, kind, way] for name in names]
        row: dict[str, str | float | None] = {"": way}
        for column in dict.fromkeys(column for values in own for column in values):
            known = [values[column] for values in own if column in values]
            row[column] = float(np.mean(known))
        for column in ("PA-MPJPE, mm", "MPJPE, mm"):
            more = [found[name, kind, way][column] - found[name, kind, "start"][column] for name in names]
            row[f"most more {column}"] = float(max(more))
            row[f"worse, {column.split(',')[0]}"] = f"{sum(m > _WORSE for m in more)} of {len(names)}"
        yield row


def _result(
    made: MotionClipMade, clip: Clip, body: BodyModel, how: Disturbance
) -> tuple[Float[np.ndarray, "T 55 3"], GivenStart]:
    """A disturbed result: its own joints (NaN where it has none), and it as the start of a fit."""
    rng = np.random.default_rng([made.sequence.seed, 20])
    frames = len(clip)
    params = _disturbed(made.truth.params[slice(0, frames)], body, how, rng)
    missing = slice((frames - how.missing) // 2, (frames + how.missing) // 2)
    there = np.ones(frames, bool)
    there[missing] = False
    joints = joints_in_space(body, params)
    joints[~there] = np.nan
    with tempfile.TemporaryDirectory() as folder:
        path = _write_tram(Path(folder), params, np.flatnonzero(there), made, how)
        return joints, read_start(path, clip, body)


def _disturbed(true: BodyParams, body: BodyModel, how: Disturbance, rng: np.random.Generator) -> BodyParams:
    """The truth as a learned system might see it, on the mean body."""
    frames = len(true)
    late = true[np.maximum(np.arange(frames) - how.lag, 0).tolist()]
    turns = np.concatenate([late.global_orient.numpy(), late.body_pose.numpy()], 1).reshape(frames, 22, 3)
    slow = gaussian_filter1d(rng.standard_normal((frames + 60, 22, 3)), 7.0, axis=0)[30:-30]
    slow /= slow.std()
    noise = how.bias * rng.standard_normal((1, 22, 3)) + how.slow * slow + how.fast * rng.standard_normal(turns.shape)
    for _ in range(how.jumps):
        joint = JOINT[str(rng.choice(["left_shoulder", "right_shoulder", "left_hip", "right_hip"]))]
        axis, first = rng.standard_normal(3), int(rng.integers(0, max(frames - 6, 1)))
        noise[first : first + 6, joint] += 50 * axis / np.linalg.norm(axis)
    turned = rotations.exp(torch.as_tensor(turns)) @ rotations.exp(torch.as_tensor(np.radians(noise)))
    pose = rotations.log(turned).reshape(frames, 66)
    neutral = BodyParams.neutral(frames)
    # The pelvis stays on its line of sight; a longer lens and a wrong guess put it elsewhere along it.
    pelvis = torch.as_tensor(joints_in_space(body, replace(neutral, betas=neutral.betas))[:, 0])
    before = pelvis.numpy() + late.camera_translation.numpy()
    at = how.depth * before * (1.0, 1.0, how.focal)
    # The system sees the picture, and how the body stands to its line of sight: that runs elsewhere with its lens.
    orient = rotations.log(_turn(before, at) @ turned[:, 0])
    place = torch.as_tensor(at) - pelvis
    return replace(neutral, global_orient=orient, body_pose=pose[:, 3:], camera_translation=place)


def _turn(one: Float[np.ndarray, "T 3"], other: Float[np.ndarray, "T 3"]) -> Float[Tensor, "T 3 3"]:
    """The smallest rotations from some directions to others."""
    found = [Rotation.align_vectors(b[None], a[None])[0].as_matrix() for a, b in zip(one, other, strict=True)]
    return torch.as_tensor(np.stack(found))


def _write_tram(folder: Path, params: BodyParams, frames: np.ndarray, made: MotionClipMade, how: Disturbance) -> Path:
    """TRAM's hps/hps_track_0.npy and camera.npy."""
    some = params[frames.tolist()]
    pose = torch.cat([some.global_orient, some.body_pose, torch.zeros(len(some), 6)], 1).reshape(-1, 24, 3)
    (folder / "hps").mkdir()
    track = {
        "pred_rotmat": rotations.exp(pose).float(),
        "pred_shape": torch.zeros(len(some), 10),
        "pred_trans": some.camera_translation.float()[:, None],
        "frame": torch.as_tensor(frames),
    }
    camera = made.truth.camera
    told = {"img_focal": camera.focal[0] * how.focal, "img_center": np.array(camera.center)}
    np.save(folder / "hps" / "hps_track_0.npy", np.array(track, dtype=object), allow_pickle=True)
    np.save(folder / "camera.npy", np.array(told, dtype=object), allow_pickle=True)
    return folder


if __name__ == "__main__":
    start(GivenStarts, run)
