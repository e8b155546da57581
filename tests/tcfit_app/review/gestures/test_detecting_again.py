"""Detecting again: what is looked for and where, the edit that becomes of it, and what is said."""

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting_core.camera import Lens
from fitting_core.clip import Clip
from fitting_core.detect import second_look
from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT, LEFT_HAND, PARTS, Keypoints
from fitting_core.lens import filmed, filmed_keypoints
from tcfit_app.imports.second_looks import filmed_region, known_near
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.kinds import DetectAgain
from tcfit_app.project.project import Project
from tcfit_app.review.browser.page_events import Framed, Key
from tcfit_app.review.drawing import menus
from tcfit_app.review.drawing.status import Status
from tcfit_app.review.panels.correct.correct_panel import CorrectPanel
from tests.drivers.lone_page import LonePage
from tests.samples.media import write_images
from tests.samples.project_samples import CAMERA, FRAMES, sample_clip

FIRST, LAST = 7, 7 + FRAMES - 1
"""The numbers that users see for the sample clip's frames, as the video has them."""
PLACE = (120.0, 80.0)
LENS = Lens(focal=CAMERA.focal, center=CAMERA.center, distortion=(-0.2, 0.05, 0.0, 0.0))


class Looking:
    """Stands in for the networks: finds everything in one place, in the frames that it is told."""

    def __init__(self) -> None:
        self.asked: list[dict[str, Any]] = []
        self.found: Callable[[int], bool] = lambda frame: True
        self.goes_on = threading.Event()
        self.goes_on.set()

    def __call__(
        self, source: Any, frames: list[int], *, tell: Callable[[int], None] = lambda done: None, **asked: Any
    ) -> np.ndarray:
        self.asked.append({"frames": frames, **asked})
        points = np.zeros((len(frames), 137, 3))
        for k, frame in enumerate(frames):
            assert self.goes_on.wait(10)
            if self.found(frame):
                points[k, PARTS[asked["part"]]] = (*PLACE, 0.75)
            tell(k + 1)
        return points


@pytest.fixture
def looking(monkeypatch: pytest.MonkeyPatch) -> Looking:
    made = Looking()
    monkeypatch.setattr(second_look, "look_again", made)
    return made


def clip_of(folder: Path, lens: Lens | None = None) -> Clip:
    """The sample clip with its images; the left hand is missing in its first frame."""
    clip = sample_clip()
    confidence = clip.keypoints.confidence.copy()
    confidence[0, LEFT_HAND] = 0
    keypoints = Keypoints(xy=clip.keypoints.xy, confidence=confidence)
    source = write_images(folder, *(f"{number}.png" for number in range(LAST + 1)))
    return replace(clip, keypoints=keypoints, source=source, camera=replace(clip.camera, lens=lens))


@pytest.fixture
def page_with(page_of: Callable[..., LonePage], tmp_path: Path, looking: Looking) -> Callable[..., LonePage]:
    """page_with(lens): the panel Correct of the sample clip with its images."""

    def made(lens: Lens | None = None) -> LonePage:
        page = page_of(Project.create(tmp_path / "walk.tcfit", clip_of(tmp_path / "images", lens)))
        page.only(CorrectPanel)
        return page

    return made


@pytest.fixture
def tested(page_with: Callable[..., LonePage]) -> LonePage:
    return page_with()


def project_of(tested: LonePage) -> Project:
    return tested.page.tab.session.project


def edits_of(tested: LonePage) -> list[DetectAgain]:
    return [entry.action for entry in project_of(tested).log if isinstance(entry.action, DetectAgain)]


def chips(tested: LonePage) -> str:
    return "\n".join(chip.text for chip in Status(tested.page.gestures).messages(0.0, ""))


def test_the_selected_frames_are_looked_at_and_what_is_found_is_one_edit(tested: LonePage, looking: Looking):
    tab = tested.page.tab
    before = project_of(tested).clip.keypoints
    tab.seek(2)
    tab.set(frames=range(1, 4))
    tested.press("action", "detect_left_hand")
    tested.settle()
    (asked,) = looking.asked
    assert asked["frames"] == [FIRST + 1, FIRST + 2, FIRST + 3] and asked["part"] == "left_hand"
    assert asked["region"] is None
    assert np.array_equal(asked["near"][..., :2], before.xy[1:4])
    assert np.array_equal(asked["near"][..., 2], before.confidence[1:4])
    (edit,) = edits_of(tested)
    assert edit.frames == (1, 2, 3)
    found = project_of(tested).corrected
    assert (found.xy[1:4, LEFT_HAND] == PLACE).all() and not found.edited.any()
    assert tab.message[0].startswith("Saved: left hand detected again, frames 8–10")
    tested.press("action", "undo")
    assert np.array_equal(project_of(tested).clip.keypoints.xy, before.xy)
    tested.press("action", "redo")
    assert (project_of(tested).corrected.xy[1:4, LEFT_HAND] == PLACE).all()


def test_frames_without_it_are_left_out_and_told(tested: LonePage, looking: Looking):
    looking.found = lambda frame: frame < FIRST + 3
    tested.page.tab.set(frames=range(6))
    tested.press("action", "detect_face")
    tested.settle()
    assert edits_of(tested)[0].frames == (0, 1, 2)
    assert "; not found in frames 10–12" in tested.page.tab.message[0]


def test_nothing_found_is_said_and_is_no_edit(tested: LonePage, looking: Looking):
    looking.found = lambda frame: False
    tested.page.tab.set(frames=range(6))
    tested.press("action", "detect_left_hand")
    tested.settle()
    assert [notice.title for notice in tested.notices] == ["No left hand was found in frames 7–12."]
    assert not project_of(tested).log


def test_a_rectangle_is_looked_into_once(tested: LonePage, looking: Looking):
    tested.press("action", "frame_right_hand")
    assert tested.page.gestures.again.framing == "right_hand"
    assert "Draw a rectangle around the right hand" in chips(tested)
    drawn = Framed(left=200.0, top=150.0, right=90.0, bottom=-10.0, frame=3)
    tested.page.receive(drawn)
    tested.settle()
    assert looking.asked[0]["region"] == (90, 0, 200, 150) and looking.asked[0]["frames"] == [FIRST + 3]
    assert tested.page.tab.state.frame == 3 and "Draw a rectangle" not in chips(tested)
    tested.page.receive(drawn)
    tested.settle()
    assert len(looking.asked) == 1, "nobody has asked for another one"


def test_a_rectangle_outside_the_picture_is_refused(tested: LonePage, looking: Looking):
    tested.press("action", "frame_face")
    with pytest.raises(InputError, match="Draw it in the picture, around the face"):
        tested.page.receive(Framed(left=-50.0, top=-50.0, right=-10.0, bottom=100.0, frame=0))
    assert not looking.asked


def test_escape_gives_the_rectangle_up_and_keeps_the_selection(tested: LonePage):
    tested.page.tab.set(selection=(4,))
    tested.press("action", "frame_face")
    tested.press("action", "escape")
    assert tested.page.gestures.again.framing is None and tested.page.tab.state.selection == (4,)
    tested.page.tab.set(mode="space")
    with pytest.raises(InputError, match="3D has no picture"):
        tested.press("action", "frame_face")


def test_a_look_that_goes_on_says_how_far_it_is_and_can_be_cancelled(tested: LonePage, looking: Looking):
    looking.goes_on.clear()
    tested.page.tab.set(frames=range(6))
    tested.press("action", "detect_person")
    tested.until(lambda: looking.asked)
    assert "Detecting the person again: opening the detector" in chips(tested)
    with pytest.raises(InputError, match="Detecting the person again: wait for it, or cancel it"):
        tested.press("action", "detect_face")
    tested.press("action", "cancel_detecting")
    looking.goes_on.set()
    tested.settle()
    assert not project_of(tested).log and tested.page.tab.message[0] == "Detecting the person again: cancelled"


def test_corrections_made_meanwhile_do_not_stop_it(tested: LonePage, looking: Looking):
    looking.goes_on.clear()
    tab = tested.page.tab
    tested.press("action", "detect_left_hand")
    tested.until(lambda: looking.asked)
    tab.set(selection=(4,))
    tested.press("action", "bad")
    looking.goes_on.set()
    tested.settle()
    assert len(project_of(tested).log) == 2 and project_of(tested).corrected.bad[0, 4]


def test_what_goes_wrong_is_told_with_what_to_do(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: Any, **__: Any) -> np.ndarray:
        raise InputError("The networks are not here: run tcfit models add mediapipe.")

    monkeypatch.setattr(second_look, "look_again", refuse)
    tested.press("action", "detect_face")
    tested.settle()
    (told,) = tested.notices
    assert told.title == "Detecting the face again: not possible" and "tcfit models add mediapipe" in told.text


def test_without_a_video_nothing_is_offered(page_of: Callable[..., LonePage], tmp_path: Path, looking: Looking):
    clip = replace(clip_of(tmp_path / "images"), source=None)
    page = page_of(Project.create(tmp_path / "walk.tcfit", clip))
    page.only(CorrectPanel)
    assert "video is missing" in page.html()
    with pytest.raises(InputError, match="video is missing"):
        page.page.gestures.again.look("face")


def test_a_project_that_cannot_be_changed_is_not_looked_at(
    page_of: Callable[..., LonePage], tmp_path: Path, looking: Looking
):
    Project.create(tmp_path / "walk.tcfit", clip_of(tmp_path / "images")).close()
    page = page_of(Project.open(tmp_path / "walk.tcfit", read_only=True))
    page.only(CorrectPanel)
    assert "Detect again" not in page.html()
    with pytest.raises(InputError, match="read-only"):
        page.page.gestures.again.look("face")


def test_the_menus_offer_it(tested: LonePage):
    tab, gestures = tested.page.tab, tested.page.gestures
    again, rectangle = next(group for group in menus.menus(gestures).picture if group[0].label == "Detect again")
    assert [item.action for item in again.more] == [f"detect_{part}" for part in PARTS]
    assert [item.action for item in rectangle.more] == [f"frame_{part}" for part in PARTS]
    assert any(item.label == "Detect again" for group in menus.menus(gestures).timeline for item in group)
    tab.set(frames=range(1, 3))
    labels = [item.label for group in menus.menus(gestures).frames for item in group]
    assert "Detect again, frames 8–9" in labels


def test_the_lens_is_put_back_to_look_and_taken_away_after(page_with: Callable[..., LonePage], looking: Looking):
    page = page_with(LENS)
    project = project_of(page)
    before = project.clip.keypoints
    page.press("action", "detect_left_hand")
    page.settle()
    near = looking.asked[0]["near"][0]
    assert np.allclose(near[:, :2], filmed_keypoints(before, LENS).xy[0])
    assert not np.allclose(near[:, :2], before.xy[0], atol=0.5)
    straight = project.corrected.xy[0, LEFT_HAND.start]
    assert np.allclose(filmed(LENS, straight), PLACE, atol=0.01) and not np.allclose(straight, PLACE, atol=0.5)


def test_a_rectangle_covers_what_it_shows_through_the_lens():
    region = (50.0, 40.0, 600.0, 430.0)
    left, top, right, bottom = filmed_region(region, LENS)
    inside = np.random.default_rng(0).uniform(region[:2], region[2:], (200, 2))
    bent = filmed(LENS, inside)
    assert (bent >= (left - 1, top - 1)).all() and (bent <= (right + 1, bottom + 1)).all()
    assert left > 50 and right < 600 and filmed_region(region, None) == region


def test_somebody_who_was_lost_is_looked_for_where_they_were():
    confidence = np.full((40, COUNT), 0.75)
    confidence[5:30] = 0
    keypoints = Keypoints(xy=np.random.default_rng(0).uniform(0, 100, (40, COUNT, 2)), confidence=confidence)
    near = known_near(keypoints, (4, 6, 17, 29))
    for row, frame in ((0, 4), (1, 4), (3, 30)):
        np.testing.assert_array_equal(near[row, :, :2], keypoints.xy[frame])
        assert (near[row, :, 2] == 0.75).all()
    assert not near[2, :, 2].any(), "too long ago"
    keypoints.confidence[:] = 0
    assert not known_near(keypoints, (4,))[..., 2].any()


def test_a_click_offers_a_search_where_the_person_was_not_found(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    page, tab = tested.page, tested.page.tab
    assert menus.menus(page.gestures).nobody is None
    with monkeypatch.context() as patch:
        patch.setattr(type(tab.session), "can_choose_person", property(lambda session: True))
        assert menus.menus(page.gestures).nobody is not None, "while another person can be chosen"
    with monkeypatch.context() as patch:
        nobody = Corrected.none(Keypoints(xy=np.zeros((FRAMES, COUNT, 2)), confidence=np.zeros((FRAMES, COUNT))))
        patch.setattr(type(tab.session.project), "corrected", property(lambda project: nobody))
        offer = menus.menus(page.gestures).nobody
    assert offer is not None and offer.label == "Nobody was detected here. Search here?" and not offer.obstacle
    page.receive(Key(action=offer.action, repeat=False))
    assert page.gestures.again.framing == "person", "the next drag draws the rectangle"
    assert menus.menus(page.gestures).nobody is None
