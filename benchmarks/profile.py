"""Where the time of a fit goes, by phase: on frames with body keypoints only and on frames with hands and face.

A stopwatch hangs around the fitter's functions; time counts for the innermost one. Another fit counts the time inside
torch, so that Python's share is known. All times are CPU time of the main thread: other programs do not disturb them.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from torch.overrides import TorchFunctionMode
from tyro.conf import OmitArgPrefixes

from benchmarks.clips import read
from benchmarks.excerpts import mirrored
from benchmarks.real_clips import config_of
from benchmarks.report import Common, Row, progress, report, start
from benchmarks.sections import Section, Spent, Stopwatch
from fitting_core.body.model import BodyModel
from fitting_core.body.points.body_points import BodyPoints
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.fit.events import PhaseFinished
from fitting_core.fit.fitting import fit_clip, fit_events
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.solvers import sequence
from fitting_core.fit.solvers.problem import IndependentFrames, SharedShape
from fitting_core.fit.solvers.sequence import Sequence
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.data import Data

SECTIONS = [
    Section("forward: pose the points", ((BodyPoints, "forward"),)),
    Section("Jacobians by automatic differentiation", ((FrameObjective, "differentiated"),)),
    Section("rest of E_o in torch: gradient, JtJ", ((FrameObjective, "_normal"),)),
    Section("data term", ((Data, "residual"),)),
    Section("cost of trial steps", ((FrameObjective, "cost"), (Sequence, "cost"))),
    Section("E_T: joints' rows", ((FrameObjective, "joint_jacobian"),)),
    Section("E_T: blocks of the matrix", ((sequence._SmoothnessOf, "add"),)),
    Section("solve: dense, per frame", ((IndependentFrames, "solve"),)),
    Section("solve: shared shape", ((SharedShape, "solve"),)),
    Section("solve: block-banded", ((sequence, "solve_block_banded"),)),
    Section("set-up of stages", ((Stages, "__init__"), (Stages, "objective"), (Stages, "camera_objective"))),
]
"""What the stopwatch hangs around; everything else is "solver and generators"."""
CLOCK = time.thread_time
REMAINDER = "solver and generators"
_SHOWN = 0.005
"""Share of the time under which a section is not worth a line."""


@dataclass(frozen=True, kw_only=True)
class Profile:
    """How much to fit."""

    balancing_frames: int = 100
    """Of cam03; more than it has are played backwards again."""
    signing_frames: int = 149
    """The same of gebaerden."""
    preset: str = "tcfit"
    """How to fit."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def spent_by_phase(clip: Clip, body: BodyModel, config: FitConfig) -> dict[int, dict[str, Spent]]:
    """One fit under the stopwatch."""
    watch, phases = Stopwatch(CLOCK), {}
    with watch.attached(SECTIONS):
        events = fit_events(clip, body, config)
        while True:
            with watch.section(REMAINDER):
                event = next(events, None)
            if event is None:
                return phases
            if isinstance(event, PhaseFinished):
                phases[event.phase], watch.spent = watch.spent, {}


def section_rows(phases: dict[int, dict[str, Spent]]) -> list[Row]:
    """Seconds and share of each section in each phase, the largest first, and their sum."""
    names = {name for spent in phases.values() for name in spent}
    totals = {phase: sum(s.seconds for s in spent.values()) for phase, spent in phases.items()}
    whole = sum(totals.values())
    seconds = {n: {phase: spent.get(n, Spent()).seconds for phase, spent in phases.items()} for n in names}
    rows = [_row(n, s, totals) for n, s in seconds.items() if sum(s.values()) > _SHOWN * whole]
    rows.sort(key=lambda row: -float(row["all s"] or 0))
    return [*rows, _row("all", totals, totals)]


def _row(name: str, seconds: dict[int, float], totals: dict[int, float]) -> Row:
    cells = {
        "section": name,
        "all s": sum(seconds.values()),
        "all %": 100 * sum(seconds.values()) / sum(totals.values()),
    }
    for phase, total in totals.items():
        cells |= {f"phase {phase} s": seconds[phase], f"phase {phase} %": 100 * seconds[phase] / total}
    return cells


class TorchCalls(TorchFunctionMode):
    """Sums the time inside torch's functions, methods and operators; what is left of a run's time is Python.

    cProfile cannot tell: it takes operators such as `a @ b` for a part of the Python function around them.
    """

    def __init__(self) -> None:
        super().__init__()
        self.seconds, self.calls = 0.0, 0

    def __torch_function__(self, func: Callable, types: Any, args: tuple = (), kwargs: dict | None = None) -> Any:
        """Runs one call under the clock."""
        begin = CLOCK()
        result = func(*args, **(kwargs or {}))
        self.seconds += CLOCK() - begin
        self.calls += 1
        return result


def python_row(name: str, clip: Clip, body: BodyModel, config: FitConfig) -> Row:
    """Seconds of a fit as it is, and how many of them are spent inside torch, by a second fit that counts its calls."""
    begin = CLOCK()
    fit_clip(clip, body, config)
    plain = CLOCK() - begin
    with TorchCalls() as torch_calls:
        fit_clip(clip, body, config)
    inside = torch_calls.seconds
    return {
        "clip": name,
        "whole fit s": plain,
        "inside torch s": inside,
        "Python s": plain - inside,
        "Python %": 100 * (plain - inside) / plain,
        "torch calls": torch_calls.calls,
        "µs / torch call": 1e6 * inside / torch_calls.calls,
    }


def run(options: Profile) -> None:
    """Profiles both clips."""
    body, config = options.common.load_body(), config_of(options.preset)
    tables: dict[str, list[Row]] = {}
    overhead: list[Row] = []
    for name, frames in {"cam03": options.balancing_frames, "gebaerden": options.signing_frames}.items():
        clip = read(name).clip
        clip = mirrored(clip, min(len(clip), frames), frames)
        progress(f"{name}, {frames} frames: sections")
        tables[f"{name}, {frames} frames, {options.preset}"] = section_rows(spent_by_phase(clip, body, config))
        progress(f"{name}, {frames} frames: inside torch")
        overhead.append(python_row(name, clip, body, config))
    report(options, tables | {"Torch and Python": overhead})


if __name__ == "__main__":
    start(Profile, run)
