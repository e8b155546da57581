"""The rows of the timeline: what each shows of the fits A and B."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from fitting_core.errors import InputError
from tcfit_app.analysis.curves import BETWEEN, CURVES, Curve
from tcfit_app.analysis.levels import LEVELS, LevelSpans
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.review.browser.page_events import Plot
from tcfit_app.review.drawing.rows import CHOICES, MOST_ROWS, PLOTS, with_plot
from tcfit_app.review.tab.state import TabState
from tests.drivers.lone_page import LonePage, sample_project, told

VALUES = {1: np.array([1.0, 2, 3, 4, 5, 6]), 2: np.array([2.0, 2, 2, 2, 2, np.nan])}
"""By run."""


@pytest.fixture
def tested(page_of: Callable[..., LonePage], tmp_path: Path) -> LonePage:
    """Two runs, which are A and B."""
    made = page_of(sample_project(tmp_path / "walk.tcfit", "first", "second"))
    tab = made.page.tab
    tab.set(a=FitChoice(run=1), b=FitChoice(run=2), mode="ab")

    def curves(names: tuple[str, ...], shown: Shown) -> tuple[Curve, ...]:
        return made_of.setdefault((names, shown.run.id), tuple(of(name, VALUES[shown.run.id]) for name in names))

    made_of: dict[object, tuple[Curve, ...]] = {}
    between = of(BETWEEN, np.arange(6.0))
    tab.data.curves = curves  # pyright: ignore[reportAttributeAccessIssue]
    tab.data.between = lambda a, b: between  # pyright: ignore[reportAttributeAccessIssue]
    return made


def of(name: str, values: np.ndarray) -> Curve:
    return Curve(name=name, title="", unit="", values=values)


def sent(tested: LonePage) -> list[dict[str, Any]]:
    """All states of the rows that were sent by drawing now."""
    with told(tested.page.tab) as found:
        tested.page.tab.look()
        tested.page.timeline.draw()
    return [msgspec.to_builtins(state) for name, state in found if name == "rows"]


def test_curves_are_sent_with_their_error_bars(tested: LonePage):
    tab, bars = tested.page.tab, np.array([1.0, 2, 3, 4, 5, np.nan])
    curves = {1: replace(of("jitter", VALUES[1]), error_bars=bars), 2: of("jitter", VALUES[2])}
    tab.data.curves = lambda names, shown: (curves[shown.run.id],)  # pyright: ignore[reportAttributeAccessIssue]
    tab.set(plots=("left_knee_flexion",))
    barred, plain = sent(tested)[-1]["rows"][0]["curves"]
    assert list(barred["error_bars"]) == [1, 2, 3, 4, 5, None] and not plain.get("error_bars")


def test_a_new_page_shows_what_can_be_plotted():
    assert set(TabState().plots) <= set(PLOTS) and {choice.name for choice in CHOICES} == set(PLOTS)
    assert len({choice.title for choice in CHOICES}) == len(CHOICES) == len(CURVES) + len(LEVELS) + 1


def test_each_fit_has_its_line(tested: LonePage):
    (state,) = sent(tested)
    first = state["rows"][0]
    assert first["name"] == "reprojection" and [curve["label"] for curve in first["curves"]] == ["A", "B"]
    assert list(first["curves"][1]["values"]) == [2, 2, 2, 2, 2, None]
    assert not sent(tested), "nothing has changed"


def test_one_fit_has_a_line_for_each_part_in_the_colour_of_its_keypoints(tested: LonePage):
    asked, values = [], {"reprojection_left_hand": np.full(6, np.nan)}

    def curves(names: tuple[str, ...], shown: Shown) -> tuple[Curve, ...]:
        asked.append(shown.run.id)
        return tuple(of(name, values.get(name, VALUES[1])) for name in names)

    tested.page.tab.data.curves = curves  # pyright: ignore[reportAttributeAccessIssue]
    tested.page.tab.set(mode="edit")
    ((row,),) = [state["rows"] for state in sent(tested)]
    drawn = [(curve["label"], curve["color"]) for curve in row["curves"]]
    assert drawn == [("body", "body"), ("right hand", "right_hand"), ("face", "face")], "no left hand was detected"
    assert set(asked) == {2}, "the fit that is corrected"


def test_the_same_fit_has_one_line_and_no_distance(tested: LonePage):
    tested.page.tab.set(a=FitChoice(run=2), plots=("jitter", BETWEEN))
    (state,) = sent(tested)
    each, *compared = state["rows"]
    assert [curve["label"] for curve in each["curves"]] == [""]
    assert all(not row["curves"] and "are the same" in row["empty"] for row in compared)


def test_the_distance_is_a_row(tested: LonePage):
    tested.page.tab.set(plots=(BETWEEN,))
    (state,) = sent(tested)
    (distance,) = state["rows"]
    assert list(distance["curves"][0]["values"]) == [0, 1, 2, 3, 4, 5]


def test_levels_are_those_of_b(tested: LonePage):
    tab, asked = tested.page.tab, []
    spans = ((((0, 1),), (), ((2, 5),)), ((), (), ()))

    def levels(name: str, shown: Shown) -> LevelSpans:
        asked.append((name, shown.run.id))
        return spans

    tab.data.levels = levels  # pyright: ignore[reportAttributeAccessIssue]
    tab.set(plots=("hand_phases",))
    (state,) = sent(tested)
    found = state["rows"][0]["levels"]
    assert asked == [("hand_phases", 2)] and not state["rows"][0]["curves"]
    assert found["spans"] == spans and len(found["parts"]) == 2 and len(found["words"]) == 3
    assert not sent(tested)


def test_a_row_says_why_there_is_no_curve(tested: LonePage):
    tab = tested.page.tab
    tab.set(plots=("reprojection",))
    tab.data.curves = lambda names, shown: None  # pyright: ignore[reportAttributeAccessIssue]
    assert "body of this run is missing" in sent(tested)[-1]["rows"][0]["empty"]
    tab.data.problem = lambda what, shown: ""  # pyright: ignore[reportAttributeAccessIssue]
    nothing = of("reprojection", np.full(6, np.nan))
    for curve, said in ((None, "Measuring"), (nothing, "nothing to measure")):
        tab.data.curves = lambda names, shown, curve=curve: curve and (curve,)  # pyright: ignore[reportAttributeAccessIssue]
        assert said in sent(tested)[-1]["rows"][0]["empty"]


def test_a_curve_stays_until_a_newer_one_of_the_same_fit_is_there(tested: LonePage):
    tab = tested.page.tab
    tab.set(plots=("jitter",))
    assert len(sent(tested)) == 1
    tab.data.curves = lambda names, shown: None  # pyright: ignore[reportAttributeAccessIssue]
    assert not sent(tested)
    tab.set(b=FitChoice(run=1))
    (state,) = sent(tested)
    assert not state["rows"][0]["curves"] and "empty" in state["rows"][0]


def test_the_curve_of_a_fit_stays_until_that_of_its_corrections_is_there(tested: LonePage):
    tab = tested.page.tab
    tab.set(plots=("jitter",))
    assert len(sent(tested)) == 1
    before = tab.look()
    assert before.b is not None
    run = replace(before.b.run, id=9, kind="corrections", parent=before.b.run.id)
    tab.look = lambda: None  # pyright: ignore[reportAttributeAccessIssue]
    tab._shown = replace(before, b=replace(before.b, run=run))
    tab.data.curves = lambda names, shown: None  # pyright: ignore[reportAttributeAccessIssue]
    assert not sent(tested)


def test_rows_come_and_go(tested: LonePage):
    tab, page = tested.page.tab, tested.page
    page.receive(Plot(name="depth", shown=True))
    page.receive(Plot(name="depth", shown=True))
    page.receive(Plot(name="reprojection", shown=False))
    page.receive(Plot(name="error_by_part", shown=True))  # a row of earlier versions, which a browser may remember
    assert tab.state.plots == ("depth",)
    full = tuple(PLOTS)[:MOST_ROWS]
    with pytest.raises(InputError, match="at most"):
        with_plot(full, tuple(PLOTS)[-1], shown=True)
