"""Pictures that are saved, and the first steps, which a browser shows until they have been read."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from tests.drivers.review_page import Reviewing, reviewing, until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def review(demo_project: Path, browser: "Browser", tmp_path_factory: pytest.TempPathFactory) -> Iterator[Reviewing]:
    folder = Path(shutil.copytree(demo_project, tmp_path_factory.mktemp("steps") / "demo.tcfit"))
    with reviewing(folder, browser) as found:
        until(lambda: found.tab.evaluate("tcfit.place(0, 0)"), "the picture")
        yield found


def test_the_picture_is_saved_as_it_is_on_show(review: Reviewing, tmp_path: Path):
    review.app.post(lambda: review.page.tab.seek(12))
    until(lambda: review.tab.evaluate("tcfit.state('keypoints').frame") == 12)
    review.rest()
    with review.tab.expect_download() as saved:
        review.tab.get_by_role("button", name="Save picture").click()
    assert saved.value.suggested_filename == "demo frame 12.png"
    saved.value.save_as(tmp_path / "saved.png")
    found = cv2.imread(str(tmp_path / "saved.png"))
    assert found is not None
    box = review.tab.locator("canvas[aria-label^=Picture]").bounding_box()
    assert box is not None
    review.tab.add_style_tag(content=".tcfit-chips, .mantine-Notifications-root { visibility: hidden }")
    review.tab.mouse.move(5, 5)
    x, y, width, height = (round(box[key]) for key in ("x", "y", "width", "height"))
    saved_picture = cv2.resize(found, (width, height)).astype(int)

    def is_alike() -> bool:
        screen = cv2.imdecode(np.frombuffer(review.tab.screenshot(), np.uint8), cv2.IMREAD_COLOR)
        assert screen is not None
        seen = screen[y : y + height, x : x + width]
        apart = np.abs(saved_picture - seen).max(2)
        return seen.std() > 20 and np.median(apart) <= 3 and (apart > 40).mean() < 0.03

    until(is_alike, "a screen like the saved picture")


def test_the_first_steps_stay_until_they_have_been_read(review: Reviewing, browser: "Browser"):
    context = browser.new_context(viewport={"width": 1000, "height": 640})
    tab = context.new_page()
    tab.goto(review.server.gate.link)
    steps = tab.get_by_role("region", name="First steps")
    steps.wait_for()
    assert "Fit everything" in steps.inner_text() and "Shift+R" in steps.inner_text()
    tab.reload()
    steps.wait_for()
    steps.get_by_role("button", name="Got it").click()
    steps.wait_for(state="hidden")
    tab.reload()
    tab.get_by_role("tab", name="View", exact=True).wait_for()
    assert steps.is_hidden()
    tab.keyboard.press("h")
    tab.get_by_role("button", name="First steps").click()
    steps.wait_for()
    tab.locator(".tcfit-keys").wait_for(state="hidden")
    context.close()
