"""Two people of one clip as projects, who stand beside each other, each with a fit that is the truth."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.clip import Clip
from fitting_core.io.people_file import People, Person, write_people_file
from fitting_core.keypoints import BODY, COUNT, Keypoints
from fitting_core.results.fit_result import FitResult, PhaseResult
from tcfit_app.fitting.bodies import record_of
from tcfit_app.project.people import OpenPeople, opened_people
from tcfit_app.project.project import Project
from tests.samples.project_samples import CONFIG

CAMERA = Camera(focal=(500.0, 500.0), center=(320.0, 240.0), size=(640, 480))
FRAMES = 12
LATE = 4
"""The first frame, by number in the video, in which the second person is there."""
PLACES = (-0.9, 0.8)
"""Metres right of the camera."""


def motion(person: int, frames: int) -> BodyParams:
    """Somebody 4.5 m away, who raises an arm."""
    params = BodyParams.neutral(frames)
    params.global_orient[:, 0] = torch.pi
    params.camera_translation[:] = torch.tensor([PLACES[person], -0.3, 4.5])
    params.body_pose[:, 3 * (15 + person) + 2] = torch.linspace(-1.0, 0.2, frames) * (1 - 2 * person)
    return params


def clip_of(body: BodyModel, person: int, source: Path | None) -> Clip:
    """Its keypoints are the motion's, without noise."""
    first = LATE * person
    params = motion(person, FRAMES - first)
    points, exists = keypoints_in_space(body, params)
    seen = exists & (np.arange(COUNT) < BODY.stop)
    xy = np.zeros((FRAMES - first, COUNT, 2))
    xy[:, seen] = project(CAMERA, torch.as_tensor(points[:, seen])).numpy()
    return Clip(
        keypoints=Keypoints(xy=xy, confidence=np.tile(0.9 * seen, (FRAMES - first, 1))),
        camera=CAMERA,
        frame_rate=25.0,
        name=f"talk {person + 1}",
        first_frame=first,
        source=source,
    )


def truth_of(clip: Clip, person: int) -> FitResult:
    """The motion as a result."""
    phase = PhaseResult(
        phase=1,
        params=motion(person, len(clip)),
        objective={"data": 1.0, "total": 1.0},
        frame_cost=np.ones(len(clip)),
        seconds=1.0,
        notes=(),
        provenance=None,
    )
    return FitResult(
        phases=tuple(replace(phase, phase=number) for number in (1, 2, 3)),
        camera=clip.camera,
        config=CONFIG,
        observed=np.ones((len(clip), 55), bool),
        warnings=(),
        pose_prior="relaxed",
        grounding=None,
    )


def two_people(folder: Path, body: BodyModel, *, fitted: bool = True) -> Path:
    """A folder of two people, the second of whom comes later, and may be the first one in the last frames."""
    images = folder / "images"
    images.mkdir(parents=True)
    for number in range(FRAMES):
        picture = np.full((CAMERA.size[1], CAMERA.size[0], 3), 70, np.uint8)
        cv2.putText(picture, str(number), (20, 60), cv2.FONT_HERSHEY_SIMPLEX, 2, (140, 140, 140), 3)
        cv2.imwrite(str(images / f"{number:03d}.png"), picture)
    people = []
    for person in range(len(PLACES)):
        clip = clip_of(body, person, images)
        name = f"person-{person + 1}"
        with Project.create(folder / name, clip) as made:
            if fitted:
                run = made.runs.start(CONFIG, body=record_of(body), edits_seen=0, name="truth")
                made.runs.finish(run.id, truth_of(clip, person))
        last = clip.first_frame + len(clip) - 1
        uncertain = ((9, last),) if person else ()
        people.append(
            Person(name=name.replace("-", " "), folder=name, frames=(clip.first_frame, last), uncertain=uncertain)
        )
    write_people_file(folder, People(name="talk", people=tuple(people)))
    return folder


@contextmanager
def open_two(folder: Path, *, read_only: bool = False) -> Iterator[OpenPeople]:
    """The projects of such a folder."""
    with opened_people(folder, lambda one: Project.open(one, read_only=read_only), print) as people:
        yield people
