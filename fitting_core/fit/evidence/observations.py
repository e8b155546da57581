"""What a fit takes from the detections of a clip: which count and how much, and what else says where the body is."""

from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.camera import Camera
from fitting_core.config.schema import FitConfig
from fitting_core.fit.evidence.sides import PAIRED, unswapped
from fitting_core.fit.evidence.stances import Stances
from fitting_core.image_border import cut_off, seen_confidence
from fitting_core.keypoint_noise import keypoint_weights
from fitting_core.keypoints import SEEN, Keypoints
from fitting_core.lifting.clip_lifting import LiftedClip, lift

UNSURE = 0.25
"""Metres of standard deviation from which the lifter has no say about a keypoint."""
LIFTED_HEIGHT = 1.71
"""Metres: of the bodies that the lifter has learned from, on average."""
FEET = 1.7
"""By how much more the lifter may be off about ankles and feet that are detected than it says: it was by two deviations
on balancing people, who move unlike those that it learned from, and took knees along."""
TOLD = 0.02
"""Metres of standard deviation of a depth that a person says: as near as a front view next to the picture shows it."""
USABLE = 4
"""Body keypoints that a frame must show to say where the person is."""

_HIPS = [kp.INDEX["left_hip"], kp.INDEX["right_hip"]]
_LEGS = [[kp.INDEX[f"{side}_hip"], kp.INDEX[f"{side}_knee"]] for side in ("left", "right")]
_IS_FOOT = np.array([n.endswith(("ankle", "toe", "heel")) for n in kp.BODY_25])
_OF_CLIP = {"of the whole clip": True}
"""Marks a field that the whole clip decides: its parts keep it as it is."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Observations:
    """What a fit takes from the detections of a clip.

    `observations[frames]` is the same for some consecutive frames. Every field has a row for each frame and is sliced,
    unless it is declared as one that the whole clip decides.
    """

    keypoints: Keypoints
    """The detections, with swapped sides swapped back."""
    swapped: Bool[np.ndarray, "T pairs"]
    """Whether the sides of a pair of limbs were swapped back; pairs in the order of PAIRED."""
    xy: Float[Tensor, "T 137 2"]
    """Pixels."""
    confidence: Float[Tensor, "T 137"]
    """What each detection counts for: how sure its detector is, by its keypoint's weight (`keypoint_noise`)."""
    side: Float[Tensor, "T 137 2"]
    """See `cut_off`; 0 everywhere if the configuration takes detections at the border at their word."""
    seen: Bool[Tensor, "T 137"]
    """Keypoints of which the image says where they are."""
    hips_seen: Bool[Tensor, "T"]
    """Whether both hips are."""
    leg_seen: Bool[Tensor, "T"]
    """Whether hip and knee of one side are."""
    relative_position: Float[Tensor, "T 137 3"]
    """Where each keypoint's part of the body lies relative to the pelvis, metres in camera axes, as far as anything but
    the image says so."""
    relative_position_deviation: Float[Tensor, "T 137 3"]
    """Standard deviation of that, metres; infinite where nothing is known, as the lifter's x and y of what is
    detected."""
    told: Bool[Tensor, "T 137"]
    """Keypoints whose relative z a person has said; the lifter has no say in it."""
    held_position: Float[Tensor, "T 137 3"]
    """Where each keypoint's part of the body is held, metres in camera space."""
    held_position_deviation: Float[Tensor, "T 137"]
    """Standard deviation of that, metres; infinite where nothing is held."""
    turn: Float[Tensor, "T 137 3"]
    """How joints are turned, as far as a person says it (`Keypoints.turn`); NaN elsewhere."""
    shown: Bool[Tensor, "137"] = field(metadata=_OF_CLIP)
    """Keypoints that any frame of the clip shows."""

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
            config: whether swapped sides are swapped back, whether the image's border tells less, and whose noise the
                keypoints have.
            detector: who found them, `Clip.detector`.
            dtype: of the tensors.
            device: of the tensors.
        """
        swapped = np.zeros((len(keypoints), len(PAIRED)), bool)
        if config.unswap_sides:
            keypoints, swaps = unswapped(keypoints)
            for pair, name in enumerate(PAIRED):
                swapped[swaps.get(name, []), pair] = True
        side = cut_off(keypoints, camera) if config.one_sided_cut_off else np.zeros(keypoints.xy.shape, np.int8)
        xy, confidence, sides = (
            as_tensor(a, dtype=dtype, device=device) for a in (keypoints.xy, keypoints.confidence, side)
        )
        seen = (confidence > SEEN) & (sides == 0).all(-1)
        depth = as_tensor(keypoints.told_depth, dtype=dtype, device=device)
        told, turn = depth.isfinite(), keypoints.turn
        position, deviation = (xy.new_full((*confidence.shape, 3), value) for value in (0.0, torch.inf))
        position[..., 2], deviation[..., 2] = torch.where(told, depth, 0.0), torch.where(told, TOLD, deviation[..., 2])
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
            told=told,
            held_position=xy.new_zeros(*confidence.shape, 3),
            held_position_deviation=torch.full_like(confidence, torch.inf),
            turn=torch.full_like(position, torch.nan) if turn is None else as_tensor(turn, dtype=dtype, device=device),
            shown=(confidence > 0).any(0),
        )

    def lifted(self, camera: Camera, frame_rate: float, *, size: float = 1.0) -> "Observations":
        """The same with what the lifter says of body keypoints, as far as no person says it.

        Args:
            camera: of the clip.
            frame_rate: frames per second.
            size: of the person to those of LIFTED_HEIGHT, as whom the lifter takes everybody.
        """
        lifted = lifted_keypoints(self.keypoints, camera, frame_rate)
        undetected = self.keypoints.confidence[:, kp.BODY] == 0
        deviation = size * lifted.depth_deviation * np.where(_IS_FOOT & ~undetected, FEET, 1.0)
        deviation = np.where(deviation < UNSURE, deviation, np.inf)
        position, deviations = self.relative_position.clone(), self.relative_position_deviation.clone()
        position[:, kp.BODY] = torch.as_tensor(size * lifted.points).to(position)
        deviations[:, kp.BODY, 2] = torch.as_tensor(deviation).to(position)
        deviations[:, kp.BODY, :2] = torch.as_tensor(np.where(undetected, deviation, np.inf)).to(position)[..., None]
        position[..., 2] = torch.where(self.told, self.relative_position[..., 2], position[..., 2])
        deviations[..., 2] = torch.where(self.told, self.relative_position_deviation[..., 2], deviations[..., 2])
        return replace(self, relative_position=position, relative_position_deviation=deviations)

    def near(self, points: Float[np.ndarray, "T 25 3"], deviation: Float[np.ndarray, "T 25"]) -> "Observations":
        """The same with what a given start says of body keypoints, as far as no person says it.

        Unlike the lifter it does not come from the detections: x and y count too. Where both say something it is their
        mean by variance; where they disagree, it is as uncertain as that says (R. T. Birge, Phys. Rev. 40, 1932).

        Args:
            points: relative to the pelvis, metres in camera axes.
            deviation: standard deviation of these along each axis, metres; infinite where nothing is known.
        """
        own = torch.as_tensor(deviation).to(self.xy)[..., None].repeat(1, 1, 3)
        own[..., 2].masked_fill_(self.told[:, kp.BODY], torch.inf)
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
        """The same with feet held where they stand."""
        position, deviation = (torch.as_tensor(a).to(self.xy) for a in (stances.position, stances.deviation))
        return replace(self, held_position=position, held_position_deviation=deviation)

    def __len__(self) -> int:
        return len(self.keypoints)

    def __getitem__(self, frames: slice) -> Self:
        return replace(self, **{name: value[frames] for name, value in self._by_frame().items()})

    def _by_frame(self) -> dict[str, Any]:
        """Every field with a row for each frame."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.metadata != _OF_CLIP}

    @property
    def swaps(self) -> dict[str, Int[np.ndarray, "n"]]:
        """Frames in which the sides of a pair of limbs were swapped back, by the pair's name, where there are any."""
        frames = {name: np.flatnonzero(self.swapped[:, pair]) for pair, name in enumerate(PAIRED)}
        return {name: where for name, where in frames.items() if len(where)}

    @property
    def usable(self) -> Bool[Tensor, "T"]:
        """Frames with enough confident keypoints to say where the person is."""
        return self.seen[:, kp.BODY].sum(1) >= USABLE


def _weights(keypoints: Keypoints, config: FitConfig, detector: str) -> Float[Tensor, "T 137"]:
    """Of detections, for the noise of their detector; what a person has placed has none of it."""
    weights = keypoint_weights(config.keypoint_noise, detector)
    return torch.as_tensor(np.where(keypoints.placed, 1.0, weights))


def lifted_keypoints(keypoints: Keypoints, camera: Camera, frame_rate: float) -> LiftedClip:
    """What the lifter says.

    Args:
        keypoints: of a clip, with swapped sides swapped back.
        camera: of the clip.
        frame_rate: frames per second.
    """
    confidence = seen_confidence(keypoints, camera)
    return lift(keypoints.xy, confidence, camera, frame_rate, calibrated=camera.calibrated)


def as_tensor(a: np.ndarray, *, dtype: torch.dtype, device: torch.device) -> Tensor:
    """The array in a fit's type and on its device."""
    a = np.asarray(a)
    # torch warns of arrays that cannot be written, as those of a project are.
    a = a if a.flags.writeable else a.copy()
    return torch.as_tensor(a, dtype=dtype, device=device)
