"""`tcfit fit`: read a clip, fit it, write the result; with --people all, one for each person."""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from fitting_core.body.files.reading import load_body
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.clips.people import PersonInClip, people_of
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError, printable
from fitting_core.files.atomic import sweep
from fitting_core.fit.events import Finished, FitEvent, PhaseFinished
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.fused import ready
from fitting_core.io.people_file import PEOPLE_NAME, holds_people, read_people_file, write_people_file
from fitting_core.io.result_files import FIT_NAME, OVERLAY_NAME, RESULT_NAMES, SUMMARY_NAME, is_result, write_result
from fitting_core.keypoints import ERROR_GROUPS
from fitting_core.results.fit_result import FitResult
from fitting_core.results.given_start import GivenStart, KnownShape
from tcfit_app.cli.json_lines import Note, Step, StepDone, emit, emit_figures, emit_wrote, share_reporter
from tcfit_app.cli.progress import DetectionShown, ProgressShown
from tcfit_app.exports.pictures import write_comparison
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.jobs import warm_up
from tcfit_app.imports.given import read_shape, start_of
from tcfit_app.options.clip_input import all_people_of, clip_of, described, notes_of, with_views
from tcfit_app.options.fit import FitOptions, StartOptions, fit_config
from tcfit_app.options.preparing import body_file, check_out, compile_kernels, prepare_solver


def run_fit(options: FitOptions, *, command: str = "") -> None:
    """Fit, write the result, and print its folder.

    Raises:
        InputError: Files or options cannot be used. Nothing is written then.
        KeyboardInterrupt: Cancelled. Finished phases are written.
    """
    config = fit_config(options.method)
    if options.shape is not None and config.height is not None:
        raise InputError("--shape cannot be combined with --height: a known shape has its own height.")
    check_out(options.out, overwrite=options.overwrite)
    body = prepared_body(options, config)
    shape = None if options.shape is None else read_shape(options.shape, body)
    with _loading(body, config), DetectionShown() as tell_progress:
        clip = with_views(clip_of(options, tell_progress), options, tell_progress)
    start = start_of(options.begin, clip, body, Bodies(options.body.models))
    compile_kernels(config)
    fit_into(options.out, clip, body, config, options, start=start, shape=shape, command=command)


def prepared_body(options: FitOptions, config: FitConfig) -> BodyModel:
    """Prepare threads and device, and read the body. Raises InputError if the body is missing or the device does not
    work."""
    prepare_solver(config, options.threads)
    return load_body(body_file(options.body))


@contextmanager
def _loading(body: BodyModel, config: FitConfig) -> Iterator[None]:
    """Load what the fit needs at the same time; kernels that are not compiled wait until the clip can be fitted."""
    with ThreadPoolExecutor(1, "tcfit: loading") as thread:
        if not ready.problem():
            thread.submit(warm_up, body, config)
        yield


def fit_into(
    folder: Path,
    clip: Clip,
    body: BodyModel,
    config: FitConfig,
    options: FitOptions,
    *,
    start: GivenStart | None = None,
    shape: KnownShape | None = None,
    command: str = "",
    begins: Callable[[], None] = lambda: None,
) -> None:
    """Fit a clip, write the result into a folder, and print the folder and the main figures.

    Args:
        begins: Called once, before the first phase that has finished is written.

    Raises:
        InputError: The folder cannot be written.
        KeyboardInterrupt: Cancelled; the phases that had finished have been written.
    """
    tell(_inputs(clip, body))
    if start is not None:
        tell([start.about.sentence()])
    run = partial(fit_clip, clip, body, config, start=start, shape=shape)
    last = config.last_phase
    fit, summary = _fit_and_write(run, clip, body, folder, last_phase=last, command=command, begins=begins)
    tell(f"Note: {warning}" for warning in fit.warnings[len(clip.notes) + len(clip.views) :])
    written = [FIT_NAME, SUMMARY_NAME]
    if options.overlay and _overlay_written(folder / OVERLAY_NAME, fit, clip, body):
        written.append(OVERLAY_NAME)
    _emit_result(folder, clip, fit, summary, written)
    print(printable("\n".join([*report(summary), f"Wrote {', '.join(written)} into {folder}"])))


def _fit_and_write(
    run: Callable[..., object],
    clip: Clip,
    body: BodyModel,
    folder: Path,
    *,
    last_phase: int,
    command: str,
    begins: Callable[[], None],
) -> tuple[FitResult, dict[str, Any]]:
    """Run all phases, and write the result after each; that of the last is the end's, which has error bars."""
    finished: FitResult | None = None
    summary: dict[str, Any] = {}
    progress = ProgressShown(range(1, last_phase + 1))

    def take(event: FitEvent) -> None:
        progress.show(event)
        if isinstance(event, Finished):
            write(event.result, complete=True)
        elif isinstance(event, PhaseFinished) and event.phase < last_phase:
            write(event.so_far, complete=False)

    def write(fit: FitResult, *, complete: bool) -> None:
        nonlocal finished, summary
        if finished is None:
            begins()
        summary = write_result(folder, fit, clip, body, complete=complete, command=command)
        finished = fit

    try:
        with closing(progress):
            run(tell=take)
    except BaseException:
        message = "Stopped before phase 1 had finished. Nothing was written."
        if finished is not None:
            message = f"Stopped. The result up to phase {finished.last.phase} is in {folder}"
        tell([message])
        raise
    assert finished is not None
    return finished, summary


def _emit_result(folder: Path, clip: Clip, fit: FitResult, summary: dict[str, Any], written: Sequence[str]) -> None:
    for warning in fit.warnings:
        emit(Note(text=warning))
    for phase, error in summary["reprojection_px"].items():
        figures = {f"reprojection_px_{name}": value for name, value in error.items()}
        figures["jitter_mm_per_frame2"] = summary["jitter"][phase]["camera_space_mm_per_frame2"]
        emit_figures(clip.name, f"{phase[:-1]} {phase[-1]}", figures)
    emit_wrote(*(folder / name for name in written))


def _overlay_written(path: Path, fit: FitResult, clip: Clip, body: BodyModel) -> bool:
    try:
        emit(Step(step="overlay", title="Overlay video"))
        write_comparison(path, fit, clip, body, progress=share_reporter("overlay"))
        emit(StepDone(step="overlay"))
    except (InputError, OSError) as error:
        tell([f"{path.name} was not written, but the fit is complete. {error}"])
        return False
    return True


def _inputs(clip: Clip, body: BodyModel) -> list[str]:
    source = body.source.name if body.source else body.kind
    return [*described(clip), f"Body {source} ({body.gender})", *notes_of(clip)]


def report(summary: dict[str, Any]) -> list[str]:
    """The main figures as lines of a table, and the ground."""
    parts = "".join(f"{name:>8}" for name in ERROR_GROUPS)
    lines = [f"{'':9}{'error px, median':>18}{parts} (95 %){'jitter mm/frame²':>19}{'seconds':>10}"]
    for phase, error in summary["reprojection_px"].items():
        found = [error["median"], *(error[f"{name}_p95"] for name in ERROR_GROUPS)]
        median, *off = ("-" if e is None else f"{e:.1f}" for e in found)
        jitter = summary["jitter"][phase]["camera_space_mm_per_frame2"]
        title = f"{phase[:-1]} {phase[-1]}"
        lines.append(
            f"{title:9}{median:>18}{''.join(f'{px:>8}' for px in off)}{jitter:>26.1f}{summary['seconds'][phase]:>10.1f}"
        )
    return lines if summary["ground"] is None else [*lines, summary["ground"]["text"]]


def tell(lines: Iterable[str]) -> None:
    """Print lines on the standard error."""
    for line in lines:
        print(printable(line), file=sys.stderr, flush=True)


# --- --people all ---

_FORMER_GLB = "people.glb"
"""All people in one file, which earlier versions wrote."""


def run_fit_people(options: FitOptions, *, command: str = "") -> None:
    """Fit all people, write their results, and print their folders.

    Raises:
        InputError: Files or options cannot be used; nothing has been written then.
        KeyboardInterrupt: Cancelled; what had finished has been written, and is in people.json. An earlier fit is still
            there if nothing had.
    """
    config = fit_config(options.method)
    old = _check_out(options.out, overwrite=options.overwrite)
    body = prepared_body(options, config)
    with _loading(body, config), DetectionShown() as tell_progress:
        everybody = all_people_of(options, tell_progress)
    people, starts = _started(options, everybody, body)
    compile_kernels(config)
    listed: list[PersonInClip] = []
    fitted = 0

    def list_one(one: PersonInClip) -> None:
        """Before each gets a result, so that a killed process leaves a folder of several people; until the first does,
        the last fit stays."""
        if not listed:
            _remove(options.out, old)
        listed.append(one)
        _list(options.out, listed)

    try:
        for one, start in zip(people, starts, strict=True):
            tell([f"{one.about.name.capitalize()} of {len(people)}"])
            folder, begins = options.out / one.about.folder, partial(list_one, one)
            fit_into(folder, one.clip, body, config, options, start=start, command=command, begins=begins)
            fitted += 1
    except BaseException:
        if listed and not is_result(options.out / listed[-1].about.folder):
            with suppress(InputError):  # the reason is reported; people without a folder are skipped
                _list(options.out, listed[:-1])
        tell([f"{fitted} of {len(people)} people are fitted."])
        raise
    emit_wrote(options.out / PEOPLE_NAME)
    print(printable(f"Wrote {PEOPLE_NAME} into {options.out}: {len(people)} people"))


def _check_out(folder: Path, *, overwrite: bool) -> list[Path]:
    """Folders of an earlier fit of several people at this place, which the new ones replace. Raises InputError if the
    folder holds something else, and `overwrite` is not given."""
    old = [folder / one.folder for one in read_people_file(folder).people] if holds_people(folder) else []
    for path in (folder, *old):
        sweep(path)  # delete the remains of killed processes
    if overwrite or not folder.is_dir():
        check_out(folder, overwrite=overwrite)
        return old
    known = {folder / PEOPLE_NAME, folder / _FORMER_GLB, *old} if old else set()
    others = [path for path in sorted(folder.iterdir()) if path not in known]
    others += [path for one in old if one.is_dir() for path in sorted(one.iterdir()) if path.name not in RESULT_NAMES]
    if others:
        some = ", ".join(str(path.relative_to(folder)) for path in others[:4]) + (", ..." if len(others) > 4 else "")
        raise InputError(
            f"--out {folder}: contains files that are not a result of several people ({some}). Choose another folder, "
            "or give --overwrite to write the results beside them."
        )
    check_out(folder, overwrite=True)
    return old


def _remove(folder: Path, old: Sequence[Path]) -> None:
    """Delete an earlier fit of several people, so that the next fit has no person of it."""
    try:
        for path in (folder / PEOPLE_NAME, folder / _FORMER_GLB, *(one / name for one in old for name in RESULT_NAMES)):
            path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be replaced ({error.strerror}). Choose another --out.") from error
    for one in old:
        with suppress(OSError):  # with --overwrite other files may lie in it
            one.rmdir()


def _started(
    options: FitOptions, people: list[PersonInClip], body: BodyModel
) -> tuple[list[PersonInClip], list[GivenStart | None]]:
    """The start of each fit: the person in the given result who matches the keypoints, otherwise a note. Raises
    InputError if the result cannot be read, or matches no person."""
    if options.begin == StartOptions():
        return people, [None] * len(people)
    bodies = Bodies(options.body.models)
    noted: list[PersonInClip] = []
    starts: list[GivenStart | None] = []
    refused: list[InputError] = []
    for one in people:
        try:
            starts.append(start_of(options.begin, one.clip, body, bodies))
            noted.append(one)
        except InputError as error:
            refused.append(error)
            starts.append(None)
            note = f"Fitted without --start, because no person in it matches these keypoints. {error}"
            noted.append(replace(one, clip=replace(one.clip, notes=(*one.clip.notes, note))))
    if len(refused) == len(people):
        raise refused[0]
    return noted, starts


def _list(folder: Path, people: Sequence[PersonInClip]) -> None:
    """Write people.json. Raises InputError if that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not people:
            (folder / PEOPLE_NAME).unlink()
            return
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}). Choose another --out.") from error
    write_people_file(folder, people_of(people))
