"""The first picture of a page is drawn where it stays, whatever else comes after it."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from tcfit_app.project.project import Project
from tests.drivers.lone_page import sample_project
from tests.drivers.review_page import opened, reviewing, until
from tests.samples.project_samples import sample_clip
from tests.samples.spot_clips import empty_project, spot_video

if TYPE_CHECKING:
    from typing import Literal

    from playwright.sync_api import Browser

    Scheme = Literal["light", "dark"]

pytestmark = pytest.mark.thorough

CORNERS = """
  window.corners = new Set();
  const look = () => {
    const layout = window.tcfit?.state?.("layout");
    let drawn = false;
    for (const [name, node] of Object.entries(window.__viserMutable?.nodeRefFromName ?? {}))
      if (name.endsWith("/video")) node?.traverse((child) => (drawn ||= Boolean(child.material?.map?.image?.width)));
    if (layout?.image && drawn) {
      const places = [tcfit.place(0, 0), tcfit.place(...layout.image)].flat().map(Math.round);
      corners.add([...places, Math.round(__viserMutable.canvas.getBoundingClientRect().bottom)].join(" "));
    }
    requestAnimationFrame(look);
  };
  look();
"""
"""Notes where the corners of the picture are, from when it is there."""


@pytest.mark.parametrize("size", [(720, 1280), (1280, 720)])
def test_the_first_picture_is_drawn_where_it_stays(browser: "Browser", tmp_path: Path, size: tuple[int, int]):
    clip = sample_clip()
    center = size[0] / 2, size[1] / 2
    folder = tmp_path / "clip.tcfit"
    Project.create(folder, replace(clip, camera=replace(clip.camera, size=size, center=center))).close()
    with reviewing(folder, browser) as first:
        review = opened(first.app, first.server, browser, script=CORNERS)
        review.tab.wait_for_function("corners.size > 0")
        review.tab.wait_for_selector("html.tcfit-ready", state="attached")
        review.rest()
        found = review.tab.evaluate("[...corners]")
        assert len(found) == 1, found
        left, top, right, bottom, end = map(int, found[0].split())
        assert (right - left) / (bottom - top) == pytest.approx(size[0] / size[1], rel=0.02) and bottom <= end


SEEN = """
  window.seen = new Set();
  const look = () => {
    requestAnimationFrame(look);
    if (!document.getElementById("unhurried"))
      document.head?.insertAdjacentHTML("beforeend", `<style id="unhurried">html::before { animation: none }</style>`);
    if (!document.querySelector("#root > *")) return;
    const { display, visibility, left, backgroundColor } = getComputedStyle(document.documentElement, "::before");
    const behind = display === "none" || visibility === "hidden" ? "nothing" : left === "0px" ? "all" : "panel";
    seen.add([behind, document.querySelector("[role=tab]") !== null, backgroundColor].join());
  };
  requestAnimationFrame(look);
"""
"""Notes, once viser has drawn something, what is behind the curtain, whether the panels are there, and its colour. The
curtain waits for them for as long as a slow machine takes."""
WHITE, DARK = "rgb(255, 255, 255)", "rgb(26, 27, 30)"


@pytest.mark.parametrize(
    ("scheme", "chosen", "color"),
    [("light", "", WHITE), ("dark", "", DARK), ("light", "dark", DARK), ("dark", "light", WHITE)],
)
def test_viser_s_own_panel_is_never_seen(browser: "Browser", tmp_path: Path, scheme: "Scheme", chosen: str, color: str):
    sample_project(tmp_path / "walk.tcfit", "first").close()
    with reviewing(tmp_path / "walk.tcfit", browser) as first:
        context = browser.new_context(viewport={"width": 960, "height": 640}, color_scheme=scheme)
        context.add_cookies([{"name": "tcfit-theme", "value": chosen, "url": first.server.gate.link}])
        tab = context.new_page()
        tab.add_init_script(SEEN)
        tab.goto(first.server.gate.link)
        tab.wait_for_selector("html.tcfit-ready", state="attached")
        seen = tab.evaluate("[...seen]")
        assert f"all,false,{color}" in seen and not [one for one in seen if one.startswith("nothing,false")]
        assert tab.evaluate("() => getComputedStyle(document.documentElement, '::before').display") == "none"


LATE_PICTURES = """
  const { get, set } = Object.getOwnPropertyDescriptor(HTMLImageElement.prototype, "src");
  Object.defineProperty(HTMLImageElement.prototype, "src", {
    get, set(value) { setTimeout(() => set.call(this, value), 1500); }
  });
"""
"""As in a browser that is busy: viser has drawn its nodes before their first pictures are decoded."""


def test_a_picture_that_comes_late_is_seen(browser: "Browser", tmp_path: Path):
    """Not the white of a material that was compiled before."""
    folder = tmp_path / "clip.tcfit"
    media = spot_video(tmp_path / "spots")
    empty_project(folder, media)
    with reviewing(folder, browser) as first:
        review = opened(first.app, first.server, browser, script=LATE_PICTURES)
        review.rest()
        width, height = review.session.project.clip.camera.size
        (left, top), (right, bottom) = (
            review.tab.evaluate("([x, y]) => tcfit.place(x, y)", corner) for corner in ([0, 0], [width, height])
        )

        def is_seen() -> bool:
            pixels = cv2.imdecode(np.frombuffer(review.tab.screenshot(), np.uint8), cv2.IMREAD_COLOR)
            assert pixels is not None
            shown = pixels[round(top) + 2 : round(bottom) - 2, round(left) + 2 : round(right) - 2]
            return shown.std() > 5 and np.median(shown) < 250

        until(is_seen, "the picture")
