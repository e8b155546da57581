"""The row of the video in the timeline."""

from base64 import b64decode
from collections.abc import Iterator
from pathlib import Path

import pytest
import viser

from tcfit_app.review.browser.page_states import Thumbnails as State
from tcfit_app.review.drawing.rows import VIDEO
from tcfit_app.review.drawing.thumbnails import MOST, Thumbnails, evenly_spread
from tests.drivers.lone_page import LonePage, lone_page, sample_project


@pytest.fixture
def tested(panel_server: viser.ViserServer, tmp_path: Path) -> Iterator[LonePage]:
    with sample_project(tmp_path / "walk.tcfit", "first") as project, lone_page(panel_server, project) as made:
        yield made


@pytest.mark.parametrize("length", [1, 6, MOST, 1000, 20_000])
def test_they_are_spread_over_the_clip(length: int):
    frames = evenly_spread(length)
    assert len(frames) == len(set(frames)) == min(length, MOST)
    assert frames[0] <= length / MOST and frames[-1] >= length - 1 - length / MOST


def test_they_are_sent_once_they_are_there_and_only_while_the_row_is_on_show(tested: LonePage):
    tab, sent, asked = tested.page.tab, [], []
    there = {frame: bytes([frame]) for frame in range(5)}

    def thumbnails(wanted: list[tuple[int, str]], reader: object) -> dict[tuple[int, str], bytes]:
        asked.append([frame for frame, _ in wanted])
        return {(frame, size): there[frame] for frame, size in wanted if frame in there}

    tab.data.video.thumbnails = thumbnails  # pyright: ignore[reportAttributeAccessIssue]
    tab.data.video.problem_of = lambda frame: ""  # pyright: ignore[reportAttributeAccessIssue]
    tab.channel.send = lambda name, state: sent.append(state)  # pyright: ignore[reportAttributeAccessIssue]
    row = Thumbnails(tab)
    row.draw()
    assert not asked and not sent
    tab.set(plots=(VIDEO,))
    row.draw()
    there[5] = b"last"
    row.draw()
    row.draw()
    first, last, again = sent
    assert asked == [[0, 1, 2, 3, 4, 5], [5]] and first != last and again is last, "the page has it already"
    assert isinstance(last, State) and last.frames == tuple(range(6)) and b64decode(last.images[5]) == b"last"
