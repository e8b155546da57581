"""A video of three spots that move like a person's points, a model that finds them, and the same as keypoint files."""

from pathlib import Path

import cv2
import numpy as np

from fitting_core.clips.options import ClipOptions
from fitting_core.clips.reading import read_footage
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.keypoints import COUNT, Keypoints
from tcfit_app.project.project import Project
from tests.fitting_core.detect.onnx_files import brightest_model, spots

FRAMES, SIZE = 40, (160, 120)


def place(t: int) -> tuple[float, float]:
    """Where the middle of the spots is."""
    return 40 + 2.0 * t, 60.0


def nose(t: int) -> tuple[float, float]:
    """Where the red spot is, which `spot_model` takes for the nose."""
    return place(t)[0], place(t)[1] - 20


def spot_video(folder: Path) -> Path:
    """A folder of images."""
    folder.mkdir(parents=True)
    for t in range(FRAMES):
        x, y = place(t)
        image = spots(SIZE, {0: nose(t), 1: (x + 14, y), 2: (x - 14, y + 20)}, sigma=4.0)
        cv2.imwrite(str(folder / f"{t}.png"), image[..., ::-1])
    return folder


def spot_model(path: Path) -> Path:
    """A whole-body model that finds the spots."""
    return brightest_model(path, size=(96, 128))


def empty_project(folder: Path, video: Path) -> Path:
    """A project of the video without keypoints."""
    Project.create(folder, read_footage(video, clip=ClipOptions(frame_rate=25))).close()
    return folder


def imported_xy() -> np.ndarray:
    """Positions of a person who walks: the points lie around `place`."""
    around = np.random.default_rng(0).uniform(-30, 30, (COUNT, 2))
    return np.array([place(t) for t in range(FRAMES)])[:, None] + around


def two_people(frame: int) -> np.ndarray:
    """What a detector finds: a large one who walks, and a small one at the side."""
    points = np.zeros((2, COUNT, 3))
    for who, (middle, size) in enumerate(((nose(frame), 30.0), ((20.0, 60.0), 12.0))):
        around = np.random.default_rng(who).uniform(-1, 1, (25, 2))
        points[who, :25] = np.column_stack([around * size + middle, np.full(25, 0.9)])
    return points


def keypoint_files(folder: Path) -> Path:
    """These positions as OpenPose JSON."""
    keypoints = Keypoints(xy=imported_xy(), confidence=np.full((FRAMES, COUNT), 0.75))
    write_openpose(folder, keypoints, name="walk")
    return folder
