"""How right gravity, contacts of the feet and the floor are, on the motion suite, before a fit and after it.

Contacts count where a foot is in the image; their truth is that the captured foot rests. The floor's error is that of
the pelvis' height above it. Of fits it is also measured how far feet slide while they stand, and how far soles are off
the floor.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.distance import pdist
from tyro.conf import OmitArgPrefixes, arg

from benchmarks.report import Common, Row, progress, report, start
from evaluation.suite_runs import fitted_body
from evaluation.synthetic.motion_suite.clips import MotionClipMade, make_motion, motion_sequences
from fitting_core.body.model import JOINT
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS
from fitting_core.fit.evidence.observations import LifterEvidence
from fitting_core.fit.grounded import grounding_of_params
from fitting_core.fit.stages import Stages
from fitting_core.frame_runs import runs_where
from fitting_core.ground.feet import sole_heights, stance_of
from fitting_core.ground.gravity import angles_to, robust_mean
from fitting_core.ground.grounding import Grounding
from fitting_core.ground.placing import pelvis_positions
from fitting_core.ground.plane import lowest
from fitting_core.io.result_files import read_fit
from tests.samples.before_fit import grounding_before_fit

_UP = np.array([0.0, 1.0, 0.0])
_SHORTEST = 0.1
"""Seconds of a contact that is judged."""


@dataclass(frozen=True, kw_only=True)
class GroundOptions:
    """What to measure."""

    half: Literal["tuning", "untouched"] = "tuning"
    focal: Literal["true", "default"] = "true"
    fits: Annotated[Path | None, arg(metavar="FOLDER")] = None
    """Fits of `python -m evaluation motion`: its folder fits/<focal>/<preset>. Without it, only what is known before
    a fit is measured."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """One sequence, in one way."""

    way: str
    cut: str
    up_error: float
    """Degrees."""
    said: float
    """Degrees of standard deviation."""
    found: Bool[np.ndarray, "n"]
    """Feet in the image: whether they are said to stand."""
    true: Bool[np.ndarray, "n"]
    height_error: float
    """Of the pelvis above the floor, millimetres, with its sign; NaN where no floor was found."""


@dataclass(frozen=True, kw_only=True)
class Stance:
    """A foot of a fit that stands for some frames."""

    kind: str
    """Of motion."""
    of: str
    """Whether the fit or the truth says that it stands."""
    slide: float
    """Largest distance between two places of its ankle in that time, millimetres."""
    seconds: float
    off_floor: float
    """Median distance of its sole from the floor, millimetres; NaN where no floor was found."""


def run(options: GroundOptions) -> None:
    """Measures, and prints the tables."""
    measured: list[Measured] = []
    stances: list[Stance] = []
    for name, sequence in motion_sequences().items():
        if sequence.half == options.half:
            progress(name)
            made = make_motion(sequence, focal=options.focal)
            measured += _of_sequence(made, options.fits)
            stances += [] if options.fits is None else _stances(made, options.fits)
    cuts = {"whole body in the image": ("whole",), "all": ("whole", "knee", "hip", "chest")}
    rows = {
        title: [_row(way, [m for m in measured if m.way == way and m.cut in cut]) for way in _ways(measured)]
        for title, cut in cuts.items()
    }
    report(options, rows | ({"Feet that stand": _stance_rows(stances)} if stances else {}))


def _stances(made: MotionClipMade, fits: Path) -> list[Stance]:
    clip, stored, body = made.clip, read_fit(fits / made.sequence.name), fitted_body()
    grounding = grounding_of_params(Stages.of_clip(clip, body, PRESETS[DEFAULT_PRESET]), stored.params)
    assert grounding is not None, "the free body has feet"
    feet = stance_of(body, stored.params).feet
    soles = sole_heights(body, stored.params.betas.mean(0).numpy())
    off = np.full(feet.shape[:2], np.nan)
    if grounding.ground is not None:
        off = 1e3 * abs(lowest(feet, soles, grounding.ground.normal) + grounding.ground.offset)
    standing = {"fit": grounding.contacts.standing, "truth": made.window.standing & grounding.contacts.seen}
    return [
        Stance(
            kind=made.sequence.kind,
            of=of,
            slide=1e3 * float(pdist(feet[run, foot, 0]).max()),
            seconds=len(run) / clip.frame_rate,
            off_floor=float(np.median(off[run, foot])),
        )
        for of, stands in standing.items()
        for foot in range(2)
        for run in runs_where(stands[:, foot])
        if len(run) >= _SHORTEST * clip.frame_rate
    ]


def _stance_rows(stances: Sequence[Stance]) -> list[Row]:
    kinds = ["all", *dict.fromkeys(stance.kind for stance in stances)]
    return [
        _stance_row(f"{kind}, where the {of} says so", [s for s in stances if s.of == of and kind in (s.kind, "all")])
        for kind in kinds
        for of in ("fit", "truth")
    ]


def _stance_row(title: str, stances: Sequence[Stance]) -> Row:
    slides, off = np.array([s.slide for s in stances]), np.array([s.off_floor for s in stances])
    off = off[np.isfinite(off)]
    return {
        "": title,
        "contacts": str(len(stances)),
        "seconds": sum(s.seconds for s in stances),
        "slide, median mm": float(np.median(slides)) if len(slides) else None,
        "90 % mm": float(np.percentile(slides, 90)) if len(slides) else None,
        "under 1 cm %": float(100 * (slides < 10).mean()) if len(slides) else None,
        "off the floor, median mm": float(np.median(off)) if len(off) else None,
        "within 2 cm %": float(100 * (off < 20).mean()) if len(off) else None,
    }


def _ways(measured: Sequence[Measured]) -> list[str]:
    return list(dict.fromkeys(m.way for m in measured))


def _of_sequence(made: MotionClipMade, fits: Path | None) -> list[Measured]:
    clip = made.clip
    xy, camera, rate = clip.keypoints.xy, clip.camera, clip.frame_rate
    lifter = LifterEvidence(clip.keypoints, camera, rate)
    lifted, confidence = lifter.lifted, lifter.confidence
    before = grounding_before_fit(xy, confidence, lifted, camera, rate, rolled=lifter.rolled)
    pelvis = pelvis_positions(xy, confidence, lifted, camera, rate)
    alone = lifted.contact[before.contacts.seen] > 0.5
    lifted_only = _measured("the lifter alone", made, before, pelvis, alone)
    trunk = lifted.points[:, 1]
    found = [lifted_only, _measured("before a fit", made, before, pelvis)]
    if fits is not None:
        stored, body = read_fit(fits / made.sequence.name), fitted_body()
        after = grounding_of_params(Stages.of_clip(clip, body, PRESETS[DEFAULT_PRESET]), stored.params)
        assert after is not None, "the free body has feet"
        found.append(_measured("after a fit", made, after, stored.joints[:, JOINT["pelvis"]]))
        trunk = stored.joints[:, JOINT["neck"]] - stored.joints[:, JOINT["pelvis"]]
    leans = robust_mean(trunk, np.ones(len(trunk)))
    return [*found, _up_only("the trunk's direction for up", made, leans)]


def _measured(
    way: str,
    made: MotionClipMade,
    grounding: Grounding,
    pelvis: Float[np.ndarray, "T 3"],
    stands: Bool[np.ndarray, "n"] | None = None,
) -> Measured:
    contacts, view = grounding.contacts, made.view.pose()
    true = (made.truth.joints[:, JOINT["pelvis"]] - view.translation) @ view.rotation @ _UP
    error = np.nan if grounding.ground is None else 1e3 * float(np.median(grounding.ground.height(pelvis) - true))
    return Measured(
        way=way,
        cut=made.sequence.shot.cut,
        up_error=_up_error(made, grounding.gravity.up),
        said=grounding.gravity.deviation,
        found=contacts.standing[contacts.seen] if stands is None else stands,
        true=made.window.standing[contacts.seen],
        height_error=error,
    )


def _up_only(way: str, made: MotionClipMade, up: Float[np.ndarray, "3"]) -> Measured:
    none = np.zeros(0, bool)
    return Measured(
        way=way,
        cut=made.sequence.shot.cut,
        up_error=_up_error(made, up),
        said=np.nan,
        found=none,
        true=none,
        height_error=np.nan,
    )


def _up_error(made: MotionClipMade, up: Float[np.ndarray, "3"]) -> float:
    return float(angles_to(made.view.pose().rotation @ _UP, up))


def _row(way: str, measured: Sequence[Measured]) -> Row:
    errors = np.array([m.up_error for m in measured])
    found, true = (np.concatenate([getattr(m, name) for m in measured]) for name in ("found", "true"))
    heights = abs(np.array([m.height_error for m in measured if np.isfinite(m.height_error)]))
    row: dict[str, str | float | None] = {
        "": way,
        "gravity, median °": float(np.median(errors)),
        "90 % °": float(np.percentile(errors, 90)),
        "root mean square °": float(np.sqrt(np.mean(errors**2))),
        "said °": float(np.sqrt(np.mean([m.said**2 for m in measured]))) if np.isfinite(measured[0].said) else None,
    }
    if len(found):
        both = (found & true).sum()
        row |= {
            "contacts: precision": both / max(found.sum(), 1),
            "recall": both / max(true.sum(), 1),
            "F1": 2 * both / max(found.sum() + true.sum(), 1),
            "floors": f"{len(heights)} of {len(measured)}",
            "pelvis above it, median mm": float(np.median(heights)),
            "90 % mm": float(np.percentile(heights, 90)),
        }
    return row


if __name__ == "__main__":
    start(GroundOptions, run)
