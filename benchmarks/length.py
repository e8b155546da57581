"""Seconds per frame of each phase against the length of the clip: a cost linear in the length shows as ratios of 1."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median
from typing import Literal

from tyro.conf import OmitArgPrefixes

from benchmarks.clips import mirrored, read
from benchmarks.real_clips import config_of
from benchmarks.report import Common, Row, progress, report, start
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.events import PhaseFinished
from fitting_core.fitting import fit_events

CLOCKS: dict[str, Callable[[], float]] = {"wall": time.perf_counter, "cpu": time.process_time}
Seconds = dict[int, float]
"""Per frame, by phase."""


@dataclass(frozen=True, kw_only=True)
class Length:
    """Which clip at which lengths."""

    clip: str = "cam03"
    """Its first frames, as many as the shortest length, are played forwards and backwards up to each length."""
    lengths: tuple[int, ...] = (50, 100, 200, 400)
    """Frames."""
    reference: int = 100
    """The length that the ratios are against."""
    repeats: int = 3
    """Each repeat fits every length once, so that what slows the machine down for a while hits all of them."""
    preset: str = "tcfit"
    """How to fit."""
    clock: Literal["wall", "cpu"] = "wall"
    """Wall-clock time, or the process's own CPU time, which other programs on the machine disturb less."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def seconds_per_frame(clip: Clip, body: BodyModel, options: Length) -> Seconds:
    """Fits the clip once."""
    clock, seconds = CLOCKS[options.clock], {}
    begin = clock()
    for event in fit_events(clip, body, config_of(options.preset)):
        if isinstance(event, PhaseFinished):
            seconds[event.phase], begin = (clock() - begin) / len(clip), clock()
    return seconds


def medians(repeats: list[Seconds]) -> Seconds:
    """By phase."""
    return {phase: median(r[phase] for r in repeats) for phase in repeats[0]}


def row_of(frames: int, here: Seconds, reference: Seconds) -> Row:
    """Milliseconds per frame, and ratios to the reference length."""
    times = {f"phase {phase} ms / frame": 1e3 * s for phase, s in here.items()}
    ratios = {f"phase {phase} ratio": s / reference[phase] for phase, s in here.items()}
    total = sum(here.values()) / sum(reference.values())
    return {"frames": str(frames)} | times | ratios | {"total ratio": total}


def run(options: Length) -> None:
    """Fits every length in turn, several times, and compares medians."""
    if options.reference not in options.lengths:
        raise InputError(f"The reference, {options.reference} frames, is not among the lengths {options.lengths}.")
    body, clip, base = options.common.load_body(), read(options.clip).clip, min(options.lengths)
    if base > len(clip):
        raise InputError(f"The shortest length is {base} frames, but {options.clip} has only {len(clip)}.")
    clips = {frames: mirrored(clip, base, frames) for frames in options.lengths}
    progress("warming up")
    seconds_per_frame(clips[base], body, options)
    measured: dict[int, list[Seconds]] = {frames: [] for frames in options.lengths}
    for repeat in range(options.repeats):
        for frames, long_clip in clips.items():
            progress(f"repeat {repeat + 1}, {frames} frames")
            measured[frames].append(seconds_per_frame(long_clip, body, options))
    typical = {frames: medians(repeats) for frames, repeats in measured.items()}
    rows = [row_of(frames, typical[frames], typical[options.reference]) for frames in options.lengths]
    title = f"{options.clip}, {options.preset}: medians of {options.repeats} interleaved repeats, {options.clock} time"
    report(options, {title: rows})


if __name__ == "__main__":
    start(Length, run)
