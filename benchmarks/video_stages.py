"""From a plain video to its fit: what each stage costs a frame, in time and in processor time.

Processor time counts all threads: where it is twice the time, both cores are busy. Measure on a computer that does
nothing else; clips and detectors take turns, and medians are shown.
"""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from tyro.conf import OmitArgPrefixes

from benchmarks.clips import data_folder
from benchmarks.real_clips import config_of
from benchmarks.report import Common, Row, progress, report, start
from fitting_core.body.model import BodyModel
from fitting_core.clips.options import ClipOptions
from fitting_core.clips.reading import read_clip
from fitting_core.config.schema import FitConfig
from fitting_core.detect.detecting import Detection
from fitting_core.detect.detectors import find_detector
from fitting_core.detect.part import Detector
from fitting_core.fit.events import Finished, PhaseFinished
from fitting_core.fit.fitting import fit_events
from fitting_core.video.frames import FrameSource
from tcfit_app.options.preparing import compile_kernels, prepare_solver

_WHOLE = "from the video to its fit"


@dataclass(frozen=True, kw_only=True)
class VideoStages:
    """What to detect and fit."""

    clips: tuple[str, ...] = ("signs/gebaerden", "opencap/walk_ts")
    """Folders of the development data with a video.mp4."""
    detectors: tuple[str, ...] = ("mediapipe", "mediapipe-fast")
    """Names in `DETECTORS`."""
    frames: int = 150
    """Of each clip, at most."""
    repeats: int = 2
    fit_threads: int = 2
    preset: str = "tcfit"
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


class Watch:
    """Time and processor time of stages, in seconds."""

    def __init__(self) -> None:
        self.spent: dict[str, tuple[float, float]] = {}
        self._since = self._now()

    def _now(self) -> tuple[float, float]:
        return time.perf_counter(), time.process_time()

    def note(self, stage: str) -> None:
        """What has passed since the last note was this stage."""
        now = self._now()
        self.spent[stage] = (now[0] - self._since[0], now[1] - self._since[1])
        self._since = now

    @contextmanager
    def whole(self) -> Iterator[None]:
        """All stages together."""
        begun = self._since = self._now()
        yield
        end = self._now()
        self.spent[_WHOLE] = (end[0] - begun[0], end[1] - begun[1])


def decode(video: Path, frames: int) -> int:
    """Decode the first frames; how many there are."""
    with FrameSource(video) as source:
        count = min(frames, len(source))
        for frame in range(count):
            source.frame_or_grey(frame)
        return count


def fit(video: Path, count: int, detector: Detector, body: BodyModel, config: FitConfig) -> Watch:
    """Find the keypoints, without the cache, and fit."""
    with FrameSource(video) as source:
        Detection(source=source, frames=range(count), detector=detector).store().discard()
    watch = Watch()
    with watch.whole():
        clip = read_clip(
            video,
            clip=ClipOptions(last_frame=count - 1),
            detector=detector,
            tell=lambda done: watch.note("decoding and detection") if done.kept == done.total else None,
        )
        watch.note("who it is, and the focal length")
        for event in fit_events(clip, body, config):
            if isinstance(event, PhaseFinished):
                watch.note(f"phase {event.phase}")
            elif isinstance(event, Finished):
                watch.note("error bars")
    return watch


def run(options: VideoStages) -> None:
    """Measures and prints a table for each clip."""
    body, config = options.common.load_body(), config_of(options.preset)
    prepare_solver(config, options.fit_threads)
    compile_kernels(config)
    videos = {name: data_folder() / name / "video.mp4" for name in options.clips}
    detectors = {name: find_detector(name) for name in options.detectors}
    spent: dict[tuple[str, str], list[dict[str, tuple[float, float]]]] = defaultdict(list)
    counts: dict[str, int] = {}
    for turn in range(options.repeats):
        for clip, video in videos.items():
            watch = Watch()
            counts[clip] = decode(video, options.frames)
            watch.note("decoding alone")
            for name, detector in detectors.items():
                progress(f"turn {turn + 1}: {clip}, {name}")
                spent[clip, name].append(watch.spent | fit(video, counts[clip], detector, body, config).spent)
    tables: dict[str, list[Row]] = {}
    for (clip, name), turns in spent.items():
        rows = tables.setdefault(f"{clip}, {counts[clip]} frames: ms a frame", [])
        for stage in turns[0]:
            took, worked = (1000 * median(turn[stage][k] for turn in turns) / counts[clip] for k in (0, 1))
            rows.append({"detector": name, "stage": stage, "time": took, "processor time": worked})
    report(options, tables)


if __name__ == "__main__":
    start(VideoStages, run)
