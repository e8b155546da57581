"""One task of a batch: a clip fitted into a draft, as files or a project, which then becomes the result in one step.

A process may die at any time. Before the draft has its summary.json, the clip counts as not started; after that as
fitted, and the next process only puts the draft into its place.
"""

import dataclasses
import os
import shutil
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import msgspec
import torch

from fitting_core.body.files.reading import load_body
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.clips.reading import read_clip
from fitting_core.detect.detecting import DetectionProgress
from fitting_core.detect.detectors import Running, find_detector
from fitting_core.detect.part import Detector
from fitting_core.errors import InputError
from fitting_core.files.atomic import sync
from fitting_core.fit import fitting
from fitting_core.fit.events import FitEvent, Iteration
from fitting_core.fit.subject_shape import subject_shape
from fitting_core.io.known_shape import read_known_shape
from fitting_core.io.result_files import OVERLAY_NAME, SUMMARY_NAME, write_result
from fitting_core.io.summary import summary
from fitting_core.results.fit_result import FitResult
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.suspicion import findings, review_queue, worst_place
from tcfit_app.batch.inputs import FIRST_NAME, SHAPE_NAME, detector_of, inputs_of, missing_input, unchanged
from tcfit_app.batch.manifest import ClipTask, Form
from tcfit_app.batch.records import (
    Record,
    ResultFigures,
    done_record,
    patient_lock,
    read_record,
    write_json,
    write_log,
)
from tcfit_app.exports.pictures import write_comparison
from tcfit_app.fitting.bodies import Bodies, record_of
from tcfit_app.fitting.process_queue import Report, Work
from tcfit_app.imports.given import start_of
from tcfit_app.options.fit import FitOptions
from tcfit_app.options.preparing import body_file, check_out, prepare_solver
from tcfit_app.project.glance import off_by_part
from tcfit_app.project.project import Project
from tcfit_app.project.storage.accessing import accessing
from tcfit_app.project.storage.clip import same_detections
from tcfit_app.project.storage.database import is_project
from tcfit_app.project.storage.run_files import read_run, write_run
from tcfit_app.project.storage.run_record import Given, Source

DRAFT_SUFFIX, LOCK_SUFFIX = ".batch-draft", ".batch-lock"
"""Suffixes of the hidden folders beside a result while it is being made."""
_PATIENCE = 30.0
"""Seconds to wait for another process that fits the same clip; one whose batch was killed ends sooner."""
Content = tuple[dict[str, Any], list[str]]
"""What goes into summary.json, and notes for the user."""


def fit_clip(task: ClipTask, folder: Path, report: Report = lambda work: None) -> Record:
    """Fit a clip and write its result, in a process of its own or of Ray. What goes wrong is in the record, and nothing
    of the result is there then.

    `folder` is the batch's. `report` takes the progress of the keypoints' detection, and of each phase.
    """
    torch.set_num_threads(1)  # many clips at a time share the cores
    begin, inputs, trace = time.time(), "", ""
    report(Work(step="reading", share=0.0))
    try:
        with _drafting(task) as draft:
            if record := _left_behind(task, draft, folder):
                return record
            write_log(folder, "started", task)
            inputs = inputs_of(task)
            return _fitted(task, inputs, draft, folder, report)
    except InputError as error:
        reason = str(error)
    except KeyboardInterrupt:  # raised by a plugin: the process is deaf to those of a terminal
        reason = "A plugin interrupted the fit (KeyboardInterrupt)."
    except Exception as error:  # A clip's failure is an outcome like another; the batch goes on.
        reason, trace = f"{type(error).__name__}: {error}", traceback.format_exc()
    return failure(inputs, reason, trace=trace, seconds=time.time() - begin)


def failure(inputs: str, reason: str, *, trace: str = "", seconds: float = 0.0) -> Record:
    """The record of a clip that failed now."""
    return Record(state="failed", inputs=inputs, finished=time.time(), seconds=seconds, reason=reason, trace=trace)


def tidy(task: ClipTask) -> None:
    """Remove what a process that died just after it had finished a clip left beside the result. Raises InputError if
    another process is at work there."""
    if any(path.exists() for path in _beside(task)):
        with _drafting(task):
            pass


def _beside(task: ClipTask) -> tuple[Path, Path]:
    """The draft's folder and the lock's."""
    out = task.out.absolute()
    return out.with_name(f".{out.name}{DRAFT_SUFFIX}"), out.with_name(f".{out.name}{LOCK_SUFFIX}")


@contextmanager
def _drafting(task: ClipTask) -> Iterator[Path]:
    """The folder that is to become the result, for this process alone; gone at the end.

    It lies beside the result: one step must move it, and a project's link to its video must stay right.
    """
    draft, place = _beside(task)
    held = patient_lock(place, seconds=_PATIENCE, wanted=f"fit into {task.out}")
    try:
        yield draft
    finally:
        shutil.rmtree(draft, ignore_errors=True)
        shutil.rmtree(place, ignore_errors=True)
        held.release()


def _left_behind(task: ClipTask, draft: Path, folder: Path) -> Record | None:
    """What a process had fitted before it died, put into its place."""
    if record := done_record(task):
        return record
    record = read_record(draft)
    if record and unchanged(record.inputs, task):
        write_log(folder, "recovered", task)
        _put(draft, task.out)
        return record
    shutil.rmtree(draft, ignore_errors=True)
    return None


def _fitted(task: ClipTask, inputs: str, draft: Path, folder: Path, report: Report) -> Record:
    begin = time.time()
    body = _body(body_file(task.fit.body))
    prepare_solver(task.config, 1)
    attempt = Attempt(task=task, body=body, draft=draft, folder=folder, inputs=inputs, report=report)
    content, notes = _WRITERS[task.form](attempt)
    record = Record(
        state="done",
        inputs=inputs,
        finished=time.time(),
        seconds=time.time() - begin,
        figures=_figures(content, notes),
    )
    (task.out / OVERLAY_NAME).unlink(missing_ok=True)  # That of the result which is replaced.
    write_json(draft / SUMMARY_NAME, content | {"batch": record})
    write_log(folder, "fitted", task, seconds=record.seconds)
    _put(draft, task.out)
    return record


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """A clip that is being fitted."""

    task: ClipTask
    body: BodyModel
    draft: Path
    """What becomes the result's folder."""
    folder: Path
    """The batch's."""
    inputs: str
    """See `inputs_of`."""
    report: Report

    @cached_property
    def clip(self) -> Clip:
        """Read when it is needed."""
        return _clip_of(self.task, self.report)

    def tell(self, event: FitEvent) -> None:
        """Report the progress of a phase."""
        if isinstance(event, Iteration):
            self.report(Work(step=f"phase {event.phase}", share=event.share))


def _clip_of(task: ClipTask, report: Report) -> Clip:
    fit, name = task.fit, detector_of(task)
    detector = None if name is None else _detector(name)

    def tell(event: DetectionProgress) -> None:
        report(Work(step="keypoints", share=event.share))

    return read_clip(fit.video, fit.keypoints, clip=fit.clip, camera=fit.camera, detector=detector, tell=tell)


@lru_cache(maxsize=1)  # Most clips of a list have the same, which takes a second to open.
def _detector(name: str) -> Detector:
    return find_detector(name, Running(threads=1))


def write_first(attempt: Attempt) -> Content:
    """Fit the first phase alone, for the shape and for the phases after it. Raises InputError if the clip cannot be
    fitted, or nothing can be written."""
    fit = _run_fit(attempt, attempt.clip)
    attempt.draft.mkdir(parents=True, exist_ok=True)
    write_run(attempt.draft / FIRST_NAME, fit)
    return {"frames": len(attempt.clip)}, []


class FoundShape(msgspec.Struct, frozen=True, kw_only=True):
    """shape.json, which `read_known_shape` reads too."""

    subject: str
    betas: list[float]
    body: dict[str, str]
    """Hash and kind of the body model to which the betas belong."""
    frames: dict[str, tuple[int, ...]]
    """By clip, the frames that it was found from."""


def write_shape(attempt: Attempt) -> Content:
    """Find the shape of a subject from its clips' first phases. A clip whose files have gone since does not count.
    Raises InputError if none of the clips is there any more, or nothing can be written."""
    members = [member for member in attempt.task.members if not missing_input(member)]
    if not members:
        raise InputError(
            f"{attempt.task.subject}: the files of all its clips are gone, so its shape cannot be found again."
        )
    clips = ((_clip_of(member, attempt.report), read_run(member.out / FIRST_NAME, member.config)) for member in members)
    found = subject_shape(clips, attempt.body, attempt.task.config)
    content = FoundShape(
        subject=attempt.task.subject,
        betas=found.betas.tolist(),
        body={"hash": attempt.body.hash, "kind": attempt.body.kind},
        frames={member.name: frames for member, frames in zip(members, found.frames, strict=True)},
    )
    attempt.draft.mkdir(parents=True, exist_ok=True)
    write_json(attempt.draft / SHAPE_NAME, content)
    return {"frames": sum(map(len, found.frames))}, []


def write_files(attempt: Attempt) -> Content:
    """Fit, and write what `tcfit fit` writes into the draft. Raises InputError if the clip cannot be fitted, or the
    result cannot be written or would lie among other files."""
    task, clip, body = attempt.task, attempt.clip, attempt.body
    check_out(task.out, overwrite=task.fit.overwrite)
    fit = _run_fit(attempt, clip)
    content = write_result(attempt.draft, fit, clip, body, command=task.command)
    notes = list(fit.warnings)
    if task.fit.overlay and clip.source is not None:
        try:
            write_comparison(attempt.draft / OVERLAY_NAME, fit, clip, body)
        except (InputError, OSError) as error:
            notes.append(f"No {OVERLAY_NAME} was written. {error}")
    return content, notes


def write_project(attempt: Attempt) -> Content:
    """Fit, and make the draft a project with the run; a project that is there already gets another run. Raises
    InputError if the clip cannot be fitted, or the project cannot be written or is another clip's."""
    if is_project(attempt.task.out):
        return _another_run(attempt)
    check_out(attempt.task.out, overwrite=False)
    fit = _run_fit(attempt, attempt.clip)
    with Project.create(attempt.draft, attempt.clip) as project:
        project.set_height(attempt.task.config.height)
        return _added(attempt, project, attempt.clip, fit)


def _another_run(attempt: Attempt) -> Content:
    """On the keypoints as they were corrected; nothing of the project is lost."""
    with Project.open(attempt.task.out) as project:
        _check_same_clip(project, attempt.clip)
        # The run is in the project before the record is: a process may have died between.
        made = [run for run in project.runs.all() if run.name == _run_name(attempt) and run.state == "finished"]
        if made and made[-1].edits_seen == project.last_edit:
            found = dict(made[-1].summary or {}), []
        else:
            clip = project.clip
            found = _added(attempt, project, clip, _run_fit(attempt, clip))
    attempt.draft.mkdir(exist_ok=True)
    return found


def _check_same_clip(project: Project, clip: Clip) -> None:
    same = same_detections(project.detections, clip.keypoints)
    if not (same and project.clip.camera == clip.camera and project.clip.frame_rate == clip.frame_rate):
        raise InputError(
            f"{project.folder}: is already a project, with other keypoints, another camera or another frame rate. "
            "Choose another folder for this clip, or delete the project."
        )


def _run_name(attempt: Attempt) -> str:
    return f"Batch {attempt.inputs[:8]}"


def _added(attempt: Attempt, project: Project, clip: Clip, fit: FitResult) -> Content:
    content = summary(fit, clip, attempt.body, complete=True, command=attempt.task.command)
    body, seen, given = record_of(attempt.body), project.last_edit, _given(attempt.task.fit)
    run = project.runs.start(
        fit.config, fit=fit, body=body, edits_seen=seen, summary=content, given=given, name=_run_name(attempt)
    )
    project.review.set_worst(
        worst_place(run.id, review_queue(findings(PosedFit.of(clip, fit, Meshes(attempt.body)))).left)
    )
    return content, list(fit.warnings)


def _given(options: FitOptions) -> Given:
    """The fit's inputs, as the app stores them with a run."""
    begin = options.begin
    start = Source(path=str(begin.start), person=begin.start_person, first_frame=begin.start_first_frame)
    return Given(
        start=None if begin.start is None else start,
        shape=None if options.shape is None else Source(path=str(options.shape)),
    )


_WRITERS: dict[Form, Callable[[Attempt], Content]] = {
    "files": write_files,
    "project": write_project,
    "first": write_first,
    "shape": write_shape,
}


def _run_fit(attempt: Attempt, clip: Clip) -> FitResult:
    task, body = attempt.task, attempt.body
    shape = None if task.fit.shape is None else read_known_shape(task.fit.shape, body_hash=body.hash)
    start = start_of(task.fit.begin, clip, body, Bodies(task.fit.body.models))
    first = None
    # A project's corrected keypoints have another first phase.
    if task.start is not None and clip is attempt.clip:
        first = dataclasses.replace(read_run(task.start / FIRST_NAME, task.config), start=start)
    return fitting.fit_clip(clip, body, task.config, start=start, shape=shape, first=first, tell=attempt.tell)


@lru_cache(maxsize=4)  # One for each gender; tens of megabytes each.
def _body(path: Path) -> BodyModel:
    return load_body(path)


def _put(draft: Path, out: Path) -> None:
    """Make a draft the result.

    In one step where nothing is there. Else file by file, summary.json last: a process that dies in between leaves the
    rest in the draft, and other files stay.
    """
    with accessing(out):
        if not out.exists() or not any(out.iterdir()):
            if out.exists():
                out.rmdir()  # Windows replaces no folder.
            draft.rename(out)
        else:
            _put_among(draft, out)
        sync(out.parent)


def _put_among(draft: Path, out: Path) -> None:
    (out / SUMMARY_NAME).unlink(missing_ok=True)
    files = sorted(draft.iterdir(), key=lambda file: file.name == SUMMARY_NAME)
    for file in files:
        os.replace(file, out / file.name)
    sync(out)


def _figures(content: dict[str, Any], notes: list[str]) -> ResultFigures:
    """For the summary."""
    if "reprojection_px" not in content:
        return ResultFigures(frames=content["frames"])
    last = max(content["reprojection_px"])
    return ResultFigures(
        frames=content["frames"],
        off=off_by_part(content["reprojection_px"][last]),
        jitter_mm=content["jitter"][last]["camera_space_mm_per_frame2"],
        notes=tuple(notes),
    )
