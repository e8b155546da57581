"""From a clip, a body and a configuration to the objective of each stage."""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.kinematics import contour_bins
from fitting_core.body.model import N_JOINTS, BodyModel
from fitting_core.body.points.body_points import BodyPoints
from fitting_core.body.points.pairs import Point, keypoint_points
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.fit.collision.colliding_body import CollidingBody
from fitting_core.fit.evidence.given_start import corrected_start
from fitting_core.fit.evidence.observations import LifterEvidence, Observations, PointsInSpace, Stances
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.terms.context import TermContext, UsedKeypoints
from fitting_core.fit.terms.positions import evidence_weight
from fitting_core.fit.terms.table import camera_terms, stage_terms
from fitting_core.fit.variables.estimate import SolverView
from fitting_core.fit.variables.state import Free, Parametrisation, State
from fitting_core.fit.views.evidence import points_in_space
from fitting_core.fit.views.relating import related
from fitting_core.keypoints import Keypoints
from fitting_core.lifting.clip_lifting import LIFTED_HEIGHT
from fitting_core.priors.pose import make_prior
from fitting_core.results.given_start import GivenStart
from fitting_core.silhouettes import Silhouettes


class FittedBody:
    """A body model, its parametrisation by a solver, and its visible points.

    Args:
        model: the body model.
        config: its pose prior, hands, precision and device count.
    """

    def __init__(self, model: BodyModel, config: FitConfig) -> None:
        self.model = model
        self.dtype, self.device = getattr(torch, config.precision), torch.device(config.device)
        self.parametrisation = Parametrisation(
            model,
            make_prior(config.pose_prior, dtype=self.dtype, device=self.device),
            hand_components=config.hand_components,
            dtype=self.dtype,
            device=self.device,
        )
        self.keypoint_points: list[Point | None] = keypoint_points(model)
        self.known = torch.tensor([p is not None for p in self.keypoint_points], device=self.device)
        """Keypoints that the body has, (137,) bool."""

    @cached_property
    def colliding(self) -> CollidingBody:
        """The whole mesh, created when the first stage needs collisions."""
        return CollidingBody(self.model, dtype=self.dtype, device=self.device)

    @property
    def size(self) -> float:
        """Scale to the people that the lifter knows, before the fit has found a shape."""
        return self.model.height[0] / LIFTED_HEIGHT if self.model.gender == "child" else 1.0

    @cached_property
    def rest_joints(self) -> Float[Tensor, "55 3"]:
        """Joints of the mean shape at rest, metres."""
        return torch.as_tensor(self.model.rest_joints, dtype=self.dtype, device=self.device)

    def points(self, indices: Int[Tensor, "N"]) -> BodyPoints:
        """Some keypoints' points on the body."""
        return _compiled(self.model, tuple(indices.tolist()), self.dtype, self.device)

    def contour_bins(self, points: BodyPoints, state: State) -> Int[Tensor, "B"]:
        """The face contour's table of each frame, from the head's yaw in `state`."""
        p = self.parametrisation
        return contour_bins(points.world_rotations(state.orient, p.pose(state, p.body_pose(state))))

    def turned_by(self, seen: Bool[Tensor, "T 137"]) -> Bool[np.ndarray, "T 55"]:
        """Joints with one of these keypoints below them in the tree, so that the image determines their rotation."""
        return (seen.cpu().numpy().astype(int) @ _turning(self.model)) > 0


@lru_cache(maxsize=16)
def _compiled(body: BodyModel, indices: tuple[int, ...], dtype: torch.dtype, device: torch.device) -> BodyPoints:
    """The points of some keypoints. Cached beyond a fit: otherwise each drag of a keypoint would take 0.1 s more."""
    known = keypoint_points(body)
    points = [point for i in indices if (point := known[i]) is not None]
    return BodyPoints(body, points, dtype=dtype, device=device)


@lru_cache(maxsize=4)
def _turning(body: BodyModel) -> Int[np.ndarray, "137 55"]:
    """1 where a joint moves a keypoint. Cached: for all keypoints it takes 0.3 s, which would delay a drag."""
    known = {i: p for i, p in enumerate(keypoint_points(body)) if p is not None}
    points = BodyPoints(body, list(known.values()))
    hangs = np.zeros((kp.COUNT, N_JOINTS), int)
    hangs[np.array(list(known))[points.entry_point.numpy()], points.entry_joint.numpy()] = 1
    return hangs


IMAGE_SCALE = 1000.0
"""The data term's pixels are scaled to this image height."""
N_STAGES = 5
_TORSO = [kp.INDEX[n] for n in ("neck", "right_shoulder", "left_shoulder", "mid_hip", "right_hip", "left_hip")]
_HEAD = [kp.INDEX[n] for n in ("nose", "right_eye", "left_eye", "right_ear", "left_ear")]


@dataclass(frozen=True, kw_only=True, eq=False)
class Stages:
    """Builds objectives from the constants of a fit."""

    observations: Observations
    camera: Camera
    fitted: FittedBody
    """Shared by all parts of a clip."""
    config: FitConfig
    temporal_weight: float
    """w_T for this clip."""
    lifter: LifterEvidence
    """Of the whole clip, also in parts of it."""
    start: GivenStart | None = None
    """Of the same frames."""
    silhouettes: Silhouettes | None = None
    """Of the same frames, if known and used."""

    @staticmethod
    def of(
        keypoints: Keypoints,
        camera: Camera,
        body: BodyModel,
        config: FitConfig,
        *,
        frame_rate: float = 25.0,
        detector: str = "",
        start: GivenStart | None = None,
        size: float | None = None,
        silhouettes: Silhouettes | None = None,
        located: PointsInSpace | None = None,
        lifter: LifterEvidence | None = None,
    ) -> "Stages":
        """The stages of a whole clip.

        Args:
            keypoints: the detections.
            camera: the clip's camera.
            body: the body model.
            config: weights and all other settings.
            frame_rate: of the clip, frames per second; used if `config.temporal.reference_rate` is set.
            detector: who found the keypoints, `Clip.detector`.
            start: what phase 1 begins with, and what is held near it if `config.start_deviation` says so.
            size: of the person, `FitResult.size`; None: as a fit begins.
            silhouettes: the person's outlines, used if `config.silhouettes` says so.
            located: points that other views locate, used if the lifter's are.
            lifter: of the same keypoints; None: it is made.
        """
        fitted, reference = FittedBody(body, config), config.temporal.reference_rate
        size = size or fitted.size
        observations = Observations.of(
            keypoints, camera, config, detector=detector, dtype=fitted.dtype, device=fitted.device
        )
        up = None if located is None else located.up
        lifter = lifter or LifterEvidence(observations.keypoints, camera, frame_rate, up)
        if any(config.weights.relative_position):
            observations = observations.lifted(lifter.lifted, size=size)
            observations = observations if located is None else observations.viewed(located, size=size)
        if start is not None and config.start_deviation is not None:
            start = corrected_start(start, keypoints, camera)
            ratio = size / fitted.size
            observations = observations.near(ratio * start.points, ratio * start.deviation(config.start_deviation))
        return Stages(
            observations=observations,
            camera=camera,
            fitted=fitted,
            config=config,
            lifter=lifter,
            temporal_weight=config.temporal.weight * ((frame_rate / reference) ** 2 if reference else 1.0),
            start=start,
            silhouettes=silhouettes if config.silhouettes else None,
        )

    @staticmethod
    def of_clip(
        clip: Clip,
        body: BodyModel,
        config: FitConfig,
        *,
        start: GivenStart | None = None,
        size: float | None = None,
        lifter: LifterEvidence | None = None,
    ) -> "Stages":
        """The same for a clip, with its detector, frame rate and other views."""
        return Stages.of(
            clip.keypoints,
            clip.camera,
            body,
            config,
            frame_rate=clip.frame_rate,
            detector=clip.detector,
            start=start,
            size=size,
            silhouettes=clip.silhouettes,
            located=points_in_space(related(clip)) if clip.views and any(config.weights.relative_position) else None,
            lifter=lifter,
        )

    def holding(self, stances: Stances) -> "Stages":
        """The same stages with the standing feet held in place."""
        return replace(self, observations=self.observations.held(stances))

    def within(self, frames: range) -> "Stages":
        """The same for a part of the clip, treated as a clip: its cost does not grow with the whole.

        Decisions about the whole clip stay: swapped sides, the keypoints used, what is free to move.
        """
        return self._of(slice(frames.start, frames.stop))

    def picked(self, frames: Int[np.ndarray, "n"]) -> "Stages":
        """The same for some frames, for what takes each by itself."""
        return self._of(frames)

    def _of(self, frames: slice | Int[np.ndarray, "n"]) -> "Stages":
        return replace(
            self,
            observations=self.observations[frames],
            camera=self.camera[frames if isinstance(frames, slice) else frames.tolist()],
            start=None if self.start is None else self.start[frames],
            silhouettes=None if self.silhouettes is None else self.silhouettes[frames],
        )

    def __len__(self) -> int:
        return len(self.observations)

    @property
    def body(self) -> BodyModel:
        """What is fitted."""
        return self.fitted.model

    @property
    def parametrisation(self) -> Parametrisation:
        """How a solver's numbers become the body's pose."""
        return self.fitted.parametrisation

    @property
    def device(self) -> torch.device:
        """Where the fit computes."""
        return self.fitted.device

    @property
    def keypoints(self) -> Keypoints:
        """The detections, with swapped sides corrected."""
        return self.observations.keypoints

    @property
    def xy(self) -> Float[Tensor, "T 137 2"]:
        """Pixels of the detections."""
        return self.observations.xy

    @cached_property
    def all_frames(self) -> Int[Tensor, "T"]:
        """Their indices."""
        return torch.arange(len(self), device=self.device)

    @cached_property
    def given(self) -> Bool[Tensor, "T"]:
        """Frames that begin with the given start; those with too few keypoints only if they are held near it."""
        usable = self.observations.usable
        if self.start is None:
            return torch.zeros_like(usable)
        there = torch.as_tensor(self.start.there).to(usable)
        return there if self.config.start_deviation is not None else there & usable

    @property
    def near_start(self) -> Bool[Tensor, "T"]:
        """Frames that are held near the given start, which determines the root's rotation and the legs."""
        return self.given if self.config.start_deviation is not None else torch.zeros_like(self.given)

    @cached_property
    def observed(self) -> Bool[np.ndarray, "T 55"]:
        """Joints with a confident keypoint below them in the tree, so that the image determines their rotation."""
        return self.fitted.turned_by(self.observations.seen)

    @cached_property
    def _shown(self) -> Bool[Tensor, "137"]:
        """Keypoints that the body has and that any frame of the clip shows."""
        return self.fitted.known & self.observations.shown

    @cached_property
    def context(self) -> TermContext:
        """What the terms are made from."""
        positioned = self.observations.relative_position_deviation.isfinite().any(2)
        fitted = self.fitted  # a closure over self would keep it alive until the next garbage collection
        return TermContext(
            config=self.config,
            body=self.body,
            parametrisation=self.parametrisation,
            observations=self.observations,
            camera=self.camera,
            pelvis=self.fitted.rest_joints[0],
            near_start=self.near_start,
            hands_shown=self.has(kp.HANDS),
            turned=self.fitted.turned_by(self.observations.seen | positioned),
            temporal_weight=self.temporal_weight,
            colliding=lambda: fitted.colliding,
        )

    def has(self, group: slice) -> bool:
        """Whether any keypoint of the group that the body has was detected."""
        return bool(self._shown[group].any())

    def _joint_weights(self, stage: int) -> Float[Tensor, "137"]:
        w, config = self.config.weights, self.config
        weights = self.xy.new_full((kp.COUNT,), w.body_keypoints[stage - 1])
        weights[kp.INDEX["neck"]] *= config.neck_weight
        weights[[kp.INDEX["left_hip"], kp.INDEX["right_hip"]]] *= config.hip_weight
        weights[kp.HANDS] = w.hand_keypoints[stage - 1]
        weights[kp.FACE] = w.face_keypoints[stage - 1]
        return weights

    def _looked(self, joint_weights: Float[Tensor, "T 137"], chosen: Bool[Tensor, "137"]) -> UsedKeypoints:
        weight = self.observations.confidence * joint_weights * (IMAGE_SCALE / self.camera.size[1])
        used = ((joint_weights > 0).any(0) & chosen).nonzero()[:, 0]
        return UsedKeypoints(used, weight[:, used])

    def _used_in(self, stage: int) -> UsedKeypoints:
        """Keypoints seen in any frame, or located by anything but the image in this stage."""
        o = self.observations
        known = o.relative_position_deviation.isfinite().any(2)
        elsewhere = (known if evidence_weight(self.config, stage - 1) else o.depth_by_hand).any(0)
        return self._looked(
            self._joint_weights(stage).expand(len(self), -1), self._shown | (elsewhere & self.fitted.known)
        )

    def looked_at(self, stage: int) -> Int[Tensor, "N"]:
        """The keypoints of a stage's data term and relative positions."""
        return self._used_in(stage).indices

    def view(self, indices: Int[Tensor, "N"], state: State | None) -> SolverView:
        """These keypoints on the body, before the camera; `state`, if given, determines the face contour's tables."""
        points = self.fitted.points(indices)
        focal, center = self.xy.new_tensor(self.camera.focal), self.xy.new_tensor(self.camera.center)
        bins = None if state is None or not points.has_contour else self.fitted.contour_bins(points, state)
        return SolverView(self.parametrisation, points, focal, center, bins)

    def free(self, stage: int, *, betas: bool, resting: bool = False, translation: bool = True) -> Free:
        """What moves in a stage.

        Hands and face move only if the clip shows them: otherwise nothing but their priors would act on them. `resting`
        says that they are still in the rest pose (phase 1), so that stages without their keypoints need not free them.
        """
        w = self.config.weights
        stages = [stage - 1] if resting else range(N_STAGES)
        hands = self.has(kp.HANDS) and any(w.hand_keypoints[s] > 0 for s in stages)
        face = self.has(kp.FACE) and any(w.face_keypoints[s] > 0 for s in stages)
        return Free(hands=hands, face=face, betas=betas, translation=translation)

    def adds_detail(self, stage: int) -> bool:
        """Whether hands or face have more weight than in the stage before, so that many points start far off."""
        w = self.config.weights
        rows = ((w.hand_keypoints, kp.HANDS), (w.face_keypoints, kp.FACE))
        return any(stage > 1 and row[stage - 1] > row[stage - 2] and self.has(group) for row, group in rows)

    def objective(self, stage: int, state: State, free: Free) -> FrameObjective:
        """E_o of a stage (1 to 5).

        Args:
            stage: which row of the weights.
            state: all frames of the clip; it determines the face contour's tables, which then stay.
            free: what moves.
        """
        used = self._used_in(stage)
        return FrameObjective(stage_terms(self.context, used, stage), self.view(used.indices, state), free)

    def camera_objective(self, depth: Float[Tensor, "T"]) -> FrameObjective:
        """The camera step: orientation and translation on the torso, depth held near its guess.

        If hips are not seen the head replaces them, and the lean counts: shoulders and neck alone are one line.
        """
        weights = self.xy.new_zeros(len(self), kp.COUNT)
        weights[:, _TORSO] = 1
        headed = torch.zeros_like(weights)
        headed[:, _HEAD] = 1
        weights = torch.where(self.observations.hips_seen[:, None], weights, weights + headed)
        looked = self._looked(weights, self._shown)
        free = Free(body=False, hands=False, face=False, betas=False)
        return FrameObjective(camera_terms(self.context, looked, depth), self.view(looked.indices, None), free)
