"""A project without keypoints in Chromium: import, upload and detection, and what a reload and a second tab show."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import viser

from fitting_core.detect import known_models
from fitting_core.keypoints import INDEX
from tcfit_app.server.uploads import UPLOAD_BYTES, Uploads
from tests.drivers.review_page import Reviewing, opened, reviewing, until
from tests.samples.spot_clips import FRAMES, empty_project, imported_xy, keypoint_files, nose, spot_model, spot_video

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return spot_video(tmp_path_factory.mktemp("spots") / "walk")


@pytest.fixture
def review(tmp_path: Path, video: Path, browser: "Browser", monkeypatch: pytest.MonkeyPatch) -> Iterator[Reviewing]:
    monkeypatch.setattr(known_models, "models_folder", lambda: tmp_path / "models")
    with reviewing(empty_project(tmp_path / "walk.tcfit", video), browser) as found:
        found.tab.get_by_text("Import from this path").wait_for(timeout=60_000)
        yield found
        assert not found.complaints


def field(review: Reviewing, label: str) -> "Locator":
    """viser's input with a label, which is no label to the browser."""
    return review.tab.locator(f"xpath=//*[normalize-space(text())='{label}']/following::input[1]")


def drawn(review: Reviewing) -> int:
    """How many keypoints the page has for its frame."""
    return review.tab.evaluate("() => (window.tcfit?.state('keypoints')?.confidence ?? []).filter((c) => c > 0).length")


def chips(review: Reviewing) -> str:
    return review.tab.evaluate("() => (window.tcfit?.state('chips')?.chips ?? []).map((c) => c.text).join(' | ')")


def test_keypoints_of_a_path_appear_in_all_tabs_and_stay(review: Reviewing, tmp_path: Path, browser: "Browser"):
    until(lambda: "No keypoints yet" in chips(review), "the status line")
    assert drawn(review) == 0
    second = opened(review.app, review.server, browser)
    field(review, "Path").fill(str(keypoint_files(tmp_path / "kp")))
    review.tab.get_by_text("Import from this path").click()
    review.tab.get_by_text(f"Found in {FRAMES} of {FRAMES} frames").wait_for()
    for tab in (review, second):
        until(lambda tab=tab: drawn(tab) == 137)
        until(lambda tab=tab: "No fit yet" in chips(tab), "the status line")
    assert review.tab.get_by_text("Import from this path").is_hidden()
    assert np.array_equal(review.session.project.detections.xy, imported_xy())
    known = len(review.app.pages)
    review.tab.reload()
    until(lambda: len(review.app.pages) >= known and review.page.tab.ready and drawn(review) == 137)
    review.tab.get_by_role("tab").first.wait_for()
    assert review.tab.get_by_role("tab").first.inner_text().strip() == "View"


def test_an_archive_is_uploaded(review: Reviewing, tmp_path: Path):
    archive = shutil.make_archive(str(tmp_path / "kp"), "zip", keypoint_files(tmp_path / "kp"))
    with review.tab.expect_file_chooser() as chooser:
        review.tab.get_by_text("Upload a file or ZIP").click()
    chooser.value.set_files(archive)
    until(lambda: review.session.project.has_detections)
    until(lambda: drawn(review) == 137)


def test_a_file_that_is_too_large_stays_here_and_the_next_one_is_uploaded(
    review: Reviewing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    archive = shutil.make_archive(str(tmp_path / "kp"), "zip", keypoint_files(tmp_path / "kp"))
    large = tmp_path / f"{'very ' * 20}large 🎥.zip"
    with large.open("wb") as file:
        file.truncate(UPLOAD_BYTES + 1)
    begun: list[int] = []
    begin = Uploads.begin
    monkeypatch.setattr(Uploads, "begin", lambda self, file: begun.append(file.size_bytes) or begin(self, file))
    for path in (large, archive):
        with review.tab.expect_file_chooser() as chooser:
            review.tab.get_by_text("Upload a file or ZIP").click()
        chooser.value.set_files(path)
        if path == large:
            review.tab.get_by_text("expected at most 256 MB").wait_for()
            assert "large 🎥.zip cannot be uploaded" in review.tab.inner_text("body")
    until(lambda: review.session.project.has_detections)
    assert begun == [Path(archive).stat().st_size]
    inputs = review.page.tab.client.gui._gui_input_handle_from_uuid.values()
    files = [handle.value.content for handle in inputs if isinstance(handle, viser.GuiUploadButtonHandle)]
    assert files and not any(files), "viser keeps none"


def test_detection_runs_beside_the_video(review: Reviewing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("fitting_core.detect.detecting.PART", 4)
    model = spot_model(tmp_path / "pose.onnx")
    field(review, "Model").click()
    review.tab.get_by_role("option", name="An ONNX file of yours").click()
    field(review, "Model file").fill(str(model))
    review.tab.get_by_text("Detect", exact=True).click()
    until(lambda: review.session.source.going is not None)
    review.tab.mouse.move(300, 300)
    frame = review.frame
    review.press("ArrowRight", lambda: review.frame == frame + 1)
    until(lambda: review.session.project.has_detections)
    until(lambda: drawn(review) > 100)
    found = review.session.project.detections.xy[:, INDEX["nose"]]
    assert np.abs(found - [nose(t) for t in range(FRAMES)]).max() < 1


def test_a_model_of_another_kind_is_named(review: Reviewing, tmp_path: Path):
    (tmp_path / "text.onnx").write_text("hello")
    field(review, "Model").click()
    review.tab.get_by_role("option", name="An ONNX file of yours").click()
    field(review, "Model file").fill(str(tmp_path / "text.onnx"))
    review.tab.get_by_text("Detect", exact=True).click()
    review.tab.get_by_text("cannot be opened as an ONNX model").first.wait_for()
    until(lambda: "No keypoints yet" in chips(review), "the status line")
