"""A project without keypoints in Chromium: finding, import and upload, and what a reload and a second tab show."""

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import viser

from fitting_core.detect import known_models, stored
from fitting_core.detect.detectors import DEFAULT, DETECTORS
from tcfit_app.server.uploads import UPLOAD_BYTES, Uploads
from tests.drivers.review_page import Reviewing, opened, reviewing
from tests.drivers.waiting import until
from tests.samples.fake_detector import FakeDetector, known
from tests.samples.spot_clips import FRAMES, empty_project, imported_xy, keypoint_files, spot_video, two_people

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return spot_video(tmp_path_factory.mktemp("spots") / "walk")


class Gated(FakeDetector):
    """Finds two people, and waits before frame 12 until it is let go on."""

    def __init__(self) -> None:
        self.gate = threading.Event()
        super().__init__(self._gated, length=8)

    def _gated(self, frame: int) -> np.ndarray:
        assert frame < 12 or self.gate.wait(60)
        return two_people(frame)


@pytest.fixture
def detector(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Gated]:
    """In place of the default."""
    made = Gated()
    monkeypatch.setitem(DETECTORS, DEFAULT, known(made))
    monkeypatch.setattr(stored, "users_folder", lambda: tmp_path / "cache")
    yield made
    made.gate.set()


@pytest.fixture
def review(
    tmp_path: Path, video: Path, browser: "Browser", monkeypatch: pytest.MonkeyPatch, detector: Gated
) -> Iterator[Reviewing]:
    monkeypatch.setattr(known_models, "models_folder", lambda: tmp_path / "models")
    with reviewing(empty_project(tmp_path / "walk.tcfit", video), browser) as found:
        found.tab.get_by_text("Find keypoints and fit").wait_for(timeout=60_000)
        yield found
        detector.gate.set()
        assert not found.complaints


def unfold(review: Reviewing, title: str, label: str) -> None:
    """Open a folder of the panel, and wait for what is in it."""
    review.tab.get_by_role("button", name=title).click()
    review.tab.locator(f"text='{label}' >> visible=true").last.wait_for()


def drawn(review: Reviewing) -> int:
    """How many keypoints the page has for its frame."""
    return review.tab.evaluate("() => (window.tcfit?.state('keypoints')?.confidence ?? []).filter((c) => c > 0).length")


def chips(review: Reviewing) -> str:
    return review.tab.evaluate("() => document.querySelector('.tcfit-status')?.innerText ?? ''")


def test_keypoints_of_a_path_appear_in_all_tabs_and_stay(review: Reviewing, tmp_path: Path, browser: "Browser"):
    until(lambda: "No keypoints yet" in chips(review), "the status line")
    assert drawn(review) == 0
    second = opened(review.app, review.server, browser)
    unfold(review, "Import keypoints", "Import from this path")
    review.field("Path").fill(str(keypoint_files(tmp_path / "kp")))
    review.tab.get_by_text("Import from this path").click()
    review.tab.get_by_text(f"Keypoints were found in {FRAMES} of {FRAMES} frames").wait_for()
    for tab in (review, second):
        until(lambda tab=tab: drawn(tab) == 137)
        until(lambda tab=tab: "No fit yet" in chips(tab), "the status line")
    assert review.tab.get_by_text("Import from this path").is_hidden()
    assert np.array_equal(review.session.project.detections.xy, imported_xy())
    known = len(review.app.pages)
    review.tab.reload()
    until(lambda: len(review.app.pages) >= known and review.page.tab.ready and drawn(review) == 137)
    review.tab.get_by_role("tab").first.wait_for()
    until(lambda: review.tab.get_by_role("tab", selected=True).inner_text().strip() == "Fit")


def test_a_file_that_is_too_large_stays_here_and_the_next_one_is_uploaded(
    review: Reviewing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    small = next(keypoint_files(tmp_path / "kp").iterdir())
    large = tmp_path / f"{'very ' * 20}large 🎥.json"
    with large.open("wb") as file:
        file.truncate(UPLOAD_BYTES + 1)
    begun: list[int] = []
    begin = Uploads.begin
    monkeypatch.setattr(Uploads, "begin", lambda self, file: begun.append(file.size_bytes) or begin(self, file))
    unfold(review, "Import keypoints", "Upload a file")
    for path in (large, small):
        with review.tab.expect_file_chooser() as chooser:
            review.tab.get_by_text("Upload a file").click()
        chooser.value.set_files(path)
        if path == large:
            review.tab.get_by_text("expected at most 256 MB").wait_for()
            assert "large 🎥.json cannot be uploaded" in review.tab.inner_text("body")
    until(lambda: review.session.project.has_detections)
    assert begun == [small.stat().st_size]
    inputs = review.page.tab.client.gui._gui_input_handle_from_uuid.values()
    files = [handle.value.content for handle in inputs if isinstance(handle, viser.GuiUploadButtonHandle)]
    assert files and not any(files), "viser keeps none"


def found_until(review: Reviewing) -> int:
    """How many frames the timeline shows as found."""
    spans = review.tab.evaluate("() => window.tcfit?.state('fit')?.spans ?? []")
    return max((span["last"] + 1 for span in spans if span["state"] == "found"), default=0)


def others(review: Reviewing) -> int:
    """How many people the page draws who are not meant."""
    return review.tab.evaluate("() => (window.tcfit?.state('other_people')?.people ?? []).length")


def meant(review: Reviewing) -> int:
    """Which of `two_people` the page draws as the one who is meant."""
    xy = review.tab.evaluate("() => window.tcfit?.state('keypoints')?.xy ?? []")
    away = [np.abs(np.array(xy)[:25] - one[:25, :2]).max() if xy else np.inf for one in two_people(review.frame)]
    return int(np.argmin(away)) if min(away) < 1 else -1


def test_keypoints_are_seen_while_they_are_found_in_all_tabs(review: Reviewing, detector: Gated, browser: "Browser"):
    second = opened(review.app, review.server, browser)
    review.tab.get_by_text("Find keypoints only").click()
    for tab in (review, second):
        until(lambda tab=tab: found_until(tab) == 12, "the frames that were found")
        until(lambda tab=tab: meant(tab) == 0 and others(tab) == 1, "the people of the frame")
        until(lambda tab=tab: "Detecting keypoints" in chips(tab), "the status line")
    assert review.tab.get_by_text("Find keypoints only").is_hidden()
    second.tab.mouse.move(300, 300)
    second.press("ArrowRight", lambda: second.frame == 1)
    detector.gate.set()
    until(lambda: review.session.project.has_detections)
    review.tab.get_by_text(f"Keypoints were found in {FRAMES} of {FRAMES} frames").wait_for()
    until(lambda: "No fit yet" in chips(review) and found_until(review) == 0, "the status line")


def test_a_click_says_who_is_meant_while_people_are_found_and_afterwards(review: Reviewing, detector: Gated):
    review.tab.get_by_text("Find keypoints only").click()
    until(lambda: meant(review) == 0 and others(review) == 1, "both people")
    review.tab.get_by_text("2 people found").wait_for()
    review.rest()
    x, y = review.tab.evaluate("() => tcfit.place(20, 60)")
    review.tab.mouse.click(x, y)
    until(lambda: meant(review) == 1, "the other one, in colour")
    detector.gate.set()
    until(lambda: review.session.project.has_detections and not review.session.source.busy)
    review.tab.get_by_text("2 people were found").wait_for()
    assert np.abs(review.session.project.detections.xy[9, :25] - two_people(9)[1, :25, :2]).max() < 1
    review.tab.get_by_text("This one?").click()
    until(lambda: meant(review) == 0, "the first one again")


def test_what_fails_is_told_in_the_panel(review: Reviewing, tmp_path: Path):
    (tmp_path / "text.json").write_text("hello")
    unfold(review, "Import keypoints", "Path")
    review.field("Path").fill(str(tmp_path / "text.json"))
    review.tab.get_by_text("Import from this path").click()
    review.tab.get_by_text("text.json").first.wait_for()
    until(lambda: "No keypoints yet" in chips(review), "the status line")
