"""What all tabs draw from: a run beside the keypoints and marks as they are now."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.keypoints import INDEX
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.project import Project
from tcfit_app.project.storage.marks import Marks
from tcfit_app.review.shared import desk as desk_module
from tcfit_app.review.shared.desk import Desk
from tests.samples.sessions import QUICK, idle, newest, session_of, small_clip, until

WRIST = INDEX["right_wrist"]


@pytest.fixture
def desk(tiny_body: BodyModel, tmp_path: Path) -> Iterator[Desk]:
    """Of a project with one fit."""
    folder = tmp_path / "walk.tcfit"
    Project.create(folder, small_clip(tiny_body)).close()
    with session_of(folder, tiny_body) as session:
        session.fit_everything(replace(QUICK, last_phase=1), kind="smplx", gender="neutral")
        idle(session)
        made = Desk(session, lambda: None)
        try:
            yield made
        finally:
            made.close()


def test_marked_keypoints_are_known_as_marked(desk: Desk):
    desk.session.edit(MarkBad(frames=(4,), joints=(WRIST,)), author="me")
    bad = desk.posed(newest(desk.session))().bad
    assert np.argwhere(bad).tolist() == [[4, WRIST]]


def test_what_was_imported_did_not_fail(desk: Desk):
    shown = newest(desk.session)
    assert desk.posed(shown)().frame_cost is not None
    assert desk.posed(replace(shown, run=replace(shown.run, kind="imported")))().frame_cost is None


def test_frames_that_looked_fine_are_looked_at_again_after_another_fit(desk: Desk, monkeypatch: pytest.MonkeyPatch):
    fine: list[frozenset[int]] = []

    def queue(posed: object, *, checked: frozenset[int]) -> tuple[()]:
        fine.append(checked)
        return ()

    monkeypatch.setattr(desk_module, "review_queue", queue)
    session, first = desk.session, newest(desk.session)
    session.mark([2, 5], "checked", author="me")
    until(session, lambda: desk.suspects(first) is not None)
    session.rerun_frames(first, replace(QUICK, last_phase=3), (range(4, 7),))
    idle(session)
    until(session, lambda: desk.suspects(newest(session)) is not None)
    until(session, lambda: desk.suspects(first) is not None)
    assert fine == [{2, 5}, {2}]


def test_what_is_there_is_not_made_again(desk: Desk, monkeypatch: pytest.MonkeyPatch):
    """The loop asks for everything at every draw: of a clip of 20,000 frames a single PosedFit takes 40 ms."""
    session, shown = desk.session, newest(desk.session)
    draws = {
        "curve": lambda: desk.curve("reprojection", shown),
        "queue": lambda: desk.suspects(shown),
        "figures": lambda: desk.metrics(shown),
        "ground": lambda: desk.ground(shown),
        "between": lambda: desk.between(shown, shown),
        "distances": lambda: desk.distances(shown, shown),
    }
    for draw in draws.values():
        until(session, lambda draw=draw: draw() is not None)

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("copied or read again")

    for owner, name in ((PosedFit, "posed"), (Corrected, "frozen"), (Corrected, "keypoints"), (Marks, "all")):
        monkeypatch.setattr(owner, name, refuse)
    assert [name for name, draw in draws.items() if draw() is None] == []


def test_nothing_waits_for_the_first_body(desk: Desk):
    shown = newest(desk.session)
    desk.warming = True
    assert desk.curve("reprojection", shown) is None and desk.suspects(shown) is None
    assert desk.problem("suspects", shown) == "" and desk.problem("metrics", shown) == ""
    desk.warm_up()
    until(desk.session, lambda: not desk.warming)
    until(desk.session, lambda: desk.curve("reprojection", shown) is not None)
