"""Recorded events of a fit and of a re-run of 5 frames, replayed at several speeds: fraction, phrase, time left."""

import itertools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from fitting_core.fit.events import FitEvent, Iteration, PhaseFinished, PhaseStarted
from tcfit_app.fitting.fit_progress import KEYPOINTS, FitProgress, time_left

RECORDED = Path(__file__).parents[2] / "samples" / "progress"
"""Seconds, kind of event, phase and fraction of it; the demo clip with preset tcfit."""
NOTHING: Any = None


@dataclass(frozen=True)
class Shown:
    seconds: float
    fraction: float
    phrase: str
    remaining: float | None
    true: float
    """Seconds that the fit still took."""


def event_of(kind: str, phase: int, share: float) -> FitEvent | None:
    if kind == "PhaseStarted":
        return PhaseStarted(phase=phase, title="")
    if kind == "Iteration":
        return Iteration(phase=phase, label="", share=share, cost=1.0)
    return PhaseFinished(phase=phase, result=NOTHING, so_far=NOTHING) if kind == "PhaseFinished" else None


def replayed(name: str, phases: tuple[int, ...], seconds: float) -> list[Shown]:
    """What a fit that takes so many seconds shows."""
    rows = json.loads((RECORDED / f"{name}.json").read_text())
    scale, progress, shown = seconds / rows[-1][0], FitProgress(phases), list[Shown]()
    for at, *event in rows:
        if (found := event_of(*event)) is not None:
            progress.take(found, scale * at)
            now = scale * at
            shown.append(Shown(now, progress.fraction, progress.phrase, progress.remaining, seconds - now))
    return shown


@pytest.mark.parametrize("seconds", [12.0, 60.0, 900.0])
def test_fit_shows_one_monotone_fraction_and_three_phrases(seconds: float):
    shown = replayed("fit", (1, 2, 3), seconds)
    fractions = [one.fraction for one in shown]
    assert fractions == sorted(fractions) and fractions[-1] == pytest.approx(1)
    assert [phrase for phrase, _ in itertools.groupby(one.phrase for one in shown)] == [
        "first pass",
        "one shape",
        "final fit",
    ]
    assert all(abs(one.fraction - one.seconds / seconds) < 0.15 for one in shown)


@pytest.mark.parametrize("seconds", [60.0, 900.0])
def test_fit_shows_a_time_only_when_it_is_about_right(seconds: float):
    shown = replayed("fit", (1, 2, 3), seconds)
    told = [one for one in shown if one.remaining is not None]
    assert len(told) > len(shown) / 3 and shown[0].remaining is None
    assert all(abs(one.remaining - one.true) < 0.25 * one.true + 3 for one in told if one.remaining is not None)


def test_rerun_of_five_frames_never_shows_minutes():
    shown = replayed("rerun", (3,), 15.0)
    assert all(one.remaining is None or one.remaining < 15 for one in shown)
    assert shown[-1].fraction > 0.5 and {one.phrase for one in shown} == {"final fit"}


def test_detection_belongs_to_the_same_fraction():
    progress = FitProgress((KEYPOINTS, 1, 2, 3))
    assert progress.phrase == "finding keypoints"
    fractions = list[float]()
    for share in (0.0, 0.5, 1.0):
        progress.detected(share, 10 * share)
        fractions.append(progress.fraction)
    progress.take(Iteration(phase=1, label="", share=0.5, cost=1.0), 12.0)
    assert fractions == [0, 0.375, 0.75] and progress.fraction == pytest.approx(0.825)
    progress.take(Iteration(phase=1, label="", share=0.1, cost=1.0), 12.5)
    assert progress.fraction == pytest.approx(0.825)


@pytest.mark.parametrize(
    "seconds, words",
    [
        (None, ""),
        (4, "a few seconds left"),
        (34, "about 30 s left"),
        (57, "about 1 min left"),
        (310, "about 5 min left"),
        (7200, "about 2.0 h left"),
    ],
)
def test_time_left_is_coarse(seconds: float | None, words: str):
    assert time_left(seconds) == words
