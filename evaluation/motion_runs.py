"""The motion suite, fitted and measured; what is done stays in a folder and is not done again."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import torch

from evaluation.suite_runs import fit_key, fit_seconds, fitted_body, keep_fit
from evaluation.synthetic.motion_suite.clips import MotionClipMade, make_motion, motion_sequences
from evaluation.synthetic.motion_suite.depth_figures import DepthRecord, measured
from fitting_core.body.points.positions import joints_in_space
from fitting_core.clips.camera_rule import estimated
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.fused import ready
from fitting_core.io.result_files import read_fit
from fitting_core.measure.records import PHASE_1


@dataclass(frozen=True, kw_only=True)
class MotionTask:
    """One sequence of the motion suite to be fitted in one way."""

    sequence: str
    focal: str
    """The focal length that the fit is given: "true", "default", or "auto" for an estimate from the keypoints."""
    variant: str
    """Name of the way of fitting; its records are named after it."""
    config: FitConfig
    folder: Path
    """Where the fit stays."""


def motions_named(names: Sequence[str], half: str) -> list[str]:
    """Sequences of a half by name or kind of motion; all of it without any.

    Raises:
        InputError: The half has no such sequence or kind.
    """
    own = {name: sequence for name, sequence in motion_sequences().items() if sequence.half == half}
    chosen = [name for name, sequence in own.items() if not names or name in names or sequence.kind in names]
    known = {*own, *(sequence.kind for sequence in own.values())}
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"--sequences: this half has no {unknown[0]}; expected some of {', '.join(sorted(known))}.")
    return chosen


def run_motion(task: MotionTask) -> tuple[DepthRecord, ...]:
    """Phase 1 and the last phase of a fit, measured; it is taken from its folder if it was fitted with the same
    settings before."""
    torch.set_num_threads(1)
    ready.use(threads=1)
    made, body = _made(task), fitted_body()
    key = f"{fit_key(task.config, made.clip, made.truth, body)} {made.clip.camera.focal[0]}"
    keep_fit(task.folder, key, lambda: fit_clip(made.clip, body, task.config), made.clip, body)
    found, seconds = read_fit(task.folder), fit_seconds(task.folder)
    phases = [(f"{task.variant}{PHASE_1}", found.phase1, seconds["phase1"])]
    if found.last_phase > 1:
        phases.append((task.variant, found.params, seconds["total"]))
    return tuple(
        measured(made, joints_in_space(body, params), method=method, seconds=spent) for method, params, spent in phases
    )


def _made(task: MotionTask) -> MotionClipMade:
    """The clip with the focal length that the fit is given."""
    sequence = motion_sequences()[task.sequence]
    if task.focal != "auto":
        return make_motion(sequence, focal=task.focal)
    made = make_motion(sequence, focal="default")
    camera = estimated(made.clip.camera, made.clip.keypoints, made.clip.frame_rate)
    return replace(made, clip=replace(made.clip, camera=camera))


def write_records(path: Path, records: Sequence[DepthRecord], settings: dict[str, str]) -> None:
    """Everything measured, as JSON.

    Raises:
        InputError: It cannot be written.
    """
    content = {"format": "tcfit motion suite 1", "settings": settings, "records": records}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as draft:
            draft.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=0) + b"\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}). Choose another --out.") from error
