"""Whether a person who stands upright comes out so: a hundred generated ones, with the settings that a new user has.

Six bodies stand with hanging arms, turned any way, before a phone, a portrait lens and a tele lens that look at them
from 5 degrees below to 15 above; the detector is the motion suite's. Upright means that the trunk (pelvis to neck) is
within 5 degrees of the true one and both knees within 10 degrees of straight, in the middle frame.
"""

from dataclasses import dataclass, field, fields, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.motion_suite.framing import Shot, view_of
from evaluation.synthetic.motion_suite.measured_detector import MEASURED, MeasuredErrors, detected
from evaluation.synthetic.suite import SUBJECTS, Subject, in_view, subject_body
from evaluation.synthetic.truth import truth_of
from fitting_core.body.model import JOINT
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera, default_focal
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.fused import ready
from fitting_core.world_camera import in_camera

LENSES = {"phone": 26.0, "portrait": 85.0, "tele": 200.0}
"""Focal lengths, millimetres on 35 mm film."""
UPRIGHT, STRAIGHT = 5.0, 10.0
"""Degrees by which a trunk may lean, and knees may bend."""
_NO_ERRORS = {f.name: 0.0 for f in fields(MEASURED) if f.name.startswith(("lasting", "changing"))}
_ERRORS = {"measured": MEASURED, "exact": replace(MEASURED, outlying=0.0, **_NO_ERRORS)}
_SIZES = ((1280, 720), (720, 1280))
_FRAME_RATE = 25.0


@dataclass(frozen=True, kw_only=True)
class Standing:
    """How many people, and how they are fitted."""

    cases: int = 100
    frames: int = 25
    """Of each clip; 1: photographs."""
    focal: Literal["default", "true"] = "default"
    detector: Literal["measured", "exact"] = "measured"
    """With the motion suite's errors, or without any."""
    lifter: bool = True
    """With what preset tcfit takes from the lifter, and feet held."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One person before one lens."""

    lens: str
    clip: Clip
    joints: Float[np.ndarray, "T 55 3"]
    """The true ones in camera space, metres."""


def run(options: Standing) -> None:
    """Fit them all, and report by lens."""
    ready.use(threads=options.common.threads)
    config, body = PRESETS["tcfit"], options.common.load_body()
    if not options.lifter:
        config = _without_lifter(config)
    found: list[tuple[str, float, float]] = []
    for number in range(options.cases):
        made = case(number, frames=options.frames, focal=options.focal, errors=_ERRORS[options.detector])
        fitted = joints_in_space(body, fit_clip(made.clip, body, config).last.params)
        middle = options.frames // 2
        found.append((made.lens, lean(fitted[middle], made.joints[middle]), bend(fitted[middle])))
        progress(f"{number + 1:3} {made.lens:8}  trunk {found[-1][1]:5.1f}°  knees {found[-1][2]:5.1f}°")
    report(options, {"Standing people": rows(found)})


def case(number: int, *, frames: int, focal: str, errors: MeasuredErrors = MEASURED) -> Case:
    """The same number is always the same person before the same camera.

    Args:
        number: Which.
        frames: How many.
        focal: "true" or "default": what the clip's camera says.
        errors: Of the detector.
    """
    rng, lens = np.random.default_rng([20261, number]), list(LENSES)[number % len(LENSES)]
    subject = SUBJECTS[rng.integers(len(SUBJECTS))]
    body = subject_body(subject)
    world = _standing(subject, frames, rng)
    shot = Shot(
        azimuth=float(rng.uniform(-180, 180)),
        elevation=float(rng.uniform(-5, 15)),
        lens=LENSES[lens],
        size=_SIZES[rng.integers(2)],
        cut="whole",
        aside=0.0,
    )
    rest = joints_in_space(body, replace(BodyParams.neutral(1), betas=world.betas[:1]))[0]
    view = view_of(shot, keypoints_in_space(body, world)[0])
    params = in_camera(world, rest[0], view.pose())
    truth = truth_of(body, params, shot.camera, _FRAME_RATE)
    points, _ = keypoints_in_space(body, params)
    inside = np.asarray(((truth.keypoints >= 0) & (truth.keypoints < shot.size)).all(-1))
    keypoints = detected(
        truth.keypoints,
        truth.exists & in_view(body, params, shot.camera),
        inside,
        shot.camera.focal[0] / np.maximum(points[..., 2], 0.1),
        frame_rate=_FRAME_RATE,
        rng=rng,
        errors=errors,
    )
    camera = shot.camera if focal == "true" else _unknown(shot.camera)
    clip = Clip(keypoints=keypoints, camera=camera, frame_rate=_FRAME_RATE, name=f"standing_{number}")
    return Case(lens=lens, clip=clip, joints=truth.joints)


def _standing(subject: Subject, frames: int, rng: np.random.Generator) -> BodyParams:
    """At ease: arms hang, feet a little apart, and the trunk sways by a degree."""
    neutral = BodyParams.neutral(frames)
    pose = np.zeros((frames, 21, 3))
    apart = rng.uniform(0.02, 0.12)
    for sign, side in ((1, "left"), (-1, "right")):
        arm = Rotation.from_rotvec([0.0, 0.0, -sign * np.radians(rng.uniform(62, 78))])
        swung = Rotation.from_rotvec([np.radians(rng.uniform(-12, 12)), 0.0, 0.0])
        pose[:, JOINT[f"{side}_shoulder"] - 1] = (swung * arm).as_rotvec()
        pose[:, JOINT[f"{side}_elbow"] - 1, 1] = -sign * np.radians(rng.uniform(5, 35))
        pose[:, JOINT[f"{side}_hip"] - 1, 2] = sign * apart
    sway = np.radians(1.0) * np.sin(np.linspace(0, 2 * np.pi, frames, endpoint=False) + rng.uniform(0, 6))
    betas = torch.as_tensor([subject.betas], dtype=torch.float64).expand(frames, -1).clone()
    orient = torch.as_tensor(np.stack([sway, np.zeros(frames), np.zeros(frames)], 1))
    return replace(neutral, betas=betas, global_orient=orient, body_pose=torch.as_tensor(pose.reshape(frames, -1)))


def _unknown(camera: Camera) -> Camera:
    focal = default_focal(camera.size)
    return replace(camera, focal=(focal, focal), source="default")


def _without_lifter(config: FitConfig) -> FitConfig:
    nothing = (0.0,) * 5
    return replace(config, weights=replace(config.weights, relative_position=nothing, held_position=nothing))


def lean(found: Float[np.ndarray, "55 3"], true: Float[np.ndarray, "55 3"]) -> float:
    """Degrees between two trunks, pelvis to neck."""
    return _angle(*(joints[JOINT["neck"]] - joints[JOINT["pelvis"]] for joints in (found, true)))


def bend(joints: Float[np.ndarray, "55 3"]) -> float:
    """Degrees by which the more bent knee is bent."""
    legs = (tuple(joints[JOINT[f"{side}_{name}"]] for name in ("hip", "knee", "ankle")) for side in ("left", "right"))
    return max(_angle(knee - hip, ankle - knee) for hip, knee, ankle in legs)


def _angle(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)))


def rows(found: list[tuple[str, float, float]]) -> list[Row]:
    """One for each lens, and one for all."""
    return [_row(lens, [case for case in found if lens in (case[0], "all")]) for lens in (*LENSES, "all")]


def _row(lens: str, found: list[tuple[str, float, float]]) -> Row:
    trunk, knees = (np.array([case[i] for case in found]) for i in (1, 2))
    return {
        "lens": lens,
        "people": str(len(found)),
        "trunk median °": float(np.median(trunk)),
        "trunk p95 °": float(np.percentile(trunk, 95)),
        "knees median °": float(np.median(knees)),
        "knees p95 °": float(np.percentile(knees, 95)),
        "trunk upright %": float(100 * (trunk <= UPRIGHT).mean()),
        "knees straight %": float(100 * (knees <= STRAIGHT).mean()),
        "both %": float(100 * ((trunk <= UPRIGHT) & (knees <= STRAIGHT)).mean()),
    }


if __name__ == "__main__":
    start(Standing, run)
