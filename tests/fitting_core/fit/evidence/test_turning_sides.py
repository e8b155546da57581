"""Sides of people who turn round: nothing is exchanged that was right. Swaps themselves: test_observations."""

import numpy as np
import pytest

from fitting_core import keypoints as kp
from fitting_core.fit.evidence.sides import unswapped
from fitting_core.keypoints import Keypoints

STANDING = {
    "neck": (0.0, 0.5, 0.0), "mid_hip": (0.0, 0.0, 0.0),
    "left_shoulder": (0.18, 0.48, 0.0), "left_elbow": (0.25, 0.2, -0.03), "left_wrist": (0.27, -0.02, 0.1),
    "left_hip": (0.1, 0.0, 0.0), "left_knee": (0.11, -0.42, 0.03), "left_ankle": (0.11, -0.82, -0.02),
}  # fmt: skip
"""Metres: x to the left, y up, z forward."""


def turning(step: float, frames: int, seed: int = 0) -> Keypoints:
    """Seen from 4 m by a camera of 1200 pixels, with 12 mm of noise at the body."""
    random = np.random.default_rng(seed)
    points = np.zeros((kp.COUNT, 3))
    for name, (x, y, z) in STANDING.items():
        points[kp.INDEX[name]] = (x, y, z)
        if name.startswith("left"):
            points[kp.INDEX[name.replace("left", "right")]] = (-x, y, z)
    angle = np.radians(step * np.arange(frames) + random.uniform(0, 360))
    x = np.cos(angle)[:, None] * points[:, 0] + np.sin(angle)[:, None] * points[:, 2]
    z = np.cos(angle)[:, None] * points[:, 2] - np.sin(angle)[:, None] * points[:, 0]
    place = np.stack([x, np.broadcast_to(-points[:, 1], x.shape)], -1) / (4 - z)[..., None]
    noise = random.normal(0, 0.012 / 4, place.shape)
    confidence = np.zeros((frames, kp.COUNT))
    shown = [i for name in STANDING for i in (kp.INDEX[name], kp.INDEX[name.replace("left", "right")])]
    confidence[:, shown] = 0.7
    return Keypoints(xy=600 + 1200 * (place + noise), confidence=confidence)


@pytest.mark.parametrize("step", [1, 2, 4, 8, 12, 20, 30])
@pytest.mark.parametrize("seed", range(3))
def test_who_turns_keeps_their_sides(step: float, seed: int):
    assert unswapped(turning(step, max(24, int(720 / step)), seed))[1] == {}


@pytest.mark.parametrize("step", [2, 12])
@pytest.mark.parametrize(("pair", "parts"), [("arms", ("elbow", "wrist")), ("legs", ("knee", "ankle"))])
def test_swaps_of_who_turns_are_found(step: float, pair: str, parts: tuple[str, ...]):
    true = turning(step, 60, 1)
    sides = [kp.INDEX[f"{side}_{part}"] for side in ("left", "right") for part in parts]
    wide = np.abs(true.xy[:, kp.INDEX["left_shoulder"], 0] - true.xy[:, kp.INDEX["right_shoulder"], 0])
    first = int(np.argmax(wide[5:50])) + 5
    rows = np.arange(first, first + 3)
    xy = true.xy.copy()
    xy[np.ix_(rows, sides)] = xy[np.ix_(rows, sides[2:] + sides[:2])]
    corrected, swaps = unswapped(Keypoints(xy=xy, confidence=true.confidence))
    assert {name: frames.tolist() for name, frames in swaps.items()} == {pair: rows.tolist()}
    np.testing.assert_array_equal(corrected.xy[:, sides], true.xy[:, sides])
