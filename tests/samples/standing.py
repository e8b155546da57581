"""Keypoints of a person who stands, and what a person places by hand."""

from dataclasses import replace

import numpy as np

from fitting_core import keypoints as kp
from fitting_core.keypoints import Keypoints


def standing(frames: int = 20) -> Keypoints:
    """A person who waves: arms apart, every body keypoint well inside the image."""
    rng = np.random.default_rng(0)
    xy = np.full((frames, kp.COUNT, 2), 240.0)
    xy[:, kp.BODY] += rng.uniform(-100, 100, (25, 2))
    sway = 20 * np.sin(np.arange(frames) / 4)[:, None]
    for side, x in (("left", 420.0), ("right", 120.0)):
        for k, part in enumerate(("elbow", "wrist", "knee", "ankle")):
            xy[:, kp.INDEX[f"{side}_{part}"]] = (
                np.stack([np.full(frames, x), np.full(frames, 150.0 + 60 * k)], -1) + sway
            )
    confidence = np.zeros((frames, kp.COUNT))
    confidence[:, kp.BODY] = 0.8
    return Keypoints(xy=xy, confidence=confidence)


def by_hand(keypoints: Keypoints, names: tuple[str, ...], frames: list[int]) -> Keypoints:
    placed = keypoints.placed.copy()
    placed[np.ix_(frames, [kp.INDEX[name] for name in names])] = True
    return replace(keypoints, by_hand=placed)
