"""How fast whole fits are: each phase, and the memory, as clips get longer; and ways to fit against each other.

Fits of the demo clip's first frames, played forwards and backwards, so that longer clips differ in their length alone.
Each fit has its own process, whose memory is reported, and comes after a small one that loads and compiles. All take
turns: what slows the computer down for a while slows all of them.
"""

import itertools
import time
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median

from tyro.conf import OmitArgPrefixes

from benchmarks.excerpts import mirrored, picked
from benchmarks.real_clips import config_of
from benchmarks.report import Common, Row, progress, report, start
from fitting_core.clip import Clip
from fitting_core.clips.demo import demo_clip
from fitting_core.config.schema import FitConfig
from fitting_core.config.settings import changed
from fitting_core.errors import InputError
from fitting_core.fit.events import PhaseFinished
from fitting_core.fit.fitting import fit_clip, fit_events
from fitting_core.fit.fused import ready
from tcfit_app.cli.demo_command import read_demo
from tcfit_app.fitting.process_queue import CONTEXT
from tcfit_app.options.preparing import compile_kernels

_STATUS = Path("/proc/self/status")


@dataclass(frozen=True, kw_only=True)
class Speed:
    """What to fit, and how often."""

    lengths: tuple[int, ...] = (16, 32, 64)
    """Frames of the clips; as many as the shortest has are played back and forth."""
    repeats: int = 3
    """Turns; medians are shown, with the least and the most."""
    preset: str = "tcfit"
    """How to fit."""
    compare: tuple[str, ...] = ()
    """Settings with their values, KEY=A,B such as temporal.window_size=7,15: every combination is fitted."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def ways(options: Speed) -> Iterator[tuple[str, FitConfig]]:
    """Each combination of the values that are compared, by its name.

    Raises:
        InputError: One of them is no setting, or a wrong value.
    """
    choices = [text.partition("=") for text in options.compare]
    for values in itertools.product(*(rest.split(",") for _, _, rest in choices)):
        chosen = {key: value for (key, _, _), value in zip(choices, values, strict=True)}
        name = " ".join(f"{key}={value}" for key, value in chosen.items()) or options.preset
        yield name, changed(config_of(options.preset), chosen, origin="--compare", texts=True)


def measured(clip: Clip, config: FitConfig, common: Common) -> dict[str, float]:
    """One fit: milliseconds a frame by phase, what it ended at, and MiB that the process has held at most."""
    ready.use(threads=common.threads)
    body = common.load_body()
    fit_clip(picked(clip, range(3)), body, config)
    found: dict[str, float] = {}
    begin = time.perf_counter()
    for event in fit_events(clip, body, config):
        if isinstance(event, PhaseFinished):
            found[f"phase {event.phase}, ms/frame"] = 1e3 * (time.perf_counter() - begin) / len(clip)
            found["objective"] = event.result.objective["total"]
            begin = time.perf_counter()
    found["all phases, ms/frame"] = sum(value for name, value in found.items() if name.startswith("phase"))
    if _STATUS.is_file():  # not getrusage, which counts what the parent held when it started this process
        (peak,) = (line.split()[1] for line in _STATUS.read_text().splitlines() if line.startswith("VmHWM:"))
        found["memory, MiB"] = int(peak) / 2**10
    return found


def run(options: Speed) -> None:
    """Fits in turns, and prints medians."""
    if min(options.lengths) < 3:
        raise InputError(f"--lengths {min(options.lengths)}: expected 3 frames or more.")
    demo = read_demo(demo_clip())
    clips = {frames: mirrored(demo, min(options.lengths), frames) for frames in options.lengths}
    found: dict[tuple[int, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    compile_kernels(config_of(options.preset))
    for turn in range(options.repeats):
        for (frames, clip), (name, config) in itertools.product(clips.items(), ways(options)):
            progress(f"{turn + 1}/{options.repeats} {frames} frames, {name}")
            with ProcessPoolExecutor(1, CONTEXT) as process:
                values = process.submit(measured, replace(clip, source=None), config, options.common).result()
            for what, value in values.items():
                found[frames, name][what].append(value)
    report(options, {f"{frames} frames, {name}": list(_rows(each)) for (frames, name), each in found.items()})


def _rows(values: dict[str, list[float]]) -> Iterator[Row]:
    for what, taken in values.items():
        yield {"what": what, "median": median(taken), "least": min(taken), "most": max(taken)}


if __name__ == "__main__":
    start(Speed, run)
