"""What an edit costs the thread that draws does not grow with the clip."""

import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import viser

from fitting_core.clip import Clip
from fitting_core.keypoints import INDEX
from tcfit_app.project.edits.kinds import DetectAgain, Lock, MarkBad, Pin, SetDepth, SwapSides
from tcfit_app.project.project import Project
from tcfit_app.review.browser.page_events import Drag, Hello
from tests.drivers.lone_page import LonePage, lone_page
from tests.samples.project_samples import BODY, CONFIG, sample_clip, sample_fit
from tests.samples.sessions import OneBody

pytestmark = pytest.mark.thorough

WRIST, FRAME = INDEX["right_wrist"], 60
SHORT, LONG = 200, 8000
"""Frames."""


def clip_of(frames: int) -> Clip:
    clip = sample_clip(frames)
    there = np.full(clip.keypoints.confidence.shape, 0.9)
    return replace(clip, keypoints=replace(clip.keypoints, confidence=there))


def drag(page: LonePage) -> None:
    for phase, dx in (("start", 0.0), ("move", 5.0), ("end", 9.0)):
        page.page.receive(Drag(phase, (WRIST,), dx, 0.0, FRAME))  # pyright: ignore[reportArgumentType]


def detect_again(page: LonePage) -> None:
    points = np.full((1, 137, 3), 0.5)
    page.page.gestures.correcting.make(DetectAgain.found((FRAME,), "right_hand", points))


HERE = {"frames": (FRAME,), "joints": (WRIST,)}
DEEDS: dict[str, Callable[[LonePage], None]] = {
    "nudge": lambda page: page.page.gestures.correcting.nudge(1.0, 0.0),
    "drag": drag,
    "mark bad": lambda page: page.page.gestures.correcting.make(MarkBad(**HERE)),
    "swap": lambda page: page.page.gestures.correcting.make(SwapSides(frames=(FRAME,), joints=(4, 7))),
    "depth": lambda page: page.page.gestures.correcting.make(SetDepth(**HERE, depth=((0.1,),))),
    "pin": lambda page: page.page.gestures.correcting.make(Pin(**HERE, xy=((1.0, 2.0),), depth=((0.1,),))),
    "lock": lambda page: page.page.gestures.correcting.make(Lock(**HERE, turn=((0.1, 0.2, 0.3),))),
    "detect again": detect_again,
    "undo": lambda page: page.page.gestures.correcting.undo(),
    "redo": lambda page: page.page.gestures.correcting.redo(),
}


def taken(page: LonePage, deed: Callable[[LonePage], None]) -> int:
    """The most memory in bytes that an edit and the drawing after it take at once: a copy of the clip would show."""
    page.page._next_panels = 0.0  # also menus and panels, which rest at other times
    page.page.draw(time.monotonic())
    tracemalloc.start()
    try:
        deed(page)
        page.page._next_panels = 0.0
        page.page.draw(time.monotonic())
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def costs(folder: Path, frames: int, server: viser.ViserServer) -> dict[str, int]:
    with Project.create(folder, clip_of(frames)) as project:
        run = project.runs.start(CONFIG, body=BODY, edits_seen=0)
        project.runs.finish(run.id, sample_fit(1, frames=frames))
        with lone_page(server, project, bodies=OneBody(None)) as page:
            page.page.receive(Hello(tab="a", browser="b", dark=False, width=1000, height=700, hinted=True))
            tab = page.page.tab
            tab.session.edit_follower.after_edits = False
            page.html()
            tab.set(frame=FRAME, selection=(WRIST,), plots=())
            for deed in DEEDS.values():  # once for what is made at first
                taken(page, deed)
            return {name: taken(page, deed) for name, deed in DEEDS.items()}


def test_an_edit_and_the_drawing_after_it_take_no_more_in_a_long_clip(tmp_path: Path, panel_server: viser.ViserServer):
    short, long = (costs(tmp_path / str(frames), frames, panel_server) for frames in (SHORT, LONG))
    # One byte for each keypoint of the longer clip would be a megabyte more.
    grown = {name: long[name] - short[name] for name in DEEDS}
    assert max(grown.values()) < 200_000, grown
