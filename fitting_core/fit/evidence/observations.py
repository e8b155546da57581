"""The evidence that a fit takes from the detections of a clip: which count and how much, and where else the body is
known."""

from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int, Int8
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.camera import Camera
from fitting_core.config.schema import FitConfig
from fitting_core.fit.evidence.kept_offsets import STATED, kept_places, with_kept
from fitting_core.fit.evidence.sides import PAIRED, unswapped
from fitting_core.frame_runs import runs_where
from fitting_core.ground.contacts import FOOT_POINTS, Contacts
from fitting_core.ground.gravity import RolledView, rolled_views, told_gravity
from fitting_core.image_border import cut_off, seen_confidence
from fitting_core.keypoint_noise import keypoint_weights
from fitting_core.keypoints import SEEN, Keypoints
from fitting_core.lifting.clip_lifting import LiftedClip, lift

ACCURACY = 0.01
"""Standard deviation in metres of a standing foot's motion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stances:
    """Points of the feet (FOOT_POINTS), held in still space (see `CameraPath`), relative to each frame's camera."""

    position: Float[np.ndarray, "T 2 4 3"]
    """Metres."""
    deviation: Float[np.ndarray, "T 2 4"]
    """Metres; infinite where nothing is held."""


def stances(
    contacts: Contacts, feet: Float[np.ndarray, "T 2 4 3"], camera: Camera, *, accuracy: float = ACCURACY
) -> Stances:
    """For every contact of a foot.

    They are not moved onto a common floor: the fit of a tilted floor, which a clip determines to a median of 7 degrees,
    moves feet along the viewing ray, and legs with them.

    Args:
        contacts: Of the clip.
        feet: Still space, metres: ankle, heel, big and small toe of the left and the right foot.
        camera: Of the clip.
        accuracy: Standard deviation of a standing foot's motion, metres.
    """
    position, deviation = np.zeros(feet.shape), np.full(feet.shape[:3], np.inf)
    for foot in range(len(FOOT_POINTS)):
        for run in runs_where(contacts.standing[:, foot]):
            position[run.start : run.stop, foot] = np.median(feet[run, foot], axis=0)
            deviation[run.start : run.stop, foot] = accuracy
    return Stances(position=camera.from_still(position), deviation=deviation)


@dataclass(frozen=True, kw_only=True, eq=False)
class PointsInSpace:
    """Keypoints relative to the pelvis, if the person is as tall as the average adult."""

    points: Float[np.ndarray, "T 137 3"]
    """Metres in camera axes."""
    deviation: Float[np.ndarray, "T 137 3"]
    """Metres; infinite where unknown."""
    outvoted: Bool[np.ndarray, "T 137"]
    """Detections of the first view that do not count: another view disagrees and is surer."""
    up: Float[np.ndarray, "T 3"]
    """Against gravity, as `LiftedClip.up`: of the lifter in all views."""


UNSURE = 0.25
"""Standard deviation in metres above which the lifter is ignored for a keypoint."""
FEET = 1.7
"""Factor on the lifter's deviation for ankles and feet that are detected: it was off by two deviations on balancing
people, who move unlike its training data, and pulled the knees along."""
USABLE = 4
"""Minimum number of body keypoints for locating the person in a frame."""

_HIPS = [kp.INDEX["left_hip"], kp.INDEX["right_hip"]]
_LEGS = [[kp.INDEX[f"{side}_hip"], kp.INDEX[f"{side}_knee"]] for side in ("left", "right")]
_IS_FOOT = np.array([n.endswith(("ankle", "toe", "heel")) for n in kp.BODY_25])
_OF_CLIP = {"of the whole clip": True}
"""Marks a field determined by the whole clip: parts of the clip keep it unchanged."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Observations:
    """The evidence that a fit takes from the detections of a clip.

    `observations[frames]` is the same for consecutive frames. Every field has a row for each frame and is sliced,
    unless it is declared as determined by the whole clip.
    """

    keypoints: Keypoints
    """The detections, with left and right unswapped."""
    swapped: Bool[np.ndarray, "T pairs"]
    """Whether a pair of limbs was unswapped; pairs in the order of PAIRED."""
    xy: Float[Tensor, "T 137 2"]
    """Pixels."""
    confidence: Float[Tensor, "T 137"]
    """Confidence of each detection times its keypoint's weight (`keypoint_noise`)."""
    side: Int8[Tensor, "T 137 2"]
    """See `cut_off`; 0 everywhere if the configuration treats detections at the border like any other."""
    seen: Bool[Tensor, "T 137"]
    """Keypoints located by the image."""
    hips_seen: Bool[Tensor, "T"]
    """Whether both hips are seen."""
    leg_seen: Bool[Tensor, "T"]
    """Whether hip and knee of one side are seen."""
    relative_position: Float32[Tensor, "T 137 3"]
    """Keypoints relative to the pelvis, metres in camera axes, where evidence other than the image locates them. In
    single precision, as these two are the largest part of a long clip's evidence."""
    relative_position_deviation: Float32[Tensor, "T 137 3"]
    """Its standard deviation, metres; infinite where unknown, as for x and y of detected keypoints, for which the
    lifter does not count."""
    depth_by_hand: Bool[Tensor, "T 137"]
    """Keypoints whose relative z was set by a person; the lifter does not count there."""
    held_position: Float[Tensor, "T 2 4 3"]
    """Held positions of the feet, as in FOOT_POINTS, metres in camera space."""
    held_position_deviation: Float[Tensor, "T 2 4"]
    """Their standard deviation, metres; infinite where nothing is held."""
    turn: Float[Tensor, "T 137 3"]
    """Joint rotations set by a person (`Keypoints.turn`); NaN elsewhere."""
    shown: Bool[Tensor, "137"] = field(metadata=_OF_CLIP)
    """Keypoints detected in any frame of the clip, or of a hand whose shape a person stated."""

    def __post_init__(self) -> None:
        rows = {name: len(value) for name, value in self._by_frame().items()}
        assert set(rows.values()) == {len(self.keypoints)}, f"fields of a row for each frame differ in length: {rows}"

    @staticmethod
    def of(
        keypoints: Keypoints,
        camera: Camera,
        config: FitConfig,
        *,
        detector: str = "",
        dtype: torch.dtype,
        device: torch.device,
    ) -> "Observations":
        """The observations of a whole clip.

        Args:
            keypoints: the detections.
            camera: of the clip; its image has a border.
            config: whether left and right are unswapped, whether detections at the image border count one-sidedly, and
                the keypoints' noise.
            detector: the detector, `Clip.detector`.
            dtype: of the tensors.
            device: of the tensors.
        """
        swapped = np.zeros((len(keypoints), len(PAIRED)), bool)
        if config.unswap_sides:
            keypoints, swaps = unswapped(keypoints)
            for pair, name in enumerate(PAIRED):
                swapped[swaps.get(name, []), pair] = True
        stated = keypoints.overruled
        side = cut_off(keypoints, camera) if config.one_sided_cut_off else np.zeros(keypoints.xy.shape, np.int8)
        xy, confidence = (
            as_tensor(a, dtype=dtype, device=device)
            for a in (keypoints.xy, np.where(stated, 0.0, keypoints.confidence))
        )
        sides = torch.as_tensor(side, device=device)
        seen = (confidence > SEEN) & (sides == 0).all(-1)
        depth = as_tensor(keypoints.told_depth, dtype=dtype, device=device)
        by_hand, turn = depth.isfinite(), keypoints.turn
        position, deviation = (
            xy.new_full((*confidence.shape, 3), value, dtype=torch.float32) for value in (0.0, torch.inf)
        )
        position[..., 2] = torch.where(by_hand, depth, 0.0)
        deviation[..., 2] = torch.where(by_hand, STATED, deviation[..., 2])
        return Observations(
            keypoints=keypoints,
            swapped=swapped,
            xy=xy,
            confidence=confidence * _weights(keypoints, config, detector).to(confidence),
            side=sides,
            seen=seen,
            hips_seen=seen[:, _HIPS].all(1),
            leg_seen=torch.stack([seen[:, leg].all(1) for leg in _LEGS]).any(0),
            relative_position=position,
            relative_position_deviation=deviation,
            depth_by_hand=by_hand,
            held_position=xy.new_zeros(len(xy), *FOOT_POINTS.shape, 3),
            held_position_deviation=xy.new_full((len(xy), *FOOT_POINTS.shape), torch.inf),
            turn=(
                xy.new_tensor(torch.nan).expand_as(position)
                if turn is None
                else as_tensor(turn, dtype=dtype, device=device)
            ),
            shown=(confidence > 0).any(0) | torch.as_tensor(stated.any(0)).to(device),
        )

    def lifted(self, lifted: LiftedClip, *, size: float = 1.0) -> "Observations":
        """With the lifter's estimates of body keypoints and kept offsets, except where a person set a depth.

        Args:
            lifted: the lifter's result for these keypoints.
            size: the person's size relative to LIFTED_HEIGHT, which the lifter assumes for everyone.
        """
        undetected = self.keypoints.confidence[:, kp.BODY] == 0
        deviation = size * lifted.depth_deviation * np.where(_IS_FOOT & ~undetected, FEET, 1.0)
        places = kept_places(self.keypoints, lifted.points)
        points, deviation = with_kept(self.keypoints.kept, size * lifted.points, deviation)
        deviation = np.where(deviation < UNSURE, deviation, np.inf)
        position, deviations = self.relative_position.clone(), self.relative_position_deviation.clone()
        position[:, kp.BODY] = torch.as_tensor(points).to(position)
        deviation[..., :2] = np.where(undetected[..., None], deviation[..., :2], np.inf)
        deviations[:, kp.BODY] = torch.as_tensor(deviation).to(position)
        position[..., 2] = torch.where(self.depth_by_hand, self.relative_position[..., 2], position[..., 2])
        deviations[..., 2] = torch.where(
            self.depth_by_hand, self.relative_position_deviation[..., 2], deviations[..., 2]
        )
        xy = self.xy + torch.as_tensor(places).to(self.xy)
        return replace(self, xy=xy, relative_position=position, relative_position_deviation=deviations)

    def viewed(self, found: PointsInSpace, *, size: float = 1.0) -> "Observations":
        """With points that other views locate, moved by kept offsets, except where a person set depths.

        Args:
            found: of this clip.
            size: as in `lifted`.
        """
        located, spread = size * found.points, size * found.deviation
        if self.keypoints.kept:
            # The trunk's axes are needed in all frames, also where no view locates it.
            whole = np.where(np.isfinite(spread), located, self.relative_position.numpy(force=True))[:, kp.BODY]
            moved, widened = with_kept(self.keypoints.kept, whole, spread[:, kp.BODY, 2])
            kept = (moved != whole).any(-1, keepdims=True)
            located[:, kp.BODY], spread[:, kp.BODY] = moved, np.where(kept, widened, spread[:, kp.BODY])
        deviation = torch.as_tensor(spread).to(self.relative_position)
        deviation[..., 2].masked_fill_(self.depth_by_hand, torch.inf)
        known = deviation.isfinite()
        points = torch.as_tensor(located).to(self.relative_position)
        outvoted = torch.as_tensor(found.outvoted).to(self.xy.device)
        return replace(
            self,
            confidence=self.confidence.masked_fill(outvoted, 0.0),
            seen=self.seen & ~outvoted,
            relative_position=torch.where(known, points, self.relative_position),
            relative_position_deviation=torch.where(known, deviation, self.relative_position_deviation),
        )

    def near(self, points: Float[np.ndarray, "T 25 3"], deviation: Float[np.ndarray, "T 25"]) -> "Observations":
        """With a given start's positions of body keypoints, except where a person set them.

        Unlike the lifter's, these are independent of the detections: x and y count too. Where both exist they are
        averaged by inverse variance; where they disagree, the uncertainty is increased accordingly (R. T. Birge, Phys.
        Rev. 40, 1932).

        Args:
            points: relative to the pelvis, metres in camera axes.
            deviation: standard deviation along each axis, metres; infinite where unknown.
        """
        own = torch.as_tensor(deviation).to(self.xy)[..., None].repeat(1, 1, 3)
        own[..., 2].masked_fill_(self.depth_by_hand[:, kp.BODY], torch.inf)
        found = torch.where(own.isfinite(), torch.as_tensor(points).to(self.xy), 0.0)
        before, spread = self.relative_position[:, kp.BODY], self.relative_position_deviation[:, kp.BODY]
        precision = spread**-2 + own**-2
        mean = (before * spread**-2 + found * own**-2) / precision.clamp_min(1e-9)
        both = own.isfinite() & spread.isfinite()
        apart = torch.where(both, (before - found) ** 2 / (spread**2 + own**2), 1.0).clamp_min(1.0)
        position, deviations = self.relative_position.clone(), self.relative_position_deviation.clone()
        position[:, kp.BODY] = torch.where(own.isfinite(), mean, before)
        deviations[:, kp.BODY] = torch.where(own.isfinite(), (apart / precision).sqrt(), spread)
        return replace(self, relative_position=position, relative_position_deviation=deviations)

    def held(self, stances: Stances) -> "Observations":
        """With standing feet held in place."""
        position, deviation = (torch.as_tensor(a).to(self.xy) for a in (stances.position, stances.deviation))
        return replace(self, held_position=position, held_position_deviation=deviation)

    def __len__(self) -> int:
        return len(self.keypoints)

    def __getitem__(self, frames: slice | Int[np.ndarray, "n"]) -> Self:
        return replace(self, **{name: value[frames] for name, value in self._by_frame().items()})

    def _by_frame(self) -> dict[str, Any]:
        """Every field with a row for each frame."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.metadata != _OF_CLIP}

    @property
    def swaps(self) -> dict[str, Int[np.ndarray, "n"]]:
        """Frames in which a pair of limbs was unswapped, by the pair's name; only pairs with such frames."""
        frames = {name: np.flatnonzero(self.swapped[:, pair]) for pair, name in enumerate(PAIRED)}
        return {name: where for name, where in frames.items() if len(where)}

    @property
    def usable(self) -> Bool[Tensor, "T"]:
        """Frames with enough confident keypoints to locate the person."""
        return self.seen[:, kp.BODY].sum(1) >= USABLE


def _weights(keypoints: Keypoints, config: FitConfig, detector: str) -> Float[Tensor, "T 137"]:
    """Weights for the detector's noise; keypoints placed by a person have none."""
    weights = keypoint_weights(config.keypoint_noise, detector)
    return torch.as_tensor(np.where(keypoints.placed, 1.0, weights))


def lifted_keypoints(keypoints: Keypoints, camera: Camera, frame_rate: float) -> LiftedClip:
    """The lifter's estimates.

    Args:
        keypoints: of a clip, unswapped.
        camera: of the clip.
        frame_rate: frames per second.
    """
    confidence = seen_confidence(keypoints, camera)
    return lift(keypoints.xy, confidence, camera, frame_rate, calibrated=camera.calibrated)


class LifterEvidence:
    """The lifter's results for a whole clip, each computed once, when first used: the body's pose changes none of them.

    Args:
        keypoints: of the clip, unswapped.
        camera: of the clip.
        frame_rate: frames per second.
        up: in place of the lifter's own; None: its own.
    """

    def __init__(
        self, keypoints: Keypoints, camera: Camera, frame_rate: float, up: Float[np.ndarray, "T 3"] | None = None
    ) -> None:
        self.keypoints, self.camera, self.frame_rate, self.up = keypoints, camera, frame_rate, up

    @cached_property
    def confidence(self) -> Float[np.ndarray, "T 137"]:
        """Of the keypoints; 0 for those that the image cuts off."""
        return seen_confidence(self.keypoints, self.camera)

    @cached_property
    def lifted(self) -> LiftedClip:
        """Positions, up direction and contacts."""
        lifted = lifted_keypoints(self.keypoints, self.camera, self.frame_rate)
        return lifted if self.up is None else replace(lifted, up=self.up)

    @cached_property
    def rolled(self) -> list[RolledView]:
        """The views rotated about the camera's axis; none if the up direction is given."""
        if told_gravity(self.camera) is not None:
            return []
        return rolled_views(self.keypoints.xy, self.confidence, self.camera, self.frame_rate)


def as_tensor(a: np.ndarray, *, dtype: torch.dtype, device: torch.device) -> Tensor:
    """The array as a tensor of a fit's type and on its device."""
    a = np.asarray(a)
    # torch warns about read-only arrays, such as those of a project.
    a = a if a.flags.writeable else a.copy()
    return torch.as_tensor(a, dtype=dtype, device=device)
