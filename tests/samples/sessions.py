"""A session over a small project on the tiny body, for tests of the review app without a browser."""

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig, ShapeSample, SolverSettings, Temporal, Weights
from fitting_core.errors import InputError
from fitting_core.fit.events import FitEvent, Iteration
from fitting_core.measure.references.reference import Reference
from fitting_core.results.fit_result import FitResult
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.fitting.reports import Notice
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import BodyRecord
from tcfit_app.review.session.session import Session
from tests.samples.scenes import arms_in_motion, clip_of, hidden, keypoints_of, noisy

FRAMES = 8
PATIENCE = 60.0
"""Seconds after which a test gives up; all of them take a small part of it."""
QUICK = FitConfig(
    weights=replace(Weights(), collision=(0.0,) * 5),
    pose_prior="relaxed",
    hip_weight=1.0,
    shape_sample=ShapeSample(size=2, stages=(5,)),
    temporal=Temporal(mode="global", stages=(5,)),
    settings=SolverSettings(iterations=4),
)


@dataclass(frozen=True)
class OneBody:
    """The tiny body as neutral SMPL-X; with no body, what a user without model files gets."""

    body: BodyModel | None

    def check(self, *, kind: str, gender: str) -> None:
        if self.body is None or (kind, gender) != ("smplx", "neutral"):
            raise InputError(f"There is no {gender} {kind} body. Put <{kind.upper()}>.npz there.")

    def find(self, *, kind: str = "smplx", gender: str = "neutral") -> BodyModel:
        self.check(kind=kind, gender=gender)
        assert self.body is not None
        return self.body

    def of_reference(self, reference: Reference) -> BodyModel | None:
        return None if reference.body is None else self.body

    def of(self, record: BodyRecord) -> BodyModel:
        return self.find()


@cache
def small_clip(body: BodyModel, frames: int = FRAMES) -> Clip:
    return clip_of(hidden(noisy(keypoints_of(body, arms_in_motion(frames)), 2.0), kp.HANDS, kp.FACE))


@contextmanager
def session_of(folder: Path, body: BodyModel | None, *, read_only: bool = False) -> Iterator[Session]:
    """A session on a project that exists; what it tells is in `told(session)`."""
    with Project.open(folder, read_only=read_only) as project:
        session: Any = Session(project, OneBody(body))  # pyright: ignore[reportArgumentType]
        session.told = []
        session.tell = session.told.append
        try:
            yield session
        finally:
            session.close()


def told(session: Session) -> list[Notice]:
    return session.told  # pyright: ignore[reportAttributeAccessIssue]


def until(session: Session, condition: Callable[[], Any]) -> None:
    """Let the worker work until something is so."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.005)
        session.take_news()


def idle(session: Session) -> None:
    until(session, lambda: not session.jobs and not session.edit_follower.busy)


def newest(session: Session) -> Shown:
    shown = session.fits.show(FitChoice())
    assert shown is not None
    return shown


class _Endless:
    """A job that does nothing until it is cancelled."""

    title, phases = "endless", (3,)

    def run(self) -> Generator[FitEvent, None, FitResult]:
        while True:
            time.sleep(0.002)
            yield Iteration(phase=3, label="", share=0.0, cost=1.0)


@contextmanager
def held(session: Session) -> Iterator[None]:
    """Jobs that are submitted inside wait, as behind a long fit; drags are followed all the same."""
    number = session.worker.submit(_Endless())
    yield
    session.worker.cancel(number)
