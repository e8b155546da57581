"""Two people who press and drag whatever they find: nothing breaks, and nothing piles up."""

import gc
import logging
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fitting_core.keypoints import BODY, LOCKABLE
from tcfit_app.review.browser import page_events
from tcfit_app.review.gestures.actions import ACTIONS, Key
from tests.drivers.review_page import QUICK, Reviewing, opened, reviewing, until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough

_ROOM = 100 * 2**20
"""Bytes by which the server may grow."""
_MODIFIERS = {"shift": "Shift+", "ctrl": "Control+"}


def _pressed(key: Key) -> str:
    """A key as Playwright names it."""
    return "".join(text for name, text in _MODIFIERS.items() if getattr(key, name)) + key.key


KEYS = [_pressed(key) for name, action in ACTIONS.items() for key in action.keys if name != "fit"]


def _press(user: Reviewing, rng: np.random.Generator) -> None:
    if rng.random() < 0.3:  # out of the field that a note is typed into, or that was clicked
        user.tab.evaluate("() => document.activeElement?.blur()")
    user.tab.keyboard.press(str(rng.choice(KEYS)))


COMMANDS = [name for name, action in ACTIONS.items() if not (action.keys or name.startswith(("detect_", "frame_")))]
"""That have no key: they are chosen by their names. Parts are detected again by networks that not everybody has."""


def _command(user: Reviewing, rng: np.random.Generator) -> None:
    user.page.tab.browser.receive(page_events.Key(action=str(rng.choice(COMMANDS)), repeat=False))


def _turn(user: Reviewing, rng: np.random.Generator) -> None:
    """The rings around a joint in 3D, if they are met."""
    joint = int(rng.choice([*LOCKABLE]))
    user.page.tab.do(lambda: user.page.tab.set(mode="space", selection=(joint,)))
    place = user.tab.evaluate("(joint) => tcfit.placeOfFit(joint)", joint)
    if place is not None:
        angle, radius = rng.uniform(0, 2 * np.pi), rng.uniform(20, 90)
        x, y = place[0] + radius * np.cos(angle), place[1] + radius * np.sin(angle)
        user.tab.mouse.move(x, y)
        user.tab.mouse.down()
        user.tab.mouse.move(x + rng.normal(0, 30), y + rng.normal(0, 30), steps=3)
        user.tab.mouse.up()


def _point(user: Reviewing, rng: np.random.Generator) -> tuple[float, float]:
    """Somewhere in the window: near a keypoint, or anywhere."""
    size = user.tab.viewport_size
    assert size is not None
    x, y = user.session.project.corrected.xy[user.frame, int(rng.integers(BODY.stop))].tolist()
    place = user.tab.evaluate("([x, y]) => tcfit.place(x, y)", [x, y])
    if place is None or rng.random() < 0.3:
        return float(rng.uniform(5, size["width"] - 5)), float(rng.uniform(5, size["height"] - 5))
    return tuple(place)


def _drag(user: Reviewing, rng: np.random.Generator) -> None:
    x, y = _point(user, rng)
    user.tab.mouse.move(x, y)
    button = str(rng.choice(["left", "left", "left", "right", "middle"]))
    if rng.random() < 0.3:
        user.tab.keyboard.down("Shift")
    user.tab.mouse.down(button=button)  # pyright: ignore[reportArgumentType]
    user.tab.mouse.move(x + rng.normal(0, 60), y + rng.normal(0, 60), steps=int(rng.integers(1, 6)))
    if rng.random() < 0.1:
        user.tab.keyboard.press("Escape")
    user.tab.mouse.up(button=button)  # pyright: ignore[reportArgumentType]
    user.tab.keyboard.up("Shift")


def _drag_in_depth(user: Reviewing, rng: np.random.Generator) -> None:
    """A keypoint of the fit in the side view or in 3D, or the side view's border."""
    joint = int(rng.integers(BODY.stop))
    mode = user.tab.evaluate("() => tcfit.state('layout')?.mode")
    place = user.tab.evaluate("([joint, at]) => tcfit.placeOfFit(joint, at)", [joint, 0 if mode == "space" else 1])
    if place is None:
        return
    x, y = place if rng.random() < 0.9 else (place[0] - 150, place[1])
    user.tab.mouse.move(x, y)
    user.tab.mouse.down()
    user.tab.mouse.move(x + rng.normal(0, 40), y + rng.normal(0, 10), steps=4)
    user.tab.mouse.up()


def _menu(user: Reviewing, rng: np.random.Generator) -> None:
    """A right click in the picture or the timeline, and something of the menu that it opens."""
    size = user.tab.viewport_size
    assert size is not None
    x, y = _point(user, rng) if rng.random() < 0.5 else (rng.uniform(80, size["width"] - 400), size["height"] - 100)
    user.tab.mouse.click(x, y, button="right")
    items = user.tab.locator("[role=menu] [role^=menuitem]")
    names = items.all_inner_texts()
    chosen = [i for i, name in enumerate(names) if not name.startswith("Fit everything")]
    if chosen:
        user.tab.evaluate(
            "(i) => document.querySelectorAll('[role=menu] [role^=menuitem]')[i]?.click()", int(rng.choice(chosen))
        )


def _seek(user: Reviewing, rng: np.random.Generator) -> None:
    size = user.tab.viewport_size
    assert size is not None
    x, y = rng.uniform(80, size["width"] - 400), size["height"] - rng.uniform(20, 120)
    user.tab.mouse.move(x, y)
    user.tab.mouse.down()
    user.tab.mouse.move(x + rng.normal(0, 80), y, steps=3)
    user.tab.mouse.up()


def _wheel(user: Reviewing, rng: np.random.Generator) -> None:
    user.tab.mouse.move(*_point(user, rng))
    user.tab.mouse.wheel(0, float(rng.choice([-300, 300])))


def _resize(user: Reviewing, rng: np.random.Generator) -> None:
    """Smaller than usual windows: without a graphics card, a large one is drawn in seconds."""
    user.tab.set_viewport_size({"width": int(rng.integers(700, 1100)), "height": int(rng.integers(480, 720))})


def _reload(user: Reviewing, rng: np.random.Generator) -> None:
    pages = len(user.app.pages)
    user.tab.reload()
    user.tab.wait_for_function("() => window.tcfit?.place && tcfit.state('keypoints')", timeout=60_000)
    until(lambda: len(user.app.pages) == pages and all(page.tab.ready for page in user.app.pages.values()))


def _click(user: Reviewing, rng: np.random.Generator) -> None:
    """Some button or tab of the panels."""
    user.tab.keyboard.press("Escape")
    places = user.tab.evaluate(
        """() => [...document.querySelectorAll("button, [role=tab]")]
          .filter((b) => b.checkVisibility() && !/purge/i.test(b.textContent))
          .map((b) => b.getBoundingClientRect()).filter((r) => r.width && r.bottom < innerHeight)
          .map((r) => [r.x + r.width / 2, r.y + r.height / 2])"""
    )
    if places:
        user.tab.mouse.click(*places[int(rng.integers(len(places)))])


def _wait(user: Reviewing, rng: np.random.Generator) -> None:
    user.tab.wait_for_timeout(float(rng.uniform(0, 400)))


DEEDS: list[tuple[float, Callable[[Reviewing, np.random.Generator], None]]] = [
    (0.5, _press),
    (0.05, _command),
    (0.03, _turn),
    (0.15, _drag),
    (0.1, _drag_in_depth),
    (0.05, _menu),
    (0.1, _seek),
    (0.05, _wheel),
    (0.05, _click),
    (0.02, _resize),
    (0.01, _reload),
    (0.07, _wait),
]


def _memory() -> int:
    """Bytes of this process."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _let_loose(folder: Path, browser: "Browser", actions: int, warm: int, log: pytest.LogCaptureFixture) -> int:
    """Bytes by which the server has grown after `warm` actions."""
    rng = np.random.default_rng(1)
    shares = np.array([share for share, _ in DEEDS])
    with log.at_level(logging.WARNING), reviewing(folder, browser) as first:
        first.app.post(lambda: first.session.fit_everything(QUICK, kind="smplx", gender="neutral"))
        until(lambda: first.session.jobs)
        users = [first, opened(first.app, first.server, browser)]
        before = 0
        for i in range(actions):
            if i == warm:
                before = _memory()
            user = users[int(rng.integers(2))]
            user.tab.wait_for_function("() => window.tcfit?.place")  # it loads itself anew after a lost connection
            DEEDS[int(rng.choice(len(DEEDS), p=shares / shares.sum()))][1](user, rng)
        first.app.post(first.session.cancel)
        until(lambda: not first.session.jobs and not first.session.edit_follower.busy, "the worker")
        grown = _memory() - before
        for user in users:
            assert not user.complaints
        loud = [r for r in log.records if r.levelno >= logging.ERROR]
        assert not loud, loud
    return grown


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="this system does not say how large a process is")
def test_some_random_actions(demo_project: Path, browser: "Browser", tmp_path: Path, caplog: pytest.LogCaptureFixture):
    folder = Path(shutil.copytree(demo_project, tmp_path / "demo.tcfit"))
    assert _let_loose(folder, browser, 20, 10, caplog) < _ROOM


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="this system does not say how large a process is")
def test_1000_random_actions(demo_project: Path, browser: "Browser", tmp_path: Path, caplog: pytest.LogCaptureFixture):
    folder = Path(shutil.copytree(demo_project, tmp_path / "demo.tcfit"))
    grown = _let_loose(folder, browser, 1000, 200, caplog)
    print(f"grown by {grown / 2**20:.0f} MB")
    assert grown < _ROOM
