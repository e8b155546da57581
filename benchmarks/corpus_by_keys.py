"""How many keys and clicks a corpus takes, from videos to approved fits.

Clips are cut out of the given videos in turn. In the list, all of them are selected and fitted, which finds their
keypoints. Then each is opened, corrected three times and approved. A correction goes to the next suspicious place and
moves the keypoint there by 10 pixels; where none is left, the left wrist is clicked on. A browser does all of it by
keys and clicks, which are counted, and the projects say at the end whether it was done.
"""

import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import OmitArgPrefixes, Positional

from benchmarks.report import Common, Row, progress, report, start
from fitting_core.errors import InputError
from fitting_core.keypoints import INDEX
from fitting_core.video.encoding import video_writer
from fitting_core.video.frames import FrameSource
from tcfit_app.home.home import Home
from tcfit_app.home.reviews import Review
from tcfit_app.project.glance import glance
from tcfit_app.review.browser.channel import web_files
from tcfit_app.server.serving import review_server
from tests.drivers.browser import chromium

if TYPE_CHECKING:
    from playwright.sync_api import Page as Tab

CORRECTIONS = 3
_PATIENCE = 180.0
"""Seconds for what a key does."""
_FITS = 3600.0
"""Seconds for all fits."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What is cut out of which videos."""

    videos: Positional[tuple[Path, ...]]
    clips: int = 20
    frames: int = 25
    """Of each clip."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def cut(videos: tuple[Path, ...], folder: Path, *, clips: int, frames: int) -> None:
    """Clips of the videos in turn, each from where its last one ended. Raises InputError if they are too short."""
    begins = Counter[Path]()
    for number in range(clips):
        video = next((v for v in sorted(set(videos), key=lambda v: begins[v]) if _fits(v, begins[v] + frames)), None)
        if video is None:
            raise InputError(f"{', '.join(map(str, videos))}: too short for {clips} clips of {frames} frames.")
        with FrameSource(video) as source:
            size = (source.size[0] // 2 * 2, source.size[1] // 2 * 2)
            name = folder / f"{number + 1:02} {video.parent.name}.mp4"
            with video_writer(name, size, source.frame_rate or 25.0) as writer:
                for frame in range(begins[video], begins[video] + frames):
                    writer.write(source.frame(frame)[: size[1], : size[0]])
        begins[video] += frames


def _fits(video: Path, end: int) -> bool:
    with FrameSource(video) as source:
        return end <= source.count


@dataclass
class Hand:
    """Keys and clicks, counted by what they were for."""

    tab: "Tab"
    keys: Counter[str] = field(default_factory=Counter)
    clicks: Counter[str] = field(default_factory=Counter)

    def press(self, key: str, what: str) -> None:
        """Press a key."""
        self.tab.keyboard.press(key)
        self.keys[what] += 1

    def click(self, x: float, y: float, what: str) -> None:
        """Click on the page."""
        self.tab.mouse.click(x, y)
        self.clicks[what] += 1


def until(condition: Callable[[], Any], what: str, seconds: float = _PATIENCE) -> Any:
    """Wait for something to be so; what it is."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        if time.monotonic() > end:
            raise InputError(f"Waited {seconds:.0f} s in vain for {what}.")
        time.sleep(0.05)
    return found


@contextmanager
def served(root: Path) -> Iterator[tuple[Home, str]]:
    """The list of a folder, and its link."""
    home = Home(root)
    with review_server("corpus", port=0, open_browser=False, scripts=web_files(), site=home) as server:
        thread = threading.Thread(target=home.run, args=(server,))
        thread.start()
        try:
            yield home, server.gate.link
        finally:
            home.stop()
            thread.join()
            home.close()


def correct(hand: Hand, review: Review) -> None:
    """One correction, and the fit that follows it."""
    (page,) = review.app.pages.values()
    tab, project = page.tab, review.project
    hand.press("n", "next place")
    hand.tab.wait_for_timeout(1500)  # as somebody would look at it
    if not project.corrected[tab.state.frame].present[list(tab.state.selection)].any():  # a face that is not detected
        x, y = project.corrected.xy[tab.state.frame, INDEX["left_wrist"]].tolist()
        x, y = hand.tab.evaluate("([x, y]) => tcfit.place(x, y, 0)", [x, y])
        hand.click(x, y, "keypoint")
        until(lambda: len(tab.state.selection) == 1, "a selection")
    before = project.last_edit
    hand.press("Control+Shift+ArrowRight", "correction")
    until(lambda: project.last_edit != before, f"a correction of {tab.state.selection} in frame {tab.state.frame}")
    session = review.app.session
    until(lambda: not session.jobs and not session.edit_follower.busy, "the fit that follows")


def review_all(hand: Hand, home: Home, count: int) -> None:
    """Correct and approve one clip after the other, from the first in the list on."""
    keys = [row.key for row in home.catalogue.rows() if row.kind == "project"]
    hand.press("Home", "list")
    hand.press("Enter", "open")
    for number, key in enumerate(keys):
        hand.tab.wait_for_url(f"**/clip/{key}*", timeout=1000 * _PATIENCE)
        hand.tab.wait_for_selector("html.tcfit-ready", state="attached", timeout=1000 * _PATIENCE)
        until(lambda key=key: home.reviews.viewers(key), "the review")
        review = home.reviews.open(key)
        until(lambda review=review: len(review.app.pages) == 1, "the tab")
        hand.tab.wait_for_timeout(1500)  # as somebody would look first
        for _ in range(CORRECTIONS):
            correct(hand, review)
        hand.press("Shift+O", "approve")
        until(lambda review=review: glance(review.project.folder).state == "approved", "the approval")
        progress(f"{number + 1} of {count} approved")
        if number < count - 1:
            hand.press("PageDown", "open")


def run(options: Options) -> None:
    """Cut, fit, correct, approve and count."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        root = Path(folder)
        cut(options.videos, root, clips=options.clips, frames=options.frames)
        with served(root) as (home, link):
            tab = browser.new_context(viewport={"width": 1280, "height": 720}).new_page()
            tab.context.add_cookies([{"name": "tcfit-hints", "value": "read", "url": link.partition("?")[0]}])
            tab.goto(link)
            tab.wait_for_selector("tr.clip")
            hand, begun = Hand(tab), time.monotonic()
            hand.press("Control+a", "list")
            hand.press("f", "fit")
            until(
                lambda: all(row.state == "fitted" and not row.work for row in home.catalogue.rows()), "the fits", _FITS
            )
            fitted = time.monotonic()
            progress(f"{options.clips} clips fitted in {fitted - begun:.0f} s")
            hand.press("Escape", "list")
            review_all(hand, home, options.clips)
            ended = time.monotonic()
        folders = sorted(root.glob("*.tcfit"))
        done = [one for one in folders if glance(one).state == "approved"]
    steps = list(dict.fromkeys([*hand.keys, *hand.clicks]))
    rows: list[Row] = [{"for": what, "keys": hand.keys[what], "clicks": hand.clicks[what]} for what in steps]
    rows.append({"for": "all", "keys": hand.keys.total(), "clicks": hand.clicks.total()})
    seconds = f"{fitted - begun:.0f} s of fits, {ended - fitted:.0f} s of reviews"
    report(options, {f"{len(done)} of {options.clips} clips approved: {seconds}": rows})


if __name__ == "__main__":
    start(Options, run)
