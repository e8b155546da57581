"""The silhouette and the straight lines over the picture: where they are, and when they are sent."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from fitting_core.camera import Lens
from fitting_core.errors import InputError
from fitting_core.ground.from_pictures import StraightLines
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.lens import filmed
from fitting_core.silhouettes import Silhouettes, silhouette_size
from tcfit_app.project.project import Project
from tcfit_app.review.drawing.overlays import outlines
from tcfit_app.review.gestures.actions import ACTIONS
from tcfit_app.review.shared import drawing_data
from tests.drivers.lone_page import LonePage, told
from tests.drivers.waiting import until
from tests.samples.spot_clips import FRAMES, SIZE, empty_project, spot_video

WIDE = (1280, 960)


def square_mask(size: tuple[int, int], hole: bool = False) -> np.ndarray:
    """A square in the middle, half as high as the image, and a hole in it."""
    width, height = silhouette_size(size)
    mask = np.zeros((height, width), bool)
    mask[height // 4 : -height // 4, width // 4 : -width // 4] = True
    if hole:
        mask[height // 2 - 10 : height // 2 + 10, width // 2 - 10 : width // 2 + 10] = False
    return mask


def test_an_outline_lies_around_what_is_covered():
    (line,) = outlines(square_mask(WIDE), WIDE, None)
    assert len(line) == 4
    pixel = WIDE[0] / silhouette_size(WIDE)[0]
    np.testing.assert_allclose(line.min(0), np.array(WIDE) / 4, atol=pixel)
    np.testing.assert_allclose(line.max(0), 0.75 * np.array(WIDE), atol=pixel)


def test_a_hole_has_its_own_outline_and_nothing_has_none():
    assert len(outlines(square_mask(WIDE, hole=True), WIDE, None)) == 2
    assert outlines(np.zeros_like(square_mask(WIDE)), WIDE, None) == []


def test_steps_of_the_mask_are_smoothed():
    width, height = silhouette_size(WIDE)
    mask = cv2.circle(np.zeros((height, width), np.uint8), (width // 2, height // 2), 60, 1, -1).astype(bool)
    (line,) = outlines(mask, WIDE, None)
    radius = np.linalg.norm(line - np.array(WIDE) / 2, axis=1) * width / WIDE[0]
    assert len(line) < 60 and np.abs(radius - 60).max() < 1.5


def test_it_is_straightened_as_the_picture_is():
    lens = Lens(focal=(900.0, 900.0), center=(640.0, 480.0), distortion=(-0.2, 0.03))
    (plain,), (straight,) = (outlines(square_mask(WIDE), WIDE, one) for one in (None, lens))
    np.testing.assert_allclose(filmed(lens, straight), plain, atol=0.05)


@pytest.fixture
def page(page_of: Callable[..., LonePage], tmp_path: Path, request: pytest.FixtureRequest) -> LonePage:
    """The silhouette is known in all frames but the first; with the parameter "unknown" in none."""
    mask = np.packbits(square_mask(SIZE))
    known = Silhouettes.of([None, *[mask] * (FRAMES - 1)], silhouette_size(SIZE))
    points = Keypoints(xy=np.ones((FRAMES, COUNT, 2)), confidence=np.ones((FRAMES, COUNT)))
    project = Project.open(empty_project(tmp_path / "walk.tcfit", spot_video(tmp_path / "walk")))
    project.take_detections(points, silhouettes=None if getattr(request, "param", "") == "unknown" else known)
    made = page_of(project)
    made.only()
    return made


def test_it_is_sent_where_it_is_wanted_and_known(page: LonePage):
    tab = page.page.tab

    def draw() -> None:
        tab.look()
        page.page.picture.draw()

    with told(tab) as sent:
        draw()
        page.press("action", "silhouette")
        draw()
        assert "silhouette" not in dict(sent), "of the first frame there is none"
        tab.seek(3)
        draw()
        draw()
        tab.set(mode="space")
        draw()
    shown, gone = (state for name, state in sent if name == "silhouette")
    assert len(shown.lines) == 1 and gone is None


def test_straight_lines_are_sent_while_they_are_shown(page: LonePage, monkeypatch: pytest.MonkeyPatch):
    found = StraightLines(edges=np.array([[1.0, 2, 3, 4], [5, 6, 7, 8]]), along=np.array([True, False]))
    monkeypatch.setattr(drawing_data, "straight_lines", lambda *_: found)
    tab = page.page.tab
    with told(tab) as sent:
        page.press("action", "straight_lines")
        until(lambda: tab.data.straight_lines is found, "the lines")
        for mode in ("edit", "space"):
            tab.set(mode=mode)
            tab.look()
            page.page.picture.draw()
    shown, gone = (state for name, state in sent if name == "straight_lines")
    assert shown.along == ((1, 2, 3, 4),) and shown.other == ((5, 6, 7, 8),) and gone is None


def test_the_button_is_off_where_none_is_known(page: LonePage):
    assert not ACTIONS["silhouette"].obstacle(page.page.gestures)


@pytest.mark.parametrize("page", ["unknown"], indirect=True)
def test_without_one_it_is_said_why(page: LonePage):
    assert "There is no silhouette" in ACTIONS["silhouette"].obstacle(page.page.gestures)
    with pytest.raises(InputError, match="There is no silhouette"):
        page.press("action", "silhouette")
