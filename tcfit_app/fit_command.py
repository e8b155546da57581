"""`tcfit fit`: read a clip, fit it, write the result."""

import dataclasses
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import torch

from fitting_core.body.files import load_body
from fitting_core.body.model import BodyModel
from fitting_core.body.registry import find_body
from fitting_core.clip import Clip
from fitting_core.config import FitConfig
from fitting_core.errors import InputError
from fitting_core.events import PhaseFinished
from fitting_core.fitting import fit_events
from fitting_core.io.result_files import FIT_NAME, OVERLAY_NAME, SUMMARY_NAME, is_result, write_result
from fitting_core.result import FitResult
from tcfit_app.clip_input import clip_of, described, notes_of
from tcfit_app.options import BodyOptions, FitOptions, fit_config
from tcfit_app.overlay_video import write_comparison
from tcfit_app.progress import Progress


@dataclasses.dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a fit left behind."""

    fit: FitResult
    body: BodyModel
    summary: dict[str, Any]


def run_fit(options: FitOptions, *, command: str = "") -> Outcome:
    """Fit as the options say, write the result and say on the standard output where it is.

    Args:
        options: The command line.
        command: The same as text, for the record.

    Raises:
        InputError: Files or options cannot be used; nothing has been written then.
        KeyboardInterrupt: Cancelled; the phases that had finished have been written.
    """
    config = fit_config(options.method)
    check_out(options.out, overwrite=options.overwrite)
    prepare_torch(config, options.threads)
    body = load_body(body_file(options.body))
    clip = clip_of(options)
    _tell(_inputs(clip, body))
    fit, summary = _fit_and_write(clip, body, config, options.out, command)
    _tell(f"Note: {warning}" for warning in fit.warnings[len(clip.notes) :])
    written = [FIT_NAME, SUMMARY_NAME]
    if options.overlay and _overlay_written(options.out / OVERLAY_NAME, fit, clip, body):
        written.append(OVERLAY_NAME)
    print("\n".join([*report(summary), f"Wrote {', '.join(written)} into {options.out}"]))
    return Outcome(fit=fit, body=body, summary=summary)


def check_out(folder: Path, *, overwrite: bool) -> None:
    """Refuse to write among files that are not tcfit's.

    Raises:
        InputError: The folder is a file, cannot be written, or holds something other than a result and `overwrite` is
            not given.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; expected a folder, which may not exist yet.")
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not os.access(there, os.W_OK):
        raise InputError(
            f"--out {folder}: cannot be written, for {there} is read-only. Allow writing, or choose another."
        )
    if overwrite or is_result(folder) or not folder.exists() or not any(folder.iterdir()):
        return
    names = sorted(entry.name for entry in folder.iterdir())
    some = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
    raise InputError(
        f"--out {folder}: holds files that are no result of tcfit ({some}). "
        "Choose another folder, or give --overwrite to write the result among them."
    )


def prepare_torch(config: FitConfig, threads: int | None) -> None:
    """Set torch's threads, and check that the device works.

    Raises:
        InputError: The device is not there.
    """
    if threads is not None:
        if threads < 1:
            raise InputError(f"--threads is {threads}; expected 1 or more, up to the number of cores.")
        torch.set_num_threads(threads)
    try:
        torch.zeros(1, device=config.device, dtype=getattr(torch, config.precision))
    except (RuntimeError, AssertionError, TypeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"--device {config.device} cannot be used with {config.precision} ({reason}). Use --device cpu; "
            "`tcfit doctor` shows the devices that torch finds."
        ) from error


def body_file(options: BodyOptions) -> Path:
    """The body model's file.

    Raises:
        InputError: There is none, or --body-model is a path and --models is given too.
    """
    given = Path(options.body_model).expanduser()
    if not (given.suffix or given.exists() or len(given.parts) > 1):
        return find_body(model=options.body_model, gender=options.gender, search=options.models)
    if options.models is not None:
        raise InputError(
            f"--body-model {given} is a file and --models {options.models} a folder to search: give one of them."
        )
    return find_body(gender=options.gender, search=given)


def _fit_and_write(
    clip: Clip, body: BodyModel, config: FitConfig, folder: Path, command: str
) -> tuple[FitResult, dict[str, Any]]:
    """Run all phases; after each, what is finished is on the disk."""
    finished: PhaseFinished | None = None
    summary: dict[str, Any] = {}
    try:
        with Progress() as progress:
            for event in fit_events(clip, body, config):
                progress.show(event)
                if isinstance(event, PhaseFinished):
                    complete = event.phase == config.last_phase
                    summary = write_result(folder, event.so_far, clip, body, complete=complete, command=command)
                    finished = event
    except BaseException:
        _tell([_what_stayed(finished, folder)])
        raise
    assert finished is not None
    return finished.so_far, summary


def _what_stayed(finished: PhaseFinished | None, folder: Path) -> str:
    if finished is None:
        return "Stopped before phase 1 had finished; nothing was written."
    return f"Stopped; the result up to phase {finished.phase} is in {folder}"


def _overlay_written(path: Path, fit: FitResult, clip: Clip, body: BodyModel) -> bool:
    try:
        write_comparison(path, fit, clip, body)
    except (InputError, OSError) as error:
        _tell([f"No {path.name} was written, but the fit is complete. {error}"])
        return False
    return True


def _inputs(clip: Clip, body: BodyModel) -> list[str]:
    """What is fitted, for the user."""
    source = body.source.name if body.source else body.kind
    return [*described(clip), f"Body {source} ({body.gender})", *notes_of(clip)]


def report(summary: dict[str, Any]) -> list[str]:
    """The main figures as lines of a table."""
    lines = [f"{'':9}{'reprojection px':>18}{'95 %':>8}{'jitter mm/frame²':>19}{'seconds':>10}"]
    for phase, error in summary["reprojection_px"].items():
        median, p95 = ("-" if e is None else f"{e:.1f}" for e in (error["median"], error["p95"]))
        jitter = summary["jitter"][phase]["camera_space_mm_per_frame2"]
        title = f"{phase[:-1]} {phase[-1]}"
        lines.append(f"{title:9}{median:>18}{p95:>8}{jitter:>19.1f}{summary['seconds'][phase]:>10.1f}")
    return lines


def _tell(lines: Iterable[str]) -> None:
    for line in lines:
        print(line, file=sys.stderr, flush=True)
