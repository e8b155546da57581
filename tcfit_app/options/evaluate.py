"""The options of `tcfit evaluate`. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from tcfit_app.options.fit import shown


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions:
    """Measure a fit against what is known to be true, or the method against the synthetic suite.

    Prints a table; the --out folder receives metrics.csv, metrics.json and report.html.
    """

    fit: Annotated[Positional[Path | None], arg(metavar="FIT", help_behavior_hint="(or --suite)")] = None
    """A project, or the folder of a result."""
    reference: Annotated[Path | None, shown("PATH", "the project's, if it has one")] = None
    """3D points (npz, or TRC of OpenSim), an AMASS-style npz, the truth.npz of a generated clip, or another fit.npz."""
    camera: Annotated[Path | None, shown("FILE.npz", "none")] = None
    """The clip's camera in the reference's world: R and t, with x_camera = R x + t. Without, only form is compared."""
    reference_first_frame: Annotated[int | None, shown("N", "as it says, or 0")] = None
    """Number in the video of the reference's first frame, where it was cut and does not say so."""
    run: Annotated[str | None, shown("NAME|N", "the latest")] = None
    """Which of a project's runs."""
    suite: bool = False
    """Fit the sequences of the synthetic suite, whose truth is known, and measure these. What is done is kept in
    --out, and not repeated with the same settings."""
    ablations: bool = False
    """With --suite: vary window size, shape sample and temporal weight of the last of --presets, one at a time."""
    level: Annotated[str, arg(metavar="{clean,normal,hard}")] = "normal"
    """How hard the suite's detections are."""
    presets: Annotated[tuple[str, ...], arg(metavar="PRESET")] = ("smplifyx", "paper", "tcfit")
    """What is compared on the suite; of smplifyx phase 1 alone, which is all that SMPLify-X does."""
    collisions: bool = True
    """Of the presets that have the term of self-collision (smplifyx, paper). It takes 6/7 of their time, and the report
    says when it was left out."""
    sequences: Annotated[tuple[str, ...], shown("NAME", "all")] = ()
    """Of the suite: names like complex_1, or motions like simple."""
    jobs: Annotated[int, arg(metavar="N")] = 1
    """Sequences that are fitted at once."""
    every: Annotated[int, arg(metavar="N")] = 1
    """Measure surfaces in every Nth frame, which is the slow part."""
    pictures: Annotated[int, arg(metavar="N")] = 12
    """Worst frames in the report."""
    out: Annotated[Path | None, shown("DIR", "NAME-evaluation")] = None
    """Folder for tables and report; those that lie there are replaced."""
    models: Annotated[Path | None, shown("DIR", "see tcfit models")] = None
    """Folder with body models, which alone is searched then."""
