"""The lifter's input: keypoints as rays before a virtual camera that looks at the person."""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core import keypoints as kp

POINTS = len(kp.BODY_25)
N_FEATURES = 3 * POINTS + 5
SEEN = 0.05
"""Confidence above which a keypoint counts as seen."""
_TRUNK = [kp.INDEX[n] for n in ("nose", "neck", "right_shoulder", "left_shoulder", "mid_hip", "right_hip", "left_hip")]
_OF_LIMBS = 0.05
"""Weight of keypoints outside the trunk in the window's centre and extent."""
_EXTENT = 0.5
_FARTHEST = 6.0
"""In extents from the centre: a keypoint farther away is an outlier."""


class Seen(NamedTuple):
    """Windows of keypoints as the network takes them."""

    features: Float[Tensor, "B T F"]
    to_virtual: Float[Tensor, "B 3 3"]
    """From the camera's axes to those of the virtual camera, which looks at the person: x right, y down, z away."""


def seen(rays: Float[Tensor, "B T 25 2"], confidence: Float[Tensor, "B T 25"], calibrated: Float[Tensor, "B"]) -> Seen:
    """Windows as the network takes them.

    Args:
        rays: x / z and y / z of each keypoint in camera space; anything where confidence is 0.
        confidence: 0 for keypoints not found.
        calibrated: 1 if the focal length is known, 0 if it is guessed.
    """
    there = (confidence > SEEN).to(rays)
    centre, weight = _centre(rays, confidence * there)
    to_virtual = _looking_at(centre)
    # Rows of to_virtual are the virtual camera's axes: ray' = to_virtual ray, then back to the plane z = 1.
    around = torch.cat([rays, torch.ones_like(rays[..., :1])], -1) @ to_virtual[:, None].mT
    flat = around[..., :2] / around[..., 2:].clamp_min(0.05)
    extent = _extent(flat, weight)
    # Distances in extents: the network sees a person of one size, and the true one as log(extent).
    scaled = (_EXTENT * flat / extent[:, None, None, None] * there[..., None]).clamp(-_FARTHEST, _FARTHEST)
    whole = torch.stack([extent.log(), *torch.unbind(to_virtual[:, 2], -1), calibrated], -1)
    parts = [scaled.flatten(2), confidence * there, whole[:, None].expand(-1, rays.shape[1], -1)]
    return Seen(torch.cat(parts, 2), to_virtual)


def _centre(rays: Tensor, confidence: Tensor) -> tuple[Tensor, Tensor]:
    """Of the trunk over the window, and the weights of its keypoints."""
    of_trunk = torch.full((POINTS,), _OF_LIMBS).to(rays)
    of_trunk[_TRUNK] = 1.0
    weight = (confidence * of_trunk)[..., None]
    return (rays * weight).sum((1, 2)) / weight.sum((1, 2)).clamp_min(1e-6), weight


def _looking_at(centre: Float[Tensor, "B 2"]) -> Float[Tensor, "B 3 3"]:
    """Rows: the axes of a camera that looks there, without roll relative to the real one."""
    ahead = torch.nn.functional.normalize(torch.cat([centre, torch.ones_like(centre[:, :1])], 1), dim=1)
    # y (down) x ahead, without y: the horizontal direction to the right.
    level = torch.stack([ahead[:, 2], torch.zeros_like(ahead[:, 0]), -ahead[:, 0]], 1)
    right = torch.nn.functional.normalize(level, dim=1)
    return torch.stack([right, torch.linalg.cross(ahead, right), ahead], 1)


def _extent(flat: Float[Tensor, "B T 25 2"], weight: Float[Tensor, "B T 25 1"]) -> Float[Tensor, "B"]:
    """Root mean square distance of the trunk's keypoints from their centre in each frame."""
    total = weight.sum(2, keepdim=True).clamp_min(1e-6)
    own = (flat * weight).sum(2, keepdim=True) / total
    squared = ((flat - own).square() * weight).sum((1, 2, 3)) / weight.sum((1, 2, 3)).clamp_min(1e-6)
    return squared.clamp_min(1e-8).sqrt()
