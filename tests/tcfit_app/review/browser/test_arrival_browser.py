"""Picture, body and keypoints of a frame reach the screen together, in a real browser."""

import math
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tcfit_app.review.browser.channel import web_files
from tcfit_app.review.browser.page_states import Cursor
from tcfit_app.review.scene.layers import BodyLayer, jpeg
from tcfit_app.review.scene.nodes import BodyNode, ImageNode, MeshDressing
from tcfit_app.server.serving import review_server
from tests.drivers.page_tab import TABS, Tab, open_tab

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough

FACES = np.array([[0, 2, 1], [0, 3, 2]])
SQUARE = np.array([[-0.2, -0.2, 0], [0.2, -0.2, 0], [0.2, 0.2, 0], [-0.2, 0.2, 0]], np.float32)
BROKEN = b"no picture"
WATCH = """() => {
  window.meshOf = (name) => {
    let found = null;
    __viserMutable.nodeRefFromName[name]?.traverse((child) => (found ??= child.isMesh ? child : null));
    return found;
  };
  window.shownPicture = () => meshOf("/video")?.material.map?.image?.width ?? 0;
  window.drawn = [];
  const { scene } = __viserMutable, usual = scene.onAfterRender;
  scene.onAfterRender = (...all) => {
    const body = meshOf("/body")?.geometry.attributes.position.array[2] ?? 0;
    window.drawn.push([Math.round(-1000 * body), shownPicture(), tcfit.state("cursor")?.frame ?? 0]);
    usual?.(...all);
  };
}"""
"""Notes at each drawing whose frame the body, the picture and the page's own state are."""
PUT_AWAY = """(hidden) => {
  Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
  document.dispatchEvent(new Event("visibilitychange"));
}"""


class Scene:
    """A page with a picture and a body. Those of frame i: i pixels wide, and at z = -i / 1000."""

    def __init__(self, tab: Tab) -> None:
        self.tab, self.page, self.client = tab, tab.page, tab.clients[-1]
        self.make_nodes()
        self.page.evaluate(WATCH)
        self.show(1)
        tab.look(300.0)
        self.until_shown(1)

    def make_nodes(self) -> None:
        """As for a new connection."""
        dressing = MeshDressing(self.client)
        self._image = ImageNode(self.client, "/video", dressing, picture(1))
        self._body = BodyNode(self.client, "/body", dressing)

    def show(self, frame: int, image: bytes | None = None) -> None:
        """All of a frame in one message."""
        vertices = SQUARE - np.array([0, 0, frame / 1000], np.float32)
        layer = BodyLayer(vertices=vertices, faces=FACES)
        with self.client.atomic():
            self._image.draw(image or picture(frame), (1.0, 1.0))
            self._body.draw(layer, vertices)
            self.tab.post(cursor=Cursor(frame=frame))

    def until_shown(self, frame: int) -> None:
        """Waits until the picture of that frame was drawn, and nothing waits any more."""
        self.page.wait_for_function("(width) => window.drawn.some(([, shown]) => shown === width)", arg=frame)
        self.page.wait_for_timeout(100)

    def drawn(self) -> list[list[int]]:
        """Frame of body, picture and state at each drawing since the last time."""
        return self.page.evaluate("() => window.drawn.splice(0)")


def picture(frame: int) -> bytes:
    return jpeg(np.full((9, frame, 3), 90, np.uint8))


@pytest.fixture(scope="module")
def opened(browser: "Browser") -> Iterator[Scene]:
    scripts = web_files()
    with review_server("A clip", port=0, open_browser=False, scripts=scripts, say=lambda text: None) as running:
        running.viser.on_client_connect(lambda client: TABS[-1].connect(client))
        # As in the app. In software, viser's surroundings take five seconds at the first drawing of a body.
        running.viser.scene.configure_environment_map(None)
        tab = open_tab(running, browser)
        tab.page.on("console", lambda said: tab.complaints.append(said.text) if said.type == "error" else None)
        yield Scene(tab)


@pytest.fixture
def scene(opened: Scene) -> Iterator[Scene]:
    opened.drawn()
    yield opened
    assert opened.tab.complaints == []


def test_no_drawing_mixes_two_frames(scene: Scene):
    for frame in range(2, 10):
        scene.show(frame)
        scene.until_shown(frame)
    drawn = scene.drawn()
    assert [found for found in drawn if len(set(found)) > 1] == []
    assert sorted({found[0] for found in drawn} - {1}) == list(range(2, 10))


def test_a_frame_is_drawn_once(scene: Scene):
    began = time.monotonic()
    scene.show(30)
    scene.until_shown(30)
    drawn = scene.drawn()
    # viser itself draws once a second: within half a second once or not at all, and a busy machine may take seconds.
    assert len(drawn) <= 2 + math.ceil(time.monotonic() - began)


def test_frames_that_come_faster_than_they_are_decoded_keep_their_order(scene: Scene):
    for frame in range(40, 80):
        scene.show(frame)
    scene.until_shown(79)
    drawn = [found for found in scene.drawn() if found[0] >= 40]
    assert all(len(set(found)) == 1 for found in drawn) and drawn == sorted(drawn) and drawn[-1] == [79] * 3


def test_a_body_needs_no_picture(scene: Scene):
    scene.show(20)
    scene.until_shown(20)
    scene.show(21, scene._image._image)
    scene.page.wait_for_function("() => window.drawn.some(([body]) => body === 21)")
    assert scene.drawn()[-1] == [21, 20, 21]


def test_panels_do_not_wait_and_keep_their_order(scene: Scene):
    with scene.client.atomic():
        scene.show(31)
        text = scene.client.gui.add_markdown("first")
    text.content = "second"
    scene.until_shown(31)
    scene.page.get_by_text("second").wait_for()
    text.remove()
    assert scene.drawn()[-1] == [31] * 3


def test_a_node_that_is_made_anew_shows_its_new_picture(scene: Scene):
    scene.show(32)
    scene.until_shown(32)
    with scene.client.atomic():
        scene.make_nodes()
        scene.show(33)
    scene.until_shown(33)
    scene.show(34)
    scene.until_shown(34)
    assert scene.drawn()[-1] == [34] * 3


def test_a_broken_picture_holds_nothing_up(scene: Scene):
    scene.show(22, BROKEN)
    scene.page.wait_for_function("() => window.drawn.some(([body]) => body === 22)")
    scene.show(23)  # viser's own loader failed, and leaves the last picture where it is
    scene.page.wait_for_function("() => window.drawn.some(([body]) => body === 23)")
    scene.until_shown(23)
    assert scene.drawn()[-1] == [23] * 3


def test_a_tab_that_was_put_away_shows_the_newest_frame(scene: Scene):
    scene.page.evaluate(PUT_AWAY, True)
    for frame in (24, 25):
        scene.show(frame)
        scene.page.wait_for_timeout(200)
    scene.page.evaluate(PUT_AWAY, False)
    scene.until_shown(25)
    for frame in (26, 27, 28):
        scene.show(frame)
        scene.until_shown(frame)
    assert scene.drawn()[-1] == [28] * 3
