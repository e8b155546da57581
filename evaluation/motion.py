"""`python -m evaluation motion`: how right fits are in the third dimension, on captured motion from all sides."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import msgspec
import torch

from evaluation.options import MotionOptions
from evaluation.suite_runs import PHASE_1, done_tasks, fit_key, fit_seconds, fitted_body, keep_fit
from evaluation.synthetic.motion_suite.clips import make_motion, motion_sequences
from evaluation.synthetic.motion_suite.depth_figures import (
    DEPTH_CURVES,
    GROUPINGS,
    PART_CURVES,
    DepthRecord,
    depth_figures,
    measured,
    titled,
)
from fitting_core.body.points.positions import joints_in_space
from fitting_core.config.schema import DEFAULT_PRESET, FitConfig, without_collisions
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.fused import ready
from fitting_core.io.result_files import read_fit
from tcfit_app.options.fit import MethodOptions, fit_config
from tcfit_app.options.preparing import compile_kernels


@dataclass(frozen=True, kw_only=True)
class MotionTask:
    """One sequence of the motion suite to be fitted in one way."""

    sequence: str
    focal: str
    """The focal length that the fit is given: one of FOCALS."""
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
    made = make_motion(motion_sequences()[task.sequence], focal=task.focal)
    body = fitted_body()
    key = f"{fit_key(task.config, made.clip, made.truth, body)} {made.clip.camera.focal[0]}"
    keep_fit(task.folder, key, lambda: fit_clip(made.clip, body, task.config), made.clip, body)
    found, seconds = read_fit(task.folder), fit_seconds(task.folder)
    phases = [(f"{task.variant}{PHASE_1}", found.phase1, seconds["phase1"])]
    if found.last_phase > 1:
        phases.append((task.variant, found.params, seconds["total"]))
    return tuple(
        measured(made, joints_in_space(body, params), method=method, seconds=spent) for method, params, spent in phases
    )


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


JSON_NAME, TABLES_NAME = "motion.json", "motion.md"
_TOLD = "MPJPE, mm"
"""The figure that is printed for each finished fit."""
Rows = dict[str, dict[str, float | None]]


def run(options: MotionOptions, command: str) -> None:
    """Fit and measure a half of the motion suite; print tables and write the files.

    Raises:
        InputError: Options cannot be used, or the folder cannot be written.
    """
    folder = options.out or Path("tcfit-motion-suite")
    names = motions_named(options.sequences, options.half)
    presets = options.presets or (DEFAULT_PRESET,)
    configs = {preset: _config(preset, options) for preset in presets}
    compile_kernels(configs[presets[-1]])
    label = "-".join(text.replace("=", "_") for text in options.set)
    tasks = [
        MotionTask(
            sequence=name,
            focal=options.focal,
            variant=preset,
            config=config,
            folder=folder / "fits" / options.focal / "-".join(filter(None, (preset, _file_name(label)))) / name,
        )
        for name in names
        for preset, config in configs.items()
    ]
    records = _done(tasks, options.jobs)
    settings = {"Command": command, "Half": options.half, "Focal length": options.focal, "Date": f"{date.today()}"}
    write_records(folder / JSON_NAME, records, settings)
    methods = list(dict.fromkeys(record.method for record in records))
    tables = {method: _tables([record for record in records if record.method == method]) for method in methods}
    text = _markdown(tables, settings)
    with replacing(folder / TABLES_NAME) as draft:
        draft.write_text(text)
    print(text)
    print(f"Wrote {JSON_NAME} and {TABLES_NAME} into {folder}")


def _config(preset: str, options: MotionOptions) -> FitConfig:
    config = fit_config(MethodOptions(preset=preset, set=options.set))
    config = config if options.collisions else without_collisions(config)
    return replace(config, last_phase=1) if preset == "smplifyx" else config


def _file_name(text: str) -> str:
    return "".join(c if c.isalnum() or c in "-_.," else "-" for c in text)[:100]


def _done(tasks: Sequence[MotionTask], jobs: int) -> list[DepthRecord]:
    found: dict[Path, tuple[DepthRecord, ...]] = {}
    for task, records in done_tasks(run_motion, tasks, jobs=jobs):
        found[task.folder] = records
        value = depth_figures(records[-1:], "")["all"][_TOLD]
        line = f"{task.sequence}, {task.variant}: {_TOLD.replace(',', f' {_number(value, 1)}')}"
        print(f"{len(found)} of {len(tasks)}: {line}", file=sys.stderr, flush=True)
    return [record for task in tasks for record in found[task.folder]]


def _tables(records: Sequence[DepthRecord]) -> dict[str, Rows]:
    """By title: rows by label."""
    rows: Rows = {}
    for grouping in GROUPINGS:
        rows |= {_row(grouping, label): own for label, own in depth_figures(records, grouping).items()}
    parts: Rows = {}
    for grouping in ("", "view"):
        parts |= {_row(grouping, label): own for label, own in depth_figures(records, grouping, PART_CURVES).items()}
    return {"figures over all frames": rows, "errors of the limb joints in the image, hips aligned": parts}


def _row(grouping: str, label: str) -> str:
    return f"{grouping}: {label}" if grouping else label


_DIGITS = {titled(curve, s): curve.digits for curve in (DEPTH_CURVES | PART_CURVES).values() for s in curve.statistics}


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _cells(row: dict[str, float | None]) -> list[str]:
    return [_number(value, _DIGITS[title]) for title, value in row.items()]


def _markdown(tables: dict[str, dict[str, Rows]], settings: dict[str, str]) -> str:
    lines = [f"- {name}: {value}" for name, value in settings.items()]
    for method, own in tables.items():
        for title, rows in own.items():
            head = next(iter(rows.values()))
            lines += ["", f"{method}: {title}", "", f"| | {' | '.join(head)} |", "|---" * (len(head) + 1) + "|"]
            lines += [f"| {label} | {' | '.join(_cells(row))} |" for label, row in rows.items()]
    return "\n".join(lines) + "\n"
