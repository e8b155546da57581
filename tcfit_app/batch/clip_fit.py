"""One clip of a batch, fitted as `tcfit fit` does.

A process may die at any time. Only the last write puts the clip's hash into summary.json; before that, the clip counts
as not done and is fitted again.
"""

import time
import traceback
from functools import lru_cache
from pathlib import Path

import torch

from fitting_core.body.files.reading import load_body
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.clips.reading import read_clip
from fitting_core.detect.detecting import DetectionProgress
from fitting_core.detect.detectors import Running, find_detector
from fitting_core.detect.part import Detector
from fitting_core.errors import InputError
from fitting_core.fit import fitting
from fitting_core.fit.events import FitEvent, Iteration
from fitting_core.io.known_shape import read_known_shape
from fitting_core.io.result_files import OVERLAY_NAME, SUMMARY_NAME, write_result
from fitting_core.results.fit_result import FitResult
from tcfit_app.batch.inputs import detector_of, inputs_of
from tcfit_app.batch.manifest import ClipTask
from tcfit_app.batch.outcome import ClipOutcome, Mark, failure, mark_done
from tcfit_app.exports.pictures import write_comparison
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.process_queue import Report, Work
from tcfit_app.imports.given import start_of
from tcfit_app.options.clip_input import with_views
from tcfit_app.options.preparing import body_file, check_out, prepare_solver
from tcfit_app.project.storage.accessing import accessing


def fit_clip(task: ClipTask, report: Report = lambda work: None) -> ClipOutcome:
    """Fit a clip and write its result, in a process of its own or of Ray. The outcome names what failed.

    `report` receives the progress of the detection and of each phase.
    """
    torch.set_num_threads(1)  # many clips at a time share the cores
    begin = time.time()
    report(Work(step="reading", share=0.0))
    try:
        return _fit(task, begin, report)
    except InputError as error:
        reason = str(error)
    except KeyboardInterrupt:  # raised by a plugin: the process is deaf to those of a terminal
        reason = "A plugin interrupted the fit (KeyboardInterrupt)."
    except Exception as error:  # A clip's failure is an outcome like another; the batch goes on.
        reason = f"{type(error).__name__}: {error}"
        traceback.print_exc()
    return failure(task, reason, seconds=time.time() - begin)


def _fit(task: ClipTask, begin: float, report: Report) -> ClipOutcome:
    inputs, body = inputs_of(task), _body(body_file(task.fit.body))
    prepare_solver(task.config, 1)
    clip = _clip_of(task, report)
    check_out(task.out, overwrite=task.fit.overwrite)
    fit = _run_fit(task, clip, body, report)
    with accessing(task.out):
        (task.out / SUMMARY_NAME).unlink(missing_ok=True)  # the hash of an earlier fit must not vouch for this one
    content = write_result(task.out, fit, clip, body, command=task.command)
    notes: list[str] = []
    if task.fit.overlay and clip.source is not None:
        try:
            write_comparison(task.out / OVERLAY_NAME, fit, clip, body)
        except (InputError, OSError) as error:
            notes = [f"No {OVERLAY_NAME} was written. {error}"]
    return mark_done(task, content, Mark(inputs=inputs, seconds=time.time() - begin, notes=notes))


def _clip_of(task: ClipTask, report: Report) -> Clip:
    fit, name = task.fit, detector_of(task)
    detector = None if name is None else _detector(name)

    def tell(event: DetectionProgress) -> None:
        report(Work(step="keypoints", share=event.share))

    clip = read_clip(fit.video, fit.keypoints, clip=fit.clip, camera=fit.camera, detector=detector, tell=tell)
    return with_views(clip, fit, tell, detector=detector)


def _run_fit(task: ClipTask, clip: Clip, body: BodyModel, report: Report) -> FitResult:
    def tell(event: FitEvent) -> None:
        if isinstance(event, Iteration):
            report(Work(step=f"phase {event.phase}", share=event.share))

    shape = None if task.fit.shape is None else read_known_shape(task.fit.shape, body_hash=body.hash)
    start = start_of(task.fit.begin, clip, body, Bodies(task.fit.body.models))
    return fitting.fit_clip(clip, body, task.config, start=start, shape=shape, tell=tell)


@lru_cache(maxsize=1)  # Most clips of a list have the same, which takes a second to open.
def _detector(name: str) -> Detector:
    return find_detector(name, Running(threads=1))


@lru_cache(maxsize=4)  # One for each gender; tens of megabytes each.
def _body(path: Path) -> BodyModel:
    return load_body(path)
