"""Getting keypoints in the review: jobs beside the app, what they leave when they end, and the panel Start."""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.camera import Camera, FocalFrom
from fitting_core.clip import Clip
from fitting_core.detect import known_models, stored
from fitting_core.detect.detectors import DEFAULT, DETECTORS
from fitting_core.detect.known_models import KNOWN_MODELS
from fitting_core.detect.mediapipe import networks
from fitting_core.errors import InputError
from fitting_core.io.cameras.reading import CameraFile
from fitting_core.keypoints import BODY, COUNT, INDEX, Keypoints
from tcfit_app.fitting import jobs
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.imports.keypoint_jobs import FoundKeypoints, ImportFiles, ImportUpload, ProgressReport
from tcfit_app.project import project as project_module
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.project import Project
from tcfit_app.review.panels import start_panel
from tcfit_app.review.panels.start_panel import StartPanel
from tcfit_app.review.session import session as session_module
from tcfit_app.review.session.session import Session
from tests.drivers.lone_page import LonePage
from tests.drivers.review_page import QUICK
from tests.flows.disk import disk
from tests.samples.fake_detector import FakeDetector, known
from tests.samples.sessions import session_of, told, until
from tests.samples.spot_clips import (
    FRAMES,
    empty_project,
    imported_xy,
    keypoint_files,
    nose,
    spot_model,
    spot_video,
    two_people,
)


@pytest.fixture(scope="session")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return spot_video(tmp_path_factory.mktemp("spots") / "walk")


@pytest.fixture(scope="session")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return spot_model(tmp_path_factory.mktemp("model") / "pose.onnx")


@pytest.fixture
def folder(tmp_path: Path, video: Path) -> Path:
    return empty_project(tmp_path / "walk.tcfit", video)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    return keypoint_files(tmp_path / "kp")


@pytest.fixture
def session(folder: Path) -> Iterator[Session]:
    with session_of(folder, None) as made:
        yield made


@dataclass(frozen=True)
class Waits:
    """A job that waits to be cancelled."""

    title: str = "Waiting"

    def run(self, clip: Clip, report: ProgressReport) -> FoundKeypoints | None:
        while True:
            report("waits", 0.5)
            time.sleep(0.005)


def ended(session: Session) -> None:
    until(session, lambda: not session.source.busy)
    session.take_news()


def test_keypoints_of_this_computer(session: Session, files: Path):
    edits = session.project.keypoints_version
    session.source.begin(ImportFiles(path=files))
    ended(session)
    assert session.project.has_detections and session.project.keypoints_version > edits
    assert np.array_equal(session.project.detections.xy, imported_xy())
    assert session.project.clip.detector == "openpose"
    assert session.project.clip.camera.focal_from is FocalFrom.ESTIMATED, "as with keypoints that are detected"
    assert told(session)[-1].kind == "done"
    with pytest.raises(InputError, match="already has keypoints"):
        session.source.begin(ImportFiles(path=files))


@pytest.fixture
def detector(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakeDetector:
    """In place of the default."""
    made = FakeDetector(two_people, length=8)
    monkeypatch.setitem(DETECTORS, DEFAULT, known(made))
    monkeypatch.setattr(stored, "users_folder", lambda: tmp_path / "cache")
    return made


def test_keypoints_are_found_and_then_a_fit_could_begin(session: Session, detector: FakeDetector):
    with pytest.raises(InputError, match="no keypoints yet"):
        session.fit_everything(None, kind="smplx", gender="neutral")  # pyright: ignore[reportArgumentType]
    session.source.detect(DEFAULT)
    ended(session)
    project = session.project
    large = two_people(7)[0, :25, :2]
    assert np.abs(project.detections.xy[7, :25] - large).max() < 0.1
    assert "found by fake" in told(session)[-1].text and project.clip.detector == "mediapipe"
    assert project.clip.silhouettes is not None and len(project.clip.silhouettes) == FRAMES
    with pytest.raises(InputError, match="neutral smplx"):
        session.fit_everything(None, kind="smplx", gender="neutral")  # pyright: ignore[reportArgumentType]


def test_what_is_found_is_fitted_as_it_is_found(
    folder: Path, tiny_body: BodyModel, detector: FakeDetector, monkeypatch: pytest.MonkeyPatch
):
    """Bodies of the first frames are there while the last ones are still looked at."""
    gate, plain = threading.Event(), detector._people
    monkeypatch.setattr(detector, "_people", lambda frame: plain(frame) if frame < 18 or gate.wait(60) else None)
    with session_of(folder, tiny_body) as session:
        session.find_and_fit(DEFAULT, QUICK)
        until(session, lambda: session.fits.show(FitChoice()))
        shown = session.fits.show(FitChoice())
        assert (
            shown and shown.has(3) and not shown.has(20) and session.source.busy and not session.project.has_detections
        )
        gate.set()
        ended(session)
        until(session, lambda: not session.jobs)
        (run,) = session.fits.runs
        shown = session.fits.show(FitChoice())
        assert run.state == "finished" and shown and shown.has(20) and shown.phase == 3


def test_full_disk_leaves_no_detection_without_its_fit(
    folder: Path, tiny_body: BodyModel, detector: FakeDetector, monkeypatch: pytest.MonkeyPatch
):
    gate, plain = threading.Event(), detector._people
    monkeypatch.setattr(detector, "_people", lambda frame: gate.wait(60) and plain(frame))
    with session_of(folder, tiny_body) as session, disk() as full:
        full.room = 0
        with pytest.raises(InputError, match="full"):
            session.find_and_fit(DEFAULT, QUICK)
        full.room = None
        gate.set()
        until(session, lambda: not session.tasks.busy)
        assert session.source.going is not None and session.source.going.state in ("cancelled", "failed")
        assert not session.jobs and not session.project.runs.all()
        session.find_and_fit(DEFAULT, QUICK)
        until(session, lambda: not session.jobs and not session.tasks.busy)
        assert [run.state for run in session.fits.runs] == ["finished"]


def test_a_fit_whose_keypoints_are_not_found_leaves_nothing(
    folder: Path, tiny_body: BodyModel, detector: FakeDetector, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(detector, "_people", lambda frame: np.zeros((0, COUNT, 3)))
    with session_of(folder, tiny_body) as session:
        session.find_and_fit(DEFAULT, QUICK)
        ended(session)
        until(session, lambda: not session.jobs)
        assert session.fits.runs == () and not session.project.has_detections
        assert [notice.title for notice in told(session)] == ["Detecting keypoints failed"]


def test_no_detection_begins_while_the_camera_changes(
    session: Session, detector: FakeDetector, monkeypatch: pytest.MonkeyPatch
):
    """Its keypoints would be those of the lens before."""
    reading, gone_on = threading.Event(), threading.Event()
    camera = session.project.footage.camera

    def slowly(*_: object) -> Camera:
        reading.set()
        assert gone_on.wait(60)
        return replace(camera, source="a file")

    monkeypatch.setattr(session_module, "read_camera", slowly)
    task = session.tasks.submit(
        "camera", lambda report: session.set_camera(CameraFile(path=Path("c.toml"))), then=lambda task: None
    )
    assert reading.wait(60)
    with pytest.raises(InputError, match="camera is being changed: wait"):
        session.source.detect(DEFAULT)
    assert session.source.going is None
    gone_on.set()
    until(session, lambda: task.state == "finished")
    session.source.detect(DEFAULT)
    with pytest.raises(InputError, match="with the current camera: wait for them"):
        session.set_camera(CameraFile(path=Path("c.toml")))
    until(session, lambda: not session.source.busy)


def test_whom_somebody_clicks_on_is_taken(session: Session, detector: FakeDetector):
    session.source.detect(DEFAULT)
    people = session.source.people
    assert people is not None
    until(session, lambda: people.at(3) is not None)
    found = people.at(3)
    assert found is not None and found.chosen == 0 and len(found.points) == 2
    people.choose(3, 1)
    ended(session)
    small = two_people(9)[1, :25, :2]
    assert np.abs(session.project.detections.xy[9, :25] - small).max() < 0.1


def test_somebody_else_is_taken_afterwards_as_long_as_nothing_stands_on_the_keypoints(
    session: Session, detector: FakeDetector
):
    session.source.detect(DEFAULT)
    ended(session)
    project, seen = session.project, len(detector.asked)
    notes = project.clip.notes
    assert session.can_choose_person
    session.source.choose(3, 1)
    ended(session)
    assert np.abs(project.detections.xy[9, :25] - two_people(9)[1, :25, :2]).max() < 0.1
    assert len(detector.asked) == seen and len(project.clip.notes) == len(notes), "nothing is looked for again"
    assert project.clip.silhouettes is not None and session.source.people and session.source.people.count == 2
    session.edit(MarkBad(frames=(0,), joints=(0,)), author="me")
    session.source.choose(3, 0)
    assert not session.can_choose_person and not session.source.busy
    with pytest.raises(InputError, match="This person already has edits"):
        project.take_detections(project.detections, before=project.clip)


def test_what_was_found_when_it_was_cancelled_is_not_looked_for_again(
    folder: Path, detector: FakeDetector, monkeypatch: pytest.MonkeyPatch
):
    gate, plain = threading.Event(), detector._people

    def slowly(frame: int) -> np.ndarray:
        assert frame < 18 or gate.wait(60)
        return plain(frame)

    monkeypatch.setattr(detector, "_people", slowly)
    with session_of(folder, None) as first:
        first.source.detect(DEFAULT)
        until(first, lambda: first.source.people and len(first.source.people.done) == 2)
        assert [part[0] for part in first.source.people.done] == [0, 4] and first.source.people.count == 2  # pyright: ignore[reportOptionalMemberAccess]
        first.source.cancel()
        gate.set()
        ended(first)
        assert first.source.going and first.source.going.state == "cancelled" and not first.project.has_detections
    detector.asked.clear()
    with session_of(folder, None) as second:
        second.source.detect(DEFAULT)
        ended(second)
        assert second.project.has_detections and min(detector.asked) == 12


def test_a_model_of_the_users_own(session: Session, model: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(stored, "users_folder", lambda: tmp_path / "cache")
    session.source.detect(str(model))
    ended(session)
    found = session.project.detections.xy[:, INDEX["nose"]]
    assert np.abs(found - [nose(t) for t in range(FRAMES)]).max() < 1
    assert "found by pose.onnx" in told(session)[-1].text and session.project.clip.silhouettes is None


def test_the_drawing_thread_does_not_wait_for_detections_to_be_written(
    session: Session, files: Path, monkeypatch: pytest.MonkeyPatch
):
    gate, writing, write = threading.Event(), threading.Event(), project_module.replace_detections

    def slowly(*args: Any) -> None:
        writing.set()
        assert gate.wait(60)
        write(*args)

    monkeypatch.setattr(project_module, "replace_detections", slowly)
    session.source.begin(ImportFiles(path=files))
    assert writing.wait(60)
    session.take_news()
    project = session.project
    assert not project.has_detections and project.log == () and not project.corrected.bad.any() and project.clip
    assert not told(session)
    gate.set()
    ended(session)
    assert project.has_detections and told(session)[-1].kind == "done"


@pytest.mark.parametrize(
    ("begin", "words"),
    [
        (lambda source: source.begin(ImportFiles(path=Path("/no/such/folder"))), "there is no such file or folder"),
        (
            lambda source: source.begin(ImportUpload(name="a.exe", content=b"x")),
            "and its name is not a keypoint file's",
        ),
        (lambda source: source.detect("/no/model.onnx"), "there is no such model file"),
    ],
)
def test_what_fails_is_told_and_another_try_can_begin(
    session: Session, files: Path, begin: Callable[[Any], None], words: str
):
    begin(session.source)
    ended(session)
    assert session.source.going and session.source.going.state == "failed" and words in session.source.going.reason
    assert told(session)[-1].kind == "error" and words in told(session)[-1].text
    session.source.begin(ImportFiles(path=files))
    ended(session)
    assert session.project.has_detections


def test_one_job_at_a_time_and_none_where_nothing_may_be_written(folder: Path):
    with session_of(folder, None) as session:
        session.source.begin(Waits())
        with pytest.raises(InputError, match="Waiting: wait for it, or cancel it"):
            session.source.detect("model.onnx")
    assert session.source.going and session.source.going.state == "cancelled", "closing ends it"
    with session_of(folder, None, read_only=True) as reader, pytest.raises(InputError, match="read-only"):
        reader.source.begin(ImportFiles(path=Path("x")))


# --- the panel ---


@pytest.fixture
def page(page_of: Callable[..., LonePage], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> LonePage:
    monkeypatch.setattr(known_models, "models_folder", lambda: tmp_path / "models")
    made = page_of(folder)
    made.only(StartPanel)
    return made


def finish(page: LonePage) -> None:
    page.until(lambda: not page.page.tab.session.source.busy)
    page.page.tab.session.take_news()
    page.draw()


def test_the_panel_imports_a_path_and_then_fit_opens(page: LonePage, files: Path, monkeypatch: pytest.MonkeyPatch):
    opened: list[str] = []
    monkeypatch.setattr(page.page.tab, "show_panel", opened.append)
    assert "No keypoints yet" in page.html()
    groups = lambda: [one.visible for one in page._children() if isinstance(one, viser.GuiTabGroupHandle)]  # noqa: E731
    assert groups() == [True, False], "the panels come with the keypoints"
    for path in ("", "  "):
        page.enter("Path", path)
        page.click("Import from this path")
        assert page.notices[-1].text.startswith("The path is empty")
    page.enter("Path", f"  {files} ")
    page.click("Import from this path")
    finish(page)
    page.page._draw_panels(0.0)
    assert groups() == [False, True] and opened == ["Fit"]
    assert f"Keypoints were found in {FRAMES} of {FRAMES} frames" in page.html()
    assert page.button("Fit everything").value == "fit"


def test_one_button_finds_keypoints(page: LonePage, detector: FakeDetector):
    page.draw()
    assert "Find keypoints and fit" in page.html()
    page.click("Find keypoints only")
    finish(page)
    page.page._draw_panels(0.0)
    assert "2 people were found. To choose another person, click" in page.html()
    page.page.tab.session.edit(MarkBad(frames=(0,), joints=(0,)), author="me")
    page.page._draw_panels(0.0)
    assert "people were found" not in page.html()


def test_a_detector_that_is_not_here_is_shown_before_it_is_fetched(
    page: LonePage, model: Path, monkeypatch: pytest.MonkeyPatch
):
    for name in ("dwpose-m", "rtmdet-nano"):
        monkeypatch.setitem(KNOWN_MODELS, name, replace(KNOWN_MODELS[name], url=model.as_uri()))
    known = KNOWN_MODELS["dwpose-m"]
    page.enter("Detector", DETECTORS["dwpose-m"].title)
    page.draw()
    html = page.html()
    assert known.url in html and known.licence in html and "unknown; the first" in html and "Find keypoints" not in html
    page.click("Agree and download")
    finish(page)
    assert KNOWN_MODELS["rtmdet-nano"].title in page.html(), "the next that it needs"


def test_networks_that_are_not_here_are_told(page: LonePage, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(networks, "folder", lambda: tmp_path / "none")
    page.enter("Detector", DETECTORS[DEFAULT].title)
    page.draw()
    html = page.html()
    assert "networks are not on this computer" in html and "Apache-2.0" in html and "Agree and download" in html


def test_a_failure_stays_in_the_panel_as_text(page: LonePage):
    page.enter("Path", "/no/<img src=x>")
    page.click("Import from this path")
    finish(page)
    assert "&lt;img src=x&gt;" in page.html() and "<img" not in page.html()


def test_progress_can_be_cancelled_in_the_panel(page: LonePage, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(start_panel, "ImportFiles", lambda path: Waits())
    page.enter("Path", "x")
    page.click("Import from this path")
    page.until(lambda: "waits …" in page.html())
    page.click("Cancel")
    finish(page)
    assert "Cancelled." in page.html()


def test_a_project_with_keypoints_has_no_such_panel(page_of: Callable[..., LonePage], folder: Path):
    project = Project.open(folder)
    project.take_detections(Keypoints(xy=np.ones((FRAMES, COUNT, 2)), confidence=np.ones((FRAMES, COUNT))))
    assert not [panel for panel in page_of(project).page.panels if isinstance(panel, StartPanel)]


def test_the_first_fit_finds_everything_loaded(
    folder: Path, detector: FakeDetector, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    """Before a project has keypoints a body is fitted that nobody sees; one that has some waits for its user."""
    fitted = []

    def noting(clip: Clip, *args: Any, **more: Any) -> Any:
        fitted.append(clip)
        return plain(clip, *args, **more)

    plain = jobs.fit_events
    monkeypatch.setattr(jobs, "fit_events", noting)
    with session_of(folder, tiny_body) as session:
        session.warm_up()
        (alone,) = fitted
        assert len(alone) == 1 and (alone.keypoints.confidence[0, BODY] > 0).sum() > 15
        assert (alone.keypoints.xy[alone.keypoints.confidence > 0] < alone.camera.size).all()
        assert not session.fits.runs and not session.project.has_detections
        session.source.detect(DEFAULT)
        ended(session)
        session.warm_up()
        assert len(fitted) == 1
