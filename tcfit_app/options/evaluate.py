"""The options of `tcfit evaluate`. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, UseAppendAction, arg
from tyro.constructors import PrimitiveConstructorSpec

from tcfit_app.options.fit import JsonLines, ModelsFolder, shown

SUITES = ("acted", "motion")
"""The first is meant where --suite stands alone."""


def _suite_option() -> PrimitiveConstructorSpec[str | None]:
    """A name that may be left out behind --suite."""
    return PrimitiveConstructorSpec(
        nargs=(0, 1),
        metavar="[{" + ",".join(SUITES) + "}]",
        instance_from_str=lambda given: given[0] if given else SUITES[0],
        is_instance=lambda value: value is None or isinstance(value, str),
        str_from_instance=lambda value: [] if value is None else [value],
        choices=SUITES,
    )


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions:
    """Measure a fit against what is known to be true, or the method against the synthetic suite.

    Prints a table; the --out folder receives metrics.csv, metrics.json and report.html; with --suite
    motion, motion.json and motion.md.
    """

    fit: Annotated[Positional[Path | None], arg(metavar="FIT", help_behavior_hint="(or --suite)")] = None
    """A project, or a result: a folder or a fit.npz of tcfit, or what another program wrote, as for tcfit import."""
    reference: Annotated[Path | None, shown("PATH", "the project's, if it has one")] = None
    """3D points (npz, TRC, C3D), an AMASS-style npz, the truth.npz of a generated clip, or another fit.npz."""
    camera: Annotated[Path | None, shown("FILE.npz", "as the clip's camera is calibrated")] = None
    """The clip's camera in the reference's world: R and t, with x_camera = R x + t. Without, only form is compared."""
    reference_first_frame: Annotated[int | None, shown("N", "as it says, or 0")] = None
    """Number in the video of the reference's first frame, where it was cut and does not say so."""
    reference_offset: Annotated[str | None, shown("SECONDS|auto", "none")] = None
    """Second of the video at which the reference's first frame was taken, below 0 if that was before. auto: found by
    the movement of both, where their clocks differ."""
    markers: Annotated[Path | None, shown("FILE", "by their names")] = None
    """What the points of a TRC or C3D reference are: a TOML or JSON file of their names and vertices of the body's
    mesh, markers of the standard set, or joints."""
    run: Annotated[str | None, shown("NAME|N", "the latest")] = None
    """Which of a project's runs."""
    person: Annotated[int | None, shown("N", "who is in most frames; of SMPLify-X 0")] = None
    """Of several people in another program's result, as it numbers them."""
    body_model: Annotated[str | None, shown("{smplx,smplh,smpl}", "the result's")] = None
    """Another kind of body to pose with another program's result: joint angles are kept, the shape is not."""
    frame_rate: Annotated[float | None, shown("FPS", "as it says, the reference's, or 30")] = None
    """Frames per second of another program's result, which hardly any of them tells."""
    suite: Annotated[str | None, _suite_option(), arg(help_behavior_hint="(default: none; alone: acted)")] = None
    """Fit the sequences of a suite, whose truth is known, and measure these. What is done is kept in --out, and not
    repeated with the same settings. acted: the synthetic suite; motion: captured motion from all sides, for depth."""
    ablations: bool = False
    """With --suite: vary window size, shape sample and temporal weight of the last of --presets, one at a time."""
    level: Annotated[str, arg(metavar="{clean,normal,hard}")] = "normal"
    """How hard the suite's detections are."""
    presets: Annotated[tuple[str, ...], shown("PRESET", "smplifyx paper tcfit; on the motion suite tcfit")] = ()
    """What is compared on the suite; of smplifyx phase 1 alone, which is all that SMPLify-X does."""
    collisions: bool = True
    """Of the presets that have the term of self-collision (smplifyx, paper). It takes 6/7 of their time, and the report
    says when it was left out."""
    sequences: Annotated[tuple[str, ...], shown("NAME", "all")] = ()
    """Of the suite: names like complex_1, or motions like simple or dance."""
    jobs: Annotated[int, arg(metavar="N")] = 1
    """Sequences that are fitted at once."""
    half: Literal["tuning", "untouched"] = "tuning"
    """Of the motion suite. Settle on a method with the tuning half; look at the untouched one when it is settled."""
    focal: Literal["true", "default", "auto"] = "true"
    """Of the motion suite: the focal length that fits are given, the camera's own, the image's diagonal, or an
    estimate from the keypoints."""
    set: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=VALUE", help_behavior_hint="(repeatable)")] = ()
    """Of the motion suite: a setting of all --presets, as for tcfit fit."""
    every: Annotated[int, arg(metavar="N")] = 1
    """Measure surfaces in every Nth frame, which is the slow part."""
    pictures: Annotated[int, arg(metavar="N")] = 12
    """Worst frames in the report."""
    out: Annotated[Path | None, shown("DIR", "NAME-evaluation")] = None
    """Folder for tables and report; those that lie there are replaced."""
    json: JsonLines = False
    models: ModelsFolder = None
