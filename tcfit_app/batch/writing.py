"""What a clip of a batch leaves: the files of `tcfit fit`, or a project."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.fit.events import FitEvent, PhaseFinished
from fitting_core.fit.fitting import fit_events
from fitting_core.fit.result import FitResult
from fitting_core.io.result_files import OVERLAY_NAME, write_result
from fitting_core.io.summary import summary
from tcfit_app.batch.manifest import ClipTask
from tcfit_app.batch.records import Figures
from tcfit_app.exports.overlay_video import write_comparison
from tcfit_app.fitting.bodies import record_of
from tcfit_app.options.preparing import check_out
from tcfit_app.project.project import Project
from tcfit_app.project.storage.database import is_project

Report = Callable[[FitEvent], None]


@dataclass(frozen=True, kw_only=True)
class Work:
    """A clip that is being fitted."""

    task: ClipTask
    clip: Clip
    body: BodyModel
    draft: Path
    """What becomes the result's folder."""
    settings: str
    """Their hash."""
    report: Report


def write_files(work: Work) -> Figures:
    """Fit, and write what `tcfit fit` writes into the draft.

    Raises:
        InputError: The clip cannot be fitted, or the result cannot be written or would lie among other files.
    """
    task, clip, body = work.task, work.clip, work.body
    check_out(task.out, overwrite=task.fit.overwrite)
    fit = _fitted(work, clip)
    content = write_result(work.draft, fit, clip, body, command=task.command)
    notes = list(fit.warnings)
    if task.fit.overlay and clip.source is not None:
        try:
            write_comparison(work.draft / OVERLAY_NAME, fit, clip, body)
        except (InputError, OSError) as error:
            notes.append(f"No {OVERLAY_NAME} was written. {error}")
    return _figures(content, notes)


def write_project(work: Work) -> Figures:
    """Fit, and make the draft a project with the run; a project that is there already gets another run.

    Raises:
        InputError: The clip cannot be fitted, or the project cannot be written or is another clip's.
    """
    if is_project(work.task.out):
        return _another_run(work)
    check_out(work.task.out, overwrite=False)
    fit = _fitted(work, work.clip)
    with Project.create(work.draft, work.clip) as project:
        return _added(work, project, work.clip, fit)


def _another_run(work: Work) -> Figures:
    """On the keypoints as they were corrected; nothing of the project is lost."""
    with Project.open(work.task.out) as project:
        _check_same_clip(project, work.clip)
        # The run is in the project before the record is: a process may have died between.
        made = [run for run in project.runs.all() if run.name == _run_name(work) and run.state == "finished"]
        if made and made[-1].edits_seen == project.last_edit:
            figures = _figures(made[-1].summary, [])
        else:
            clip = project.clip
            figures = _added(work, project, clip, _fitted(work, clip))
    work.draft.mkdir(exist_ok=True)
    return figures


def _check_same_clip(project: Project, clip: Clip) -> None:
    there, given = project.detections, clip.keypoints
    same = np.array_equal(there.xy, given.xy) and np.array_equal(there.confidence, given.confidence)
    if not (same and project.clip.camera == clip.camera and project.clip.frame_rate == clip.frame_rate):
        raise InputError(
            f"{project.folder}: is a project already, of other keypoints, another camera or another frame rate. Choose "
            "another folder for this clip, or delete the project."
        )


def _run_name(work: Work) -> str:
    return f"Batch {work.settings[:8]}"


def _added(work: Work, project: Project, clip: Clip, fit: FitResult) -> Figures:
    content = summary(fit, clip, work.body, complete=True, command=work.task.command)
    body = record_of(work.body)
    run = project.runs.start(work.task.config, body=body, edits_seen=project.last_edit, name=_run_name(work))
    project.runs.finish(run.id, fit, summary=content)
    return _figures(content, list(fit.warnings))


def _fitted(work: Work, clip: Clip) -> FitResult:
    finished: PhaseFinished | None = None
    for event in fit_events(clip, work.body, work.task.config):
        work.report(event)
        if isinstance(event, PhaseFinished):
            finished = event
    assert finished is not None
    return finished.so_far


def _figures(content: dict[str, Any], notes: list[str]) -> Figures:
    last = max(content["reprojection_px"])
    return Figures(
        frames=content["frames"],
        reprojection_px=content["reprojection_px"][last]["median"],
        jitter_mm=content["jitter"][last]["camera_space_mm_per_frame2"],
        notes=tuple(notes),
    )
