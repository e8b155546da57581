"""`tcfit fit --people all`: everybody in a clip, each with a folder of their own, and all together in one file."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from fitting_core.body.model import BodyModel
from fitting_core.clips.people import PersonInClip, people_of
from fitting_core.errors import InputError, printable
from fitting_core.files.atomic import sweep
from fitting_core.io.motion_files import motion_of
from fitting_core.io.people_file import PEOPLE_NAME, holds_people, read_people_file, write_people_file
from fitting_core.io.result_files import FIT_NAME, OVERLAY_NAME, SUMMARY_NAME, is_result
from fitting_core.results.given_start import GivenStart
from tcfit_app.cli.detection_shown import DetectionShown
from tcfit_app.cli.fit_command import Outcome, fit_into, prepared_body, tell
from tcfit_app.cli.json_lines import emit_wrote
from tcfit_app.exports.motions import write_together
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.imports.given import start_of
from tcfit_app.options.clip_input import everybody_of
from tcfit_app.options.fit import FitOptions, StartOptions, fit_config
from tcfit_app.options.preparing import check_out, compile_kernels

GLB_NAME = "people.glb"
"""Everybody, in one world."""
_RESULT = (FIT_NAME, SUMMARY_NAME, OVERLAY_NAME)


def run_fit_people(options: FitOptions, *, command: str = "") -> list[Outcome]:
    """Fit all people, write their results, and print their folders.

    Raises:
        InputError: Files or options cannot be used; nothing has been written then.
        KeyboardInterrupt: Cancelled; what had finished has been written, and is in people.json. An earlier fit is still
            there if nothing had.
    """
    _refuse_what_is_of_one(options)
    config = fit_config(options.method)
    old = _check_out(options.out, overwrite=options.overwrite)
    body = prepared_body(options, config)
    with DetectionShown() as tell_progress:
        everybody = everybody_of(options, tell_progress)
    people, starts = _started(options, everybody, body)
    compile_kernels(config)
    outcomes: list[Outcome] = []
    listed: list[PersonInClip] = []

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
            fitted = fit_into(folder, one.clip, body, config, options, start=start, command=command, begins=begins)
            outcomes.append(fitted)
    except BaseException:
        if listed and not is_result(options.out / listed[-1].about.folder):
            with suppress(InputError):  # the reason is reported; people without a folder are skipped
                _list(options.out, listed[:-1])
        tell([f"{len(outcomes)} of {len(people)} people are fitted."])
        raise
    _write_together(options.out, people, outcomes)
    return outcomes


def _refuse_what_is_of_one(options: FitOptions) -> None:
    """Raise InputError for an option that is for one person."""
    ones = {"--shape": options.shape, "--height": options.method.height, "--start-person": options.begin.start_person}
    if given := [name for name, value in ones.items() if value is not None]:
        raise InputError(
            f"--people {options.people} cannot be combined with {' and '.join(given)}, which is for one person."
        )


def _check_out(folder: Path, *, overwrite: bool) -> list[Path]:
    """Folders of an earlier fit of several people at this place, which the new ones replace. Raises InputError if the
    folder holds something else, and `overwrite` is not given."""
    old = [folder / one.folder for one in read_people_file(folder).people] if holds_people(folder) else []
    for path in (folder, *old):
        sweep(path)  # delete the remains of killed processes
    if overwrite or not folder.is_dir():
        check_out(folder, overwrite=overwrite)
        return old
    known = {folder / PEOPLE_NAME, folder / GLB_NAME, *old} if old else set()
    others = [path for path in sorted(folder.iterdir()) if path not in known]
    others += [path for one in old if one.is_dir() for path in sorted(one.iterdir()) if path.name not in _RESULT]
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
        for path in (folder / PEOPLE_NAME, folder / GLB_NAME, *(one / name for one in old for name in _RESULT)):
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
            note = f"Fitted without --start, because nobody in it matches these keypoints. {error}"
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


def _write_together(folder: Path, people: Sequence[PersonInClip], outcomes: Sequence[Outcome]) -> None:
    """Write everybody into one file, and say so."""
    motions = [
        replace(motion_of(outcome.fit, one.clip, outcome.body), name=one.about.name)
        for one, outcome in zip(people, outcomes, strict=True)
    ]
    path = folder / GLB_NAME
    try:
        note = write_together(path, motions, [one.fit.grounding for one in outcomes], name=people[0].name)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}). Free space.") from error
    emit_wrote(folder / PEOPLE_NAME, path)
    print(printable(f"Wrote {PEOPLE_NAME} and {GLB_NAME} into {folder}: {note}"))
