"""How long two fits, a detection, a fit from the plain video and a start of the app take, beside the committed values.

Times are in units: one is what 40,000 small matrix products take on one thread of the same computer, measured before
each turn, so that figures of different computers and hours can be compared to some degree. Run it while the computer
does nothing else, after every change to the path of a fit or of a detection; what is more than 15 % above its committed
value (speed.json) is marked. `--write` commits new values. For the functions in which a fit spends its time:

    python -m cProfile -s cumulative -m benchmarks.speed --parts fit-cam03
"""

import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Literal

import torch
from tyro.conf import OmitArgPrefixes

from benchmarks.clips import data_folder, read
from benchmarks.excerpts import mirrored
from benchmarks.report import Common, Row, progress, report, start
from benchmarks.review import opening
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS
from fitting_core.detect.detecting import Detection
from fitting_core.detect.detectors import DEFAULT, find_detector
from fitting_core.errors import InputError
from fitting_core.fit.events import Finished, PhaseFinished
from fitting_core.fit.fitting import fit_clip, fit_events
from fitting_core.fit.fused import ready
from fitting_core.video.frames import FrameSource
from tcfit_app.options.preparing import compile_kernels
from tests.drivers.browser import chromium

Part = Literal["fit-cam03", "fit-gebaerden", "detection", "from-video", "start"]
COMMITTED = Path(__file__).with_name("speed.json")
SLOWER = 1.15
"""Ratio to the committed value that is marked."""
_PRODUCTS = 40_000
_STATUS = Path("/proc/self/status")


@dataclass(frozen=True, kw_only=True)
class Speed:
    """What to measure, and how often."""

    parts: tuple[Part, ...] = ("fit-cam03", "fit-gebaerden", "detection", "from-video", "start")
    repeats: int = 3
    """Turns; medians count."""
    project: Path | None = None
    """A project with a finished fit, such as `make demo` leaves, for the start; it is copied."""
    frames: int | None = None
    """Of the clips that are fitted: played back and forth to be longer or shorter, and compared with nothing."""
    fit_threads: int = 2
    write: bool = False
    """Write what is measured to speed.json."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def unit() -> float:
    """Seconds that 40,000 products of 8 x 55 matrices of 3 x 3 take, on one thread."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    a, b = torch.rand(2, 8, 55, 3, 3)
    begun = time.perf_counter()
    for _ in range(_PRODUCTS):
        torch.matmul(a, b)
    torch.set_num_threads(before)
    return time.perf_counter() - begun


Stages = Iterator[tuple[str, float]]
"""Names and seconds of the parts of one turn."""


def fit(clip: Clip, options: Speed) -> Stages:
    """A fit in a process that has fitted before."""
    name = f"fit of {clip.name}, {len(clip)} frames"
    begun = last = time.perf_counter()
    for event in fit_events(clip, options.common.load_body(), PRESETS["tcfit"]):
        if isinstance(event, PhaseFinished | Finished):
            now = time.perf_counter()
            if isinstance(event, PhaseFinished):
                yield f"{name}: phase {event.phase}", now - last
            last = now
    yield name, last - begun


def _video() -> Path:
    return data_folder() / "signs" / "gebaerden" / "video.mp4"


def _without_cache(source: FrameSource) -> Detection:
    """The detection of a whole video, of which nothing is stored."""
    detection = Detection(source=source, frames=range(len(source)), detector=find_detector(DEFAULT))
    detection.store().discard()
    return detection


def detection() -> Stages:
    """Decoding and detection of a video of 149 frames."""
    with FrameSource(_video()) as source:
        found = _without_cache(source)
        begun = time.perf_counter()
        for _ in found.events(found.store()):
            pass
        yield f"detection of gebaerden, {len(source)} frames", time.perf_counter() - begun


def from_video(folder: Path, options: Speed) -> Stages:
    """`tcfit fit VIDEO` without its overlay, from the command to its end."""
    with FrameSource(_video()) as source:
        _without_cache(source)
    out = folder / "result"
    shutil.rmtree(out, ignore_errors=True)
    command = [sys.executable, "-m", "tcfit_app", "fit", str(_video()), "--no-overlay", "--out", str(out)]
    begun = time.perf_counter()
    subprocess.run([*command, "--threads", str(options.fit_threads)], check=True, capture_output=True)
    yield "gebaerden from its video, tcfit fit", time.perf_counter() - begun


def opened(project: Path) -> Stages:
    """The app's start, from the command to the first frame with its body in the browser."""
    with chromium() as browser:
        yield "review of a fitted project: first body", opening(browser, project, (1440, 900)) / 1e3


def _works(options: Speed, folder: Path) -> Iterator[Callable[[], Stages]]:
    """Each part that is asked for, prepared."""
    for name in ("cam03", "gebaerden"):
        if f"fit-{name}" in options.parts:
            clip = read(name).clip
            if options.frames is not None:
                clip = mirrored(clip, min(len(clip), options.frames), options.frames)
            fit_clip(clip, options.common.load_body(), PRESETS["tcfit"])
            yield lambda clip=clip: fit(clip, options)
    if "detection" in options.parts:
        yield detection
    if "from-video" in options.parts:
        yield lambda: from_video(folder, options)
    if "start" in options.parts and options.project is not None:
        project = Path(shutil.copytree(options.project, folder / "copy.tcfit"))
        list(opened(project))  # the first time it has no stored body
        yield lambda: opened(project)


def run(options: Speed) -> None:
    """Measure the parts in turns; print seconds, units and committed units."""
    ready.use(threads=options.fit_threads)
    compile_kernels(PRESETS["tcfit"])
    units: list[float] = []
    took: dict[str, list[tuple[float, float]]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        works = list(_works(options, Path(folder)))
        if not works:
            raise InputError("Nothing is measured: the start needs --project, and --parts names nothing else.")
        for turn in range(options.repeats):
            for work in works:
                units.append(unit())
                progress(f"turn {turn + 1} of {options.repeats}: unit {units[-1]:.2f} s")
                for name, seconds in work():
                    took[name].append((seconds, seconds / units[-1]))
    committed: dict[str, float] = json.loads(COMMITTED.read_text())
    rows = [_row(name, turns, committed.get(name)) for name, turns in took.items()]
    report(options, {f"Time, unit {median(units):.2f} s": rows} | _memory())
    if options.write:
        committed |= {name: round(median(u for _, u in turns), 2) for name, turns in took.items()}
        COMMITTED.write_text(json.dumps(committed, indent=1) + "\n")


def _row(name: str, turns: list[tuple[float, float]], committed: float | None) -> Row:
    seconds, units = (median(values) for values in zip(*turns, strict=True))
    ratio = None if committed is None else units / committed
    mark = "slower" if ratio is not None and ratio > SLOWER else ""
    return {"what": name, "s": seconds, "units": units, "committed": committed, "ratio": ratio, "": mark}


def _memory() -> dict[str, list[Row]]:
    if not _STATUS.is_file():
        return {}
    (peak,) = (line.split()[1] for line in _STATUS.read_text().splitlines() if line.startswith("VmHWM:"))
    return {"Memory": [{"what": "at most in this process, MiB", "value": int(peak) / 2**10}]}


if __name__ == "__main__":
    start(Speed, run)
