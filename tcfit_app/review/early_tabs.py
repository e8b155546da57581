"""Tabs that connect while the app is being loaded, because torch takes two seconds.

Each gets the page's script at once and, of a fitted project, the first picture with its stored body. The app takes both
over, with what the page has sent until then.
"""

import threading
from collections.abc import Callable
from pathlib import Path

import viser

from fitting_core.errors import InputError
from fitting_core.render.colors import rgb
from fitting_core.video.frames import FrameSource
from tcfit_app.project.storage.opening_body import read_opening_body
from tcfit_app.review.browser.channel import Channel
from tcfit_app.review.browser.page_events import Hello, PageEvent
from tcfit_app.review.scene.layers import BodyLayer
from tcfit_app.review.scene.poster import Poster, Posters, SidePoster, poster_layout
from tcfit_app.review.scene.room import UNKNOWN
from tcfit_app.review.scene.scene import SceneView
from tcfit_app.review.scene.side_view import side_view, usual_width
from tcfit_app.review.shared.video_frames import encoded
from tcfit_app.server.serving import set_theme


class EarlyTab:
    """What has been made for a tab, and what its page has sent."""

    def __init__(self, client: viser.ClientHandle, said_hello: "Callable[[EarlyTab], None]") -> None:
        self.client, self._said_hello, self._guard = client, said_hello, threading.Lock()
        self.drawn = False
        """Whether it shows a body."""
        self.size: tuple[int, int] | None = None
        """Of the canvas, once the page has said hello."""
        self._events: list[PageEvent] = []
        self._receive: Callable[[PageEvent], None] = self._events.append
        self.channel = Channel(client, self._take, timeline=True)
        self.scene = SceneView(client)

    def _take(self, event: PageEvent) -> None:
        with self._guard:
            self._receive(event)
        if isinstance(event, Hello):
            self.size = event.width, event.height
            set_theme(self.client.gui, dark=event.dark)
            self._said_hello(self)

    def hand_over(self, receive: Callable[[PageEvent], None]) -> None:
        """Pass on all events, the earlier ones first."""
        with self._guard:
            for event in self._events:
                receive(event)
            self._receive = receive


class EarlyTabs:
    """Serves tabs until the app does. Thread-safe.

    Args:
        server: Of the tabs.
        folder: The project.
    """

    def __init__(self, server: viser.ViserServer, folder: Path) -> None:
        self._guard = threading.RLock()
        self._tabs: dict[int, EarlyTab] = {}
        self._picture: Posters | None = None
        self._ended = False
        server.on_client_connect(self._connected)
        threading.Thread(target=self._prepare, args=(folder,), name="tcfit: first picture", daemon=True).start()

    async def _connected(self, client: viser.ClientHandle) -> None:
        with self._guard:
            if not self._ended:
                self._tabs[client.client_id] = EarlyTab(client, self._draw)

    def _prepare(self, folder: Path) -> None:
        picture = first_picture(folder)
        with self._guard:
            self._picture = picture
            for tab in self._tabs.values():
                self._draw(tab)

    def _draw(self, tab: EarlyTab) -> None:
        with self._guard:
            if self._ended or self._picture is None or tab.size is None:
                return
            with tab.client.atomic():
                tab.scene.cameras.follow(tab.size)
                tab.scene.show(self._picture)
                window = tab.scene.cameras.window
                tab.channel.send("layout", poster_layout(self._picture, (("", None),) * 2, window, clipped=True))
            tab.client.flush()
            tab.drawn = True

    def end(self) -> dict[int, EarlyTab]:
        """The tabs, by client; from now on they and all others are left to the app."""
        with self._guard:
            self._ended = True
            return self._tabs


def first_picture(folder: Path) -> Posters | None:
    """What a project opens with; None without a stored body that still holds, or without its picture."""
    stored = read_opening_body(folder)
    if stored is None:
        return None
    body, source, number = stored
    try:
        with FrameSource(source, lens=body.camera.lens) as frames:
            image = encoded(frames.frame(number), "full")
    except (InputError, OSError):
        return None
    layer = BodyLayer(
        vertices=body.vertices,
        faces=body.faces,
        color=rgb("fit"),
        camera=body.fit_camera,
        opacities=body.opacities,
    )
    width, height = body.camera.size
    side = side_view(UNKNOWN, body.fit_camera, "right", usual_width(width / height))
    return Posters(camera=body.camera, posters=(Poster(image=image, bodies=(layer,)),), side=SidePoster(view=side))
