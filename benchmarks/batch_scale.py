"""What a batch of very many clips costs beside the fits: 10,000 short ones, killed twice on the way.

The fit and the writing of its result are replaced by two small files, so that what is left is the batch: reading and
checking the list, comparing it with what is done, handing clips out, reading their keypoints, and putting result and
record in their place. The clips share a few folders of keypoints, and each has a result of its own. Linux only.
"""

import multiprocessing
import os
import signal
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, Row, progress, report, start
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.io.result_files import FIT_NAME, SUMMARY_NAME
from fitting_core.keypoints import COUNT, Keypoints
from tcfit_app.batch import clip_fit
from tcfit_app.batch.records import Figures
from tcfit_app.cli.main import main
from tcfit_app.fitting import child_processes

_FOLDERS, _FRAMES = 20, 3
"""Of keypoints, which the clips share."""
_A_FOLDER = 1000
"""Results beside each other."""
_PAUSE, _LOOK = 0.2, 2.0
"""Seconds between looks at the log, and at the memory."""


@dataclass(frozen=True, kw_only=True)
class BatchScale:
    """How many clips, and where."""

    folder: Path
    """For list, keypoints and results; it may not exist yet."""
    clips: int = 10_000
    jobs: int = 2
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True)
class Run:
    """One start of the batch."""

    seconds: float
    first: float
    """Seconds until a clip was done, or until the end."""
    fitted: int
    """Clips done by it."""
    memory: dict[str, float]
    """MB of the process that hands out, and of the largest one that fits, by when it was."""


def run(options: BatchScale) -> None:
    """Measure, and report."""
    folder = options.folder.absolute()
    manifest = _write(folder, options.clips)
    clip_fit._WRITERS["files"] = _write_little
    child_processes.CONTEXT = multiprocessing.get_context("fork")  # pyright: ignore[reportAttributeAccessIssue]
    thirds = [options.clips // 3, 2 * options.clips // 3, None]
    names = ["start, killed at a third", "resumed, killed at two thirds", "resumed to the end"]
    runs = {name: _run(manifest, options.jobs, until) for name, until in zip(names, thirds, strict=True)}
    runs["again, with nothing to do"] = _run(manifest, options.jobs, None)
    runs["--report"] = _run(manifest, options.jobs, None, "--report")
    _check(folder, options.clips)
    rows: list[Row] = [
        {
            "run": name,
            "clips done": str(one.fitted),
            "seconds": one.seconds,
            "until the first": one.first,
            "ms a clip": 1e3 * (one.seconds - one.first) / one.fitted if one.fitted else None,
            **{f"MB, {what}": value for what, value in one.memory.items()},
        }
        for name, one in runs.items()
    ]
    report(options, {f"{options.clips} clips, {options.jobs} processes": rows})


def _write(folder: Path, clips: int) -> Path:
    """The list and its keypoints."""
    random = np.random.default_rng(0)
    for number in range(_FOLDERS):
        xy, confidence = random.uniform(100, 400, (_FRAMES, COUNT, 2)), np.full((_FRAMES, COUNT), 0.9)
        write_openpose(folder / f"keypoints/k{number:02}", Keypoints(xy=xy, confidence=confidence), name=f"k{number}")
    rows = (f"keypoints/k{i % _FOLDERS:02},fits/{i // _A_FOLDER:03}/c{i:06}\n" for i in range(clips))
    manifest = folder / "clips.csv"
    manifest.write_text("keypoints,out\n" + "".join(rows))
    return manifest


def _write_little(work: clip_fit.Work) -> Figures:
    """In place of a fit and its result."""
    work.draft.mkdir(parents=True)
    (work.draft / FIT_NAME).write_bytes(b"as if")
    (work.draft / SUMMARY_NAME).write_bytes(b"{}")
    return Figures(frames=len(work.clip), reprojection_px=1.0, jitter_mm=1.0, suspicious=0)


def _run(manifest: Path, jobs: int, until: int | None, *more: str) -> Run:
    """Start the batch in a process of its own, and kill it with all its processes when so many clips are done."""
    begin, before = time.monotonic(), _done(manifest)
    child = os.fork()
    if not child:
        _become_batch(manifest, jobs, more)
    first, memory, looked = None, {}, 0.0
    while os.waitpid(child, os.WNOHANG)[0] == 0:
        time.sleep(_PAUSE)
        done = _done(manifest)
        now = time.monotonic() - begin
        if done > before and first is None:
            first = now
            memory |= {f"{who} at first": size for who, size in _memory(child).items()}
        if now > looked + _LOOK:
            looked, memory = now, memory | {f"{who} at last": size for who, size in _memory(child).items()}
        if until is not None and done >= until:
            os.killpg(child, signal.SIGKILL)
            until = None
    seconds = time.monotonic() - begin
    one = Run(seconds=seconds, first=first or seconds, fitted=_done(manifest) - before, memory=memory)
    progress(str(one))
    return one


def _become_batch(manifest: Path, jobs: int, more: tuple[str, ...]) -> None:
    os.setsid()
    sys.stdout = sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115
    os._exit(main(["batch", str(manifest), "--jobs", str(jobs), "--image-size", "640", "480", *more]))


def _done(manifest: Path) -> int:
    """Clips whose result is there, by the log."""
    try:
        return (manifest.parent / "clips.batch/log.jsonl").read_bytes().count(b'"event":"fitted"')
    except FileNotFoundError:
        return 0


def _memory(child: int) -> dict[str, float]:
    """Private MB of the process that hands out, and of the largest that fits: what is shared was here before."""
    try:
        children = Path(f"/proc/{child}/task/{child}/children").read_text().split()
        return {"main": _private(child), "fitting": max((_private(int(pid)) for pid in children), default=0.0)}
    except (OSError, ValueError):
        return {}


def _private(pid: int) -> float:
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return sum(int(line.split()[1]) for line in lines if line.startswith("Private")) / 1024


def _check(folder: Path, clips: int) -> None:
    """Every clip has one result, which was made once."""
    made = sum(1 for _ in (folder / "fits").glob("*/*/batch.json"))
    entries = [msgspec.json.decode(line) for line in (folder / "clips.batch/log.jsonl").read_bytes().splitlines()]
    fitted = Counter(entry["clip"] for entry in entries if entry["event"] == "fitted")
    hidden = [path for path in (folder / "fits").glob("*/.*")]
    assert made == len(fitted) == clips and set(fitted.values()) == {1} and not hidden, (made, len(fitted), hidden)


if __name__ == "__main__":
    start(BatchScale, run)
