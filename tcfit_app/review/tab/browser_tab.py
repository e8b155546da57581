"""What a browser tab has whichever person it shows: its connection to the page, its scene, its messages."""

from collections.abc import Callable, Sequence

import viser

from tcfit_app.review.browser.channel import Channel
from tcfit_app.review.browser.page_events import PageEvent
from tcfit_app.review.scene.scene import SceneView
from tcfit_app.review.tab.people import Someone
from tcfit_app.review.tab.toasts import Toasts
from tcfit_app.server.gate import HOME
from tcfit_app.server.gated_viser import Visitor
from tcfit_app.server.page_files import PageFiles

Do = Callable[[Callable[[], None]], None]
"""Runs a command on the drawing thread, soon."""
BROWSER = "browser "
"""The start of authors' names in edits; earlier versions used "tab "."""


class BrowserTab:
    """One of viser's clients.

    Args:
        client: viser's client.
        do: how callbacks reach the drawing thread.
        files: which files on this computer the page may read.
        whose: its user, as the gate knows them.
    """

    def __init__(self, client: viser.ClientHandle, do: Do, files: PageFiles, whose: Visitor | None = None) -> None:
        self.client, self.do, self.files = client, do, files
        self.take: Callable[[PageEvent], None] = lambda event: None
        """Takes the page's events for the person on show, on the drawing thread."""
        self.go_to: Callable[[Someone], None] = lambda someone: None
        """Shows another person."""
        self.has_come: Callable[[], None] = lambda: None
        """Called once the page has said hello, and so which tab it is."""
        self.authors: Callable[[], Sequence[str]] = lambda: ()
        """Returns the authors of all tabs that are open."""
        self.show_first_steps: Callable[[], None] = lambda: None
        """Shows the first steps in the page."""
        self.channel = Channel(client, self.receive, timeline=True)
        self.scene = SceneView(client)
        self.toasts = Toasts(client)
        self.name: str | None = None
        """Chosen by the page; None until it has said hello."""
        whose = whose or Visitor()
        self.reviewer = whose.reviewer
        """Under what name the time spent and approvals are kept."""
        self.in_list = whose.path != HOME
        """Its clip is one of a folder that was opened."""
        self._signed_in = whose.name
        self.author = whose.name or f"{BROWSER}{client.client_id}"
        self.size = (0, 0)
        """Canvas size in CSS pixels, as last reported by the page."""
        self.commands: dict[str, viser.CommandHandle] = {}
        """The actions in the command palette, by name; empty until they are there."""

    def receive(self, event: PageEvent) -> None:
        """Let an event of the page be taken, soon: the first one may come before there is anybody to take it."""
        self.do(lambda: self.take(event))

    def greet(self, name: str, browser: str, size: tuple[int, int]) -> None:
        """The page's script has started, and gives its name.

        Edits are attributed to the signed-in user, or else to the browser, so that a new tab after a restart of tcfit
        still has the same author.
        """
        self.name, self.size = name, size
        self.author = self._signed_in or f"{BROWSER}{(browser or name)[:8]}"
