"""Fit a video and write the result: python examples/fit_video.py walk.mp4 walk-fit"""

import sys

from fitting_core import PRESETS, CameraOptions, InputError, Iteration, find_body, load_body, read_clip, write_result
from fitting_core.fit.events import drained, mapped
from fitting_core.fit.fitting import fit_events


def show(event: object) -> None:
    """Print the progress, on one line."""
    if isinstance(event, Iteration):
        print(f"\rphase {event.phase}: {event.share:4.0%}", end="", flush=True)


def main(video: str, folder: str) -> None:
    # A detector finds the keypoints. Most phones have a lens of 26 mm; leave `camera` out if you do not know yours.
    clip = read_clip(video, camera=CameraOptions(focal_length_35mm=26.0))
    body = load_body(find_body(gender="neutral"))
    result = drained(mapped(fit_events(clip, body, PRESETS["tcfit"]), show))
    write_result(folder, result, clip, body)
    print(f"\n{len(clip)} frames, wrote {folder}/fit.npz")
    for note in (*clip.notes, *result.warnings):
        print("note:", note)


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except InputError as error:
        sys.exit(str(error))
