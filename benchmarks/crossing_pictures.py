"""Whether people who cross are told apart in pictures: scenes of `crossing_people`, rendered and detected."""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from tyro.conf import OmitArgPrefixes

from benchmarks.crossing_people import row
from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.motion_suite.windows import FRAME_RATE
from evaluation.synthetic.studio.clothing import Outfit
from evaluation.synthetic.studio.studio import Studio
from evaluation.synthetic.studio.view import View
from fitting_core.body.geometry import vertex_normals
from fitting_core.body.mesh import shared_mesh
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera
from fitting_core.detect.detecting import Detected, Detection
from fitting_core.detect.detectors import DEFAULT, find_detector
from fitting_core.detect.found import found_detections
from fitting_core.detect.stored import StoredDetection
from fitting_core.keypoints import BODY
from fitting_core.video.frames import FrameSource
from tests.samples.company.filmed import CAMERA, Acting, Company, rehearsed
from tests.samples.company.scenes import SCENES
from tests.samples.company.telling_apart import told_apart

_SMALL = 0.5
"""Of the scenes' pictures: rendering takes a second a frame at their size."""
_SAME = 0.25
"""Median distance to somebody's true points, in their height, up to which a detection is theirs."""


@dataclass(frozen=True, kw_only=True)
class CrossingPictures:
    """What to measure."""

    seeds: tuple[int, int] = (0, 1)
    """From the first on, up to before the second."""
    scenes: tuple[str, ...] = tuple(SCENES)
    detector: str = DEFAULT
    pictures: Path | None = None
    """Folder for the pictures, to look at; None: they are thrown away."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def rendered(view: View, cast: list[Acting], camera: Camera) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """The pictures of a scene, all in the same clothes."""
    studio, outfit = Studio(camera, seat_height=None, view=view), Outfit.of(cast[0].body)
    sizes = np.cumsum([0, *(len(one.body.template) for one in cast)])[:-1]
    faces = np.concatenate([one.body.faces + size for one, size in zip(cast, sizes, strict=True)])
    everybody = replace(outfit, paint=np.concatenate([Outfit.of(one.body).paint for one in cast]))
    moved = [one.moved(shared_mesh(one.body)(one.params).numpy()[one.which]) for one in cast]
    for t in range(len(cast[0].which)):
        vertices = np.concatenate([points[t] for points in moved]).astype(float)
        yield studio.draw(vertices, faces, vertex_normals(vertices, faces), everybody)[0]


def filmed(options: CrossingPictures, scene: str, seed: int, folder: Path) -> Company:
    """A scene as a detector finds it in pictures."""
    view, cast = rehearsed(np.random.default_rng([list(SCENES).index(scene), seed]), scene)
    width, height = (int(side * _SMALL) for side in CAMERA.size)
    focal, center = CAMERA.focal[0] * _SMALL, (CAMERA.center[0] * _SMALL, CAMERA.center[1] * _SMALL)
    camera = replace(CAMERA, focal=(focal, focal), center=center, size=(width, height))
    folder.mkdir(parents=True, exist_ok=True)
    for t, image in enumerate(rendered(view, cast, camera)):
        cv2.imwrite(str(folder / f"{t:04}.png"), image[..., ::-1])
    seen = [one.moved(keypoints_in_space(one.body, one.params)[0][one.which]) for one in cast]
    points = np.stack([view.pose()(those) for those in seen])
    with FrameSource(folder) as source, tempfile.TemporaryDirectory() as kept:
        made = Detection(source=source, frames=range(len(source)), detector=find_detector(options.detector))
        *_, found = made.events(StoredDetection(made.settings(), Path(kept)))
    assert isinstance(found, Detected)
    true = points[..., BODY, :2] / points[..., BODY, 2:] * focal + np.array(center)
    return Company(
        detections=replace(found_detections(found, folder), frame_rate=FRAME_RATE),
        owners=tuple(owners(people, true[:, t]) for t, people in enumerate(found.people)),
        camera=camera,
        frame_rate=FRAME_RATE,
        points=points,
    )


def owners(people: Float[np.ndarray, "P 137 3"], true: Float[np.ndarray, "Q 25 2"]) -> tuple[int, ...]:
    """Whose each detection of a frame is; -1: nobody's."""
    found = []
    for one in people[:, BODY]:
        sure = one[:, 2] > 0
        apart = np.median(np.linalg.norm(one[sure, :2] - true[:, sure], axis=-1), axis=1) / np.ptp(true[..., 1], axis=1)
        found.append(int(apart.argmin()) if apart.min() < _SAME else -1)
    return tuple(found)


def rows(options: CrossingPictures) -> list[Row]:
    """A line for each scene."""
    found = []
    with tempfile.TemporaryDirectory() as scratch:
        for scene in options.scenes:
            progress(scene)
            folder = options.pictures or Path(scratch)
            names = ((seed, folder / f"{scene}-{seed}") for seed in range(*options.seeds))
            found.append(row(scene, [told_apart(filmed(options, scene, seed, name)) for seed, name in names]))
    return found


def run(options: CrossingPictures) -> None:
    """Renders, detects, follows everybody, and reports."""
    report(options, {f"Who is who in pictures, by {options.detector}": rows(options)})


if __name__ == "__main__":
    start(CrossingPictures, run)
