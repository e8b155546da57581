"""A stick figure that walks before a camera that looks down: its points, its keypoints, and when its feet stand."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from fitting_core import keypoints as kp
from fitting_core.camera import Camera
from fitting_core.ground.contacts import FOOT_POINTS
from fitting_core.ground.grounding import Grounding
from fitting_core.lifting.clip_lifting import LiftedClip
from tests.samples.before_fit import grounding_before_fit

RATE = 30.0
CAMERA = Camera(focal=(1100.0, 1100.0), center=(640.0, 360.0), size=(1280, 720), source="given")
HEIGHT, TILT = 1.6, 15.0
"""Of the camera: metres above the floor, degrees down."""
SOLES = np.array([[0.09, 0.02, 0.02, 0.02]] * 2)
"""Metres of a standing foot's points above the floor."""
_STEP, _STRIDE, _RAISED = 18, 0.6, 0.15
"""Frames of a step, metres of it, and how high a foot is in its middle."""
_BODY = {
    "neck": (0.0, 1.4, 0.0), "nose": (0.0, 1.55, 0.1), "mid_hip": (0.0, 0.9, 0.0),
    "left_shoulder": (0.18, 1.4, 0.0), "right_shoulder": (-0.18, 1.4, 0.0),
    "left_hip": (0.1, 0.9, 0.0), "right_hip": (-0.1, 0.9, 0.0),
    "left_knee": (0.1, 0.48, 0.05), "right_knee": (-0.1, 0.48, 0.05),
}  # fmt: skip
_FOOT = {
    "ankle": (0.0, 0.09, 0.0),
    "heel": (0.0, 0.02, -0.04),
    "big_toe": (0.0, 0.02, 0.16),
    "small_toe": (0.05, 0.02, 0.13),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Walker:
    """What a camera sees of somebody who walks to and fro across the image."""

    points: Float[np.ndarray, "T 25 3"]
    """Camera space, metres; BODY_25."""
    xy: Float[np.ndarray, "T 25 2"]
    confidence: Float[np.ndarray, "T 25"]
    standing: Bool[np.ndarray, "T 2"]
    up: Float[np.ndarray, "3"]
    """In camera axes."""

    @property
    def feet(self) -> Float[np.ndarray, "T 2 4 3"]:
        return self.points[:, FOOT_POINTS]

    def lifted(self, *, contact: float = 0.5) -> LiftedClip:
        """What a lifter that knows everything but contacts would say."""
        frames, pelvis = len(self.points), self.points[:, kp.INDEX["mid_hip"]]
        return LiftedClip(
            points=self.points - pelvis[:, None],
            depth_deviation=np.full((frames, 25), 0.03),
            up=np.tile(0.98 * self.up, (frames, 1)),
            contact=np.full((frames, 2), contact),
        )

    def without_feet(self) -> "Walker":
        """The same where the image ends above the ankles."""
        confidence = self.confidence.copy()
        confidence[:, FOOT_POINTS] = 0
        return replace(self, confidence=confidence)


def walker(frames: int = 108, *, noise: float = 0.0, climbs: float = 0.0) -> Walker:
    """So many frames.

    Args:
        frames: at 30 a second.
        noise: of the keypoints, pixels.
        climbs: metres that every step leads up.
    """
    world, standing = np.zeros((frames, 25, 3)), np.zeros((frames, 2), bool)
    seen = np.zeros(25, bool)
    for t in range(frames):
        step, share = divmod(t, _STEP)
        smooth = 0.5 - 0.5 * np.cos(np.pi * (share + 1) / _STEP)
        # The foot of this step moves on by two strides; the other one stands.
        moving = step % 2
        place = {moving: step - 1 + 2 * smooth, 1 - moving: float(step)}
        body = 0.5 * (place[0] + place[1])
        for name, at in _BODY.items():
            seen[kp.INDEX[name]] = True
            world[t, kp.INDEX[name]] = np.add(at, (_STRIDE * body, climbs * body, 0.0))
        for foot, side in enumerate(("left", "right")):
            standing[t, foot] = foot != moving
            raised = _RAISED * np.sin(np.pi * (share + 1) / _STEP) if foot == moving else 0.0
            for name, at in _FOOT.items():
                seen[kp.INDEX[f"{side}_{name}"]] = True
                aside = 0.1 if side == "left" else -0.1
                # Walks to the side of the image, as a crab does: x of the world is x of the picture.
                offset = (_STRIDE * place[foot] + aside, climbs * place[foot] + raised, 0.0)
                world[t, kp.INDEX[f"{side}_{name}"]] = np.array(at) + offset
    world += (-1.5, 0.0, 0.0)
    down = Rotation.from_euler("x", TILT, degrees=True).as_matrix()
    turn = down @ np.diag([1.0, -1.0, -1.0])
    points = (world - (0.0, HEIGHT, 6.0)) @ turn.T
    xy = points[..., :2] / points[..., 2:] * CAMERA.focal + CAMERA.center
    xy = xy + noise * np.random.default_rng(0).standard_normal(xy.shape)
    confidence = np.tile(np.where(seen, 0.9, 0.0), (frames, 1))
    points = np.where(seen[:, None], points, points[:, [kp.INDEX["mid_hip"]]])
    return Walker(points=points, xy=xy, confidence=confidence, standing=standing, up=turn @ (0.0, 1.0, 0.0))


def grounding_of_a_walk(frames: int) -> Grounding:
    """What is known of the first frames of a walk."""
    made = walker()
    return grounding_before_fit(made.xy, made.confidence, made.lifted(), CAMERA, RATE)[:frames]
