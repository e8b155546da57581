"""A rectangle for a second look, drawn in a real browser."""

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from fitting_core.detect import second_look
from fitting_core.keypoints import PARTS
from tests.drivers.review_page import Reviewing, reviewing, until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough


def choose(review: Reviewing, *labels: str) -> None:
    """Of the picture's menu and of those that it opens."""
    x, y = review.tab.evaluate("(bottom) => tcfit.place(0, bottom)", review.session.project.clip.camera.size[1])
    review.tab.mouse.click(x + 12, y - 12, button="right")
    for label in labels:
        review.tab.get_by_role("menuitem", name=label, exact=True).click()


def drag(review: Reviewing, start: tuple[float, float], end: tuple[float, float]) -> None:
    """From one of the image's pixels to another."""
    for step, (x, y) in enumerate((start, end)):
        place = review.tab.evaluate("([x, y]) => tcfit.place(x, y)", [x, y])
        review.tab.mouse.move(*place, steps=1 + 3 * step)
        (review.tab.mouse.up if step else review.tab.mouse.down)()


def test_a_rectangle_is_drawn_around_a_hand(
    demo_project: Path, browser: "Browser", tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = Path(shutil.copytree(demo_project, tmp_path / "demo.tcfit"))
    asked: list[dict[str, Any]] = []

    def look_again(source: Any, frames: list[int], **given: Any) -> np.ndarray:
        asked.append({"frames": frames, **given})
        points = np.zeros((len(frames), 137, 3))
        points[:, PARTS[given["part"]]] = (50, 60, 0.5)
        return points

    monkeypatch.setattr(second_look, "look_again", look_again)
    with reviewing(folder, browser) as review:
        until(lambda: review.page.tab.ready and "panels" in review.page.__dict__, "the panels")
        review.rest()
        again, project = review.page.gestures.again, review.session.project
        choose(review, "Detect in a rectangle", "Left hand")
        until(lambda: review.tab.evaluate("() => tcfit.state('framing')?.around") == "left hand", "the page to know")
        review.press("Escape", lambda: again.framing is None)
        choose(review, "Detect in a rectangle", "Right hand")
        until(lambda: review.tab.evaluate("() => tcfit.state('framing')?.around") == "right hand", "the page to know")
        wrist = tuple(project.corrected.xy[0, PARTS["right_hand"].start].tolist())
        end = (wrist[0] + 60, wrist[1] + 40)
        drag(review, wrist, end)  # it begins on a keypoint, which stays where it is
        until(lambda: project.log, "the edit")
        assert asked[0]["part"] == "right_hand" and len(asked) == 1
        assert asked[0]["region"] == pytest.approx((*wrist, *end), abs=2)
        assert [entry.action.part for entry in project.log] == ["right_hand"]  # pyright: ignore
        until(lambda: review.tab.evaluate("() => tcfit.state('framing')") is None, "the page to know the end")
        review.press("Control+z", lambda: project.redoable is not None)
        assert not review.complaints
