"""The review app as its users have it: a real browser, the demo project with few frames, a fit that runs."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch

from fitting_core.keypoints import INDEX
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.project import Project
from tests.drivers.review_page import QUICK, Reviewing, opened, reviewing, until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

WRIST = INDEX["right_wrist"]


@pytest.fixture(scope="module")
def review(demo_project: Path, browser: "Browser") -> Iterator[Reviewing]:
    """The project in a browser, after a fit that streamed in before its eyes."""
    with reviewing(demo_project, browser) as found:
        bodies = []
        found.app.post(lambda: found.session.fit_everything(QUICK, kind="smplx", gender="neutral"))
        until(lambda: found.session.jobs)

        def look() -> bool:
            bodies.append(found.session.fits.show(FitChoice()))
            return not found.session.jobs

        until(look, "the fit")
        shown = {shown.phase for shown in bodies if shown is not None}
        assert shown >= {1, 3}, "the phases came in one after the other"
        yield found
        assert not found.complaints


@pytest.fixture(autouse=True)
def at_ease(request: pytest.FixtureRequest) -> None:
    """Every test begins in Edit, at frame 8, with nothing selected."""
    if "review" not in request.fixturenames:
        return
    review: Reviewing = request.getfixturevalue("review")
    page = review.page
    review.app.post(lambda: page.tab.set(mode="edit", frame=8, selection=(), frames=None, playing=False, blinked=False))
    until(lambda: page.tab.state.frame == 8)
    review.rest()


def test_plays_pauses_and_steps(review: Reviewing):
    review.press("Space", lambda: review.frame > 10)
    assert review.page.tab.state.playing
    review.press("Space", lambda: not review.page.tab.state.playing)
    review.press("Home", lambda: review.frame == 0)
    review.press("ArrowRight", lambda: review.frame == 1)
    review.press("Shift+ArrowRight", lambda: review.frame == 11)
    review.press("ArrowLeft", lambda: review.frame == 10)
    review.press("End", lambda: review.frame == review.page.tab.length - 1)


def test_a_keypoint_is_dragged_and_the_body_follows(review: Reviewing):
    before = review.session.fits.show(FitChoice())
    assert before is not None
    was = review.session.project.corrected.xy[8, WRIST].copy()
    x, y = review.place("right_wrist")
    review.tab.mouse.move(x, y)
    review.tab.mouse.down()
    review.tab.mouse.move(x - 30, y - 24, steps=6)
    until(lambda: review.session.following.live is not None, "the live correction")
    review.tab.mouse.move(x - 60, y - 48, steps=6)
    review.tab.mouse.up()
    until(lambda: review.session.project.last_edit > 0, "the edit")
    moved = review.session.project.corrected.xy[8, WRIST] - was
    assert moved == pytest.approx(np.array([-60, -48]) / review.scale(), abs=0.05)
    review.rest()
    after = review.session.fits.show(FitChoice())
    assert after is not None and after.run.kind == "corrections"
    assert not torch.equal(after.params.body_pose[8], before.params.body_pose[8])
    assert torch.equal(after.params.body_pose[20], before.params.body_pose[20])
    assert review.page.tab.state.selection == (WRIST,)
    edits = review.session.project.last_edit
    review.press("x", lambda: review.session.project.corrected.bad[8, WRIST])
    review.press("Control+z", lambda: not review.session.project.corrected.bad[8, WRIST])
    review.press("Control+z", lambda: np.array_equal(review.session.project.corrected.xy[8, WRIST], was))
    review.press("Control+Shift+z", lambda: not np.array_equal(review.session.project.corrected.xy[8, WRIST], was))
    assert review.session.project.last_edit == edits + 4


def test_a_range_is_fitted_again_with_another_weight(review: Reviewing):
    page = review.page
    review.press("BracketLeft", lambda: page.tab.state.frames is not None)
    review.press("Shift+ArrowRight", lambda: review.frame == 18)
    review.press("BracketRight", lambda: page.tab.state.frames == range(8, 19))
    settings = page.tab.state.settings
    changed = replace(QUICK, temporal=replace(QUICK.temporal, weight=500.0))
    review.app.post(lambda: page.tab.set(settings=replace(settings, config=changed)))
    runs = len(review.session.fits.runs)
    review.press("r", lambda: len(review.session.fits.runs) > runs)
    review.rest()
    run = review.session.fits.runs[-1]
    assert (run.kind, run.frames, run.state, run.config.temporal.weight) == ("frames", range(8, 19), "finished", 500.0)
    until(lambda: run.name in shown_labels(review)[0], "the new run in the view")


def test_two_fits_side_by_side(review: Reviewing):
    review.press("2", lambda: len(shown_labels(review)) == 2)
    labels = shown_labels(review)
    assert "SMPLify-X" in labels[0] and "temporal" in labels[1]
    a, b = (until(lambda i=i: body_in_page(review, i), "a body") for i in (0, 1))
    assert a != b
    review.press("b", lambda: "temporal" in shown_labels(review)[0])
    review.press("3", lambda: review.page.tab.state.mode == "space")
    review.press("1", lambda: len(shown_labels(review)) == 1)


def test_every_key_is_taken(review: Reviewing):
    page = review.page
    for key, name in {"m": "bodies", "k": "keypoints", "g": "wireframe", "d": "difference", "l": "loop"}.items():
        before = getattr(page.tab.state, name)
        review.press(key, lambda name=name, before=before: getattr(page.tab.state, name) != before)
        review.press(key, lambda name=name, before=before: getattr(page.tab.state, name) == before)
    review.press("d", lambda: review.tab.locator(".tcfit-legend").is_visible())
    review.press("m", lambda: review.tab.locator(".tcfit-legend").is_hidden())
    review.press("m", lambda: review.tab.locator(".tcfit-legend").is_visible())
    review.press("d", lambda: review.tab.locator(".tcfit-legend").is_hidden())
    review.press("Control+a", lambda: len(page.tab.state.selection) > 60)
    review.press("Escape", lambda: page.tab.state.selection == ())


def test_a_reload_keeps_everything(review: Reviewing):
    review.press("2", lambda: review.page.tab.state.mode == "ab")
    review.press("End", lambda: review.frame == review.page.tab.length - 1)
    before, edits = review.page.tab.state, review.session.project.last_edit
    client = review.page.tab.client.client_id
    review.tab.reload()
    until(lambda: review.app.pages and review.page.tab.client.client_id != client and review.page.tab.ready, "the page")
    assert replace(review.page.tab.state, playing=False) == replace(before, playing=False)
    assert review.session.project.last_edit == edits
    until(lambda: len(shown_labels(review)) == 2)
    until(lambda: body_in_page(review, 1), "the body")


def test_a_second_browser_has_its_own_frame_and_sees_the_same_project(review: Reviewing, browser: "Browser"):
    first = review.page
    other = opened(review.app, review.server, browser)
    assert other.page is not first and other.frame == 0
    other.press("ArrowRight", lambda: other.frame == 1)
    assert first.tab.state.frame == 8
    seen = review.session.edits
    first.tab.do(lambda: first.tab.set(selection=(WRIST,)))
    review.tab.keyboard.press("Control+ArrowUp")
    until(lambda: review.session.edits > seen, "the edit")
    other.press("Control+z", lambda: other.session.project.undoable is None or other.session.edits > seen + 1)
    assert not other.complaints
    other.tab.context.close()
    until(lambda: len(review.app.pages) == 1)


def test_states_without_a_fit_a_video_or_the_lock(demo_project: Path, browser: "Browser", tmp_path: Path):
    folder = tmp_path / "copy.tcfit"
    with Project.open(demo_project, read_only=True) as project:
        Project.create(folder, replace(project.clip, source=None)).close()
    with Project.open(folder), reviewing(folder, browser, read_only=True) as found:
        texts = until(lambda: chips(found), "the status line")
        assert any("No fit yet" in text for text in texts) and any("Read-only" in text for text in texts)
        assert any("made without a video" in text for text in texts)
        found.press("d", lambda: found.page.tab.state.difference)
        assert found.tab.locator(".tcfit-legend").is_hidden(), "there is nothing between two fits yet"
        found.tab.keyboard.press("Shift+R")
        found.tab.get_by_text("open read-only").first.wait_for()
        assert not found.session.jobs and not found.complaints


def shown_labels(review: Reviewing) -> list[str]:
    """Labels of the posters as the page has them."""
    return review.tab.evaluate("() => tcfit.state('layout')?.posters.map((p) => p.label) ?? []")


def chips(review: Reviewing) -> list[str]:
    """The page's status line."""
    return review.tab.evaluate("() => tcfit.state('chips')?.chips.map((c) => c.text) ?? []")


def body_in_page(review: Reviewing, poster: int) -> list[float]:
    """The first bytes of a poster's body, as viser's scene in the page has them; empty if there is none."""
    return review.tab.evaluate(
        """(poster) => {
          const nodes = Object.entries(window.__viserSceneTree.getState());
          const mine = nodes.filter(([name]) => name.startsWith(`/posters/${poster}/`)).map(([, n]) => n.message.props);
          const body = mine.find((props) => props.vertices);
          return body ? [...body.vertices.slice(0, 240)] : [];
        }""",
        poster,
    )
