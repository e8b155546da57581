"""The progress display, on a terminal and elsewhere."""

import io
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest

from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.config.schema import FitConfig
from fitting_core.fit.events import FitEvent, Iteration, PhaseFinished, PhaseStarted
from fitting_core.fit.result import FitResult, PhaseResult
from tcfit_app.cli.fit_command import ProgressBars


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def _events() -> Iterator[FitEvent]:
    yield PhaseStarted(phase=1, title="every frame on its own")
    for share, label in ((0.25, "stage 2"), (0.5, "stage 4"), (0.2, "other side"), (0.75, "relay 1")):
        yield Iteration(phase=1, label=label, share=share, cost=1234.5678)
    params = BodyParams.neutral(2)
    result = PhaseResult(
        phase=1, params=params, objective={"data": 41.0, "total": 42.5}, frame_cost=np.ones(2), seconds=1.0
    )
    camera = Camera(focal=(1, 1), center=(0, 0), size=(2, 2))
    fit = FitResult(phases=(result,), camera=camera, config=FitConfig(), observed=np.ones((2, 55), bool))
    yield PhaseFinished(phase=1, result=result, so_far=fit)


def test_lines_where_there_is_no_terminal():
    stream = io.StringIO()
    with closing(ProgressBars(stream)) as progress:
        for event in _events():
            progress.show(event)
    first, second = stream.getvalue().splitlines()
    assert first == "Phase 1: every frame on its own"
    assert second.startswith("  finished in ") and second.endswith(" s, cost 42.5")


def test_bar_on_a_terminal_never_goes_back(monkeypatch: pytest.MonkeyPatch):
    stream = _Terminal()
    shares = []
    with closing(ProgressBars(stream)) as progress:
        for event in _events():
            progress.show(event)
            if progress.bar is not None:
                shares.append(progress.bar.n / progress.bar.total)
    assert shares == [0, 0.25, 0.5, 0.5, 0.75]
    last = stream.getvalue().split("\r")[-1]
    assert "Phase 1: every frame on its own" in last and "100 %" in last and "cost 42.5" in last


def test_bar_shows_label_cost_and_times():
    stream = _Terminal()
    events = _events()
    with closing(ProgressBars(stream)) as progress:
        for event in (next(events), next(events)):
            progress.show(event)
        assert progress.bar is not None
        shown = str(progress.bar)
    assert "25 %" in shown and "00:00 < " in shown and "stage 2, cost 1235" in shown


def test_bar_is_closed_when_a_phase_is_cut_short():
    stream = _Terminal()
    with pytest.raises(KeyboardInterrupt), closing(ProgressBars(stream)) as progress:
        progress.show(next(_events()))
        raise KeyboardInterrupt
    assert stream.getvalue().endswith("\n")
