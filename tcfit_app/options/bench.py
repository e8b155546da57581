"""The options of `tcfit bench`. Imports nothing heavy."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, UseAppendAction

from fitting_core.clips.options import CameraOptions, ClipOptions
from tcfit_app.options.fit import BodyOptions, MethodOptions, shown

Part = Literal["fit", "solver", "window", "live"]
Clock = Literal["wall", "cpu"]


@dataclass(frozen=True, kw_only=True)
class BenchOptions:
    """Measure how fast fits are on this computer, on the demo clip's keypoints or your own.

    Parts: fit (each phase at growing lengths, and memory), solver (Levenberg-Marquardt against L-BFGS from one start),
    window (phase 3 by size of the sliding window), live (the latency of a correction by hand). Whatever is measured
    takes turns, so that what slows the computer down for a while hits all of it. Of all figures less is better.
    """

    video: Annotated[Positional[Path | None], shown("VIDEO", "the demo")] = None
    """A clip as for `tcfit fit`; only its keypoints are fitted."""
    keypoints: Annotated[Path | None, shown("PATH", "the demo's")] = None
    """Its keypoints."""
    quick: bool = False
    """Less of everything, without L-BFGS: a look, not a figure to keep."""
    parts: tuple[Part, ...] = ("fit", "solver", "window", "live")
    """What to measure."""
    compare: Annotated[UseAppendAction[tuple[str, ...]], shown("KEY=A,B", "measure the parts")] = ()
    """Instead of the parts, fit the clip with each of these values, in turns: solver=lm,lbfgs, window=7,global,
    threads=1,2, preset=paper,tcfit, or any setting of `tcfit settings`. Given twice: every combination."""
    against: Annotated[Path | None, shown("FILE.json", "nothing")] = None
    """Also say how the figures compare with those of an earlier run."""
    json: Annotated[Path | None, shown("FILE.json", "not written")] = None
    """Write machine, versions, options and every figure."""
    lengths: Annotated[tuple[int, ...] | None, shown("N [N ...]", "16 32 64; quick: 6 12")] = None
    """Frames: the clip's first ones, as many as the shortest length has, played forwards and backwards."""
    repeats: Annotated[int | None, shown("N", "3; quick: 2")] = None
    """Times that everything is measured; the median is shown, and the range."""
    clock: Clock = "wall"
    """The wall's clock, or the time of the processor, which other programs disturb less."""
    threads: int = 1
    """Threads on which the frames of a fit are shared out."""
    clip: ClipOptions = field(default_factory=ClipOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    body: BodyOptions = field(default_factory=BodyOptions)
    method: MethodOptions = field(default_factory=MethodOptions)
