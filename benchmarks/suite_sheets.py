"""Contact sheets of the suite, from its cameras and from the side, and its sequences as files that anything can fit.

python -m benchmarks.suite_sheets --out FOLDER [NAMES] [--level hard] [--export] [--video]
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro
from jaxtyping import UInt8
from tqdm import tqdm

from evaluation.synthetic.studio.view import View
from evaluation.synthetic.suite import LEVELS, SEQUENCES, SuiteClip, make_sequence
from fitting_core.camera import Camera
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.io.truth import write_truth
from fitting_core.keypoints import BODY, BONES
from fitting_core.video.encoding import video_writer
from tests.samples.suite_pictures import render_frames

_COLUMNS, _SIZE = 8, (270, 360)
_SIDE = View(azimuth=100.0, height=0.7, distance=4.0, looking_at=(0.1, 0.75, 0.0))
_SIDE_FOCAL = (600.0, 600.0)
"""Pixels: a standing person fills three quarters of the height."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to draw and write."""

    out: Path
    """Folder for the sheets; made if it is missing."""
    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Sequences; none: all."""
    level: Annotated[str, tyro.conf.arg(help=f"One of {', '.join(LEVELS)}.")] = "normal"
    """Of the detections."""
    frames: int = 16
    """On each sheet."""
    export: bool = False
    """Also write OpenPose JSON and truth.npz, in a folder for each sequence."""
    video: bool = False
    """Also write the video."""


def main(options: Options) -> None:
    """Draw a sheet for each sequence, and write what else is asked for."""
    options.out.mkdir(parents=True, exist_ok=True)
    for name in tqdm(options.names or tuple(SEQUENCES), unit="sequence"):
        made = make_sequence(SEQUENCES[name], options.level)
        picture = sheet(made, options.frames)
        cv2.imwrite(str(options.out / f"{name}_{options.level}.png"), picture[..., ::-1])
        folder = options.out / made.clip.name
        if options.export:
            folder.mkdir(exist_ok=True)
            write_openpose(folder / "keypoints", made.clip.keypoints, name=made.clip.name)
            write_truth(folder / "truth.npz", made.truth)
        if options.video:
            folder.mkdir(exist_ok=True)
            write_video(folder / "video.mp4", made)


def sheet(made: SuiteClip, count: int) -> UInt8[np.ndarray, "H W 3"]:
    """Frames from the sequence's camera with what was detected of the body, each above the same from the side."""
    frames = np.linspace(0, len(made.clip) - 1, count).round().astype(int).tolist()
    camera = _small(made.truth.camera)
    front = list(render_frames(made, frames, camera=camera))
    side = list(render_frames(made, frames, camera=replace(camera, focal=_SIDE_FOCAL), view=_SIDE))
    front = [_marked(picture, made, frame) for picture, frame in zip(front, frames, strict=True)]
    rows = [
        np.concatenate(pictures[start : start + _COLUMNS], axis=1)
        for start in range(0, count, _COLUMNS)
        for pictures in (front, side)
    ]
    return np.concatenate([np.pad(row, ((0, 0), (0, rows[0].shape[1] - row.shape[1]), (0, 0))) for row in rows])


def _small(camera: Camera) -> Camera:
    scale = _SIZE[1] / camera.size[1]
    focal = (scale * camera.focal[0], scale * camera.focal[1])
    return replace(camera, focal=focal, center=(_SIZE[0] / 2, _SIZE[1] / 2), size=_SIZE)


def _marked(picture: np.ndarray, made: SuiteClip, frame: int) -> np.ndarray:
    """With the frame's number, and the body's detections: green where sure, red where not."""
    picture = picture.copy()
    cv2.putText(picture, str(frame), (4, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 0), 1, cv2.LINE_AA)
    points = made.clip.keypoints.xy[frame] * _SIZE[1] / made.truth.camera.size[1]
    confidence = made.clip.keypoints.confidence[frame]
    for a, b in BONES:
        if max(a, b) < BODY.stop and min(confidence[a], confidence[b]) > 0:
            sure = float(min(confidence[a], confidence[b]))
            color = (int(255 * (1 - sure)), int(255 * sure), 60)
            ends = [tuple(round(float(v)) for v in points[i]) for i in (a, b)]
            cv2.line(picture, ends[0], ends[1], color, 1, cv2.LINE_AA)
    return picture


def write_video(path: Path, made: SuiteClip) -> None:
    """The sequence's frames in full size (about 0.3 s a frame)."""
    with video_writer(path, made.truth.camera.size, made.truth.frame_rate) as video:
        for picture in render_frames(made, list(range(len(made.clip)))):
            video.write(picture)


if __name__ == "__main__":
    main(tyro.cli(Options))
