"""The review app's server: viser behind the gate, with the app's looks, and its link in the terminal and a browser."""

import json
import os
import sys
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Thread

import viser

from fitting_core.render.colors import rgb
from tcfit_app.server.address import Address, listen
from tcfit_app.server.gate import Entry, Gate
from tcfit_app.server.gated_viser import TalkingSite, gated_viser
from tcfit_app.server.viser_bridge import run_javascript

HOST = "127.0.0.1"
PORT = 8080
PANEL_WIDTH = 340
"""CSS pixels of the panels at the right."""

Say = Callable[[str], None]
"""Tells the user something, normally in the terminal."""


def tell(text: str) -> None:
    """Prints at once, also into a file or a pipe."""
    print(text, flush=True)


@dataclass(frozen=True, kw_only=True)
class ReviewServer:
    """A running server."""

    viser: viser.ViserServer
    """For what is drawn and clicked."""
    gate: Gate
    """For links to further browsers."""
    address: Address


@contextmanager
def review_server(
    title: str,
    *,
    host: str = HOST,
    port: int = PORT,
    open_browser: bool = True,
    scripts: Mapping[str, bytes] | None = None,
    entry: Entry | None = None,
    site: TalkingSite | None = None,
    say: Say = tell,
) -> Iterator[ReviewServer]:
    """Serve until the end of the `with` block, which closes all connections and ends all of the server's threads.
    Raises InputError if nothing can listen there.

    Args:
        title: In the browser's tab.
        host: Name or address of this computer to listen at; one reachable from other computers gives a warning.
        port: From here upwards the first that is free is taken; 0 takes any.
        open_browser: Open the link in a browser, where there is one to see it.
        scripts: JavaScript modules for the page, by their paths.
        entry: A password, and the address of a proxy, if there are such.
        site: Several reviews, and pages around them; None: one review.
        say: Gets the link, a fresh one after each use, and warnings.
    """
    listening, address = listen(host, port)
    with listening:
        welcome = "A browser is connected. Link for another one: "
        gate = Gate(address, scripts=scripts, entry=entry, site=site, admitted=lambda: _aside(say, welcome + gate.link))
        with gated_viser(listening, gate, site) as server:
            _dress(server, title)
            for line in _greeting(address, port, gate.link, entry or Entry()):
                say(line)
            if open_browser and browser_at_hand(os.environ, sys.platform):
                webbrowser.open(gate.link)
            yield ReviewServer(viser=server, gate=gate, address=address)


def browser_at_hand(environment: Mapping[str, str], platform: str) -> bool:
    """Whether a browser that is opened here is seen by the user, judged from environment variables."""
    if environment.get("CI"):
        return False
    if environment.get("BROWSER"):  # chosen by the user, or by an editor that opens it at the other end
        return True
    if environment.get("SSH_CONNECTION"):
        return False
    # Without a display, webbrowser would find a text browser and take the terminal for it.
    return platform in ("darwin", "win32") or bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))


def _greeting(address: Address, asked_port: int, link: str, entry: Entry) -> Iterator[str]:
    """What the user should know at the start, line by line."""
    if asked_port not in (0, address.port):
        yield f"Port {asked_port} is in use, so this is {address.port}."
    if entry.public and not address.loopback:
        yield (
            f"Browsers come in at {entry.public}. Allow only its proxy to reach port {address.port} of this computer: "
            "there nothing is encrypted."
        )
    elif not address.loopback:
        yield (
            "Warning: other computers can connect. Anyone with the link, or who listens on the network (nothing is "
            "encrypted), can see and change this project. Safer: leave out --host, and reach it through "
            f"ssh -L {address.port}:127.0.0.1:{address.port} ..."
        )
    if address.ip.is_unspecified and not entry.public:
        yield "From another computer, put this computer's address in place of the one in the link."
    yield f"Review: {link}"


def _aside(say: Say, text: str) -> None:
    """Say it from a thread of its own: a terminal that is paused or closed must not block the server's loop."""
    Thread(target=say, args=(text,), daemon=True).start()


def set_theme(gui: viser.GuiApi, *, dark: bool) -> None:
    """Light or dark panels, of a server's pages or of one client's."""
    gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False, brand_color=rgb("accent", dark=dark))


def set_title(receiver: viser.ViserServer | viser.ClientHandle, title: str) -> None:
    """In the browser's tab, of a server's pages or of one client's."""
    # viser has no setting for it.
    run_javascript(receiver, f"document.title = {json.dumps(title)};")


def _dress(server: viser.ViserServer, title: str) -> None:
    set_theme(server.gui, dark=True)
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(PANEL_WIDTH)
    server.gui.set_panel_label(" ")  # else it names the state of the connection
    set_title(server, title)
