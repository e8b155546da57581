"""A fit in the background, and the projects that are made for it."""

import os
import time
from dataclasses import replace
from pathlib import Path

from fitting_core.body.files.reading import load_body
from fitting_core.clips.footage import locate
from fitting_core.clips.options import ClipOptions
from fitting_core.clips.reading import read_clip, read_footage
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.errors import InputError
from fitting_core.fit.events import FitEvent
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.fused.ready import cores
from fitting_core.io.summary import summary
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.suspicion import findings, review_queue, worst_place
from tcfit_app.fitting.bodies import record_of
from tcfit_app.fitting.fit_progress import KEYPOINTS, FitProgress, in_words
from tcfit_app.fitting.process_queue import Report, Work
from tcfit_app.home.catalogue import project_beside
from tcfit_app.home.found import Found
from tcfit_app.imports.keypoint_jobs import Detect, ProgressReport
from tcfit_app.imports.results import project_of_result
from tcfit_app.options.fit import BodyOptions
from tcfit_app.options.preparing import body_file, compile_kernels, prepare_solver
from tcfit_app.project.project import Project


def make_project(clip: Found) -> Path:
    """Create the project of a result, with its fit, or of a video or images, with keypoints that lie beside these.

    Returns:
        Its folder. A result may have had one already.

    Raises:
        InputError: As `project_of_result`, `read_clip` and `Project.create`.
    """
    if clip.kind == "result":
        if (known := project_beside(clip)) is None:
            known = _free_place(clip)
            project_of_result(clip.path, known)
        return known
    given = clip.kind == "images" and locate(clip.path, None)[1] is not None
    folder = _free_place(clip)
    Project.create(folder, read_clip(clip.path) if given else read_footage(clip.path)).close()
    return folder


def _free_place(clip: Found) -> Path:
    return next(place for place in clip.project_places() if not os.path.lexists(place))


def fit_project(folder: Path, report: Report, *, models: Path | None = None, config: FitConfig | None = None) -> None:
    """Fit a project with the default preset; keypoints are found if it has none. Raises InputError if it is open
    elsewhere, no person is found, the body is missing, or it cannot be read or written.

    Args:
        folder: Of the project.
        report: Receives the progress.
        models: Folder of body models.
        config: In place of the default.
    """
    with Project.open(folder) as project:
        body = load_body(body_file(BodyOptions(models=models)))
        phases = range(1, (config or PRESETS[DEFAULT_PRESET]).last_phase + 1)
        progress = FitProgress(phases if project.has_detections else (KEYPOINTS, *phases))
        begin = time.monotonic()

        def shown() -> None:
            words = in_words(progress.phrase.capitalize(), progress.remaining)
            report(Work(step=words, share=progress.fraction))

        def found(step: str, share: float | None) -> None:
            progress.detected(share or 0.0, time.monotonic() - begin)
            shown()

        def fitted(event: FitEvent) -> None:
            progress.take(event, time.monotonic() - begin)
            shown()

        if not project.has_detections:
            _find_keypoints(project, found)
        used = config or PRESETS[DEFAULT_PRESET]
        if project.height is not None:
            used = replace(used, height=project.height)
        prepare_solver(used, max(1, cores() - 1))  # reviewers use this computer too
        report(Work(step="Preparing the fit", share=progress.fraction))
        compile_kernels(used)
        clip = project.clip
        run = project.runs.start(used, body=record_of(body), edits_seen=project.last_edit)
        try:
            fit = fit_clip(clip, body, used, tell=fitted)
        except InputError as error:
            project.runs.end(run.id, "failed", str(error))
            raise
        project.runs.finish(run.id, fit, summary=summary(fit, clip, body, complete=True, command=""))
        report(Work(step="Looking for suspicious frames", share=1.0))
        suspects = review_queue(findings(PosedFit.of(clip, fit, Meshes(body)))).left
        project.review.set_worst(worst_place(run.id, suspects))


def _find_keypoints(project: Project, tell: ProgressReport) -> None:
    found = Detect(detector=ClipOptions().detector).run(project.clip, tell)
    project.take_detections(
        found.keypoints, found.notes, detector=found.detector, silhouettes=found.silhouettes, camera=found.camera
    )
