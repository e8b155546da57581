"""Getting keypoints in the review: jobs beside the app, what they leave when they end, and the panel Start."""

import io
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import viser

from fitting_core.clip import Clip
from fitting_core.detect import known_models
from fitting_core.detect.known_models import KNOWN_MODELS
from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT, INDEX, Keypoints
from tcfit_app.imports.keypoint_jobs import FoundKeypoints, ImportFiles, ImportUpload, Report
from tcfit_app.project import project as project_module
from tcfit_app.project.project import Project
from tcfit_app.review.panels import start_panel
from tcfit_app.review.panels.start_panel import StartPanel
from tcfit_app.review.session.keypoint_source import PARTS
from tcfit_app.review.session.session import Session
from tests.drivers.lone_page import LonePage, lone_page
from tests.fitting_core.detect.onnx_files import brightest_model
from tests.samples.sessions import session_of, told, until
from tests.samples.spot_clips import FRAMES, empty_project, imported_xy, keypoint_files, nose, spot_model, spot_video


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

    def run(self, clip: Clip, report: Report) -> FoundKeypoints | None:
        while True:
            report("waits", 0.5)
            time.sleep(0.005)


def ended(session: Session) -> None:
    until(session, lambda: not session.source.busy)
    session.take_news()


def test_keypoints_of_this_computer(session: Session, files: Path):
    edits = session.edits
    session.source.begin(ImportFiles(path=files))
    ended(session)
    assert session.project.has_detections and session.edits > edits
    assert np.array_equal(session.project.detections.xy, imported_xy())
    assert session.project.clip.detector == "openpose"
    assert told(session)[-1].kind == "done"
    with pytest.raises(InputError, match="has its keypoints already"):
        session.source.begin(ImportFiles(path=files))


def test_an_uploaded_archive(session: Session, files: Path):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for path in files.iterdir():
            archive.write(path, f"kp/{path.name}")
    session.source.begin(ImportUpload(name="kp.zip", content=buffer.getvalue()))
    ended(session)
    assert np.array_equal(session.project.detections.xy, imported_xy())


def test_detection_and_then_a_fit_could_begin(session: Session, model: Path):
    with pytest.raises(InputError, match="no keypoints yet"):
        session.fit_everything(None, kind="smplx", gender="neutral")  # pyright: ignore[reportArgumentType]
    session.source.detect(str(model))
    ended(session)
    found = session.project.detections.xy[:, INDEX["nose"]]
    assert np.abs(found - [nose(t) for t in range(FRAMES)]).max() < 1
    assert "detected by pose.onnx" in told(session)[-1].text
    assert session.project.clip.detector == "coco-wholebody"
    assert not (session.project.folder / PARTS).exists()
    with pytest.raises(InputError, match="neutral smplx"):
        session.fit_everything(None, kind="smplx", gender="neutral")  # pyright: ignore[reportArgumentType]


def slowly(monkeypatch: pytest.MonkeyPatch, seconds: float = 0.02) -> list[int]:
    """Makes the model slow; how many frames it has seen."""
    from fitting_core.detect.simcc import SimCC

    seen: list[int] = []
    plain = SimCC.points

    def points(self: SimCC, images: Any, boxes: Any) -> Any:
        time.sleep(seconds)
        seen.append(1)
        return plain(self, images, boxes)

    monkeypatch.setattr(SimCC, "points", points)
    return seen


def test_a_cancelled_detection_goes_on_in_the_next_session(folder: Path, model: Path, monkeypatch: pytest.MonkeyPatch):
    seen = slowly(monkeypatch)
    with session_of(folder, None) as first:
        first.source.detect(str(model))
        until(first, lambda: len(seen) > 36)
        first.source.cancel()
        ended(first)
        assert first.source.going and first.source.going.state == "cancelled"
        assert not first.project.has_detections and first.source.begun
    seen.clear()
    with session_of(folder, None) as second:
        assert second.source.begun
        second.source.detect(str(model))
        ended(second)
        assert second.project.has_detections and len(seen) < 12, "only the last part is done again"


def test_another_model_begins_anew(folder: Path, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    seen = slowly(monkeypatch, 0.005)
    with session_of(folder, None) as session:
        session.source.detect(str(model))
        until(session, lambda: len(seen) > 36)
        session.source.cancel()
        ended(session)
        session.source.detect(str(brightest_model(tmp_path / "other.onnx", size=(48, 64))))
        ended(session)
        assert session.project.has_detections


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
        (lambda source: source.begin(ImportUpload(name="a.exe", content=b"x")), "is no keypoint file by its name"),
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
def page(
    panel_server: viser.ViserServer, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[LonePage]:
    monkeypatch.setattr(known_models, "models_folder", lambda: tmp_path / "models")
    with Project.open(folder) as project, lone_page(panel_server, project) as made:
        made.only(StartPanel)
        yield made


def finish(page: LonePage) -> None:
    page.until(lambda: not page.page.tab.session.source.busy)
    page.page.tab.session.take_news()
    page.draw()


def test_the_panel_imports_a_path_and_offers_the_fit(page: LonePage, files: Path):
    assert "No keypoints yet" in page.html()
    for path in ("", "  "):
        page.enter("Path", path)
        page.click("Import from this path")
        assert page.notices[-1].text.startswith("No path is given")
    page.enter("Path", f"  {files} ")
    page.click("Import from this path")
    finish(page)
    assert f"Found in {FRAMES} of {FRAMES} frames" in page.html()
    assert page.button("Fit everything").value == "fit"


def test_a_model_that_is_not_here_is_shown_before_it_is_fetched(
    page: LonePage, model: Path, monkeypatch: pytest.MonkeyPatch
):
    known = replace(KNOWN_MODELS["dwpose-m"], url=model.as_uri())
    monkeypatch.setitem(KNOWN_MODELS, "dwpose-m", known)
    page.enter("Model", f"{known.title} (download)")
    html = page.html()
    assert known.url in html and known.licence in html and "none is known" in html
    page.click("Agree and download")
    finish(page)
    assert page.field("Model").value == known.title and "Agree" not in page.html()
    page.click("Detect")
    finish(page)
    assert page.page.tab.session.project.has_detections


def test_a_file_of_the_users_own(page: LonePage, model: Path):
    page.enter("Model", "An ONNX file of yours")
    page.draw()
    assert page.field("Model file").visible and not page.field("People file").visible
    page.click("Detect")
    assert page.notices[-1].text.startswith("No model is given")
    page.enter("Model file", str(model))
    page.click("Detect")
    finish(page)
    assert page.page.tab.session.project.has_detections


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


def test_a_project_with_keypoints_has_no_such_panel(panel_server: viser.ViserServer, folder: Path):
    with Project.open(folder) as project:
        project.take_detections(Keypoints(xy=np.ones((FRAMES, COUNT, 2)), confidence=np.ones((FRAMES, COUNT))))
        with lone_page(panel_server, project) as made:
            assert not [panel for panel in made.page.panels if isinstance(panel, StartPanel)]
