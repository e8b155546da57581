"""A page with the app's script alone, in a real browser, and the server's end of it.

On a busy machine everything that a test does in the page, or sends it, may take seconds. So `Tab.send` returns once the
page has drawn the states, `Tab.until` waits for a condition, and no test sleeps.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import viser

from fitting_core.keypoints import COUNT, INDEX
from tcfit_app.review.browser import page_states as states
from tcfit_app.review.browser.channel import Channel
from tcfit_app.review.browser.page_events import Drag, Drawn, Hello, PageEvent, Resized
from tcfit_app.server.serving import ReviewServer

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

WIDTH, HEIGHT = 320, 240
FOV = 0.004
LENGTH = 300
WRIST, ELBOW, KNEE, MISSING = (INDEX[n] for n in ("right_wrist", "right_elbow", "left_knee", "left_ear"))
PLACES = {WRIST: (80.0, 120.0), ELBOW: (120.0, 90.0), KNEE: (220.0, 180.0)}
HALVES = (0.0, 0.0, 0.5, 1.0), (0.5, 0.0, 1.0, 1.0)
"""Windows of two pictures beside each other."""
TABS: list["Tab"] = []
"""The last one is the one that connects."""
HTML = "<img src=x onerror=alert(1)> & </script>"

E = TypeVar("E", bound=PageEvent)


PATIENCE = 60.0
"""Seconds after which a test gives up."""
_CANVAS_FITS = """() => {
  const canvas = __viserMutable.canvas;
  let box = canvas.parentElement;
  while (box.style.zIndex !== "0") box = box.parentElement;
  return Math.abs(canvas.clientHeight - box.clientHeight) <= 1;
}"""
"""Whether viser's canvas has followed its box, some frames after the strip took or left its room."""
_CANVAS = """() => {
  const { clientWidth, clientHeight } = __viserMutable.canvas;
  return [clientWidth, clientHeight, __viserMutable.canvas.getBoundingClientRect().top];
}"""
"""Its width and height, and where its upper edge is on the screen."""
_STILL = """async () => {
  for (let was = "", still = 0; still < 15; await new Promise(requestAnimationFrame)) {
    const now = __viserMutable.camera.matrixWorld.elements.join();
    still = now === was ? still + 1 : 0;
    was = now;
  }
  return __viserMutable.camera.position.length();
}"""
"""Waits until viser's camera stands still; its distance from the origin then."""


@dataclass
class Tab:
    """A page, and the server's end of it."""

    page: "Page"
    clients: list[viser.ClientHandle] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    events: list[PageEvent] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)
    sent: int = 0
    frame: int = 0
    """Of the keypoints: another one for each test, so that a drag of the one before is over."""

    def connect(self, client: viser.ClientHandle) -> None:
        """As a server's callback."""
        self.clients.append(client)
        self.channels.append(Channel(client, self.events.append))

    def post(self, **changed: states.PageState | None) -> None:
        """Replace states of the page; it draws them some time later."""
        for name, state in changed.items():
            self.channels[-1].send(name, state)

    def send(self, **changed: states.PageState | None) -> None:
        """Replace states of the page, and wait until it has drawn them."""
        self.post(**changed)
        self.settle()

    def until(self, condition: Callable[[], Any], what: str = "") -> Any:
        """Wait for a condition, while events come in; its value."""
        end = time.monotonic() + PATIENCE
        while not (found := condition()):
            assert time.monotonic() < end, f"no {what or condition} in {self.events}"
            self.page.wait_for_timeout(20)
        return found

    def received(self, *kinds: type[E]) -> list[E]:
        """The events of these kinds; by default those of the user's actions, not those of the page's own."""
        if kinds:
            return [event for event in self.events if isinstance(event, kinds)]
        return [event for event in self.events if not isinstance(event, Drawn | Resized)]  # pyright: ignore

    def await_event(self, kind: type[E], count: int = 1) -> E:
        """The latest event of the kind, once there are that many."""
        self.until(lambda: len(self.received(kind)) >= count, f"{count} {kind.__name__}")
        return self.received(kind)[-1]

    def await_drag(self, phase: str) -> Drag:
        """The latest event of a drag, once it has that phase; how many come before depends on the page's speed."""
        return self.until(lambda: [drag for drag in self.received(Drag)[-1:] if drag.phase == phase], phase)[0]

    def settle(self) -> None:
        """Wait until all that was sent is drawn, and the page's events so far are here."""
        self.sent += 1
        frame = self.sent % LENGTH
        self.post(cursor=states.Cursor(frame=frame, live=self.sent))  # never what the page has already
        self.await_drawn(frame)

    def await_drawn(self, frame: int) -> None:
        """Wait until the page has drawn a frame, and forget the frames that it drew before."""
        self.until(lambda: Drawn(frame=frame) in self.events, f"drawing of frame {frame}")
        for event in self.received(Drawn):
            self.events.remove(event)  # one by one: more may come meanwhile

    def look(self, distance: float, x: float = 0.0) -> None:
        """Put the camera that far before the posters."""
        camera = self.clients[-1].camera
        with self.clients[-1].atomic():
            camera.near, camera.far, camera.fov = 1.0, 4000.0, FOV
            camera.position, camera.look_at, camera.up_direction = (x, 0.0, -distance), (x, 0.0, 0.0), (0.0, -1.0, 0.0)
        there = "(distance) => Math.abs(__viserMutable.camera.position.length() - distance) < 1e-3"
        self.page.wait_for_function(there, arg=math.hypot(distance, x))
        self.settle()

    def await_still_camera(self) -> None:
        """Wait until viser's camera stands still, and the server knows where."""
        there = self.page.evaluate(_STILL)
        self.until(lambda: abs(np.linalg.norm(self.clients[-1].camera.position) - there) < 1e-3, "the camera's place")

    def screen(self, u: float, v: float, *, window: states.Place = (0.0, 0.0, 1.0, 1.0)) -> tuple[float, float]:
        """Where an image's pixel is on the screen, in a window, from the camera that viser reports."""
        camera = self.clients[-1].camera
        x, y, distance = camera.position[0], camera.position[1], -camera.position[2]
        self.page.wait_for_function(_CANVAS_FITS)
        # Not camera.image_height: viser draws coarser where drawing is slow, and counts those pixels.
        width, height, top = self.page.evaluate(_CANVAS)
        scale = height / 2 / math.tan(camera.fov / 2) / distance
        world = ((u - WIDTH / 2) / HEIGHT, (v - HEIGHT / 2) / HEIGHT)
        middle = width * (window[0] + window[2]) / 2, height * (window[1] + window[3]) / 2
        return (middle[0] + (world[0] - x) * scale, top + middle[1] + (world[1] - y) * scale)

    def scale(self) -> float:
        """Screen pixels of an image's pixel."""
        return self.screen(1, 0)[0] - self.screen(0, 0)[0]

    def painted(self, x: float, y: float) -> bool:
        """Whether the overlay has something there, once all that was sent is drawn."""
        self.settle()
        return self.painted_now(x, y)

    def painted_now(self, x: float, y: float) -> bool:
        """Whether it has something there, after the frames that the page draws by itself."""
        self.page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        look = "([x, y]) => document.querySelector('.tcfit > canvas').getContext('2d').getImageData(x, y, 1, 1).data[3]"
        return self.page.evaluate(look, [round(x), round(y - self.page.evaluate(_CANVAS)[2])]) > 100

    def text(self, selector: str) -> str | None:
        """Of an element on show."""
        found = self.page.locator(selector)
        return found.text_content() if found.is_visible() else None

    def show(
        self,
        *,
        joints: dict[int, tuple[float, float]] = PLACES,
        selection: tuple[int, ...] = (),
        **attributes: tuple[int, ...],
    ) -> None:
        """The keypoints of a frame, one edited and one bad, with other attributes if given; and which are selected."""
        xy, confidence = np.zeros((COUNT, 2)), np.zeros(COUNT)
        for joint, place in joints.items():
            xy[joint], confidence[joint] = place, 0.83
        state = states.Keypoints(
            frame=self.frame,
            xy=states.pixel_pairs(xy),
            confidence=states.shares(confidence),
            edited=(WRIST,),
            bad=(KNEE,),
            **attributes,
        )
        self.send(keypoints=state, selection=states.Selection(joints=selection))

    def drag(self, start: tuple[float, float], way: tuple[float, float], *, key: str | None = None) -> None:
        """Press, move and release the left button, with a key held if one is given."""
        if key:
            self.page.keyboard.down(key)
        with self.pressed(start, way):
            pass
        if key:
            self.page.keyboard.up(key)
        self.settle()

    @contextmanager
    def pressed(self, start: tuple[float, float], way: tuple[float, float]) -> Iterator[tuple[float, float]]:
        """A drag that is not over yet, and where the pointer is."""
        end = (start[0] + way[0], start[1] + way[1])
        self.page.mouse.move(*start)
        self.page.mouse.down()
        self.page.mouse.move(*end, steps=4)
        try:
            yield end
        finally:
            self.page.mouse.up()

    def hover(self, x: float, y: float) -> None:
        """Move the pointer there, and wait for what the page shows then."""
        self.page.mouse.move(x, y)
        self.settle()


BAR = states.Markup(html='<div class="tcfit-now"></div><div class="tcfit-frames"></div>')
POSTER = states.Layout(
    mode="poster", image=(WIDTH, HEIGHT), posters=(states.Poster(width=WIDTH / HEIGHT, label="Edit"),)
)
PAIR = states.Layout(
    mode="poster",
    image=(WIDTH, HEIGHT),
    posters=(
        states.Poster(node="/posters/0", window=HALVES[0], width=WIDTH / HEIGHT, label="A"),
        states.Poster(node="/posters/1", window=HALVES[1], width=WIDTH / HEIGHT, label="B"),
    ),
)
SPACE = states.Layout(mode="space")
KEYS = states.Keys(
    bindings=(
        states.KeyBinding(key="ArrowRight", action="next"),
        states.KeyBinding(key="b", action="bad"),
        states.KeyBinding(key="b", shift=True, action="bad range"),
        states.KeyBinding(key="z", ctrl=True, action="undo"),
        states.KeyBinding(key="?", action="help"),
        states.KeyBinding(key="Space", action="play"),
    )
)
TIMELINE = states.Timeline(
    length=LENGTH,
    frame_rate=30.0,
    choices=(
        states.Choice(name="error", title="Error (px)", group="One fit"),
        states.Choice(name="jitter", title="Jitter (mm)", group="One fit"),
        states.Choice(name="distance", title="Distance (mm)", group="Two fits"),
    ),
)
ROWS = states.Rows(
    rows=(
        states.Row(
            name="error",
            title="Error",
            unit="px",
            curves=(
                states.Curve(label="A", color="beside", values=states.curve_values(np.linspace(1, 300, LENGTH))),
                states.Curve(label="B", color="fit", values=(None,) * LENGTH),
            ),
        ),
    ),
)


RECORD = """() => {
  const usual = CanvasRenderingContext2D.prototype.fillText;
  window.written = [];
  CanvasRenderingContext2D.prototype.fillText = function (text, ...where) {
    window.written.push(text);
    usual.call(this, text, ...where);
  };
}"""
"""From now on the texts that are drawn are in `window.written`."""
GUTTER, MARGIN = 178, 14
"""Left and right of the timeline's plot."""


def strip_place(tab: Tab, frame: float, y: float = 43.0) -> tuple[float, float]:
    """On the screen, when the whole clip is shown; by default in the upper row."""
    box = tab.page.locator(".tcfit-strip").bounding_box()
    assert box is not None
    return box["x"] + GUTTER + (frame + 0.5) / LENGTH * (box["width"] - GUTTER - MARGIN), box["y"] + y


def open_tab(server: ReviewServer, browser: "Browser") -> Tab:
    """A page of the server, with one poster."""
    # The panels take 344 of them.
    tab = Tab(browser.new_page(viewport={"width": 1244, "height": 640}))
    tab.page.on("pageerror", lambda error: tab.complaints.append(str(error)))
    TABS.append(tab)
    tab.page.goto(server.gate.link)
    tab.await_event(Hello)
    tab.page.locator(".mantine-Notification-closeButton").click()  # viser's remark about software WebGL
    return tab
