"""What an open project keeps in memory while it is edited."""

import gc
from pathlib import Path

import pytest

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.results.fit_result import FitResult
from tcfit_app.fitting import edit_follower
from tcfit_app.project.edits.kinds import Nudge
from tcfit_app.project.project import Project
from tcfit_app.review.shared.drawing_data import DrawingData
from tests.samples.sessions import QUICK, idle, newest, session_of, small_clip, until

EDITS = 6


def fits_alive() -> int:
    gc.collect()
    return sum(type(one) is FitResult for one in gc.get_objects())


def test_edits_leave_no_fits_in_memory_but_those_of_runs(
    tiny_body: BodyModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(edit_follower, "SETTLING", 0.0)
    Project.create(tmp_path / "a.tcfit", small_clip(tiny_body)).close()
    with session_of(tmp_path / "a.tcfit", tiny_body) as session:
        data, before = DrawingData(session, lambda: None), fits_alive()
        session.fit_everything(QUICK, kind="smplx", gender="neutral")
        idle(session)
        for frame in range(EDITS):
            edit = Nudge(frames=(frame,), joints=(kp.INDEX["right_wrist"],), by=(25.0, 0.0))
            session.edit(edit, author="me", shown=newest(session))
            idle(session)
            until(session, lambda: data.queue(newest(session)) is not None)
        kept = fits_alive() - before
        runs = len(session.fits.runs)
        data.close()
    assert runs == 2 and kept <= runs + 1, "and the worker's last job"
