"""Correct keypoints from a script: mark those that jump as wrong, and fit the frames around them again.

python examples/correct_keypoints.py walk.mp4 walk-fit
"""

import sys

import numpy as np

from fitting_core import PRESETS, find_body, fit_clip, load_body, read_clip, refit, write_result
from fitting_core.keypoints import INDEX

POINT, JUMP = "right_wrist", 0.15
"""The point to check, and how far it may be from the middle of its neighbours, as a fraction of the image's height."""


def main(video: str, folder: str) -> None:
    clip, body = read_clip(video), load_body(find_body(gender="neutral"))
    result = fit_clip(clip, body, PRESETS["tcfit"])

    xy = clip.keypoints.xy[:, INDEX[POINT]]
    off = np.linalg.norm(xy[1:-1] - (xy[:-2] + xy[2:]) / 2, axis=1) / clip.camera.size[1]
    wrong = [int(frame) + 1 for frame in np.flatnonzero(off > JUMP)]
    for frame in wrong:
        clip = clip.corrected(frame, {POINT: None})  # None: wrong, and the true place is unknown
        # clip.corrected(frame, {POINT: (480.0, 520.0)}) would give the true place, in pixels.
        around = range(max(frame - 3, 0), min(frame + 4, len(clip)))
        result = refit(clip, body, result, around)
    write_result(folder, result, clip, body)
    print(f"{POINT} corrected in frames {wrong}, wrote {folder}")


if __name__ == "__main__":
    main(*sys.argv[1:])
