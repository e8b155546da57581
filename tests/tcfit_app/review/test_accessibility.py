"""axe-core finds no serious fault in any panel and mode: names, contrast, roles."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import cv2
import numpy as np
import pytest

from fitting_core.keypoints import INDEX
from tcfit_app.review.panels import PANELS
from tests.drivers.review_page import Reviewing, reviewing
from tests.drivers.waiting import until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough

axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")


SHOWN_THEME = "document.documentElement.dataset.mantineColorScheme"


@pytest.fixture(scope="module")
def fitted(fitted_demo: Path, browser: "Browser", tmp_path_factory: pytest.TempPathFactory) -> Iterator[Reviewing]:
    folder = Path(shutil.copytree(fitted_demo, tmp_path_factory.mktemp("read") / "demo.tcfit"))
    with reviewing(folder, browser) as found:
        found.app.post(lambda: found.page.tab.set(selection=(INDEX["right_wrist"],)))
        yield found


@pytest.fixture(scope="module", params=["dark", "light"])
def review(fitted: Reviewing, request: pytest.FixtureRequest) -> Reviewing:
    """The same page as systems have it that are dark or light."""
    turn(fitted, request.param)
    return fitted


def turn(review: Reviewing, theme: Literal["dark", "light"]) -> None:
    """The system goes over to another theme."""
    review.tab.emulate_media(color_scheme=theme)
    until(lambda: review.tab.evaluate(SHOWN_THEME) == theme, f"the {theme} page")


READY = """() =>
  [...document.querySelectorAll("input[type=text]:not([type=hidden]), [role=slider]")].every(
    (field) => !field.checkVisibility() || field.ariaLabel || field.labels?.length || field.title,
  ) && document.getAnimations().every(({ playState }) => playState !== "running")"""


def faults(review: Reviewing) -> list[str]:
    """What hinders people, by axe's own judgement."""
    until(
        lambda: review.tab.evaluate(READY), "names of the fields, which come after a panel, and the end of transitions"
    )
    found = axe.Axe().run(review.tab).response["violations"]
    grave = [fault for fault in found if fault["impact"] in ("serious", "critical")]
    return [f"{fault['id']}: {node['html'][:200]}" for fault in grave for node in fault["nodes"]]


@pytest.mark.parametrize("title", [panel.title for panel in PANELS])
def test_panels(review: Reviewing, title: str):
    review.tab.get_by_role("tab", name=title, exact=True).click()
    assert faults(review) == []


def test_the_timeline_is_light_or_dark_as_the_system_is(review: Reviewing):
    """Not its ground alone: what is drawn on its canvas is told apart from that."""
    light = review.tab.evaluate("matchMedia('(prefers-color-scheme: light)').matches")

    def is_drawn() -> bool:
        strip = np.frombuffer(review.tab.locator(".tcfit-strip").screenshot(), np.uint8)
        drawn = cv2.imdecode(strip, cv2.IMREAD_GRAYSCALE)
        assert drawn is not None
        ground = np.median(drawn)
        return (ground > 200 if light else ground < 60) and (np.abs(drawn.astype(int) - ground) > 80).mean() > 0.005

    until(is_drawn, "the timeline")


def test_the_page_follows_the_system_while_it_draws(review: Reviewing):
    """Chromium tells no change of the system's theme that a script has seen by asking before."""
    review.tab.evaluate(
        """async () => {
          const { isDark } = await import("/tcfit/theme.js");
          (window.asking = () => { isDark(); requestAnimationFrame(window.asking); })();
        }"""
    )
    was = review.tab.evaluate(SHOWN_THEME)
    for _ in range(4):
        for theme in ("light", "dark"):
            turn(review, theme)
    turn(review, was)
    review.tab.evaluate("() => void (window.asking = () => {})")


@pytest.mark.parametrize("mode", ["ab", "space"])
def test_modes(review: Reviewing, mode: str):
    review.app.post(lambda: review.page.tab.set(mode=mode, difference=True))
    assert faults(review) == []


def test_menus_and_the_window_of_keys(review: Reviewing):
    review.app.post(lambda: review.page.tab.set(mode="edit", difference=False))
    review.press("h", lambda: review.tab.locator(".tcfit-keys").count())
    assert faults(review) == []
    review.press("Escape", lambda: not review.tab.locator(".tcfit-keys").count())
    review.tab.get_by_title("Choose the curves").click()
    until(lambda: review.tab.get_by_role("menu").count(), "the menu")
    assert faults(review) == []
    review.press("Escape", lambda: not review.tab.get_by_role("menu").count())
    review.press("h", lambda: review.tab.locator(".tcfit-keys").count())
    review.press("Escape", lambda: not review.tab.locator(".tcfit-keys").count())
    until(lambda: not review.tab.get_by_role("dialog").count(), "the end of the window")
