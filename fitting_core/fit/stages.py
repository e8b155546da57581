"""From a clip, a body and a configuration to the objective of each stage."""

from copy import copy
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.kinematics import contour_bins
from fitting_core.body.model import N_JOINTS, BodyModel
from fitting_core.body.points.pairs import Point, keypoint_points
from fitting_core.body.points.points import BodyPoints
from fitting_core.camera import Camera
from fitting_core.config.schema import FitConfig
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.reliability import SEEN, cut_off, unswapped
from fitting_core.fit.terms.collision.term import CollidingBody
from fitting_core.fit.terms.table import stage_terms, upright
from fitting_core.fit.terms.terms import Data, Quadratic, Term
from fitting_core.fit.variables.estimate import View
from fitting_core.fit.variables.state import Free, Parametrisation, State
from fitting_core.keypoints import Keypoints
from fitting_core.priors.pose import make_prior

IMAGE_SCALE = 1000.0
"""The data term's pixels are scaled as if the image were so high."""
DEPTH_WEIGHT = 100.0
"""Of the camera step: (1e2)^2 (tz - tz_0)^2."""
N_STAGES = 5

_TORSO = [kp.INDEX[n] for n in ("neck", "right_shoulder", "left_shoulder", "mid_hip", "right_hip", "left_hip")]
_HEAD = [kp.INDEX[n] for n in ("nose", "right_eye", "left_eye", "right_ear", "left_ear")]
_LEGS = [(kp.INDEX[f"{side}_hip"], kp.INDEX[f"{side}_knee"]) for side in ("left", "right")]


@dataclass(frozen=True)
class _Selection:
    """Keypoints that one objective looks at."""

    indices: Int[Tensor, "N"]
    weight: Float[Tensor, "T N"]


class Stages:
    """Builds objectives; holds what is constant over a fit.

    Args:
        keypoints: the detections.
        camera: the clip's camera.
        body: the body model.
        config: weights and all other settings.
        frame_rate: of the clip, frames per second; matters where `config.temporal.reference_rate` is set.
    """

    def __init__(
        self, keypoints: Keypoints, camera: Camera, body: BodyModel, config: FitConfig, *, frame_rate: float = 25.0
    ) -> None:
        self.swaps: dict[str, np.ndarray] = {}
        """Frames in which the sides of a pair of limbs were swapped back, by the limbs' name."""
        if config.unswap_sides:
            keypoints, self.swaps = unswapped(keypoints)
        self.body, self.config, self.keypoints, self.camera = body, config, keypoints, camera
        reference = config.temporal.reference_rate
        self.temporal_weight = config.temporal.weight * ((frame_rate / reference) ** 2 if reference else 1.0)
        """w_T for this clip."""
        side = cut_off(keypoints, camera.size) if config.one_sided_cut_off else np.zeros(keypoints.xy.shape, np.int8)
        self.dtype, self.device = getattr(torch, config.precision), torch.device(config.device)
        self.parametrisation = Parametrisation(
            body,
            make_prior(config.pose_prior, dtype=self.dtype, device=self.device),
            hand_components=config.hand_components,
            dtype=self.dtype,
            device=self.device,
        )
        self.xy, self.confidence = self.tensor(keypoints.xy), self.tensor(keypoints.confidence)
        self.side = self.tensor(side)
        self.seen = (self.confidence > SEEN) & (self.side == 0).all(-1)
        """Keypoints of which the image says where they are, (T, 137) bool."""
        self.keypoint_points: list[Point | None] = keypoint_points(body)
        self._known = torch.tensor([p is not None for p in self.keypoint_points], device=self.device)
        self._shown = self._known & (self.confidence > 0).any(0)
        """Keypoints that the body knows and that any frame of the clip shows."""
        self.all_frames = torch.arange(len(keypoints), device=self.device)
        self.hips_seen = self.seen[:, [kp.INDEX["left_hip"], kp.INDEX["right_hip"]]].all(1)
        self.leg_seen = torch.stack([self.seen[:, list(leg)].all(1) for leg in _LEGS]).any(0)

    def within(self, frames: range) -> "Stages":
        """The same for a part of the clip, which counts as a clip: at a cost that does not grow with the whole.

        What the whole clip decides stays: swapped sides, the keypoints that are looked at, what is free to move.
        """
        other, part = copy(self), slice(frames.start, frames.stop)
        for name in ("keypoints", "xy", "confidence", "side", "seen", "hips_seen", "leg_seen"):
            setattr(other, name, getattr(self, name)[part])
        other.all_frames = self.all_frames[: len(frames)]
        inside = {name: where[(where >= part.start) & (where < part.stop)] for name, where in self.swaps.items()}
        other.swaps = {name: where - part.start for name, where in inside.items() if len(where)}
        vars(other).pop("_observed", None)
        return other

    def tensor(self, a: np.ndarray) -> Tensor:
        """The array in the fit's type and on its device."""
        a = np.asarray(a)
        # torch warns of arrays that cannot be written, as those of a project are.
        a = a if a.flags.writeable else a.copy()
        return torch.as_tensor(a, dtype=self.dtype, device=self.device)

    def has(self, group: slice) -> bool:
        """Whether any keypoint of the group was detected that the body knows."""
        return bool(self._shown[group].any())

    def _joint_weights(self, stage: int) -> Float[Tensor, "137"]:
        w, config = self.config.weights, self.config
        weights = self.xy.new_full((kp.COUNT,), w.body_keypoints[stage - 1])
        weights[kp.INDEX["neck"]] *= config.neck_weight
        weights[[kp.INDEX["left_hip"], kp.INDEX["right_hip"]]] *= config.hip_weight
        weights[kp.HANDS] = w.hand_keypoints[stage - 1]
        weights[kp.FACE] = w.face_keypoints[stage - 1]
        return weights

    def _select(self, joint_weights: Float[Tensor, "T 137"]) -> _Selection:
        weight = self.confidence * joint_weights * (IMAGE_SCALE / self.camera.size[1])
        used = ((joint_weights > 0).any(0) & self._shown).nonzero()[:, 0]
        return _Selection(used, weight[:, used])

    def data_keypoints(self, stage: int) -> Int[Tensor, "N"]:
        """Which keypoints a stage's data term looks at."""
        return self._select(self._joint_weights(stage).expand(len(self.keypoints), -1)).indices

    def _view(self, indices: Tensor, state: State | None) -> View:
        points = _compiled(self.body, tuple(indices.tolist()), self.dtype, self.device)
        focal, center = self.xy.new_tensor(self.camera.focal), self.xy.new_tensor(self.camera.center)
        bins = None
        if points.has_contour and state is not None:
            bins = self.contour_bins(points, state)
        return View(self.parametrisation, points, focal, center, bins)

    def contour_bins(self, points: BodyPoints, state: State) -> Int[Tensor, "T"]:
        """The face contour's table of each frame, from the head's yaw in `state`."""
        p = self.parametrisation
        return contour_bins(points.world_rotations(state.orient, p.pose(state, p.body_pose(state))))

    def _data(self, selection: _Selection) -> Data:
        i = selection.indices
        config = self.config
        scale = self.camera.size[1] / config.robust_at_height if config.robust_at_height else 1.0
        fine = (i >= kp.HANDS.start)[:, None]
        rho = scale * torch.where(fine, config.robust_pixels_fine, config.robust_pixels).to(self.xy)
        return Data(self.xy[:, i], selection.weight, self.side[:, i], rho)

    def free(self, stage: int, *, betas: bool, resting: bool = False, translation: bool = True) -> Free:
        """What moves in a stage.

        Hands and face move only if the clip shows them at all: nothing but their priors would act on them. `resting`
        says that they are still at rest (phase 1), where stages that do not look at them would leave them anyway.
        """
        w = self.config.weights
        stages = [stage - 1] if resting else range(N_STAGES)
        hands = self.has(kp.HANDS) and any(w.hand_keypoints[s] > 0 for s in stages)
        face = self.has(kp.FACE) and any(w.face_keypoints[s] > 0 for s in stages)
        return Free(hands=hands, face=face, betas=betas, translation=translation)

    def looks_closer(self, stage: int) -> bool:
        """Whether hands or face weigh more than in the stage before, so that many points start far off."""
        w = self.config.weights
        rows = ((w.hand_keypoints, kp.HANDS), (w.face_keypoints, kp.FACE))
        return any(stage > 1 and row[stage - 1] > row[stage - 2] and self.has(group) for row, group in rows)

    def objective(self, stage: int, state: State, free: Free) -> FrameObjective:
        """E_o of a stage (1 to 5).

        Args:
            stage: which row of the weights.
            state: all frames of the clip; where it stands decides the face contour's tables, which then stay.
            free: what moves.
        """
        weights = self._joint_weights(stage).expand(len(self.keypoints), -1)
        selection = self._select(weights)
        terms = [self._data(selection), *stage_terms(self, stage)]
        return FrameObjective(terms, self._view(selection.indices, state), free)

    @property
    def colliding_body(self) -> CollidingBody:
        """The whole mesh, made when the first stage asks for collisions."""
        return self._colliding_body

    @cached_property
    def _colliding_body(self) -> CollidingBody:
        return CollidingBody(self.body, dtype=self.dtype, device=self.device)

    @property
    def observed(self) -> Bool[np.ndarray, "T 55"]:
        """Joints with a confident keypoint below them in the tree, so that the image says how they are turned."""
        return self._observed

    @cached_property
    def _observed(self) -> Bool[np.ndarray, "T 55"]:
        return (self.seen.cpu().numpy().astype(int) @ _turning(self.body)) > 0

    def camera_objective(self, depth: Float[Tensor, "T"]) -> FrameObjective:
        """The camera step: orientation and translation on the torso, depth held near its guess.

        Where hips are not seen the head takes their part, and the lean counts: shoulders and neck alone are one line.
        """
        weights = self.xy.new_zeros(len(self.keypoints), kp.COUNT)
        weights[:, _TORSO] = 1
        headed = torch.zeros_like(weights)
        headed[:, _HEAD] = 1
        weights = torch.where(self.hips_seen[:, None], weights, weights + headed)
        selection = self._select(weights)
        where = self.parametrisation.columns.translation
        hold = Quadratic(
            "depth", slice(where.stop - 1, where.stop), self.xy.new_full((1,), DEPTH_WEIGHT), depth[:, None]
        )
        terms: list[Term] = [self._data(selection), hold]
        terms += [term] if (term := upright(self, max(self.config.weights.lean), max(self.config.weights.turn))) else []
        free = Free(body=False, hands=False, face=False, betas=False)
        return FrameObjective(terms, self._view(selection.indices, None), free)

    def usable(self) -> Tensor:
        """Frames with enough confident keypoints to say where the person is, (T,) bool."""
        return self.seen[:, kp.BODY].sum(1) >= 4


@lru_cache(maxsize=16)
def _compiled(body: BodyModel, indices: tuple[int, ...], dtype: torch.dtype, device: torch.device) -> BodyPoints:
    """The points of some keypoints. Remembered beyond a fit: 0.1 s that each drag of a keypoint would wait."""
    known = keypoint_points(body)
    points = [point for i in indices if (point := known[i]) is not None]
    return BodyPoints(body, points, dtype=dtype, device=device)


@lru_cache(maxsize=4)
def _turning(body: BodyModel) -> Int[np.ndarray, "137 55"]:
    """1 where a joint turns a keypoint. Remembered: to compile all keypoints takes 0.3 s, which a drag would wait."""
    known = {i: p for i, p in enumerate(keypoint_points(body)) if p is not None}
    points = BodyPoints(body, list(known.values()))
    hangs = np.zeros((kp.COUNT, N_JOINTS), int)
    hangs[np.array(list(known))[points.entry_point.numpy()], points.entry_joint.numpy()] = 1
    return hangs
