"""The synthetic suite: sequences in the shape of the paper's evaluation, with exact truth and simulated detections.

Six people wave (Simple Motion) and sit down cross-legged and stand up again (Complex Motion), and one signs.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import platformdirs
import torch
from jaxtyping import Bool, Float, UInt8

from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import FREE_FOLDER, find_body
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.synthetic.acting.build import Build
from fitting_core.synthetic.acting.hazards import Hazard, Mishaps, failures
from fitting_core.synthetic.acting.performance import perform, standing_root
from fitting_core.synthetic.acting.script import Script
from fitting_core.synthetic.fingerprint import fingerprint
from fitting_core.synthetic.motions.cross_legged import cross_legged
from fitting_core.synthetic.motions.signing import signing
from fitting_core.synthetic.motions.waving import waving
from fitting_core.synthetic.simulated_detector import Detector, detect, flesh_of, visible
from fitting_core.synthetic.studio.clothing import Outfit
from fitting_core.synthetic.studio.rasterize import rasterize
from fitting_core.synthetic.studio.studio import Studio, vertex_normals
from fitting_core.synthetic.studio.view import View
from fitting_core.synthetic.studio.world_camera import in_camera
from fitting_core.synthetic.suite_table import SEQUENCES, Subject, SuiteSequence
from fitting_core.synthetic.truth import Truth, read_truth, write_truth

__all__ = [
    "LEVELS", "MOTIONS", "SEQUENCES", "Level", "Subject", "SuiteClip", "SuiteSequence", "make_sequence", "make_truth",
    "render_frames", "subject_body", "world_params",
]  # fmt: skip
_DEPTH_SCALE = 0.5
"""Of the depth buffer that tells what is hidden, against the image. At a half, 98 to 99 % of all points and 99.4 to
100 % of the body's are told as with a whole one, in 0.6 times the time (simple_2 and complex_1)."""


@dataclass(frozen=True, kw_only=True)
class Level:
    """How hard the detections are."""

    detector: Detector
    mishaps: Mishaps


LEVELS = {
    "clean": Level(
        detector=Detector(noise=0.2, confidence=1.1, hidden=0.0), mishaps=Mishaps(chance=0.0, seconds=(0.0, 0.0))
    ),
    "normal": Level(
        detector=Detector(noise=1.4, confidence=0.9, guess=14.0, lost=0.35, bias=2.0),
        mishaps=Mishaps(chance=0.5, seconds=(0.12, 0.36)),
    ),
    "hard": Level(
        detector=Detector(noise=2.4, confidence=0.8, guess=24.0, lost=0.5, bias=3.0),
        mishaps=Mishaps(chance=0.9, seconds=(0.28, 0.8)),
    ),
}
"""By name, from easy to hard.

Normal is set against OpenPose on the balancing clips (`python -m benchmarks.suite_detections`)."""

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
    level: str
    clip: Clip
    truth: Truth
    body: BodyModel
    """Of the truth: the free body of the subject's gender."""
    view: View = field(repr=False)
    """Where the camera stands; the world's floor is at y = 0."""


def make_sequence(sequence: SuiteSequence, level: str = "normal", *, cached: bool = True) -> SuiteClip:
    """Make a sequence, or take its truth from the user's cache; detections are always made anew.

    Args:
        sequence: One of SEQUENCES, or one of your own.
        level: One of LEVELS.
        cached: Use the cache.

    Raises:
        InputError: There is no such level.
    """
    if level not in LEVELS:
        raise InputError(f"'{level}' is no level of the suite, expected one of {', '.join(LEVELS)}.")
    body = subject_body(sequence.subject)
    truth = _cached_truth(sequence, body) if cached else make_truth(sequence, body)
    _, hazards = _script(sequence, body)
    keypoints = detect(
        truth.keypoints,
        truth.visible,
        truth.exists,
        frame_rate=sequence.frame_rate,
        height=sequence.camera.size[1],
        failures=failures(hazards, LEVELS[level].mishaps, np.random.default_rng([sequence.seed, 2])),
        rng=np.random.default_rng([sequence.seed, 3]),
        detector=LEVELS[level].detector,
    )
    name = f"{sequence.name}_{level}"
    clip = Clip(keypoints=keypoints, camera=truth.camera, frame_rate=sequence.frame_rate, name=name)
    return SuiteClip(sequence=sequence, level=level, clip=clip, truth=truth, body=body, view=sequence.view)


def subject_body(subject: Subject) -> BodyModel:
    """The free body that a subject's shape belongs to."""
    return _load(find_body(gender=subject.gender, search=FREE_FOLDER))


@lru_cache(maxsize=3)
def _load(path: Path) -> BodyModel:
    return load_body(path)


def make_truth(sequence: SuiteSequence, body: BodyModel) -> Truth:
    """What really happens in a sequence."""
    params = in_camera(world_params(sequence, body), _rest_root(sequence, body), *sequence.view.pose())
    points, exists = keypoints_in_space(body, params)
    pixels = np.zeros((*points.shape[:2], 2))
    pixels[:, exists] = project(sequence.camera, torch.as_tensor(points[:, exists])).numpy()
    return Truth(
        params=params,
        joints=joints_in_space(body, params),
        keypoints=pixels,
        visible=exists & _visible(points, body, params, sequence.camera),
        exists=exists,
        camera=sequence.camera,
        frame_rate=sequence.frame_rate,
        body_hash=body.hash,
    )


def world_params(sequence: SuiteSequence, body: BodyModel) -> BodyParams:
    """The person's parameters in the world: y up, the floor at 0."""
    times = np.arange(sequence.frames) / sequence.frame_rate
    script, _ = _script(sequence, body)
    return perform(body, script, times, np.random.default_rng([sequence.seed, 0]), betas=sequence.subject.betas)


def _script(sequence: SuiteSequence, body: BodyModel) -> tuple[Script, list[Hazard]]:
    build = Build.of(body, sequence.subject.betas)
    return MOTIONS[sequence.motion](build, sequence.seconds, np.random.default_rng([sequence.seed, 1]))


def _rest_root(sequence: SuiteSequence, body: BodyModel) -> Float[np.ndarray, "3"]:
    joints, _ = standing_root(body, sequence.subject.betas)
    return joints[0]


def _visible(
    points: Float[np.ndarray, "T 137 3"], body: BodyModel, params: BodyParams, camera: Camera
) -> Bool[np.ndarray, "T 137"]:
    """Which keypoints are in view, by a depth buffer of reduced size."""
    small = Camera(
        focal=(_DEPTH_SCALE * camera.focal[0], _DEPTH_SCALE * camera.focal[1]),
        center=(_DEPTH_SCALE * camera.center[0], _DEPTH_SCALE * camera.center[1]),
        size=(round(_DEPTH_SCALE * camera.size[0]), round(_DEPTH_SCALE * camera.size[1])),
    )
    mesh, own, seen = Mesh(body), _flesh(body, params.betas[:1]), np.zeros(points.shape[:2], bool)
    for i in range(len(points)):
        depth = np.full(small.size[::-1], np.inf)
        rasterize(mesh(params[i : i + 1])[0].numpy().astype(np.float64), body.faces, small, depth)
        seen[i] = visible(points[i], depth, small, own)
    return seen


def _flesh(body: BodyModel, betas: Float[torch.Tensor, "1 10"]) -> Float[np.ndarray, "137"]:
    """Flesh in front of the keypoints of a shape."""
    rest = replace(BodyParams.neutral(1), betas=betas)
    return flesh_of(keypoints_in_space(body, rest)[0][0], body.with_shape(betas[0].numpy()).template)


def render_frames(
    made: SuiteClip, frames: list[int], *, view: View | None = None, camera: Camera | None = None
) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """Pictures (RGB) of some frames, one after the other.

    Args:
        made: The sequence.
        frames: Their numbers.
        view: Where the camera stands instead of its own place.
        camera: Instead of its own; its size must be even.
    """
    body, (rotation, translation) = made.body, made.view.pose()
    studio = Studio(camera or made.truth.camera, seat_height=None, view=view or made.view)
    mesh, outfit = Mesh(body), Outfit.of(body)
    for frame in frames:
        world = (mesh(made.truth.params[[frame]])[0].numpy().astype(np.float64) - translation) @ rotation
        yield studio.draw(world, body.faces, vertex_normals(world, body.faces), outfit)[0]


def _cached_truth(sequence: SuiteSequence, body: BodyModel) -> Truth:
    folder = platformdirs.user_cache_path("tcfit", appauthor=False) / "suite"
    path = folder / f"{sequence.name}-{fingerprint(repr(sequence), body.hash)}.npz"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        write_truth(path, make_truth(sequence, body))
    return read_truth(path)
