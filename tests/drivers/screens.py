"""A scene in a real browser, what is seen there, and what should be seen."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
import viser
from jaxtyping import Bool, Float, Int, UInt8
from viser import _messages

from evaluation.synthetic.studio.rasterize import rasterize
from fitting_core.camera import Camera
from tcfit_app.review.browser.channel import Channel, web_files
from tcfit_app.review.browser.page_states import Layout
from tcfit_app.review.scene.layers import RGB, BodyLayer, uniform_jpeg
from tcfit_app.review.scene.poses import Pose, Rectangle, Window
from tcfit_app.review.scene.poster import Posters, poster_layout
from tcfit_app.review.scene.scene import SceneView
from tcfit_app.review.scene.space import Space
from tcfit_app.server.serving import review_server

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

PLATE_COLOR: RGB = (0, 0, 160)
BODY_COLOR: RGB = (255, 60, 60)
PLATE = uniform_jpeg(PLATE_COLOR)
PATIENCE_SECONDS = 30.0

# Everything but the canvas: panels, messages.
_HIDE = """() => {
  for (let e = window.__viserMutable.canvas; e !== document.body; e = e.parentElement)
    for (const other of e.parentElement.children)
      if (other !== e && !["SCRIPT", "STYLE"].includes(other.tagName)) other.style.visibility = "hidden";
}"""


_DRAW = """async () => {
  for (let i = 0; i < 6; i++) {
    window.__viserMutable.requestRender();
    await new Promise((done) => setTimeout(() => requestAnimationFrame(done), 40));
  }
}"""


@dataclass
class Screen:
    """A browser tab and the scene in it."""

    view: SceneView
    client: viser.ClientHandle
    page: "Page"
    channel: Channel
    laid_out: Layout | None = None

    def show(self, snapshot: Posters | Space) -> None:
        """Shows it, and has the page draw posters in their windows."""
        self.view.show(snapshot)
        layout = Layout(mode="space")
        if isinstance(snapshot, Posters):
            names = (("", None),) * (len(snapshot.posters) + (snapshot.side is not None))
            layout = poster_layout(snapshot, names, self.view.cameras.window, clipped=False)
        if layout != self.laid_out:
            self.laid_out = layout
            self.channel.send("layout", layout)

    def settle(self, size: tuple[int, int] | None = None) -> None:
        """Waits until all is drawn, at another window size if one is given."""
        if size is not None:
            self.page.set_viewport_size({"width": size[0], "height": size[1]})
            self._until(lambda: abs(self.client.camera.aspect / (size[0] / size[1]) - 1) < 5e-3)
        window = self.page.viewport_size
        assert window is not None
        self.view.cameras.follow((window["width"], window["height"]))
        # Messages are carried out in their order; then React and the decoding of images take their time.
        mark = time.monotonic_ns()
        script = _messages.RunJavascriptMessage(source=f"window.tcfitMark = '{mark}';")
        self.client._websock_connection.queue_message(script)
        self.page.wait_for_function(f"window.tcfitMark === '{mark}'")
        self.page.evaluate(_DRAW)
        self.view.cameras.follow()

    def _until(self, done: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE_SECONDS
        while not done():
            assert time.monotonic() < end, "the browser did not answer"
            self.page.wait_for_timeout(20)

    def picture(self) -> UInt8[np.ndarray, "H W 3"]:
        """A screenshot of the canvas alone, RGB."""
        self.page.evaluate(_HIDE)
        png = np.frombuffer(self.page.screenshot(), np.uint8)
        image = cv2.imdecode(png, cv2.IMREAD_COLOR)
        assert image is not None
        return image[..., ::-1]


@contextmanager
def screen(browser: "Browser", size: tuple[int, int] = (1440, 900)) -> Iterator[Screen]:
    """An empty scene in a browser window of that size (width, height)."""
    clients: list[viser.ClientHandle] = []
    scripts = web_files()
    serving = review_server("Scene", port=0, open_browser=False, scripts=scripts, say=lambda text: None)
    with serving as server:
        server.viser.on_client_connect(clients.append)
        server.viser.gui.main_panel.float(x=15, y=15)  # the canvas is the whole window
        page = browser.new_page(viewport={"width": size[0], "height": size[1]}, color_scheme="dark")
        # At the window's own resolution: viser lowers it where drawing is slow, and edges are then 1.4 px off.
        page.add_init_script("if (location.host) history.replaceState(null, '', '/?fixedDpr=1')")
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(server.gate.link)
        page.wait_for_selector("canvas")
        page.evaluate("document.documentElement.classList.add('tcfit-ready')")  # no panels are here to lift the curtain
        end = time.monotonic() + PATIENCE_SECONDS
        while not clients and time.monotonic() < end:
            page.wait_for_timeout(20)
        channel = Channel(clients[0], lambda event: None)
        shown = Screen(SceneView(clients[0]), clients[0], page, channel)
        shown.view.cameras.follow()
        shown.settle()
        yield shown
        assert not errors, errors


def plain_body(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> BodyLayer:
    """Opaque and red, so that it is told from plate and background."""
    return BodyLayer(vertices=vertices, faces=faces, color=BODY_COLOR, opacity=1.0)


def seen_body(picture: UInt8[np.ndarray, "H W 3"]) -> Bool[np.ndarray, "H W"]:
    """Where a screenshot shows a `plain_body`."""
    return picture[..., 0] > 55


def seen_plate(picture: UInt8[np.ndarray, "H W 3"]) -> Float[np.ndarray, "H W"]:
    """How much of each pixel is PLATE and not background."""
    blue, background = picture[..., 2].astype(float), float(picture[0, 0, 2])
    return np.clip((blue - background) / (PLATE_COLOR[2] - background), 0, 1)


def canvas_camera(camera: Camera, pose: Pose, window: tuple[int, int], place: Rectangle) -> Camera:
    """The camera that takes the whole canvas as its image, for a poster in a window.

    Worked out from where the viewer's camera was told to be, and from nothing that draws.
    """
    scale = window[1] / (2 * -pose.position[2] * np.tan(pose.fov / 2)) / camera.size[1]  # screen pixels per image pixel
    middle = np.array(camera.size) / 2 + np.array(pose.position[:2]) * camera.size[1]
    center = (np.array(camera.center) - middle) * scale + np.array(place).reshape(2, 2).mean(0)
    focal = np.array(camera.focal) * scale
    return Camera(focal=(focal[0], focal[1]), center=(center[0], center[1]), size=window)


def expected_body(posters: Posters, pose: Pose, window: tuple[int, int]) -> Bool[np.ndarray, "H W"]:
    """Where the bodies of all posters should be seen: their triangles rasterized on the processor."""
    mask = np.zeros((window[1], window[0]), bool)
    windows = posters.divide(Window(width=window[0], height=window[1])).windows
    for poster, place in zip(posters.posters, windows, strict=False):
        camera = canvas_camera(posters.camera, pose, window, place)
        left, top, right, bottom = (round(edge) for edge in place)
        for body in poster.bodies:
            depth = np.full(mask.shape, np.inf)
            rasterize(body.vertices.astype(float), body.faces, camera, depth)
            mask[top:bottom, left:right] |= np.isfinite(depth[top:bottom, left:right])
    return mask


def overlap(a: Bool[np.ndarray, "H W"], b: Bool[np.ndarray, "H W"]) -> float:
    """Intersection over union."""
    return float((a & b).sum() / (a | b).sum())


def plate_errors(picture: UInt8[np.ndarray, "H W 3"], posters: Posters, pose: Pose) -> float:
    """How far the edges of a single poster with PLATE and no body are from where they should be: screen pixels."""
    window = picture.shape[1], picture.shape[0]
    (place,) = posters.divide(Window(width=window[0], height=window[1])).windows
    camera = canvas_camera(posters.camera, pose, window, place)
    scale = camera.focal[0] / posters.camera.focal[0]
    corner = np.array(camera.center) - np.array(posters.camera.center) * scale
    expected = np.array([*corner, *(corner + np.array(posters.camera.size) * scale)])
    plate = seen_plate(picture)
    row, column = plate[int(expected[[1, 3]].mean())], plate[:, int(expected[[0, 2]].mean())]
    seen = np.array([_first(row), _first(column), len(row) - _first(row[::-1]), len(column) - _first(column[::-1])])
    return float(abs(seen - expected).max())


def _first(coverage: Float[np.ndarray, "n"]) -> float:
    """Where the plate begins, in parts of a pixel."""
    index = int(np.argmax(coverage > 0.02))
    return index + 1 - coverage[index]
