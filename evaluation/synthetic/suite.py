"""The synthetic suite: sequences in the shape of the paper's evaluation, with exact truth and simulated detections.

Six people wave (Simple Motion) and sit down cross-legged and stand up again (Complex Motion), and one signs. Frame
counts are those of the paper's Table 1, as are the people's volumes in kind.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import platformdirs
import torch
from jaxtyping import Bool, Float

from evaluation.synthetic.acting.performance import perform, standing_root
from evaluation.synthetic.acting.script import Build, Hazard, Mishaps, Script, failures
from evaluation.synthetic.fingerprint import fingerprint
from evaluation.synthetic.motions.cross_legged import cross_legged
from evaluation.synthetic.motions.signing import signing
from evaluation.synthetic.motions.waving import waving
from evaluation.synthetic.simulated_detector import Detector, detect, flesh_of, visible
from evaluation.synthetic.studio.rasterize import rasterize
from evaluation.synthetic.studio.view import View
from evaluation.synthetic.truth import truth_of, write_truth
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.io.truth import Truth, read_truth
from fitting_core.shipped import FREE_FOLDER
from fitting_core.world_camera import in_camera

SIZE = (720, 960)
"""Of the images, as the paper's: width and height in pixels."""
FRAME_RATE = 25.0


@dataclass(frozen=True, kw_only=True)
class Subject:
    """A person of the suite."""

    gender: str
    """Of the free body whose shape the person has."""
    betas: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class SuiteSequence:
    """One sequence of the suite."""

    name: str
    motion: str
    """One of MOTIONS."""
    subject: Subject
    frames: int
    view: View
    focal: float
    """Of the camera, pixels in an image of SIZE."""
    seed: int
    frame_rate: float = FRAME_RATE
    scale: float = 1.0
    """Of the image, against SIZE."""

    @property
    def seconds(self) -> float:
        """From the first frame to the last."""
        return (self.frames - 1) / self.frame_rate

    @property
    def camera(self) -> Camera:
        """With the principal point in the image's middle."""
        width, height = (round(self.scale * length) for length in SIZE)
        focal = self.scale * self.focal
        return Camera(
            focal=(focal, focal), center=(width / 2, height / 2), size=(width, height), source="the suite's own camera"
        )


SUBJECTS = (
    Subject(gender="male", betas=(0.1, -0.4, 0.3, -0.15, 0.2, 0.3, -0.2, 0.0, 0.1, 0.0)),
    Subject(gender="female", betas=(0.5, 0.2, 0.3, 1.7, 0.2, -0.2, -0.1, 0.0, 0.2, 0.0)),
    Subject(gender="female", betas=(0.9, 0.3, -0.2, 0.25, 0.2, -0.3, 0.1, 0.2, 0.0, 0.0)),
    Subject(gender="male", betas=(-0.4, 0.3, 0.2, 0.05, -0.2, 0.1, 0.3, -0.2, 0.0, 0.1)),
    Subject(gender="male", betas=(0.4, 0.2, -0.3, 1.2, -0.3, 0.2, 0.2, 0.1, 0.0, 0.0)),
    Subject(gender="female", betas=(-0.5, -0.3, -0.2, -0.9, 0.1, 0.2, -0.2, 0.1, 0.0, -0.1)),
)
"""Average, heavy, average, average, heavy, light; in the order of the paper's subjects 1, 16, 17, 32, 41 and 45."""
_SIGNER = Subject(gender="female", betas=(0.2, -0.5, 0.1, -0.1, 0.3, 0.1, 0.2, -0.2, 0.1, 0.0))


def _view(azimuth: float, height: float, distance: float, up: float = 0.86) -> View:
    return View(azimuth=azimuth, height=height, distance=distance, looking_at=(0.0, up, -0.05))


_CAMERAS = {
    "simple": (
        (_view(22, 1.35, 3.4), 1330.0), (_view(-18, 1.10, 4.2), 1700.0), (_view(28, 1.50, 3.0), 1150.0),
        (_view(-26, 1.25, 3.8), 1480.0), (_view(15, 0.95, 4.8), 1880.0), (_view(-32, 1.55, 2.8), 1120.0),
    ),
    "complex": (
        (_view(20, 1.30, 3.9, 0.80), 1480.0), (_view(-24, 1.45, 4.4, 0.80), 1700.0),
        (_view(30, 1.20, 3.4, 0.80), 1260.0), (_view(-16, 1.60, 3.7, 0.80), 1400.0),
        (_view(26, 1.05, 5.0, 0.80), 1860.0), (_view(-30, 1.40, 3.2, 0.80), 1210.0),
    ),
}  # fmt: skip
"""Slightly from the side, each with its focal length in pixels."""
_FRAMES = {"simple": (50, 75, 75, 100, 100, 75), "complex": (225, 200, 175, 250, 219, 177)}
_SEEDS = {"simple": (100, 101, 102, 103, 104, 105), "complex": (208, 315, 417, 505, 605, 707)}
"""Chosen so that people differ in the foot that crosses and the hands that support."""


SEQUENCES: dict[str, SuiteSequence] = {
    f"{motion}_{i + 1}": SuiteSequence(
        name=f"{motion}_{i + 1}",
        motion=motion,
        subject=subject,
        frames=_FRAMES[motion][i],
        view=_CAMERAS[motion][i][0],
        focal=_CAMERAS[motion][i][1],
        seed=_SEEDS[motion][i],
    )
    for motion in _FRAMES
    for i, subject in enumerate(SUBJECTS)
} | {
    "signing_1": SuiteSequence(
        name="signing_1",
        motion="signing",
        subject=_SIGNER,
        frames=200,
        view=View(azimuth=8.0, height=1.3, distance=2.6, looking_at=(0.0, 1.15, 0.0)),
        focal=1500.0,
        seed=300,
    )
}
"""By name: simple_1 to simple_6, complex_1 to complex_6, signing_1."""


_DEPTH_SCALE = 0.5
"""Of the depth buffer that tells what is hidden, against the image. At a half, 98 to 99 % of all points and 99.4 to
100 % of the body's are the same as with a whole one, in 0.6 times the time (simple_2 and complex_1)."""


DETECTOR = Detector(noise=1.4, confidence=0.9, guess=14.0, lost=0.35, bias=2.0)
MISHAPS = Mishaps(chance=0.5, seconds=(0.12, 0.36))
"""Set against OpenPose on the balancing clips."""

MOTIONS: dict[str, Callable[[Build, float, np.random.Generator], tuple[Script, list[Hazard]]]] = {
    "simple": waving,
    "complex": cross_legged,
    "signing": signing,
}
"""Functions from a person's build, seconds and a source of chance to the script and where detectors fail on it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SuiteClip:
    """A sequence as it is fitted, and the truth about it."""

    sequence: SuiteSequence
    clip: Clip
    truth: Truth
    body: BodyModel
    """Of the truth: the free body of the subject's gender."""
    view: View = field(repr=False)
    """Where the camera stands; the world's floor is at y = 0."""


def make_sequence(sequence: SuiteSequence, *, cached: bool = True) -> SuiteClip:
    """Make a sequence, or take its truth from the user's cache; detections are always made again.

    Args:
        sequence: One of SEQUENCES, or one of your own.
        cached: Use the cache.
    """
    body = subject_body(sequence.subject)
    truth = _cached_truth(sequence, body) if cached else make_truth(sequence, body)
    _, hazards = _script(sequence, body)
    keypoints = detect(
        truth.keypoints,
        truth.visible,
        truth.exists,
        frame_rate=sequence.frame_rate,
        height=sequence.camera.size[1],
        failures=failures(hazards, MISHAPS, np.random.default_rng([sequence.seed, 2])),
        rng=np.random.default_rng([sequence.seed, 3]),
        detector=DETECTOR,
    )
    clip = Clip(keypoints=keypoints, camera=truth.camera, frame_rate=sequence.frame_rate, name=sequence.name)
    return SuiteClip(sequence=sequence, clip=clip, truth=truth, body=body, view=sequence.view)


def subject_body(subject: Subject) -> BodyModel:
    """The free body that a subject's shape belongs to."""
    return _load(find_body(gender=subject.gender, search=FREE_FOLDER))


@lru_cache(maxsize=4)
def _load(path: Path) -> BodyModel:
    return load_body(path)


def make_truth(sequence: SuiteSequence, body: BodyModel) -> Truth:
    """What really happens in a sequence."""
    rest, _ = standing_root(body, sequence.subject.betas)
    params = in_camera(world_params(sequence, body), rest[0], sequence.view.pose())
    truth = truth_of(body, params, sequence.camera, sequence.frame_rate)
    return replace(truth, visible=truth.exists & in_view(body, params, sequence.camera))


def world_params(sequence: SuiteSequence, body: BodyModel) -> BodyParams:
    """The person's parameters in the world: y up, the floor at 0."""
    times = np.arange(sequence.frames) / sequence.frame_rate
    script, _ = _script(sequence, body)
    return perform(body, script, times, np.random.default_rng([sequence.seed, 0]), betas=sequence.subject.betas)


def _script(sequence: SuiteSequence, body: BodyModel) -> tuple[Script, list[Hazard]]:
    build = Build.of(body, sequence.subject.betas)
    return MOTIONS[sequence.motion](build, sequence.seconds, np.random.default_rng([sequence.seed, 1]))


def in_view(body: BodyModel, params: BodyParams, camera: Camera) -> Bool[np.ndarray, "T 137"]:
    """Which keypoints are in view, by a depth buffer of reduced size."""
    small = Camera(
        focal=(_DEPTH_SCALE * camera.focal[0], _DEPTH_SCALE * camera.focal[1]),
        center=(_DEPTH_SCALE * camera.center[0], _DEPTH_SCALE * camera.center[1]),
        size=(round(_DEPTH_SCALE * camera.size[0]), round(_DEPTH_SCALE * camera.size[1])),
    )
    points, _ = keypoints_in_space(body, params)
    mesh, own, seen = shared_mesh(body), _flesh(body, params.betas[:1]), np.zeros(points.shape[:2], bool)
    for i in range(len(points)):
        depth = np.full(small.size[::-1], np.inf)
        rasterize(mesh(params[i : i + 1])[0].numpy().astype(np.float64), body.faces, small, depth)
        seen[i] = visible(points[i], depth, small, own)
    return seen


def _flesh(body: BodyModel, betas: Float[torch.Tensor, "1 10"]) -> Float[np.ndarray, "137"]:
    """Flesh in front of the keypoints of a shape."""
    rest = replace(BodyParams.neutral(1), betas=betas)
    return flesh_of(keypoints_in_space(body, rest)[0][0], body.with_shape(betas[0].numpy()).template)


def _cached_truth(sequence: SuiteSequence, body: BodyModel) -> Truth:
    folder = platformdirs.user_cache_path("tcfit", appauthor=False) / "suite"
    path = folder / f"{sequence.name}-{fingerprint(repr(sequence), body.hash)}.npz"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        write_truth(path, make_truth(sequence, body))
    return read_truth(path)
