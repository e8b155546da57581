"""What a browser's tab has whoever of the people it shows: the way to its page, its scene, its messages."""

from collections.abc import Callable

import viser

from tcfit_app.review.browser.channel import Channel
from tcfit_app.review.browser.page_events import PageEvent
from tcfit_app.review.scene.scene import SceneView
from tcfit_app.review.tab.people import Someone
from tcfit_app.review.tab.toasts import Toasts
from tcfit_app.server.gate import HOME
from tcfit_app.server.gated_viser import Visitor
from tcfit_app.server.page_files import PageFiles

BROWSER = "browser "
"""What authors begin with, as edits have them; versions before had "tab "."""


class BrowserTab:
    """One of viser's clients.

    Args:
        client: viser's tab.
        files: which files of this computer the page may name.
        whose: its user, as the gate knows them.
    """

    def __init__(self, client: viser.ClientHandle, files: PageFiles, whose: Visitor | None = None) -> None:
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
        whose = whose or Visitor()
        self.reviewer = whose.reviewer
        """Under what name the time spent and approvals are kept."""
        self.in_list = whose.path != HOME
        """Its clip is one of a folder that was opened."""
        self._signed_in = whose.name
        self.author = whose.name or f"{BROWSER}{client.client_id}"
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
