"""The report: whole, escaped, without a network; its plots show what they were given."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import pytest

from fitting_core.measure.comparison import Comparison, figure_titles
from fitting_core.measure.records import BASELINE, Evaluation, Record, overall, pooled, wins
from fitting_core.measure.report.page import report_page
from fitting_core.measure.report.plots import Series, label, line_plot, scale_of, ticks


def record(sequence: str, method: str, errors: list[float | None], motion: str = "simple") -> Record:
    known = [e for e in errors if e is not None]
    figures = dict.fromkeys(figure_titles()) | {"vertex_to_surface_mean": sum(known) / len(known), "jitter": 3.0}
    curves = {"vertex_to_surface": errors, "volume": [70.0] * len(errors), "true_volume": [71.0] * len(errors)}
    comparison = Comparison(first_frame=0, curves=curves, figures=figures)
    return Record(
        sequence=sequence, motion=motion, method=method, frames=len(errors), frame_rate=25.0, seconds=1.0,
        comparison=comparison,
    )  # fmt: skip


RECORDS = (
    record("simple_1", BASELINE, [4.0, 6.0]),
    record("simple_1", "tcfit", [2.0, 2.0]),
    record("simple_2", BASELINE, [1.0, None]),
    record("simple_2", "tcfit", [3.0, 5.0]),
)


def fitted(sequence: str, jitter: float) -> Record:
    made = record(sequence, "tcfit", [1.0])
    return replace(made, comparison=replace(made.comparison, figures={"jitter": jitter}))


def test_figures_over_all_frames():
    assert pooled(RECORDS[::2], "vertex_to_surface") == pytest.approx(11 / 3)
    assert pooled(RECORDS[1::2], "vertex_to_surface", "std") == pytest.approx(1.5**0.5)
    assert overall(RECORDS[::2], "vertex_to_surface_mean") == pytest.approx(11 / 3), "not 3, the mean of 5 and 1"
    assert overall([fitted("a", 1.0), fitted("b", 3.0)], "jitter") == pytest.approx(2.0)
    assert overall(RECORDS, "unknown") is None
    assert wins(RECORDS, "tcfit", BASELINE, "vertex_to_surface_mean") == (1, 2)
    assert wins(RECORDS, "tcfit", "paper", "vertex_to_surface_mean") is None


@pytest.mark.parametrize(("low", "high"), [(0.0, 9.7), (61.2, 74.9), (-3.0, 2.0), (0.0, 1e-4), (5.0, 5.0)])
def test_ticks_are_round_and_hold_everything(low: float, high: float):
    marks = ticks(low, high)
    step = marks[1] - marks[0]
    assert marks[0] <= low and marks[-1] >= high and 2 <= len(marks) <= 8
    assert float(f"{step:.1e}") == pytest.approx(step)
    for mark in marks:
        assert float(label(mark, step).replace("−", "-")) == pytest.approx(mark, abs=1e-6 * step)


def test_lines_break_where_nothing_is_known():
    drawn = line_plot(
        [0, 1, 2, 3], [Series(title="a", style="red", values=[1.0, None, 2.0, 3.0])], x_title="x", y_title="y"
    )
    (path,) = [e for e in ElementTree.fromstring(drawn).iter("path")]
    assert path.get("d", "").count("M") == 2 and path.get("d", "").count("L") == 1


def test_a_logarithmic_axis():
    scale = scale_of([10, 1000], 0, 100, logarithmic=True)
    assert [scale(v) for v in (10, 100, 1000)] == pytest.approx([0, 50, 100]) and scale.labels() == [
        "10",
        "100",
        "1000",
    ]


def test_the_page_needs_nothing_but_itself():
    evaluation = Evaluation(title="<script>alert(1)</script>", records=RECORDS, settings={"Command": "a & b <c>"})
    page = report_page(evaluation)
    assert "<script" not in page and "a &amp; b &lt;c&gt;" in page
    assert not re.findall(r"(?:https?:)?//|@import|<link|src=\"(?!data:)|url\(", page)
    assert "1 of 2" in page and "3.67" in page and "prefers-color-scheme: dark" in page
    assert page.count("<svg") == page.count("</svg>") and "nan" not in page.lower().replace("finance", "")
    for svg in re.findall(r"<svg.*?</svg>", page, re.S):
        ElementTree.fromstring(svg)


def test_a_page_without_records():
    assert "How this was measured" in report_page(Evaluation(title="x", records=()))
