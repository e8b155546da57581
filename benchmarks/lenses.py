"""What a camera file is worth: the demo clip's person before bending lenses, fitted with and without knowing them.

The person of the demo clip stands nearer to a wide lens and aside of its middle, where it bends most. Keypoints are
where such a lens films them, with the demo clip's simulated detector. All fits know the focal length. The joints are
compared in the laboratory's world, whose floor is level: where an export with `--axes world` has them.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.motions import demo_script
from evaluation.synthetic.simulated_detector import detect
from evaluation.synthetic.studio.studio import VIEW
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera, Lens, World, project
from fitting_core.clip import Clip
from fitting_core.clips.demo import demo_clip
from fitting_core.config.schema import PRESETS
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.fused import ready
from fitting_core.io.truth import Truth, read_truth
from fitting_core.keypoints import Keypoints
from fitting_core.lens import filmed, straightened_keypoints
from fitting_core.metrics import mpjpe, pa_mpjpe
from fitting_core.motion import OWN_WORLD, Motion

LENSES: dict[str, tuple[float, ...]] = {
    "straight": (),
    "webcam": (-0.10, 0.02, 0.0005, -0.0005),
    "action camera": (-0.28, 0.08, 0.001, -0.001),
    "pincushion": (0.12, 0.03, 0.0, 0.0),
}
"""OpenCV's coefficients."""
_AROUND = np.radians(VIEW.azimuth)
_MOVED = 1.9 * np.array([np.sin(_AROUND), 0, np.cos(_AROUND)]) + 0.75 * np.array([np.cos(_AROUND), 0, -np.sin(_AROUND)])
"""Metres in the world: towards the camera, and aside."""
_BODY = slice(0, JOINT["right_wrist"] + 1)


def _laboratory() -> World:
    pose = VIEW.pose()
    (one, two, three), (x, y, z) = pose.rotation.tolist(), pose.translation.tolist()
    return World(rotation=(tuple(one), tuple(two), tuple(three)), translation=(x, y, z), up="y")


CAMERA = Camera(focal=(700.0, 700.0), center=(640.0, 360.0), size=(1280, 720), world=_laboratory())
"""A horizontal field of view of 85 degrees."""


@dataclass(frozen=True, kw_only=True)
class Lenses:
    """How much is fitted."""

    frames: int = 60
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def run(options: Lenses) -> None:
    """Fit all, and report."""
    ready.use(threads=options.common.threads)
    body, truth = options.common.load_body(), read_truth(demo_clip().truth)
    rows: list[Row] = []
    straight = None
    for name, distortion in LENSES.items():
        lens = Lens(focal=CAMERA.focal, center=CAMERA.center, distortion=distortion) if distortion else None
        made = _filmed(body, truth, lens)
        for known in (True, False) if lens else (True,):
            said = "none" if lens is None else "known" if known else "not known"
            joints = _fitted(made, body, lens if known else None, options.frames)
            straight = joints if straight is None else straight
            rows.append({"lens": name, "distortion": said, "bent by px": made.bent} | _figures(made, joints, straight))
            progress(str(rows[-1]))
    report(options, {"Lenses": rows})


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shot:
    """The clip as it was filmed, and the truth."""

    keypoints: Keypoints
    frame_rate: float
    bent: float
    """Pixels by which the lens moves keypoints in the mean."""
    joints: Float[np.ndarray, "T 22 3"]
    """In the laboratory's world, metres."""


def _filmed(body: BodyModel, truth: Truth, lens: Lens | None) -> _Shot:
    pose = VIEW.pose()
    moved = torch.as_tensor(pose.rotation @ _MOVED)
    params = replace(truth.params, camera_translation=truth.params.camera_translation + moved)
    points, _ = keypoints_in_space(body, params)
    # Those that the body lacks are NaN, and never detected.
    straight = np.nan_to_num(project(CAMERA, torch.as_tensor(points)).numpy())
    seen = straight if lens is None else filmed(lens, straight)
    inside = ((seen >= 0) & (seen < CAMERA.size)).all(-1)
    keypoints = detect(
        seen,
        truth.visible & inside,
        truth.exists,
        frame_rate=truth.frame_rate,
        height=CAMERA.size[1],
        failures=demo_script.FAILURES,
        rng=np.random.default_rng([20, 1]),
    )
    return _Shot(
        keypoints=keypoints,
        frame_rate=truth.frame_rate,
        bent=float(np.linalg.norm(seen - straight, axis=-1)[:, truth.exists].mean()),
        joints=(joints_in_space(body, params)[:, _BODY] - pose.translation) @ pose.rotation,
    )


def _fitted(shot: _Shot, body: BodyModel, lens: Lens | None, frames: int) -> Float[np.ndarray, "T 22 3"]:
    """Joints in the laboratory's world of a fit that knows this lens."""
    keypoints, _ = straightened_keypoints(shot.keypoints[:frames], lens)
    clip = Clip(keypoints=keypoints, camera=replace(CAMERA, lens=lens), frame_rate=shot.frame_rate, name="lens")
    params = fit_clip(clip, body, PRESETS["tcfit"]).last.params
    motion = Motion(body=body, params=params, camera=clip.camera, frame_rate=clip.frame_rate, name=clip.name)
    return motion.in_axes(OWN_WORLD).joints()[:, _BODY]


def _figures(
    shot: _Shot, joints: Float[np.ndarray, "T 22 3"], straight: Float[np.ndarray, "T 22 3"]
) -> dict[str, float]:
    """Against the truth, and against the fit of what a straight lens films."""
    true = shot.joints[: len(joints)]
    return {
        "in the world mm": float(1e3 * np.linalg.norm(joints - true, axis=-1).mean()),
        "MPJPE mm": float(mpjpe(joints, true, [JOINT["pelvis"]]).mean()),
        "PA-MPJPE mm": float(pa_mpjpe(joints, true).mean()),
        "from the straight lens's fit mm": float(1e3 * np.linalg.norm(joints - straight, axis=-1).mean()),
    }


if __name__ == "__main__":
    start(Lenses, run)
