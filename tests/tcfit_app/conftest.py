"""A tiny clip on the free body, options that fit it in about a second, and that fit."""

import io
from collections.abc import Callable, Iterator
from contextlib import ExitStack, redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import torch
import viser

from evaluation.synthetic.demo_clip import make_demo
from fitting_core import camera
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera
from fitting_core.clips.options import CameraOptions
from fitting_core.clips.reading import read_clip
from fitting_core.config.schema import FitConfig
from fitting_core.fit.events import Finished, FitEvent, PhaseFinished
from fitting_core.fit.fitting import fit_events
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.keypoints import BODY, COUNT, Keypoints
from tcfit_app.cli import fit_command
from tcfit_app.cli.main import main
from tcfit_app.project.project import Project
from tests.drivers.browser import chromium
from tests.drivers.lone_page import LonePage, lone_page
from tests.samples import sessions
from tests.samples.project_samples import sample_clip

if TYPE_CHECKING:
    from playwright.sync_api import Browser

FRAMES = 6
CAMERA = Camera(focal=(800.0, 800.0), center=(320.0, 240.0), size=(640, 480))


def motion() -> BodyParams:
    """A person 4.5 m away who raises an arm over six frames."""
    params = BodyParams.neutral(FRAMES)
    params.global_orient[:, 0] = torch.pi
    params.camera_translation[:] = torch.tensor([0.0, -0.3, 4.5])
    params.body_pose[:, 3 * 15 + 2] = torch.linspace(-1.0, 0.2, FRAMES)
    return params


@pytest.fixture(scope="session")
def fitted_walk(tiny_body: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project of a small clip with one whole fit; not to be changed."""
    folder = tmp_path_factory.mktemp("fitted") / "walk.tcfit"
    Project.create(folder, sessions.small_clip(tiny_body)).close()
    with sessions.session_of(folder, tiny_body) as session:
        session.fit_everything(sessions.QUICK, kind="smplx", gender="neutral")
        sessions.idle(session)
        assert session.fits.runs[0].state == "finished"
    return folder


@pytest.fixture
def project(tmp_path: Path) -> Iterator[Project]:
    """A new project, of the sample clip."""
    with Project.create(tmp_path / "walk.tcfit", sample_clip()) as made:
        yield made


@pytest.fixture(scope="session")
def keypoint_folder(tmp_path_factory: pytest.TempPathFactory, free_body: BodyModel) -> Path:
    """OpenPose JSON of that motion, body keypoints only, without noise."""
    points, exists = keypoints_in_space(free_body, motion())
    seen = exists & (np.arange(COUNT) < BODY.stop)
    xy = np.zeros((FRAMES, COUNT, 2))
    xy[:, seen] = camera.project(CAMERA, torch.as_tensor(points[:, seen])).numpy()
    folder = tmp_path_factory.mktemp("clip") / "wave"
    write_openpose(folder, Keypoints(xy=xy, confidence=np.tile(0.9 * seen, (FRAMES, 1))), name="wave")
    return folder


QUICK = ["--set", "relay_rounds=0", "--set", "yaws=side_view", "--set", "settings.iterations=6"]
"""Few solver steps."""


@pytest.fixture(scope="session")
def clip_arguments(keypoint_folder: Path) -> list[str]:
    """The clip, as options."""
    return ["--keypoints", str(keypoint_folder), "--image-size", "640", "480", "--focal-length", "800"]


@pytest.fixture
def fit_arguments(
    clip_arguments: list[str], tmp_path: Path, free_body: BodyModel, monkeypatch: pytest.MonkeyPatch
) -> list[str]:
    """`tcfit fit` on that clip into tmp_path/out, without an overlay and with few solver steps."""
    monkeypatch.setattr(fit_command, "load_body", lambda path: free_body)
    return ["fit", *clip_arguments, "--out", str(tmp_path / "out"), "--no-overlay", *QUICK]


@dataclass(frozen=True)
class FinishedRun:
    """A run of `tcfit fit`; tests must not change its folder."""

    code: int
    out: str
    err: str
    folder: Path
    events: tuple[FitEvent, ...]
    """What the fit told, up to `Finished`."""

    def replay(
        self,
        clip: object,
        body: object,
        config: FitConfig,
        *,
        start: object = None,
        shape: object = None,
    ) -> Iterator[FitEvent]:
        """In place of `fit_events`, for what a command does with a fit of these options: the same again, at once."""
        for event in self.events:
            if not isinstance(event, Finished):
                yield event
            if isinstance(event, PhaseFinished) and event.phase == config.last_phase:
                yield Finished(result=event.so_far)
                return


@pytest.fixture(scope="session")
def finished(clip_arguments: list[str], tmp_path_factory: pytest.TempPathFactory) -> FinishedRun:
    """The clip's fit, through the command line."""
    folder, out, err = tmp_path_factory.mktemp("results") / "wave", io.StringIO(), io.StringIO()
    events: list[FitEvent] = []

    def noted(*arguments: Any, **options: Any) -> Iterator[FitEvent]:
        for event in fit_events(*arguments, **options):
            events.append(event)
            yield event

    with redirect_stdout(out), redirect_stderr(err), pytest.MonkeyPatch.context() as patch:
        patch.setattr("fitting_core.fit.fitting.fit_events", noted)
        code = main(["fit", *clip_arguments, "--out", str(folder), "--no-overlay", *QUICK])
    return FinishedRun(code, out.getvalue(), err.getvalue(), folder, tuple(events))


DEMO_RATE = 4.0
"""Frames a second of the demo in tests: 23 frames."""


@pytest.fixture(scope="session")
def demo_project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project of the demo clip without a fit; not to be changed."""
    folder = tmp_path_factory.mktemp("demo")
    demo = make_demo(folder / "clip", frame_rate=DEMO_RATE)
    camera = CameraOptions(focal_length=demo.camera.focal[0], center=demo.camera.center)
    clip = replace(read_clip(demo.video, demo.keypoints, camera=camera), name="demo")
    Project.create(folder / "demo.tcfit", clip, copy_media=True).close()
    return folder / "demo.tcfit"


@pytest.fixture(scope="session")
def _browser() -> Iterator["Browser"]:
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def browser(_browser: "Browser") -> Iterator["Browser"]:
    """A browser without a page, which a module's tests fill; a page left open would go on drawing beside the others."""
    yield _browser
    for context in _browser.contexts:
        context.close()


@pytest.fixture(scope="session")
def panel_server() -> Iterator[viser.ViserServer]:
    """A server that panels are made on; nobody connects."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


@pytest.fixture
def page_of(panel_server: viser.ViserServer) -> Iterator[Callable[..., LonePage]]:
    """page_of(project, bodies=...): a page of an open project, or of one in a folder, until the test ends."""
    with ExitStack() as opened:

        def page(project: Project | Path, *, bodies: Any = None) -> LonePage:
            if isinstance(project, Path):
                project = Project.open(project)
            return opened.enter_context(lone_page(panel_server, opened.enter_context(project), bodies=bodies))

        yield page
