"""The report: complete, escaped, without a network; and figures over several sequences."""

import re
import sys
from dataclasses import replace

import pytest

from fitting_core.errors import InputError
from fitting_core.measure.comparison import Comparison, figure_titles
from fitting_core.measure.records import BASELINE, Evaluation, Record
from fitting_core.measure.report import report_page


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


def outside_of_plotly(page: str) -> str:
    """The page without the scripts."""
    return re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def test_page_of_several_sequences_has_bars_and_needs_no_network():
    pytest.importorskip("plotly", reason="the report needs tcfit[report]")
    hostile = replace(RECORDS[0], sequence="</script><script>alert(1)</script>")
    evaluation = Evaluation(
        title="<script>alert(2)</script>", records=(*RECORDS, hostile), settings={"Command": "a & b <c>"}
    )
    page = report_page(evaluation)
    assert "<script>alert" not in page and "a &amp; b &lt;c&gt;" in page
    assert not re.findall(r"https?://|@import|<link|src=", outside_of_plotly(page))
    assert not re.search(r"<script[^>]*src=", page) and page.count('id="plot-') == 1
    assert "4.20" in outside_of_plotly(page), "the mean over all frames of the baseline"


def test_page_of_one_sequence_has_curves_and_the_true_volume():
    pytest.importorskip("plotly", reason="the report needs tcfit[report]")
    page = report_page(Evaluation(title="x", records=RECORDS[:2]))
    assert '"name":"truth"' in page and page.count('id="plot-') == 2, "surface error, and volume"


def test_report_without_plotly_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    with pytest.raises(InputError, match=r"pip install tcfit\[report\]"):
        report_page(Evaluation(title="x", records=RECORDS))
