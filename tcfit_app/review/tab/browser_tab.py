"""What a browser tab has whichever person it shows: its connection to the page, its scene, its messages."""

from collections.abc import Callable

import viser

from tcfit_app.review.browser.channel import Channel
from tcfit_app.review.browser.page_events import PageEvent
from tcfit_app.review.scene.scene import SceneView
from tcfit_app.review.tab.people import Someone
from tcfit_app.review.tab.toasts import Toasts
from tcfit_app.server.page_files import PageFiles

BROWSER = "browser "
"""The start of authors' names in edits; earlier versions used "tab "."""


class BrowserTab:
    """One of viser's clients.

    client: viser's client.
        client: viser's tab.
        files: which files on this computer the page may read.
        signed_in: the name its user gave at the gate; empty: none.
    """

    def __init__(self, client: viser.ClientHandle, files: PageFiles, signed_in: str = "") -> None:
        self.client, self.files = client, files
        self.receive: Callable[[PageEvent], None] = lambda event: None
        """Handles the page's events for the person on show."""
        self.go_to: Callable[[Someone], None] = lambda someone: None
        """Shows another person."""
        self.has_come: Callable[[], None] = lambda: None
        """Called once the page has said hello, and so which tab it is."""
        self.show_first_steps: Callable[[], None] = lambda: None
        """Shows the first steps in the page."""
        self.channel = Channel(client, lambda event: self.receive(event), timeline=True)
        self.scene = SceneView(client)
        self.toasts = Toasts(client)
        self.name: str | None = None
        """Chosen by the page; None until it has said hello."""
        self._signed_in = signed_in
        self.author = signed_in or f"{BROWSER}{client.client_id}"
        self.size = (0, 0)
        """Canvas size in CSS pixels, as last reported by the page."""
        self.has_commands = False
        """The command palette has the actions."""

    def greet(self, name: str, browser: str, size: tuple[int, int]) -> None:
        """The page's script has started, and gives its name.

        Edits are attributed to whoever signed in, or else to the browser, so that a new tab after a restart of tcfit
        still has the same author.
        """
        self.name, self.size = name, size
        self.author = self._signed_in or f"{BROWSER}{(browser or name)[:8]}"
