"""The side view of a tab: what the page is told, and what keys and buttons make of it. No browser."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.points.positions import joints_in_space
from fitting_core.keypoints import GROUPS, INDEX
from fitting_core.results.error_bars import JOINTS
from tcfit_app.project.project import Project
from tcfit_app.review.browser.page_events import Hello, Key
from tcfit_app.review.browser.page_states import Bodies, Layout, SidePlate
from tcfit_app.review.drawing.picture import error_bars_of
from tcfit_app.review.shared.drawing_data import FrameBody
from tcfit_app.review.tab.state import CLOSE_UPS, HELD_BY
from tests.drivers.lone_page import LonePage
from tests.samples.project_samples import sample_error_bars
from tests.samples.sessions import OneBody, small_clip, until


def told(tested: LonePage, name: str) -> Any:
    """What the page was told last under a name, once all is made."""
    sent: dict[str, Any] = {}
    channel = tested.page.tab.channel
    usual = channel.send
    channel.send = lambda name, state: sent.update({name: state})  # pyright: ignore[reportAttributeAccessIssue]
    tested.page.tab._shown = None
    try:
        waits = name in ("side", "bodies", "space")
        until(tested.page.tab.session, lambda: tested.page.picture.draw() and (not waits or name in sent))
    finally:
        channel.send = usual
    return sent.get(name)


def press(tested: LonePage, action: str) -> None:
    tested.page.receive(Key(action=action, repeat=False))


def seen(tested: LonePage, name: str = "side") -> Any:
    """What the page is told under a name once there is a body."""
    found: list[Any] = []

    def there() -> bool:
        state = told(tested, name)
        found[:] = [state] if state is not None else []
        return bool(found)

    until(tested.page.tab.session, there)
    return found[0]


def colors(tested: LonePage) -> list[str]:
    return [body.color for body in seen(tested, "bodies").bodies]


def plates(tested: LonePage) -> list[str]:
    layout = told(tested, "layout")
    assert isinstance(layout, Layout)
    return [poster.label for poster in layout.posters if poster.kind == "side"]


def test_it_is_there_at_first_and_shows_the_bodies_of_the_pictures(tested: LonePage):
    assert plates(tested) == ["from the right"]
    assert colors(tested) == ["fit"]
    tested.page.tab.set(blinked=True)
    assert colors(tested) == ["beside"]
    tested.page.tab.set(mode="ab")
    assert colors(tested) == ["beside", "fit"]
    assert len(seen(tested).shifts) == 2
    tested.page.tab.set(mode="space")
    assert plates(tested) == []


def test_error_bars_are_told_of_the_keypoints_that_are_joints(tested: LonePage):
    (plain,) = seen(tested, "bodies").bodies
    assert not plain.error_bars, "this fit has none"
    shown = tested.shown
    assert shown.result is not None
    bars = sample_error_bars(1, len(shown.params))
    known = replace(shown, result=replace(shown.result, error_bars=bars))
    found = error_bars_of(known, 1)
    assert found[INDEX["left_knee"]] == pytest.approx(bars.joints[1, JOINTS.index("left_knee")], abs=1e-4)
    assert found[INDEX["nose"]] == pytest.approx(bars.joints[1, JOINTS.index("head")], abs=1e-4)
    assert found[INDEX["left_ear"]] is None
    assert error_bars_of(known, 0) == (), "there is none of this frame"


def test_keypoints_are_told_in_space_and_how_the_plate_shows_them(tested: LonePage):
    tab, state, bodies = tested.page.tab, seen(tested), seen(tested, "bodies")
    assert isinstance(state, SidePlate) and isinstance(bodies, Bodies)
    (body,), (shift,) = bodies.bodies, state.shifts
    shown = tested.shown
    points = tab.data.meshes(shown).keypoints(shown.params)[tab.state.frame, :25]
    drawn = FrameBody(shown=shown, frame=tab.state.frame)
    np.testing.assert_allclose(tab.data.body_points(drawn), points, atol=1e-6)
    joints = joints_in_space(tab.data.meshes(shown).body, shown.params)[tab.state.frame]
    assert body.pelvis == pytest.approx(joints[JOINT["pelvis"], 2], abs=1e-4), "from which edits of depth count"
    known = np.isfinite(points).all(1)
    assert [point is not None for point in body.points] == known.tolist()
    found = np.array([point for point in body.points if point is not None])
    np.testing.assert_allclose(found, points[known], atol=1e-4)
    size = tab.session.project.clip.camera.size
    pixels = found @ np.transpose(state.plate) + shift
    assert ((pixels >= 0) & (pixels <= [tab.side_width * size[1], size[1]])).all()
    # The floor is where the plate has it.
    assert state.floor is not None
    heights = bodies.floor - found @ bodies.down
    np.testing.assert_allclose(heights, (state.floor - pixels[:, 1]) / state.metre, atol=2e-3)


def test_the_page_is_told_where_what_a_close_up_follows_is(tested: LonePage):
    tab = tested.page.tab
    assert [body.followed for body in seen(tested, "bodies").bodies] == [None]
    for part in CLOSE_UPS:
        tab.set(close_up=part)
        (body,), shown = seen(tested, "bodies").bodies, tested.shown
        points = tab.data.meshes(shown).keypoints(shown.params)[tab.state.frame]
        group = points[GROUPS[part]]
        middle = group[np.isfinite(group).all(1)].mean(0) if np.isfinite(group).any() else points[HELD_BY[part]]
        np.testing.assert_allclose(body.followed, middle, atol=1e-4)


def test_3d_shows_keypoints_too_also_of_hidden_bodies(tested: LonePage):
    tested.page.tab.set(mode="space", bodies=False, ghost=True)
    until(tested.page.tab.session, lambda: len(colors(tested)) == 2)
    state = seen(tested, "space")
    np.testing.assert_allclose(state.turn[1], seen(tested, "bodies").down, atol=1e-4)


def test_keys_switch_and_turn_it(tested: LonePage):
    press(tested, "side")
    assert not tested.page.tab.state.side and plates(tested) == []
    press(tested, "turn_side")
    assert plates(tested) == ["from the right"], "what was off is switched on as it was"
    labels = []
    for _ in range(3):
        press(tested, "turn_side")
        labels += plates(tested)
    assert labels == ["from above", "from the left", "from the right"]
    tested.press("bar.side", "From above")
    assert tested.page.tab.state.side_from == "top"


def test_without_a_fit_there_is_none(page_of: Callable[..., LonePage], tmp_path: Path, tiny_body: BodyModel):
    made = page_of(Project.create(tmp_path / "walk.tcfit", small_clip(tiny_body)), bodies=OneBody(tiny_body))
    made.page.receive(Hello("me", 1000, 700))
    assert plates(made) == []
