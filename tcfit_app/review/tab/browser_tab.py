"""What a browser's tab has whoever of the people it shows: the way to its page, its scene, its messages."""

from collections.abc import Callable

import viser

from tcfit_app.review.browser.channel import Channel
from tcfit_app.review.browser.page_events import PageEvent
from tcfit_app.review.scene.scene import SceneView
from tcfit_app.review.tab.people import Someone
from tcfit_app.review.tab.toasts import Toasts
from tcfit_app.server.page_files import PageFiles

BROWSER = "browser "
"""What authors begin with, as edits have them; versions before had "tab "."""


class BrowserTab:
    """One of viser's clients.

    Args:
        client: viser's tab.
        files: which files of this computer the page may name.
        signed_in: the name that its user has given at the gate; empty: none.
    """

    def __init__(self, client: viser.ClientHandle, files: PageFiles, signed_in: str = "") -> None:
        self.client, self.files = client, files
        self.receive: Callable[[PageEvent], None] = lambda event: None
        """Takes up what the page tells, for whoever is shown."""
        self.go_to: Callable[[Someone], None] = lambda someone: None
        """Shows another of the people."""
        self.has_come: Callable[[], None] = lambda: None
        """The page has said hello: called once it is known which tab it is."""
        self.show_first_steps: Callable[[], None] = lambda: None
        """Tells the page what to do first."""
        self.channel = Channel(client, lambda event: self.receive(event), timeline=True)
        self.scene = SceneView(client)
        self.toasts = Toasts(client)
        self.name: str | None = None
        """Made up by the page; None until it has said hello."""
        self._signed_in = signed_in
        self.author = signed_in or f"{BROWSER}{client.client_id}"
        self.size = (0, 0)
        """Of the canvas, in CSS pixels, as the page told it last."""
        self.has_commands = False
        """The command palette knows the actions."""

    def greet(self, name: str, browser: str, size: tuple[int, int]) -> None:
        """The page's script is there, and calls itself so.

        Its edits are those of whoever has signed in, or else of its browser: a new tab, after tcfit was started again,
        is still the same person's.
        """
        self.name, self.size = name, size
        self.author = self._signed_in or f"{BROWSER}{(browser or name)[:8]}"
