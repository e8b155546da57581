"""A scene filmed: people of the motion suite on their ways, as a detector finds them, who hide each other."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter1d

from evaluation.synthetic.motion_suite.measured_detector import detected
from evaluation.synthetic.motion_suite.windows import FRAME_RATE, acted, shipped_windows
from evaluation.synthetic.studio.view import View
from evaluation.synthetic.suite import SUBJECTS, subject_body
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera
from fitting_core.detections import Detections
from fitting_core.keypoints import BODY, COUNT, INDEX
from tests.samples.company.scenes import SCENES, SECONDS, Way

CAMERA = Camera(focal=(1100.0, 1100.0), center=(640.0, 360.0), size=(1280, 720), source="the scene's own camera")
_KINDS = ("dance", "gestures", "sport")
"""Of motions, in which people stand and walk."""
_LIMBS = (
    ("neck", "mid_hip", 0.16), ("right_shoulder", "right_hip", 0.1), ("left_shoulder", "left_hip", 0.1),
    ("right_shoulder", "right_elbow", 0.055), ("left_shoulder", "left_elbow", 0.055),
    ("right_elbow", "right_wrist", 0.045), ("left_elbow", "left_wrist", 0.045),
    ("right_hip", "right_knee", 0.085), ("left_hip", "left_knee", 0.085),
    ("right_knee", "right_ankle", 0.06), ("left_knee", "left_ankle", 0.06),
    ("right_ear", "left_ear", 0.11), ("neck", "nose", 0.07),
)  # fmt: skip
"""What of a body hides others: capsules between keypoints, with their radii in metres."""
_FLESH = 0.12
"""Metres behind a limb's middle from which a point is behind it."""
_LOST_BEHIND = 0.8
"""Share of the points behind somebody that are not found."""
_TAKEN_OVER = 0.25
"""Share of the others that are found on whoever is in front."""
_FEWEST = 6
"""Keypoints without which a detector reports nobody."""
_TWICE, _GHOSTS = 0.01, 0.01
"""Shares of frames in which somebody is reported twice, and in which something that is nobody is."""
_MOOD_FRAMES = 4.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Company:
    """A scene as it is followed, and who is who in it."""

    detections: Detections
    owners: tuple[tuple[int, ...], ...]
    """Per frame, whose each detection is; -1: nobody's."""
    camera: Camera
    frame_rate: float
    points: Float[np.ndarray, "P T 137 3"]
    """Everybody's keypoints in camera space, metres."""


def film(scene: str, seed: int, *, every: int = 1) -> Company:
    """Make a scene.

    Args:
        scene: A name of SCENES.
        seed: Of all chance.
        every: Keep every so many frames of 30 per second.
    """
    rng = np.random.default_rng([list(SCENES).index(scene), seed])
    view, cast = rehearsed(rng, scene)
    seen = [one.moved(keypoints_in_space(one.body, one.params)[0][one.which]) for one in cast]
    points = np.stack([view.pose()(those) for those in seen])
    people = [_found(rng, points, k) for k in range(len(cast))]
    frames, owners = zip(*(_listed(rng, people, t) for t in range(0, points.shape[1], every)), strict=True)
    stems = tuple(f"frame_{t:06d}" for t in range(len(frames)))
    detections = Detections(frames=frames, stems=stems, source=Path(f"{scene} {seed}"), size=CAMERA.size)
    return Company(
        detections=replace(detections, frame_rate=FRAME_RATE / every),
        owners=owners,
        camera=CAMERA,
        frame_rate=FRAME_RATE / every,
        points=points[:, ::every],
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Acting:
    """One person of a scene: what is done, by whom, and where."""

    body: BodyModel
    params: BodyParams
    """Of a window of motion, in the world."""
    which: Int[np.ndarray, "T"]
    """Of each frame of the scene, the window's: forwards and back again, as often as it takes."""
    middle: Float[np.ndarray, "3"]
    """Of the window's way, at height 0."""
    turn: Float[np.ndarray, "T 3 3"]
    place: Float[np.ndarray, "T 3"]
    """A point p of the window goes to turn (p - middle) + place."""

    def moved(self, points: Float[np.ndarray, "T N 3"]) -> Float[np.ndarray, "T N 3"]:
        """Points of the window's frames `which` as the scene has them."""
        return (points - self.middle) @ self.turn.swapaxes(1, 2) + self.place[:, None]


def rehearsed(rng: np.random.Generator, scene: str) -> tuple[View, list[Acting]]:
    """Where a scene's camera stands, and what its people do."""
    times = np.arange(round(SECONDS * FRAME_RATE)) / FRAME_RATE
    ways = SCENES[scene](rng, times)
    view = View(azimuth=0.0, height=1.5, distance=rng.uniform(5.5, 8.0), looking_at=(0.0, 0.95, 0.0))
    return view, [_cast(rng, way) for way in ways]


def _cast(rng: np.random.Generator, way: Way) -> Acting:
    """Somebody who goes a way and does whatever a window of motion has meanwhile."""
    windows = [window for window in shipped_windows().values() if window.kind in _KINDS]
    window = windows[rng.integers(len(windows))]
    subject = SUBJECTS[rng.integers(len(SUBJECTS))]
    body = subject_body(subject)
    params = acted(window, body, subject.betas)
    hips = keypoints_in_space(body, params)[0][:, INDEX["mid_hip"]]
    loop = np.concatenate([np.arange(len(hips)), np.arange(len(hips) - 2, 0, -1)])
    which = loop[(np.arange(len(way.x)) + rng.integers(len(loop))) % len(loop)]
    velocity = np.stack([np.gradient(way.x), np.gradient(way.z)]) * FRAME_RATE
    facing = np.where(np.linalg.norm(velocity, axis=0) > 0.2, np.arctan2(velocity[0], velocity[1] + 0.3), 0.0)
    yaw = gaussian_filter1d(facing, 6.0, mode="nearest") + rng.normal(0, 0.3)
    sine, cosine, zero = np.sin(yaw), np.cos(yaw), np.zeros_like(yaw)
    return Acting(
        body=body,
        params=params,
        which=which,
        middle=hips.mean(0) * (1.0, 0.0, 1.0),
        turn=np.stack([cosine, zero, sine, zero, zero + 1, zero, -sine, zero, cosine], -1).reshape(-1, 3, 3),
        place=np.stack([way.x, zero, way.z], -1),
    )


def _pixels(points: np.ndarray) -> np.ndarray:
    return points[..., :2] / points[..., 2:].clip(0.3) * CAMERA.focal + CAMERA.center


def _behind(points: Float[np.ndarray, "T 25 3"], other: Float[np.ndarray, "T 25 3"]) -> Bool[np.ndarray, "T 25"]:
    """Which points a body's limbs hide."""
    hidden = np.zeros(points.shape[:2], bool)
    xy = _pixels(points)
    for one, two, radius in _LIMBS:
        ends = other[:, [INDEX[one], INDEX[two]]]
        a, b = _pixels(ends).swapaxes(0, 1)
        along = b - a
        share = ((xy - a[:, None]) * along[:, None]).sum(-1) / np.maximum((along**2).sum(-1), 1e-6)[:, None]
        share = share.clip(0, 1)
        depth = ends[:, :1, 2] * (1 - share) + ends[:, 1:, 2] * share
        off = np.linalg.norm(xy - a[:, None] - share[..., None] * along[:, None], axis=-1)
        hidden |= (off < radius * CAMERA.focal[0] / depth.clip(0.3)) & (points[..., 2] > depth + _FLESH)
    return hidden


def _found(
    rng: np.random.Generator, everybody: Float[np.ndarray, "P T 137 3"], who: int
) -> Float[np.ndarray, "T 137 3"]:
    """Somebody's keypoints with confidences as detected; 0 where nothing is."""
    points = everybody[who]
    body = points[:, BODY]
    inside = ((_pixels(points) >= 0) & (_pixels(points) < CAMERA.size)).all(-1) & (points[..., 2] > 0.3)
    by_other = [(k, _behind(body, other[:, BODY])) for k, other in enumerate(everybody) if k != who]
    hidden = np.any([by for _, by in by_other], axis=0)
    seen = np.ones(points.shape[:2], bool)
    seen[:, BODY] = ~(hidden | _behind(body, body))
    lost = hidden & (_mood(rng, hidden.shape) < _LOST_BEHIND)
    inside[:, BODY] &= ~lost
    keypoints = detected(
        _pixels(points), seen, inside, CAMERA.focal[0] / points[..., 2].clip(0.3), frame_rate=FRAME_RATE, rng=rng
    )
    found = np.concatenate([keypoints.xy, keypoints.confidence[..., None]], -1)
    taken = _mood(rng, hidden.shape) < _TAKEN_OVER
    for k, by in by_other:
        theirs = _pixels(everybody[k][:, BODY])
        t, j = np.nonzero(by & taken & (found[:, BODY, 2] > 0))
        found[t, j, :2] = theirs[t, j] + rng.normal(0, 4.0, (len(t), 2))
    found[(found[..., 2] > 0).sum(1) < _FEWEST] = 0.0
    return found


def _mood(rng: np.random.Generator, shape: tuple[int, ...]) -> Float[np.ndarray, "T n"]:
    """Evenly from 0 to 1, alike in frames that follow each other."""
    noise = gaussian_filter1d(rng.standard_normal(shape), _MOOD_FRAMES, axis=0, mode="wrap")
    return noise.argsort(0).argsort(0) / max(shape[0] - 1, 1)


def _listed(rng: np.random.Generator, people: list[np.ndarray], t: int) -> tuple[np.ndarray, tuple[int, ...]]:
    """A frame's list of people in any order, and whose each is."""
    there = [(k, found[t]) for k, found in enumerate(people) if found[t, :, 2].any()]
    for k, points in list(there):
        if rng.random() < _TWICE:
            again = points.copy()
            again[again[:, 2] > 0, :2] += rng.normal(0, 3.0, ((again[:, 2] > 0).sum(), 2))
            there.append((k, again * (1.0, 1.0, 0.8)))
    if rng.random() < _GHOSTS:
        ghost = np.zeros((COUNT, 3))
        some = rng.choice(25, 6, replace=False)
        ghost[some, :2] = rng.uniform(0, CAMERA.size) + rng.normal(0, 30.0, (6, 2))
        ghost[some, 2] = 0.2
        there.append((-1, ghost))
    order = rng.permutation(len(there))
    frame = np.array([there[k][1] for k in order]).reshape(-1, COUNT, 3)
    return frame, tuple(there[k][0] for k in order)
