"""The options of `python -m evaluation`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import UseAppendAction, arg

from tcfit_app.options.fit import shown


@dataclass(frozen=True, kw_only=True)
class SuiteOptions:
    """What is fitted of a suite, and where it is kept."""

    presets: Annotated[tuple[str, ...], shown("PRESET", "smplifyx paper tcfit; on the motion suite tcfit")] = ()
    """What is compared; of smplifyx phase 1 alone, which is all that SMPLify-X does."""
    collisions: bool = True
    """Of the presets that have the term of self-collision (smplifyx, paper). It takes 6/7 of their time."""
    sequences: Annotated[tuple[str, ...], shown("NAME", "all")] = ()
    """Names like complex_1, or motions like simple or dance."""
    jobs: Annotated[int, arg(metavar="N")] = 1
    """Sequences that are fitted at once."""
    out: Annotated[Path | None, shown("DIR", "tcfit-suite or tcfit-motion-suite")] = None
    """Folder for fits and figures. What is done stays there, and is not repeated with the same settings."""


@dataclass(frozen=True, kw_only=True)
class ActedOptions(SuiteOptions):
    """Fit and measure the synthetic suite: metrics.csv, metrics.json and, with tcfit[report], report.html."""

    every: Annotated[int, arg(metavar="N")] = 1
    """Measure surfaces in every Nth frame, which is the slow part."""


@dataclass(frozen=True, kw_only=True)
class MotionOptions(SuiteOptions):
    """Fit and measure captured motion from all sides, for depth: motion.json and motion.md."""

    half: Literal["tuning", "untouched"] = "tuning"
    """Settle on a method with the tuning half; look at the untouched one when it is settled."""
    focal: Literal["true", "default"] = "true"
    """The focal length that fits are given: the camera's own, or the image's diagonal."""
    set: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=VALUE", help_behavior_hint="(repeatable)")] = ()
    """A setting of all --presets, as for tcfit fit."""


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """Make the demo clip that comes with tcfit."""

    out: Annotated[Path | None, shown("DIR", "assets/demo")] = None
    """Folder that its files are written into."""
