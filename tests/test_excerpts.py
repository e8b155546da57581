"""Clips made of the frames of another one."""

import numpy as np

from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.keypoints import COUNT, Keypoints
from tests.samples.excerpts import mirrored, picked, spread

CAMERA = Camera(focal=(500.0, 500.0), center=(320.0, 240.0), size=(640, 480))


def counted(frames: int) -> Clip:
    """A clip whose frame t has the position t, the confidence t / 10, and in odd frames a point placed by hand."""
    numbers = np.arange(frames, dtype=float)
    by_hand = np.zeros((frames, COUNT), bool)
    by_hand[1::2, 3] = True
    keypoints = Keypoints(
        xy=np.broadcast_to(numbers[:, None, None], (frames, COUNT, 2)),
        confidence=np.broadcast_to(numbers[:, None] / 10, (frames, COUNT)),
        by_hand=by_hand,
    )
    return Clip(keypoints=keypoints, camera=CAMERA, frame_rate=25.0, name="counted")


def test_picked_frames_are_whole():
    clip = picked(counted(6), [5, 0, 5, 2])
    assert clip.keypoints.xy[:, 0, 0].tolist() == [5, 0, 5, 2]
    assert clip.keypoints.confidence[:, 0].tolist() == [0.5, 0, 0.5, 0.2]
    assert clip.keypoints.placed[:, 3].tolist() == [True, False, True, False] and clip.keypoints.placed.sum() == 2


def test_a_mirrored_clip_plays_forwards_and_backwards():
    clip = mirrored(counted(6), 3, 8)
    assert clip.keypoints.xy[:, 0, 0].tolist() == [0, 1, 2, 2, 1, 0, 0, 1]
    assert clip.keypoints.placed[:, 3].tolist() == [False, True, False, False, True, False, False, True]


def test_spread_frames_keep_both_ends():
    assert spread(np.arange(10, 20), 4).tolist() == [10, 13, 16, 19]
    assert spread(np.arange(3), 9).tolist() == [0, 1, 2]
