"""Films windows of motion: people of all shapes before cameras of all kinds, through a detector that errs."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from build_assets.lifter.figure import POINTS, Figure
from build_assets.lifter.motions import Motion, Windows
from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.lifting.network import FRAMES, RATE

_NEAREST = 0.35
"""Metres before the camera."""
_FACE = [kp.INDEX[n] for n in ("nose", "right_eye", "left_eye", "right_ear", "left_ear")]
_OUTWARD = torch.tensor([[0.0, 0, 1], [-0.3, 0, 1], [0.3, 0, 1], [-1, 0, 0.1], [1, 0, 0.1]])
"""Where nose, eyes and ears look, in the head's frame (x to the left, z forward)."""
_HEAD = 15
_FEET = [kp.INDEX[f"{side}_{part}"] for side in ("left", "right") for part in ("big_toe", "small_toe", "heel")]
_LIMBS = [
    [kp.INDEX[f"{side}_{name}"] for name in names]
    for side in ("left", "right")
    for names in (
        ("elbow", "wrist"), ("wrist",), ("shoulder", "elbow", "wrist"), ("eye", "ear"),
        ("knee", "ankle", "big_toe", "small_toe", "heel"), ("ankle", "big_toe", "small_toe", "heel"),
    )
]  # fmt: skip
"""Keypoints that are lost together."""
_PAIRS = [
    [(kp.INDEX[f"left_{n}"], kp.INDEX[f"right_{n}"]) for n in names]
    for names in (("elbow", "wrist"), ("knee", "ankle", "big_toe", "small_toe", "heel"))
]


def _by_point(usual: float, **others: float) -> Float[Tensor, "25"]:
    return torch.tensor([next((v for n, v in others.items() if name.endswith(n)), usual) for name in kp.BODY_25])


@dataclass(frozen=True, kw_only=True)
class DetectorErrors:
    """Errors of a detector, metres at the body along one axis of the image."""

    lasting: Float[Tensor, "25"]
    """Standard deviation of what stays for the whole clip."""
    slow: Float[Tensor, "25"]
    """Of what changes within a fifth of a second."""
    quick: float
    """Of what is new in each frame."""
    turned_away: float = 0.05
    """Of a point of the face that looks away from the camera, where it is reported at all."""
    spread: float = 0.5
    """Standard deviation of the logarithm of how good a detector is."""


OPENPOSE = DetectorErrors(
    lasting=_by_point(0.012, hip=0.03, toe=0.03, heel=0.015, wrist=0.015, elbow=0.015),
    slow=_by_point(0.011, hip=0.018, knee=0.018, elbow=0.02, toe=0.025, heel=0.015),
    quick=0.005,
)
"""As on the two balancing clips against their triangulated reference. That comes from the same detector, so what all
views get wrong alike is not in it: `lasting` is a little larger than what was measured."""


_SPEAKERS = 1 / 3
"""Share of signers and speakers: upright, before the camera, cut off at hip or chest."""
_NEAR_SPEAKERS, _NEAR_OTHERS = (0.8, 4.0), (1.5, 12.0)
"""Metres to them, and to the others: all logarithms in between are as likely."""
_ASIDE = 0.14
"""Standard deviation of where people stand beside the image's middle, as x / z."""
_GUESSED = 0.5
"""Share of the cameras whose focal length is wrong."""


class Film(NamedTuple):
    """Windows as a detector sees them, and the truth."""

    rays: Float[Tensor, "B T 25 2"]
    """With the assumed focal length."""
    confidence: Float[Tensor, "B T 25"]
    calibrated: Float[Tensor, "B"]
    points: Float[Tensor, "B T 25 3"]
    """BODY_25 relative to the pelvis joint in camera axes, metres."""
    up: Float[Tensor, "B 3"]
    """Against gravity, camera axes."""
    stands: Float[Tensor, "B T 2"]
    """As of `Motion`."""
    usable: Bool[Tensor, "B"]
    """Whether everybody stands before the camera, and enough of them is seen."""


class Studio:
    """Films windows.

    Args:
        figure: whom.
        windows: what they do.
        rng: source of all chance.
    """

    def __init__(self, figure: Figure, windows: Windows, rng: np.random.Generator) -> None:
        self.figure, self.windows, self.rng = figure, windows, rng

    def reseeded(self, seed: tuple[int, ...]) -> None:
        """From here on chance is that of another seed."""
        self.rng = self.windows.rng = np.random.default_rng(seed)

    def _uniform(self, *shape: int) -> Tensor:
        return torch.as_tensor(self.rng.random(shape), dtype=torch.float32)

    def _normal(self, *shape: int) -> Tensor:
        return torch.as_tensor(self.rng.standard_normal(shape), dtype=torch.float32)

    def film(self, count: int) -> Film:
        """Film `count` windows."""
        speaking = self.rng.random(count) < _SPEAKERS
        motion = self.windows.draw(count, upright=speaking)
        close = torch.as_tensor(speaking)
        camera = self._cameras(motion, close)
        betas = self._normal(count, 10)
        points = self.figure.pose(motion.turns.flatten(0, 1), betas.repeat_interleave(FRAMES, 0))
        relative = points.view(count, FRAMES, POINTS, 3) @ camera[:, None].mT
        path = (motion.pelvis - motion.pelvis.mean(1, keepdim=True)) @ camera.mT
        distance = torch.where(close, self._far(count, *_NEAR_SPEAKERS), self._far(count, *_NEAR_OTHERS))
        aside = _ASIDE * self._normal(count, 2)
        centre = torch.cat([aside, torch.ones(count, 1)], 1) * distance[:, None]
        placed = relative + (path + centre[:, None])[:, :, None]
        depth = placed[..., 2]
        exact = placed[..., :2] / depth.clamp_min(_NEAREST)[..., None]
        head = camera[:, None] @ self._head(motion)
        confidence = self._confidence(count) * self._facing(head, placed)
        found = exact + self._errors(confidence) / distance[:, None, None, None]
        found, confidence = self._failures(found, confidence, distance)
        confidence = torch.where(self._cut(exact, close) | (confidence < 0.08), 0.0, confidence)
        seen = (confidence > 0).sum(2) >= 4
        calibrated = (self._uniform(count) >= _GUESSED).float()
        focal = torch.where(calibrated == 1, 1.0, torch.exp(0.3 * self._normal(count)).clamp(0.5, 2.0))
        return Film(
            rays=found * focal[:, None, None, None],
            confidence=confidence,
            calibrated=calibrated,
            points=relative,
            up=camera[:, :, 1],
            stands=motion.stands,
            usable=(depth > _NEAREST).all(2).all(1) & (seen.float().mean(1) > 0.7),
        )

    def _far(self, count: int, nearest: float, farthest: float) -> Float[Tensor, "B"]:
        return nearest * (farthest / nearest) ** self._uniform(count)

    def _cameras(self, motion: Motion, close: Bool[Tensor, "B"]) -> Float[Tensor, "B 3 3"]:
        """World (y up) to camera axes (x right, y down, z away): all around, from above and below; speakers from the
        front."""
        count = len(close)
        turn = 2 * np.pi * self._uniform(count)
        facing = motion.turns[:, FRAMES // 2, 0, :, 2]
        turn = torch.where(close, 0.4 * self._normal(count) - torch.atan2(facing[:, 0], facing[:, 2]), turn)
        steep = torch.where(self._uniform(count) < 0.6, 4 + 9 * self._normal(count), -25 + 70 * self._uniform(count))
        steep = torch.where(close, 4 + 8 * self._normal(count), steep)
        angles = torch.deg2rad(torch.stack([steep, 3 * self._normal(count)], 1))
        zero = torch.zeros(count)
        level = rotations.exp(torch.stack([zero, turn, zero], 1))
        pitched = rotations.exp(torch.stack([angles[:, 0], zero, zero], 1))
        rolled = rotations.exp(torch.stack([zero, zero, angles[:, 1]], 1))
        upside = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
        return rolled @ pitched @ upside @ level

    def _head(self, motion: Motion) -> Float[Tensor, "B T 3 3"]:
        """World rotation of the head."""
        world = motion.turns[:, :, 0]
        for joint in (3, 6, 9, 12, _HEAD):  # spine1 to spine3, neck, head
            world = world @ motion.turns[:, :, joint]
        return world

    def _facing(self, head: Float[Tensor, "B T 3 3"], placed: Tensor) -> Float[Tensor, "B T 25"]:
        """1, and less for points of the face that look away from the camera."""
        share = torch.ones(placed.shape[:3])
        outward = torch.nn.functional.normalize(_OUTWARD, dim=1) @ head.mT
        towards = -torch.nn.functional.normalize(placed[:, :, _FACE], dim=-1)
        share[:, :, _FACE] = torch.sigmoid(8 * ((outward * towards).sum(-1) + 0.1)).clamp_min(0.05)
        return share

    def _wander(self, count: int, channels: int, seconds: float) -> Float[Tensor, "B T C"]:
        """Noise of variance 1 that forgets within some seconds."""
        keep = float(np.exp(-1 / (RATE * seconds)))
        noise = self._normal(count, FRAMES, channels)
        for frame in range(1, FRAMES):
            noise[:, frame] = keep * noise[:, frame - 1] + (1 - keep**2) ** 0.5 * noise[:, frame]
        return noise

    def _confidence(self, count: int) -> Float[Tensor, "B T 25"]:
        """Of points in view: another level for each detector, and dips."""
        level = 0.75 + 0.1 * self._normal(count, 1, 1) + 0.06 * self._normal(count, 1, POINTS)
        dips = self._wander(count, POINTS, 0.5) + 0.7 * self._normal(count, 1, 1)
        wandering = level + 0.05 * self._wander(count, POINTS, 0.3)
        return wandering.clamp(0.15, 1.0) * torch.sigmoid(3 * (2.2 - dips))

    def _errors(self, confidence: Float[Tensor, "B T 25"]) -> Float[Tensor, "B T 25 2"]:
        """Metres at the body: more where confidence is low."""
        errors, count = OPENPOSE, len(confidence)
        quality = torch.exp(errors.spread * self._normal(count, 1, 1, 1))
        lasts = errors.lasting[:, None] * self._normal(count, 1, POINTS, 2)
        wanders = errors.slow[:, None] * self._wander(count, 2 * POINTS, 0.1).view(count, FRAMES, POINTS, 2)
        trembles = errors.quick * self._normal(count, FRAMES, POINTS, 2)
        doubt = (1 - confidence)[..., None] ** 2
        of_face = torch.zeros(POINTS, 1)
        of_face[_FACE] = 1.0
        unsure = (
            doubt * of_face * errors.turned_away * self._wander(count, 2 * POINTS, 0.4).view(count, FRAMES, POINTS, 2)
        )
        return quality * (lasts + (1 + 3 * doubt) * (wanders + trembles)) + unsure

    def _failures(self, found: Tensor, confidence: Tensor, distance: Tensor) -> tuple[Tensor, Tensor]:
        """Limbs that are lost or guessed, sides that are swapped, feet and single points that are never found."""
        found, confidence, rng = found.clone(), confidence.clone(), self.rng
        for b in range(len(found)):
            for _ in range(rng.integers(0, 3) if rng.random() < 0.5 else 0):
                limb, begin = _LIMBS[rng.integers(len(_LIMBS))], rng.integers(FRAMES)
                rows = slice(begin, begin + rng.integers(1, FRAMES))
                if rng.random() < 0.5:
                    confidence[b, rows, limb] = 0.0
                else:
                    confidence[b, rows, limb] *= 0.45
                    found[b, rows, limb] += rng.normal(0, 0.1) / float(distance[b]) * self._normal(2)
            if rng.random() < 0.1:
                begin = rng.integers(FRAMES)
                rows = slice(begin, begin + rng.integers(1, 6))
                for one, other in _PAIRS[rng.integers(len(_PAIRS))]:
                    for values in (found, confidence):
                        values[b, rows, [one, other]] = values[b, rows, [other, one]].clone()
            if rng.random() < 0.15:
                confidence[b, :, _FEET] = 0.0
            if rng.random() < 0.1:
                confidence[b, :, rng.integers(POINTS)] = 0.0
        return found, confidence

    def _cut(self, exact: Float[Tensor, "B T 25 2"], close: Bool[Tensor, "B"]) -> Bool[Tensor, "B T 25"]:
        """What lies outside the image: of speakers all below hip or chest, of others all below or beside any line."""
        count = len(close)
        y, x = exact[..., 1], exact[..., 0]
        low, high = y.amin((1, 2)), y.amax((1, 2))
        share = torch.where(close, 0.33 + 0.25 * self._uniform(count), 0.3 + 0.65 * self._uniform(count))
        chance = torch.where(close, 0.9, 0.35)
        cut = (self._uniform(count) < chance)[:, None, None] & (y > (low + (high - low) * share)[:, None, None])
        left, right = x.amin((1, 2)), x.amax((1, 2))
        line = left + (right - left) * (0.55 + 0.4 * self._uniform(count))
        beside = (self._uniform(count) < 0.08)[:, None, None] & (x > line[:, None, None])
        above = (self._uniform(count) < 0.05)[:, None, None] & (y < (low + 0.25 * (high - low))[:, None, None])
        return cut | beside | above
