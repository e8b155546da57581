"""Bodies in motion before a camera, with the keypoints that a perfect detector would see."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.kinematics import contour_bins
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams, full_pose
from fitting_core.body.points.body_points import BodyPoints
from fitting_core.body.points.pairs import keypoint_points
from fitting_core.camera import Camera, project
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig, SolverSettings, Weights
from fitting_core.fit.stages import Stages
from fitting_core.fit.variables.state import Parametrisation, State
from fitting_core.ground.contacts import FOOT_POINTS, PARTS
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.lifting.clip_lifting import LiftedClip
from fitting_core.priors.latent import LatentPrior
from fitting_core.priors.pose import PRIORS
from tests.fitting_core.priors.networks import random_network

QUICK = FitConfig(
    pose_prior="axis_angle",
    weights=replace(Weights(), collision=(0.0,) * 5),
    hip_weight=1.0,
    settings=SolverSettings(iterations=12),
)
"""A fit in few steps, without collisions, and with a prior that holds every pose exactly."""
CAMERA = Camera(focal=(900.0, 940.0), center=(410.0, 395.0), size=(800, 800))
FACING = torch.tensor([torch.pi, 0.0, 0.0], dtype=torch.float64)
"""Axis-angle of a body that stands upright and looks into the camera."""


def generator(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def random_params(frames: int, seed: int = 0, *, hand_components: int = 12, size: float = 0.3) -> BodyParams:
    """Independent random poses of upright persons who face the camera, about 3 m away."""
    g = generator(seed)
    neutral = BodyParams.neutral(frames, hand_components=hand_components)
    values = {n: size * torch.randn(t.shape, generator=g, dtype=torch.float64) for n, t in vars(neutral).items()}
    values["leye_pose"] = values["reye_pose"] = torch.zeros(frames, 3, dtype=torch.float64)
    turn = rotations.exp(values["global_orient"]) @ rotations.exp(FACING)
    values["global_orient"] = rotations.log(turn)
    values["camera_translation"] = 0.3 * values["camera_translation"] + torch.tensor([0.0, 0.0, 3.0])
    return BodyParams(**values)


@cache
def known_points(body: BodyModel) -> tuple[list[int], BodyPoints]:
    """Which keypoints a body has, and these compiled, which takes a third of a second."""
    known = [(i, p) for i, p in enumerate(keypoint_points(body)) if p is not None]
    return [i for i, _ in known], BodyPoints(body, [p for _, p in known])


def keypoints_of(body: BodyModel, params: BodyParams, camera: Camera = CAMERA) -> Keypoints:
    """Exact projections with confidence 1; confidence 0 for keypoints that the body does not have."""
    where, points = known_points(body)
    pose = full_pose(body, params)
    orient = rotations.exp(params.global_orient)
    bins = contour_bins(points.world_rotations(orient, pose[:, 1:])) if points.has_contour else None
    coefficients = torch.cat([params.betas, params.expression], 1)
    posed = points.forward(orient, pose[:, 1:], coefficients, bins)
    xy, confidence = np.zeros((len(params), COUNT, 2)), np.zeros((len(params), COUNT))
    xy[:, where] = project(camera, posed.points + params.camera_translation[:, None]).numpy()
    confidence[:, where] = 1
    return Keypoints(xy=xy, confidence=confidence)


def noisy(keypoints: Keypoints, pixels: float, seed: int = 0) -> Keypoints:
    """Gaussian noise on the positions, and confidences spread over 0.3 to 1."""
    rng = np.random.default_rng(seed)
    xy = keypoints.xy + rng.normal(0, pixels, keypoints.xy.shape)
    return Keypoints(xy=xy, confidence=keypoints.confidence * rng.uniform(0.3, 1, keypoints.confidence.shape))


def hidden(keypoints: Keypoints, *which: Any, frames: slice = slice(None)) -> Keypoints:
    """The keypoints without some of them (indices or slices), as a detector reports what it does not find."""
    xy, confidence = keypoints.xy.copy(), keypoints.confidence.copy()
    for w in which:
        xy[frames, w], confidence[frames, w] = 0, 0
    return Keypoints(xy=xy, confidence=confidence)


def clip_of(keypoints: Keypoints, camera: Camera = CAMERA) -> Clip:
    return Clip(keypoints=keypoints, camera=camera, frame_rate=25.0, name="test clip")


def stages_of(
    body: BodyModel, keypoints: Keypoints, config: FitConfig, *, camera: Camera = CAMERA, latent: bool = False
) -> Stages:
    """The objective's builder; `latent` puts a small latent pose prior in the place of the configured one."""
    with pytest.MonkeyPatch.context() as patch:
        if latent:
            small = random_network("silu", size=9, hidden=16, spread=1.0)
            patch.setitem(PRIORS, config.pose_prior, lambda: LatentPrior(small))
        return Stages.of(keypoints, camera, body, config)


def random_state(parametrisation: Parametrisation, frames: int, seed: int = 0) -> State:
    """A state in a random pose; a latent prior's numbers are random themselves."""
    params = random_params(frames, seed, hand_components=parametrisation.columns.hand)
    g = generator(seed + 1)
    c = parametrisation.columns
    vector = torch.zeros(frames, c.total, dtype=torch.float64)
    vector[:, c.body] = 0.3 * torch.randn(frames, c.pose, generator=g, dtype=torch.float64)
    vector[:, c.hands] = torch.cat([params.left_hand_pose, params.right_hand_pose], 1)
    vector[:, c.jaw], vector[:, c.expression] = params.jaw_pose, params.expression
    vector[:, c.translation], vector[:, c.betas] = params.camera_translation, params.betas
    return State(rotations.exp(params.global_orient), vector)


def let_lift(
    patch: pytest.MonkeyPatch, points: np.ndarray, deviation: float | np.ndarray = 0.1
) -> list[Float[np.ndarray, "T K"]]:
    """Let the lifter say this of all clips: points (25, 3) or (T, 25, 3), and how sure it is; what confidences it is
    asked with."""
    asked: list[np.ndarray] = []

    def lift(xy: np.ndarray, confidence: np.ndarray, *_: object, **__: object) -> LiftedClip:
        asked.append(confidence)
        shape = len(xy), 25
        said = np.broadcast_to(points, (*shape, 3)).copy(), np.broadcast_to(deviation, shape).copy()
        return LiftedClip(*said, np.zeros((len(xy), 3)), np.zeros((len(xy), 2)))

    patch.setattr("fitting_core.fit.evidence.observations.lift", lift)
    return asked


def with_positions(stages: Stages, seed: int = 0) -> Stages:
    """The same where something is known of the depth of body keypoints, and of the place of undetected ones.

    Of every fourth nothing is known, and of none of the left arm. Of the right arm the place is known although it is
    detected, as from a given start. Some feet are held where they stand.
    """
    o, random = stages.observations, np.random.default_rng(seed)
    position = torch.as_tensor(random.normal(0.0, 0.3, o.relative_position.shape)).to(o.relative_position)
    deviation = torch.as_tensor(random.uniform(0.05, 0.4, o.confidence.shape)).to(position)
    deviation[torch.as_tensor(random.random(deviation.shape) < 0.25)] = torch.inf
    deviation[:, [*range(kp.BODY.stop, COUNT), kp.INDEX["left_elbow"], kp.INDEX["left_wrist"]]] = torch.inf
    deviations = deviation[..., None].repeat(1, 1, 3)
    seen = o.confidence > 0
    seen[:, [kp.INDEX["right_elbow"], kp.INDEX["right_wrist"]]] = False
    deviations[..., :2][seen] = torch.inf
    held = torch.full_like(o.held_position_deviation, torch.inf)
    held[1:, 1, PARTS.index("heel")] = held[: len(held) - 1, 0, PARTS.index("big_toe")] = 0.02
    place = position[:, FOOT_POINTS].to(held) + torch.tensor([0.0, 0.0, 3.0]).to(held)
    known = replace(o, relative_position=position, relative_position_deviation=deviations)
    known = replace(known, held_position=place, held_position_deviation=held)
    return replace(stages, observations=known)


def listed(steps: Any) -> tuple[list[Any], Any]:
    """The steps of a generator, and what it returns."""
    found = []
    while True:
        try:
            found.append(next(steps))
        except StopIteration as stop:
            return found, stop.value


def finished(steps: Any) -> Any:
    """What a generator returns, its steps left aside."""
    return listed(steps)[1]


def likeliest_shape(body: BodyModel, metres: float) -> np.ndarray:
    """The betas nearest to the mean of somebody of this height."""
    mean, by_betas = body.height
    return (metres - mean) / (by_betas @ by_betas) * by_betas


def without_correctives(body: BodyModel) -> BodyModel:
    return replace(body, pose_directions=0 * body.pose_directions)


def differentiated(function: Callable[[State], Tensor], state: State, index: Tensor) -> Tensor:
    """Derivative of a function of single frames by a step in the columns `index`: (B, ...) -> (B, ..., d).

    One step moves all frames, in forward mode: that is every frame's own derivative, as frames do not mix.
    """

    def moved(step: Tensor) -> Tensor:
        every = torch.zeros_like(state.vector[0]).index_copy(0, index, step).expand_as(state.vector)
        return function(state.moved(every))

    return torch.func.jacfwd(moved)(torch.zeros(len(index), dtype=torch.float64))


def arms_in_motion(frames: int, *, depth: float = 2.45) -> BodyParams:
    """A person who stands before the camera, moves both arms and one leg a little, and speaks.

    The spine is straight, as no keypoint tells its joints apart; forearms and knees point clearly to the camera, as the
    fits' start does: at the same pixels each limb could point away just as well.
    """
    share = torch.linspace(0, 1, frames, dtype=torch.float64)
    pose = torch.zeros(frames, 21, 3, dtype=torch.float64)
    angles: dict[str, tuple[Any, Any, Any]] = {
        "left_shoulder": (0.1, -0.3, -1.1 + 0.2 * share), "right_shoulder": (0.1, 0.3, 1.1 - 0.3 * share),
        "left_elbow": (0, -0.8 - 0.2 * share, 0), "right_elbow": (0, 0.9, 0),
        "left_hip": (-0.4 + 0.1 * share, 0, 0.1), "right_hip": (-0.3, 0, -0.1),
        "left_knee": (0.6, 0, 0), "right_knee": (0.5 + 0.1 * share, 0, 0),
    }  # fmt: skip
    for joint, values in angles.items():
        for axis, value in enumerate(values):
            pose[:, JOINT[joint] - 1, axis] = value
    still, g = BodyParams.neutral(frames), generator(0)
    coefficients = {"betas": 0.5, "left_hand_pose": 0.2, "right_hand_pose": 0.2, "expression": 0.3}
    drawn = {
        name: size * torch.randn(1, getattr(still, name).shape[1], generator=g, dtype=torch.float64)
        for name, size in coefficients.items()
    }
    place = torch.tensor([0.05, 0.2, depth], dtype=torch.float64) + 0.05 * share[:, None]
    return replace(
        still,
        global_orient=FACING.expand(frames, 3),
        body_pose=pose.flatten(1),
        jaw_pose=torch.tensor([0.15, 0.0, 0.0], dtype=torch.float64).expand(frames, 3),
        camera_translation=place,
        **{name: values.expand(frames, -1) for name, values in drawn.items()},
    )
