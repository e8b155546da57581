"""The view: its switches in the bar, and zooming."""

import numpy as np
import pytest

from fitting_core.errors import InputError
from fitting_core.keypoints import GROUPS
from tcfit_app.review.gestures.zooming import surroundings, zoom_to_selection
from tcfit_app.review.scene.scene import Cameras
from tests.drivers.lone_page import LonePage
from tests.tcfit_app.review.panels.conftest import suspect


def test_only_keypoints_in_the_picture_are_zoomed_to(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    page, seen = tested.page, []
    monkeypatch.setattr(page.tab.scene, "zoom_to", seen.append)
    detected = page.tab.session.project.corrected.confidence[0] > 0
    there, absent = np.flatnonzero(detected)[:2].tolist(), int(np.flatnonzero(~detected)[0])
    page.tab.set(selection=(*there, absent))
    zoom_to_selection(page.tab)
    page.tab.set(selection=tuple(there))
    zoom_to_selection(page.tab)
    assert seen[0] == seen[1]
    page.tab.set(selection=(absent,))
    with pytest.raises(InputError, match="nothing to zoom to"):
        zoom_to_selection(page.tab)


def test_what_is_gone_to_is_brought_into_view_where_the_user_has_zoomed(
    tested: LonePage, monkeypatch: pytest.MonkeyPatch
):
    page, seen = tested.page, []
    monkeypatch.setattr(page.tab.scene, "centre", seen.append)
    keypoints = page.tab.session.project.corrected
    joints = tuple(np.flatnonzero(keypoints.confidence[2])[:2].tolist())
    page.gestures.reviewing.show(suspect(2, joints=joints))
    assert not seen, "the whole picture shows it"
    monkeypatch.setattr(Cameras, "moved", True)
    page.gestures.reviewing.show(suspect(2, joints=joints))
    np.testing.assert_allclose(seen, [keypoints.xy[2, list(joints)].mean(0)])


@pytest.mark.parametrize("size", [(45, 60), (640, 480), (3840, 2160)])
def test_zooming_leaves_room_and_stays_in_the_picture(size: tuple[int, int]):
    width, height = size
    middle, diagonal = np.array([[width / 2, height / 2]]), np.hypot(*size)
    assert np.allclose(surroundings(middle, size), middle + diagonal / 30 * np.array([[-1], [1]]))
    corners = np.array([[0.0, 1.0], [width, height - 1]])
    assert np.allclose(surroundings(corners, size), [[0, 0], [width, height]])
    assert np.allclose(surroundings(np.array([[-9.0, 1.0]]), size)[0], [-9, max(0, 1 - diagonal / 30)])
    length, along = max(size), int(np.argmax(size))
    far = np.ones((2, 2))
    far[:, along] = length / 4, 3 * length / 4
    assert np.allclose(surroundings(far, size)[:, along], [0.15 * length, 0.85 * length])


def test_view_buttons(tested: LonePage):
    tested.draw()
    page = tested.page
    tested.press("action", "space")
    tested.press("action", "ghost")
    assert page.tab.state.mode == "space" and page.tab.state.ghost
    tested.press("bar.keypoints", "Face")
    assert page.tab.state.groups == set(GROUPS) - {"face"}
    tested.press("action", "keypoints")
    tested.press("bar.speed", "0.25×")
    assert (page.tab.state.keypoints, page.tab.state.speed) == (False, 0.25)
    assert ">0.25× ▾<" in tested.html()
    tested.press("bar.mode", "space")
    assert page.tab.state.mode == "edit", "off is Edit"
    tested.press("bar.mode", "ab")
    tested.press("bar.compare", "Side by side")
    assert page.tab.state.mode == "ab" and not page.tab.state.wipe
