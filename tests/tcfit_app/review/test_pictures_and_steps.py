"""The first steps, which a browser shows until they have been read."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

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


def test_the_first_steps_stay_until_they_have_been_read(review: Reviewing, browser: "Browser"):
    context = browser.new_context(viewport={"width": 1000, "height": 640})
    tab = context.new_page()
    tab.goto(review.server.gate.link)
    steps = tab.locator(".tcfit-panel", has=tab.get_by_text("First steps", exact=True))
    steps.wait_for()
    texts = steps.locator("li").all_inner_texts()
    assert len(texts) == 4 and texts[0] == "Play the clip Space"
    assert steps.bounding_box()["x"] > tab.locator(".tcfit").bounding_box()["width"], "not over the picture"  # pyright: ignore
    tab.reload()
    steps.wait_for()
    steps.get_by_role("button", name="Got it").click()
    steps.wait_for(state="detached")
    tab.reload()
    tab.wait_for_selector("html.tcfit-ready", state="attached")
    assert not steps.count()
    tab.get_by_role("button", name="Help").click()
    tab.get_by_role("menuitem", name="First steps").click()
    steps.wait_for()
    context.close()
