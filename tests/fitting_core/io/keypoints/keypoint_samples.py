"""Random keypoints for round trips: some not detected, in images of usual sizes."""

import numpy as np
from hypothesis import strategies as st

from fitting_core.keypoints import COUNT, Keypoints

SIZE = (1920, 1080)


@st.composite
def keypoints(draw: st.DrawFn) -> Keypoints:
    """One to four frames; whole frames and parts of them can be empty, and points lie outside the image."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    frames = draw(st.integers(1, 4))
    xy = rng.uniform(-200, 4000, (frames, COUNT, 2))
    confidence = rng.random((frames, COUNT)) * (rng.random((frames, COUNT)) < draw(st.sampled_from([0.2, 0.9, 1.0])))
    return Keypoints(xy=xy, confidence=confidence)


def as_points(clip: Keypoints) -> np.ndarray:
    """x, y, confidence (T, 137, 3), zero where nothing was detected."""
    return np.concatenate([clip.xy, clip.confidence[..., None]], -1) * (clip.confidence > 0)[..., None]


def by_frame(frames: tuple[np.ndarray, ...]) -> np.ndarray:
    """The first person of each frame (T, 137, 3); zero where there is none."""
    return np.stack([people[0] if len(people) else np.zeros((COUNT, 3)) for people in frames])
