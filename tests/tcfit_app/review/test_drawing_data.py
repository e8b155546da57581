"""What all tabs draw from: a run beside the keypoints and marks as they are now."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.keypoints import INDEX
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.suspicion import ReviewQueue
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.project import Project
from tcfit_app.project.storage.marks import MarkStore
from tcfit_app.review.shared import drawing_data as drawing_data_module
from tcfit_app.review.shared.drawing_data import DrawingData
from tests.samples.sessions import QUICK, idle, newest, session_of, small_clip, until

WRIST = INDEX["right_wrist"]


@pytest.fixture
def data(tiny_body: BodyModel, tmp_path: Path) -> Iterator[DrawingData]:
    """Of a project with one fit."""
    folder = tmp_path / "walk.tcfit"
    Project.create(folder, small_clip(tiny_body)).close()
    with session_of(folder, tiny_body) as session:
        session.fit_everything(replace(QUICK, last_phase=2), kind="smplx", gender="neutral")
        idle(session)
        made = DrawingData(session, lambda: None)
        try:
            yield made
        finally:
            made.close()


def test_marked_keypoints_are_known_as_marked(data: DrawingData):
    data.session.edit(MarkBad(frames=(4,), joints=(WRIST,)), author="me")
    bad = data.posed(newest(data.session))().bad
    assert np.argwhere(bad).tolist() == [[4, WRIST]]


def test_what_was_imported_did_not_fail(data: DrawingData):
    shown = newest(data.session)
    assert data.posed(shown)().frame_cost is not None
    assert data.posed(replace(shown, run=replace(shown.run, kind="imported")))().frame_cost is None


def test_frames_that_looked_fine_are_looked_at_again_after_another_fit(
    data: DrawingData, monkeypatch: pytest.MonkeyPatch
):
    fine: list[frozenset[int]] = []

    def queue(found: object, *, checked: frozenset[int], limbs: object) -> ReviewQueue:
        fine.append(checked)
        return ReviewQueue(left=(), looked_at=0)

    monkeypatch.setattr(drawing_data_module, "review_queue", queue)
    session, first = data.session, newest(data.session)
    session.project.marks.set([2, 5], "checked", author="me")
    until(session, lambda: data.queue(first) is not None)
    session.rerun_frames(first, replace(QUICK, last_phase=3), (range(4, 7),))
    idle(session)
    until(session, lambda: data.queue(newest(session)) is not None)
    until(session, lambda: data.queue(first) is not None)
    assert fine == [{2, 5}, {2}]


def test_what_is_there_is_not_made_again(data: DrawingData, monkeypatch: pytest.MonkeyPatch):
    """The loop asks for everything at every draw: of a clip of 20,000 frames a single PosedFit takes 40 ms."""
    session, shown = data.session, newest(data.session)
    draws = {
        "curve": lambda: data.curves(("reprojection",), shown),
        "queue": lambda: data.queue(shown),
        "figures": lambda: data.metrics(shown),
        "room": lambda: data.room(shown, shown),
        "between": lambda: data.between(shown, shown),
    }
    for draw in draws.values():
        until(session, lambda draw=draw: draw() is not None)

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("copied or read again")

    for owner, name in ((PosedFit, "posed"), (Corrected, "put_into"), (Corrected, "keypoints"), (MarkStore, "all")):
        monkeypatch.setattr(owner, name, refuse)
    assert [name for name, draw in draws.items() if draw() is None] == []


def test_the_room_of_a_running_fit_follows_the_body_in_depth(data: DrawingData):
    shown = replace(newest(data.session), result=None)
    params = shown.params
    nearer = replace(shown, params=replace(params, camera_translation=params.camera_translation * 0.5))
    until(data.session, lambda: data.room(shown, shown) and data.room(nearer, nearer))
    assert data.room(shown, shown) != data.room(nearer, nearer)


def test_nothing_waits_for_the_first_body(data: DrawingData):
    shown = newest(data.session)
    data.warming = True
    assert data.curves(("reprojection",), shown) is None and data.queue(shown) is None
    assert data.problem("suspects", shown) == "" and data.problem("metrics", shown) == ""
    data.warm_up()
    until(data.session, lambda: not data.warming)
    until(data.session, lambda: data.curves(("reprojection",), shown) is not None)
