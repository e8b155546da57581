"""Fit a range again with another w_T, the weight of the temporal term: python examples/refit_range.py walk.mp4 1 3 1000

The other frames and the shape stay as they are, bit for bit.
"""

import sys
from dataclasses import replace

import numpy as np

from fitting_core import PRESETS, find_body, fit_clip, joints_in_space, load_body, read_clip, refit


def main(video: str, first: str, last: str, weight: str) -> None:
    clip, body = read_clip(video), load_body(find_body(gender="neutral"))
    before = fit_clip(clip, body, PRESETS["tcfit"])

    config = PRESETS["tcfit"]
    smoother = replace(config, temporal=replace(config.temporal, weight=float(weight)))
    frames = range(int(first), int(last) + 1)  # counted from the clip's first frame, 0
    after = refit(clip, body, before, frames, config=smoother)

    def jitter(joints: np.ndarray) -> float:
        """Mean second difference of the body's joints, mm per frame²."""
        return 1e3 * float(np.linalg.norm(np.diff(joints[:, :22], 2, axis=0), axis=-1).mean())

    old, new = (joints_in_space(body, result.last.params) for result in (before, after))
    moved = 1e3 * np.linalg.norm(new - old, axis=-1).mean(1)
    print(f"w_T {config.temporal.weight:g} to {smoother.temporal.weight:g} in frames {first} to {last}")
    print(f"jitter {jitter(old):.2f} to {jitter(new):.2f} mm/frame²; joints moved by up to {moved.max():.2f} mm")
    assert all(moved[frame] == 0 for frame in range(len(clip)) if frame not in frames)


if __name__ == "__main__":
    main(*sys.argv[1:])
