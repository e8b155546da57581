"""A result of `tcfit fit` as the clip and the fit that it was written from, to go on with them."""

from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from fitting_core.io.result_files import SUMMARY_NAME, StoredFit, read_fit
from fitting_core.results.fit_result import FitResult, PhaseResult, earlier_size

_MOST_BYTES = 1 << 24


@dataclass(frozen=True, kw_only=True)
class WholeResult:
    """Content of a result's folder."""

    clip: Clip
    """Without silhouettes, and without what a person had said of depths and rotations."""
    fit: FitResult
    """Its first and last phase, without what it was given to begin with."""
    stored: StoredFit
    """The same, as fit.npz has it."""
    summary: dict[str, Any]
    """The content of summary.json."""


class _Summary(msgspec.Struct):
    config: FitConfig
    clip: str = ""
    video: str | None = None
    other_videos: tuple[str | None, ...] = ()
    seconds: dict[str, float] = {}
    objective: dict[str, dict[str, float | None]] = {}
    warnings: tuple[str, ...] = ()
    pose_prior: str = ""


def read_whole_result(folder: Path) -> WholeResult:
    """Read a result's folder.

    Raises:
        InputError: It is missing, damaged, or of an earlier version, which did not keep the keypoints; or its video is
            not where it was.
    """
    stored, about, content = read_fit(folder), *_read_summary(folder / SUMMARY_NAME)
    costs = (stored.phase1_frame_cost, stored.frame_cost)
    if stored.keypoints is None or costs[0] is None or costs[1] is None:
        raise InputError(
            f"{folder}: was written by an earlier version of tcfit, which did not keep the keypoints. Make a project "
            f"of its clip (tcfit new VIDEO --out PROJECT), and import this result: tcfit import PROJECT {folder}"
        )
    clip = Clip(
        keypoints=stored.keypoints,
        camera=stored.camera,
        frame_rate=stored.frame_rate,
        name=about.clip or folder.resolve().name,
        source=_video(folder, about.video),
        first_frame=stored.first_frame,
        detector=stored.detector,
        views=tuple(
            replace(view, clip=replace(view.clip, source=_video(folder, video)))
            for view, video in zip_longest(stored.views, about.other_videos[: len(stored.views)])
        ),
    )
    fit = FitResult(
        phases=_phases(stored, about, costs[0], costs[1]),
        camera=stored.camera,
        config=about.config,
        observed=stored.observed,
        warnings=about.warnings,
        pose_prior=about.pose_prior,
        grounding=stored.grounding,
        size=stored.size or earlier_size(about.config),
    )
    return WholeResult(clip=clip, fit=fit, stored=stored, summary=content)


def _read_summary(path: Path) -> tuple[_Summary, dict[str, Any]]:
    try:
        content = regular_file(path, most=_MOST_BYTES).read_bytes()
        return msgspec.json.decode(content, type=_Summary), msgspec.json.decode(content, type=dict[str, Any])
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read ({error}). Fit the clip again.") from error


def _video(folder: Path, relative: str | None) -> Path | None:
    if relative is None:
        return None
    try:
        path = (folder / relative).resolve()
        exists = path.exists()
    except (OSError, ValueError) as error:  # a path of 100,000 characters, or with a zero byte
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(
            f"{folder / SUMMARY_NAME}: the path of a video is not a path of this computer ({reason}). Write there "
            "where the video is now."
        ) from error
    if not exists:
        raise InputError(
            f"{path}: is not there, and is a video of the result {folder}. Move it back, or write in the result's "
            f"{SUMMARY_NAME} where it is now."
        )
    return path


def _phases(
    stored: StoredFit, about: _Summary, first_cost: Float[np.ndarray, "T"], last_cost: Float[np.ndarray, "T"]
) -> tuple[PhaseResult, ...]:
    def phase(number: int, params: BodyParams, frame_cost: Float[np.ndarray, "T"]) -> PhaseResult:
        known = about.objective.get(f"phase{number}", {})
        return PhaseResult(
            phase=number,
            params=params,
            objective={term: np.nan if cost is None else cost for term, cost in known.items()},
            frame_cost=frame_cost,
            seconds=about.seconds.get(f"phase{number}", 0.0),
        )

    last = phase(stored.last_phase, stored.params, last_cost)
    last = replace(last, provenance=stored.provenance, error_bars=stored.error_bars)
    return (last,) if stored.last_phase == 1 else (phase(1, stored.phase1, first_cost), last)
