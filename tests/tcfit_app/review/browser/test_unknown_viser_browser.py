"""What a page shows whose viser is not the one that the script knows, in a real browser."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest
import viser

from tcfit_app.review.browser.channel import Channel, web_files
from tcfit_app.server.serving import review_server
from tests.drivers.waiting import until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough

MAIN = "/tcfit/main.js"
LESS = b"delete __viserMutable.syncCanvasSize; __viserMutable.messageQueue = null;\n"


@contextmanager
def shown(browser: "Browser", scripts: dict[str, bytes], complaints: list[str]) -> Iterator[str]:
    """A page with these scripts, and what it says."""
    with review_server("A clip", port=0, open_browser=False, scripts=scripts, say=lambda text: None) as running:
        running.viser.on_client_connect(lambda client: void(Channel(client, lambda event: None)))
        page = browser.new_page()
        page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
        page.goto(running.gate.link)
        card = page.locator("body > p[role=alert]")
        card.wait_for()
        assert page.locator(".tcfit").count() == 0
        yield card.text_content() or ""
        page.close()


def void(channel: Channel) -> None:
    """viser's callbacks return nothing."""
    channel.send("notice", None)  # what comes later is ignored


def test_the_page_says_what_is_missing(browser: "Browser", caplog: pytest.LogCaptureFixture):
    complaints: list[str] = []
    scripts = web_files() | {MAIN: LESS + web_files()[MAIN]}
    with caplog.at_level(logging.INFO, "tcfit_app"), shown(browser, scripts, complaints) as text:
        told = until(lambda: [record for record in caplog.records if "lacks" in record.getMessage()], "the report")
    problem = f"tcfit needs viser 1.1.x, found {viser.__version__}, whose page lacks: messageQueue, syncCanvasSize"
    assert text.startswith(problem) and problem in told[0].getMessage() and len(told) == 1
    assert any(said.startswith(problem) for said in complaints)


def test_a_page_without_viser_s_references_says_so(browser: "Browser"):
    main = b"const { __viserMutable } = window; delete window.__viserMutable;\n" + web_files()[MAIN]
    with shown(browser, web_files() | {MAIN: main}, []) as text:
        assert "whose page lacks: __viserMutable." in text


def test_a_script_that_cannot_be_loaded_is_noticed(browser: "Browser"):
    scripts = {path: text for path, text in web_files().items() if path != "/tcfit/picture/overlay.js"}
    with shown(browser, scripts, []) as text:
        assert text.startswith("tcfit's script could not be loaded")
