"""The suite's clips: a window of motion, one of six bodies, a camera and a cut, from fixed seeds."""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from typing import TypeVar

import numpy as np
import platformdirs
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from evaluation.synthetic.fingerprint import fingerprint
from evaluation.synthetic.motion_suite.framing import Shot, view_of
from evaluation.synthetic.motion_suite.measured_detector import MEASURED, MeasuredErrors, detected
from evaluation.synthetic.motion_suite.windows import (
    FRAME_RATE,
    HALVES,
    MOTION_SUITE,
    MotionWindow,
    acted,
    shipped_windows,
)
from evaluation.synthetic.studio.view import View
from evaluation.synthetic.suite import SUBJECTS, Subject, in_view, subject_body
from evaluation.synthetic.truth import truth_of, write_truth
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import DEFAULT_FOCAL, Camera, FocalFrom, default_focal
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.io.truth import Truth, read_truth
from fitting_core.world_camera import in_camera

Choice = TypeVar("Choice")
FOCALS = ("true", "default")
"""The focal length that a fit is given: the camera's own, or the image's diagonal."""
DIRECTIONS = ("front", "side", "back", "above", "below")
_ABOVE, _BELOW = 20.0, -7.5
"""Degrees of elevation beyond which a view is called so, from wherever around."""
_SIZES = ((1280, 720), (720, 1280))
_LENSES = (26.0, 50.0, 135.0)
_WHOLE_ONLY = ("floor", "acrobatics")
"""Kinds of motion in which the image's lower edge would go through the person anywhere."""
_AZIMUTHS = ((-45.0, 45.0), (45.0, 135.0), (-135.0, -45.0), (135.0, 225.0))
_ELEVATIONS = ((-5.0, 20.0), (-5.0, 20.0), (-5.0, 20.0), (22.0, 45.0), (-20.0, -8.0))
_DIRECTIONS = tuple(product((0, 0, 1, 2, 3, 3), range(len(_ELEVATIONS))))
"""A third of the cameras in front, at the sides and behind."""
_CUTS_OF_OTHERS = ("whole",) * 9 + ("knee", "hip", "chest") * 5


@dataclass(frozen=True, kw_only=True)
class MotionSequence:
    """One clip of the suite, by what it is made of."""

    name: str
    """The window's."""
    kind: str
    half: str
    subject: Subject
    shot: Shot
    seed: int


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionClipMade:
    """A clip as it is fitted, and the truth about it."""

    sequence: MotionSequence
    window: MotionWindow
    clip: Clip
    truth: Truth
    body: BodyModel
    """Of the truth."""
    inside: Bool[np.ndarray, "T 55"]
    """Which joints lie in the image."""
    view: View = field(repr=False)

    @property
    def directions(self) -> list[str]:
        """One of DIRECTIONS for each frame: where the camera is, of the pelvis's front, unless it looks down or up."""
        if self.sequence.shot.elevation > _ABOVE or self.sequence.shot.elevation < _BELOW:
            return ["above" if self.sequence.shot.elevation > 0 else "below"] * len(self.window)
        root = Rotation.from_rotvec(self.truth.params.global_orient.numpy())
        x, _, z = root.inv().apply(-self.truth.joints[:, JOINT["pelvis"]]).T
        off = abs(np.degrees(np.arctan2(x, z)))
        return ["front" if angle <= 45 else "side" if angle < 135 else "back" for angle in off]


@lru_cache(maxsize=1)
def motion_sequences() -> dict[str, MotionSequence]:
    """All sequences by name, those for tuning first."""
    found: dict[str, MotionSequence] = {}
    for half in HALVES:
        windows = [window for window in shipped_windows().values() if window.half == half]
        found |= {sequence.name: sequence for sequence in _cast(windows, half)}
    return found


def _cast(windows: list[MotionWindow], half: str) -> Iterator[MotionSequence]:
    """Bodies and cameras for the windows of a half: every choice is dealt out evenly, in an order of its own."""
    rng, count = np.random.default_rng([zlib.crc32(half.encode()), 1]), len(windows)
    ways = _dealt(rng, _DIRECTIONS, count)
    subjects, sizes, lenses = _dealt(rng, SUBJECTS, count), _dealt(rng, _SIZES, count), _dealt(rng, _LENSES, count)
    aside = np.where(rng.random(count) < 0.3, rng.uniform(0.1, 0.25, count) * rng.choice([-1, 1], count), 0.0)
    cuts = iter(_dealt(rng, _CUTS_OF_OTHERS, sum(window.kind not in _WHOLE_ONLY for window in windows)))
    for i, window in enumerate(windows):
        around, above = ways[i]
        elevation = float(rng.uniform(*_ELEVATIONS[above]))
        shot = Shot(
            azimuth=float(rng.uniform(*_AZIMUTHS[around])),
            elevation=abs(elevation)
            if window.kind == "floor"
            else elevation,  # a camera below the floor would see nothing
            lens=lenses[i],
            size=_SIZES[0] if window.kind in _WHOLE_ONLY else sizes[i],
            cut="whole" if window.kind in _WHOLE_ONLY else next(cuts),
            aside=float(aside[i]),
        )
        seed = zlib.crc32(window.name.encode())
        yield MotionSequence(name=window.name, kind=window.kind, half=half, subject=subjects[i], shot=shot, seed=seed)


def _dealt(rng: np.random.Generator, deck: tuple[Choice, ...], count: int) -> list[Choice]:
    """A shuffled sample of a deck, with each of its entries equally often."""
    return [deck[i] for i in rng.permutation(np.arange(count) % len(deck))]


def make_motion(
    sequence: MotionSequence,
    *,
    focal: str = "true",
    errors: MeasuredErrors = MEASURED,
    cached: bool = True,
) -> MotionClipMade:
    """Make a sequence, or take its truth from the user's cache; detections are always made again.

    Args:
        sequence: One of `motion_sequences`, or one of your own with the name of a window.
        focal: One of FOCALS: which focal length the clip's camera says.
        errors: Of the detector.
        cached: Use the cache.

    Raises:
        InputError: There is no such focal length.
    """
    if focal not in FOCALS:
        raise InputError(f"'{focal}' is no focal length of the motion suite, expected one of {', '.join(FOCALS)}.")
    window, body = shipped_windows()[sequence.name], subject_body(sequence.subject)
    world = acted(window, body, sequence.subject.betas)
    view = view_of(sequence.shot, keypoints_in_space(body, world)[0])
    truth = _cached_truth(sequence, world, body, view) if cached else _truth(sequence, world, body, view)
    points, _ = keypoints_in_space(body, truth.params)
    depth = points[..., 2]
    keypoints = detected(
        truth.keypoints,
        truth.visible,
        _inside(truth.camera, truth.keypoints) & (depth > 0),
        truth.camera.focal[0] / np.maximum(depth, 0.1),
        frame_rate=FRAME_RATE,
        rng=np.random.default_rng([sequence.seed, 2]),
        errors=errors,
    )
    camera = truth.camera if focal == "true" else _with_default_focal(truth.camera)
    joints = truth.joints[..., :2] / truth.joints[..., 2:] * truth.camera.focal + truth.camera.center
    return MotionClipMade(
        sequence=sequence,
        window=window,
        clip=Clip(keypoints=keypoints, camera=camera, frame_rate=FRAME_RATE, name=sequence.name),
        truth=truth,
        body=body,
        inside=_inside(truth.camera, joints),
        view=view,
    )


def _inside(camera: Camera, xy: Float[np.ndarray, "T K 2"]) -> Bool[np.ndarray, "T K"]:
    return np.asarray(((xy >= 0) & (xy < camera.size)).all(-1))


def _with_default_focal(camera: Camera) -> Camera:
    focal = default_focal(camera.size)
    return replace(camera, focal=(focal, focal), focal_from=FocalFrom.DIAGONAL, source=DEFAULT_FOCAL)


def _truth(sequence: MotionSequence, world: BodyParams, body: BodyModel, view: View) -> Truth:
    rest = joints_in_space(body, replace(BodyParams.neutral(1), betas=world.betas[:1]))[0]
    params = in_camera(world, rest[0], view.pose())
    truth = truth_of(body, params, sequence.shot.camera, FRAME_RATE)
    return replace(truth, visible=truth.exists & in_view(body, params, sequence.shot.camera))


def _cached_truth(sequence: MotionSequence, world: BodyParams, body: BodyModel, view: View) -> Truth:
    folder = platformdirs.user_cache_path("tcfit", appauthor=False) / "motion-suite"
    asset = f"{zlib.crc32(MOTION_SUITE.read_bytes()):08x}"
    path = folder / f"{sequence.name}-{fingerprint(repr(sequence), body.hash, asset)}.npz"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        write_truth(path, _truth(sequence, world, body, view))
    return read_truth(path)
