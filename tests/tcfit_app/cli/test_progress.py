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
from fitting_core.results.fit_result import FitResult, PhaseResult
from tcfit_app.cli import progress as shown
from tcfit_app.cli.progress import ProgressShown


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


def test_lines_without_a_terminal():
    stream = io.StringIO()
    with closing(ProgressShown((1, 2, 3), stream)) as progress:
        for event in _events():
            progress.show(event)
    assert stream.getvalue().splitlines() == ["Phase 1: first pass", "  1.0 s, cost 42.5"]


def test_bar_is_one_of_the_whole_fit_and_never_goes_back():
    stream = _Terminal()
    fractions = []
    with closing(ProgressShown((1, 2, 3), stream)) as progress:
        for event in _events():
            progress.show(event)
            assert progress.bar is not None
            fractions.append(progress.bar.n / progress.bar.total)
        assert "First pass" in str(progress.bar) and " 60 %" in str(progress.bar)
    assert fractions == [0, 0.15, 0.3, 0.3, 0.45, 0.6]


def test_bar_shows_a_time_once_it_is_stable(monkeypatch: pytest.MonkeyPatch):
    stream, now = _Terminal(), [0.0]
    monkeypatch.setattr(shown.time, "perf_counter", lambda: now[0])
    with closing(ProgressShown((1,), stream)) as progress:
        progress.show(next(_events()))
        for second in range(41):
            now[0] = float(second)
            progress.show(Iteration(phase=1, label="", share=second / 100, cost=1.0))
            if second == 2:
                assert "left" not in str(progress.bar)
        assert "First pass" in str(progress.bar) and "about 1 min left" in str(progress.bar)


def test_bar_is_closed_when_a_phase_is_cut_short():
    stream = _Terminal()
    with pytest.raises(KeyboardInterrupt), closing(ProgressShown((1, 2, 3), stream)) as progress:
        progress.show(next(_events()))
        raise KeyboardInterrupt
    assert stream.getvalue().endswith("\n")
