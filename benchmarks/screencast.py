"""A short film of five tasks in the review app, for the documentation: an animated WebP.

A copy of a fitted project is opened in Debian's Chromium. Screenshots do not have the pointer in them: it is drawn
afterwards, with a line that says what is done.
"""

import io
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, progress, start
from benchmarks.screenshots import TITLE, as_it_is, open_panel, settle
from fitting_core.keypoints import INDEX
from tcfit_app.fitting.fits import FitChoice
from tests.drivers.browser import chromium
from tests.drivers.review_page import Reviewing, reviewing, until

STEP_MS, READING_MS = 140, 2200
"""How long a picture is shown while something moves, and when there is something to look at."""
CAPTION = 40
"""Pixels below the page for the line that says what is done."""
SHOWN = 0.7
"""Size of the film's pictures: so that it can be read, and is not too large a file."""


@dataclass(frozen=True, kw_only=True)
class Screencast:
    """What to film."""

    project: Path
    """A project with a finished fit and its video; it is copied."""
    out: Path
    """The film, NAME.webp."""
    window: tuple[int, int] = (1440, 900)
    frame: int = 30
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(kw_only=True)
class Film:
    """Pictures of a page, with the pointer and what is done."""

    review: Reviewing
    pictures: list[Image.Image] = field(default_factory=list)
    milliseconds: list[int] = field(default_factory=list)
    caption: str = ""
    pointer: tuple[float, float] = (700.0, 300.0)
    pressed: bool = False
    _from: tuple[float, float] = (700.0, 300.0)

    def shot(self, milliseconds: int = READING_MS) -> None:
        """The page as it is."""
        page = Image.open(io.BytesIO(self.review.tab.screenshot())).convert("RGB")
        made = Image.new("RGB", (page.width, page.height + CAPTION), "#14171c")
        made.paste(page)
        draw = ImageDraw.Draw(made)
        draw.text((16, page.height + 8), self.caption, fill="#ffffff", font=ImageFont.load_default(21))
        x, y = self.pointer
        radius = 9 if self.pressed else 12
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), outline="#ffe14d", width=4)
        size = (round(SHOWN * made.width), round(SHOWN * made.height))
        self.pictures.append(made.resize(size, Image.Resampling.LANCZOS))
        self.milliseconds.append(milliseconds)

    def move(self, x: float, y: float, steps: int = 4) -> None:
        """The pointer goes there."""
        for share in np.linspace(0, 1, steps + 1)[1:]:
            self.pointer = self._from[0] + share * (x - self._from[0]), self._from[1] + share * (y - self._from[1])
            self.review.tab.mouse.move(*self.pointer)
            self.shot(STEP_MS)
        self._from = (x, y)

    @contextmanager
    def holding(self) -> Iterator[None]:
        """With the left button down."""
        self.review.tab.mouse.down()
        self.pressed = True
        yield
        self.review.tab.mouse.up()
        self.pressed = False

    def press(self, key: str) -> None:
        """A key, and what it does."""
        self.review.tab.keyboard.press(key)
        settle(self.review)
        self.shot()


def wrong_wrist(film: Film) -> None:
    """A drag that the body follows."""
    film.caption = "1. A keypoint is wrong: drag it, and the body follows"
    film.shot()
    x, y = film.review.place("right_wrist")
    film.move(x, y)
    with film.holding():
        film.move(x + 18, y + 26, 5)
        until(lambda: film.review.session.edit_follower.live is not None, "the live correction")
        film.shot(600)
    settle(film.review)
    film.shot()


def depth(film: Film) -> None:
    """A drag in the side view."""
    film.caption = "2. Right in the picture, wrong in depth: drag it in the side view"
    x, y = until(
        lambda: film.review.tab.evaluate("(joint) => tcfit.placeOfFit(joint, 1)", INDEX["left_wrist"]), "the wrist"
    )
    film.move(x, y)
    with film.holding():
        film.move(x - 36, y, 5)
        film.shot(600)
    settle(film.review)
    film.shot()


def bad_range(film: Film) -> None:
    """Keypoints that are hidden in some frames."""
    film.caption = "3. Hidden for some frames: select the frames, and mark the keypoint bad (X)"
    review, now = film.review, film.review.frame
    box = review.tab.locator(".tcfit-strip").bounding_box()
    assert box is not None
    film.move(box["x"] + 0.45 * box["width"], box["y"] + 36)
    review.app.post(lambda: review.page.tab.set(selection=(INDEX["left_wrist"],), frames=range(now - 4, now + 8)))
    settle(review)
    film.shot()
    film.press("x")
    review.app.post(lambda: review.page.tab.set(frames=None, selection=()))


def other_weight(film: Film) -> None:
    """A range that is fitted again, compared with what it was."""
    film.caption = "4. Fit a range again with a larger w_T (R), and compare: A is the old run, B the new one"
    review = film.review
    open_panel(review, "Fit")
    tab = review.page.tab
    review.app.post(
        lambda: tab.set(
            frames=range(review.frame - 10, review.frame + 20),
            settings=replace(
                tab.state.settings,
                config=replace(
                    tab.state.settings.config,
                    temporal=replace(tab.state.settings.config.temporal, weight=1000.0),
                ),
            ),
        )
    )
    settle(review)
    film.shot()
    film.press("r")
    review.app.post(lambda: tab.set(mode="ab", wipe=True, frames=None))
    settle(review)
    film.shot()
    left, top, right, bottom = review.tab.evaluate(
        "() => { const b = document.querySelector('.tcfit-divider').getBoundingClientRect();"
        " return [b.left, b.top, b.right, b.bottom]; }"
    )
    film.move((left + right) / 2, (top + bottom) / 2)
    with film.holding():
        film.move((left + right) / 2 - 120, (top + bottom) / 2, 5)
        film.move((left + right) / 2 + 80, (top + bottom) / 2, 5)
    film.shot()
    review.app.post(lambda: tab.set(mode="edit", wipe=False, b=FitChoice()))


def queue(film: Film) -> None:
    """The review queue."""
    film.caption = "5. The review queue leads to what is suspicious: N goes on, O says that it looks fine"
    open_panel(film.review, "Review")
    until(lambda: film.review.page.gestures.reviewing.suspects is not None, "the review queue")
    settle(film.review)
    film.shot()
    for key in ("n", "o", "n"):
        film.press(key)


TASKS: tuple[Callable[[Film], None], ...] = (wrong_wrist, depth, bad_range, other_weight, queue)


def run(options: Screencast) -> None:
    """Films all tasks."""
    with chromium() as browser, tempfile.TemporaryDirectory() as folder:
        project = as_it_is(options.project, Path(folder))
        with reviewing(project, browser, title=TITLE) as review:
            review.tab.emulate_media(color_scheme="dark")
            review.tab.set_viewport_size({"width": options.window[0], "height": options.window[1]})
            review.app.post(lambda: review.page.tab.set(frame=options.frame))
            settle(review)
            film = Film(review=review)
            for task in TASKS:
                task(film)
                progress(film.caption)
    first, *others = film.pictures
    first.save(
        options.out, save_all=True, append_images=others, duration=film.milliseconds, loop=0, quality=60, method=4
    )
    progress(f"{options.out}: {len(film.pictures)} pictures, {options.out.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    start(Screencast, run)
