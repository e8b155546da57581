"""How far a job is, in the timeline."""

import numpy as np

from fitting_core.keypoints import INDEX
from fitting_core.results.provenance import Provenance
from tcfit_app.fitting.reports import RunningJob
from tcfit_app.review.drawing.timeline import fit_spans, keyframes, origins


def job(phase: int | None, *windows: range) -> RunningJob:
    return RunningJob(number=1, run=1, title="job", phases=(3,), started=True, phase=phase, windows=list(windows))


def spans(found: RunningJob, frames: range) -> list[tuple[int, int, str]]:
    return [(span.first, span.last, span.state) for span in fit_spans(found, frames)]


def test_a_whole_fit_covers_the_clip_phase_by_phase():
    clip = range(100)
    assert spans(job(None), clip) == spans(job(1), clip) == [(0, 99, "fitting")]
    assert spans(job(1, range(0, 13), range(13, 40)), clip) == [
        (0, 12, "phase1"),
        (13, 39, "phase1"),
        (40, 99, "fitting"),
    ]
    assert spans(job(2), clip) == [(0, 99, "phase1")]
    assert spans(job(3, range(0, 20), range(20, 27)), clip) == [(0, 19, "done"), (20, 26, "done"), (27, 99, "phase2")]
    assert spans(job(3, clip), clip) == [(0, 99, "done")]


def test_frames_that_are_fitted_again_are_all_that_is_drawn():
    frames = range(10, 70)
    assert spans(job(3), frames) == [(10, 69, "phase2")]
    assert spans(job(3, range(10, 30)), frames) == [(10, 29, "done"), (30, 69, "phase2")]


def test_where_frames_came_from_is_told_once_for_all_alike():
    provenance = Provenance(np.array([1, 6, 1, 1], np.uint8), np.array([1, 1, 1, 2], np.uint8))
    found = origins("Fit 1", provenance)
    told = [found.texts[i] for i in found.which]
    assert found.label == "Fit 1" and len(found.texts) == 3
    assert told[1] == "started from the fit of a frame before it, stopped because the cost fell no further"
    assert told[0] == told[2] != told[3]


def test_keyframes_say_whose_they_are():
    wrist, elbow = INDEX["right_wrist"], INDEX["right_elbow"]
    found = [keyframes(np.array([3, 5]), joints) for joints in ((), (wrist,), (wrist, elbow))]
    assert {state.frames for state in found} == {(3, 5)}
    assert [state.subject for state in found] == ["a keypoint", "right wrist", "one of 2 selected keypoints"]
