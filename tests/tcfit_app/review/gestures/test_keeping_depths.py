"""Depths, keyframes, pins and locks that are kept for the whole clip, with the panel's buttons.

The fit uses the lifter.
"""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import viser

from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.errors import InputError
from fitting_core.keypoints import BODY, INDEX, RIGHT_HAND
from fitting_core.results.fit_result import FitResult
from tcfit_app.fitting import edit_follower
from tcfit_app.project.edits.kinds import Keep, Lock, Pin, PlaceKey, Release, SetDepth, Unlock
from tcfit_app.project.project import Project
from tcfit_app.review.panels.correct.correct_panel import CorrectPanel
from tcfit_app.review.tab.state import FitSettings
from tcfit_app.review.tab.tab import Tab
from tests.drivers.lone_page import LonePage, lone_page
from tests.samples.project_samples import assert_same_fit
from tests.samples.scenes import arms_in_motion, let_lift
from tests.samples.sessions import QUICK, OneBody, small_clip

FRAMES = 24
LIFTED = replace(QUICK, weights=replace(QUICK.weights, relative_position=(6.0,) * 5))
ELBOW, WRIST, HIP = (INDEX[f"right_{name}"] for name in ("elbow", "wrist", "hip"))
BY = 0.15


@contextmanager
def opened(folder: Path, body: BodyModel, server: viser.ViserServer) -> Iterator[LonePage]:
    with Project.open(folder) as project, lone_page(server, project, bodies=OneBody(body)) as made:
        made.only(CorrectPanel)
        made.page.tab.set(settings=FitSettings(config=LIFTED, preset="paper"), folds=frozenset({"depth"}))
        yield made


@pytest.fixture(scope="module", autouse=True)
def lifter(tiny_body: BodyModel) -> Iterator[None]:
    """It is right of this body, and states 10 cm."""
    params = arms_in_motion(FRAMES)
    points = keypoints_in_space(tiny_body, params)[0][:, BODY] - joints_in_space(tiny_body, params)[:, :1]
    with pytest.MonkeyPatch.context() as patch:
        let_lift(patch, np.nan_to_num(points))
        yield


@pytest.fixture(scope="module")
def lifted(
    lifter: None, tiny_body: BodyModel, tmp_path_factory: pytest.TempPathFactory, panel_server: viser.ViserServer
) -> Path:
    """A project with a fit; not to be changed."""
    folder = tmp_path_factory.mktemp("lifted") / "walk.tcfit"
    Project.create(folder, small_clip(tiny_body, FRAMES)).close()
    with opened(folder, tiny_body, panel_server) as made:
        made.page.tab.session.fit_everything(LIFTED, kind="smplx", gender="neutral")
        followed(made)
    return folder


@pytest.fixture
def folder(lifted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(edit_follower, "SETTLING", 0.0)
    monkeypatch.setattr(edit_follower, "MOST_FOLLOWED", 15)  # fewer than the clip's
    return Path(shutil.copytree(lifted, tmp_path / "walk.tcfit"))


@pytest.fixture
def tested(folder: Path, tiny_body: BodyModel, panel_server: viser.ViserServer) -> Iterator[LonePage]:
    with opened(folder, tiny_body, panel_server) as made:
        yield made


def followed(tested: LonePage) -> FitResult:
    session = tested.page.tab.session
    tested.until(lambda: not session.jobs and not session.edit_follower.lags)
    return session.fits.fit(tested.shown.run)


def depths(fit: FitResult, body: BodyModel) -> np.ndarray:
    """Behind the pelvis, metres, (T, 137)."""
    params = fit.last.params
    return keypoints_in_space(body, params)[0][..., 2] - joints_in_space(body, params)[:, :1, 2]


def places(fit: FitResult, body: BodyModel, tab: Tab) -> np.ndarray:
    """The wrist of a fit in the picture, pixels, (T, 2)."""
    points, camera = keypoints_in_space(body, fit.last.params)[0][:, WRIST], tab.session.project.clip.camera
    return points[..., :2] / points[..., 2:] * camera.focal + camera.center


def place(project: Project, frame: int, joints: tuple[int, ...], xy: np.ndarray) -> None:
    """Set a keyframe that no other frame follows."""
    place = tuple((float(x), float(y)) for x, y in xy.reshape(-1, 2))
    project.append(PlaceKey(frames=(frame,), joints=joints, at=frame, xy=place))


def kept(tested: LonePage) -> Keep:
    edit = tested.page.tab.session.project.log[-1].action
    assert isinstance(edit, Keep)
    return edit


def test_two_depths_are_kept_undone_redone_saved_and_removed(
    folder: Path, tested: LonePage, tiny_body: BodyModel, panel_server: viser.ViserServer
):
    tab, project = tested.page.tab, tested.page.tab.session.project
    before = depths(followed(tested), tiny_body)[:, WRIST]
    tab.set(selection=(WRIST,), frame=2)
    assert "Keep for" not in tested.html(), "there is nothing to keep"
    for frame in (2, 21):
        tab.session.edit(
            SetDepth(frames=(frame,), joints=(WRIST,), depth=((float(before[frame]) + BY,),)),
            author=tab.author,
            shown=tab.look().b,
        )
        alone = followed(tested)
    tested.click("Keep for the whole clip")
    edit = kept(tested)
    assert (edit.frames, edit.joints, edit.at) == (tuple(range(FRAMES)), (WRIST,), (2, 21))
    assert tab.message[0] == "Saved: right wrist depth of frames 2, 21 kept as an offset, frames 0–23"
    offset = followed(tested)
    moved, there = (depths(fit, tiny_body)[:, WRIST] - before for fit in (offset, alone))
    assert abs(there[8:16]).max() < 0.1 * BY < 0.3 * BY < moved[8:16].min(), "far from both frames"
    assert "It has a kept offset." in tested.html()
    tested.press("action", "undo")
    assert_same_fit(followed(tested), alone)
    tested.press("action", "redo")
    assert_same_fit(followed(tested), offset)
    with Project.open(folder, read_only=True) as copy:
        assert copy.clip.keypoints.kept == edit.kept == project.clip.keypoints.kept
    tested.click("Remove the offset")
    assert project.log[-1].action == Release(frames=edit.frames, joints=(WRIST,))
    moved = depths(followed(tested), tiny_body)[:, WRIST] - before
    assert abs(moved[8:16]).max() < 0.1 * BY and project.clip.keypoints.kept == ()
    assert "Remove the offset" not in tested.html()


def test_an_offset_of_selected_frames_holds_in_these(tested: LonePage, tiny_body: BodyModel):
    tab, before = tested.page.tab, depths(followed(tested), tiny_body)[:, WRIST]
    tab.session.project.append(SetDepth(frames=(4,), joints=(WRIST,), depth=((float(before[4]) + BY,),)))
    tab.set(selection=(WRIST,), frames=range(10, 20), frame=12)
    assert "Keep for" not in tested.html(), "the depth is of another frame"
    tab.set(frames=range(0, 12), frame=4)
    tested.click("Keep for the selected frames")
    assert kept(tested).frames == tuple(range(12)) and kept(tested).at == (4,)
    moved = depths(followed(tested), tiny_body)[:, WRIST] - before
    assert moved[:8].min() > 0.3 * BY > abs(moved[18:]).max()


def test_a_pin_and_a_lock_are_kept(tested: LonePage, tiny_body: BodyModel):
    """Of the lock, what its rotation makes of the keypoints beyond."""
    tab, project = tested.page.tab, tested.page.tab.session.project
    tab.session.edit_follower.after_edits = False
    found = depths(followed(tested), tiny_body)
    project.append(Pin(frames=(3, 4), joints=(WRIST,), xy=((300.0, 200.0),), depth=((0.1,), (0.2,))))
    tab.set(selection=(ELBOW, WRIST), frame=3)
    tested.press("action", "keep")
    assert (kept(tested).joints, kept(tested).depth) == ((WRIST,), ((0.1,), (0.2,)))
    project.append(Lock(frames=(7, 8), joints=(HIP,), turn=((0.1, 0.0, 0.0),)))
    tab.set(selection=(HIP,))
    tested.press("action", "keep")
    edit = kept(tested)
    beyond = [INDEX[f"right_{name}"] for name in ("knee", "ankle", "big_toe", "small_toe", "heel")]
    assert {*edit.joints} <= {*beyond} and {*beyond[:2]} <= {*edit.joints} and edit.at == (7, 8)
    stated = np.array(edit.depth, float)
    np.testing.assert_allclose(stated, found[[7, 8]][:, list(edit.joints)], atol=1e-4)


def test_keyframes_are_kept_as_an_offset_in_the_picture(tested: LonePage, tiny_body: BodyModel):
    """Of body keypoints that were detected; with depths of the same frames, where there are any."""
    tab, project = tested.page.tab, tested.page.tab.session.project
    before = places(followed(tested), tiny_body, tab)
    detected = project.detected.xy[4, [WRIST, ELBOW]]
    for frame, by in ((4, (15.0, 9.0)), (20, (17.0, 5.0))):
        place(project, frame, (WRIST,), project.detected.xy[frame, WRIST] + by)
    tab.set(selection=(WRIST, RIGHT_HAND.start), frame=4)
    alone = followed(tested)
    tested.click("Keep for the whole clip")
    edit = kept(tested)
    assert (edit.joints, edit.at, edit.depth) == ((WRIST,), (4, 20), ((None,), (None,)))
    np.testing.assert_allclose(np.array(edit.shift)[:, 0], [(15, 9), (17, 5)], atol=0.01)
    assert tab.message[0] == "Saved: right wrist place of frames 4, 20 kept as an offset, frames 0–23"
    moved = places(followed(tested), tiny_body, tab) - before
    assert moved[9:16].min(0)[0] > 2.0, "far from both frames"
    offset = followed(tested)
    tested.press("action", "undo")
    assert_same_fit(followed(tested), alone)
    tested.press("action", "redo")
    assert_same_fit(followed(tested), offset)
    project.append(SetDepth(frames=(4,), joints=(WRIST,), depth=((0.2,),)))
    place(project, 4, (ELBOW,), detected[1])
    tab.set(selection=(WRIST, ELBOW))
    tested.press("action", "keep")
    edit = kept(tested)
    assert edit.joints == (WRIST,) and edit.depth == ((0.2,), (None,)), "a keyframe where it was detected says nothing"
    assert edit.shift[0] == ((15.0, 9.0),)
    assert tab.message[0] == "Saved: right wrist depth and place of frames 4, 20 kept as an offset, frames 0–23"
    with Project.open(project.folder, read_only=True) as copy:
        assert copy.clip.keypoints.kept == project.clip.keypoints.kept and len(copy.clip.keypoints.kept) == 2


def test_a_stiff_joint_is_locked_in_all_frames_and_unlocked(tested: LonePage):
    tab, project = tested.page.tab, tested.page.tab.session.project
    tab.session.edit_follower.after_edits = False
    shown = followed(tested).last.params.body_pose[5].view(-1, 3)[JOINT["right_elbow"] - 1]
    tab.set(selection=(ELBOW, WRIST), frame=5)
    tested.click("Lock in all frames")
    assert project.corrected.locked[:, [ELBOW, WRIST]].all() and project.corrected.locked.sum() == 2 * FRAMES
    np.testing.assert_allclose(project.corrected.turn[:, ELBOW], np.tile(shown, (FRAMES, 1)), atol=1e-5)
    assert tab.message[0] == "Saved: right elbow, right wrist rotation locked, frames 0–23"
    tested.press("action", "undo")
    assert not project.corrected.locked.any() and "Unlock in all frames" not in tested.html()
    tested.press("action", "redo")
    tested.click("Unlock in all frames")
    assert project.log[-1].action == Unlock(frames=tuple(range(FRAMES)), joints=(ELBOW, WRIST))
    assert not project.corrected.locked.any() and "Lock in all frames" in tested.html()


def test_what_cannot_be_kept(tested: LonePage):
    tab = tested.page.tab
    tab.set(selection=(WRIST,), frame=3)
    with pytest.raises(InputError, match="There is nothing to keep: first set a depth"):
        tested.press("action", "keep")
    with pytest.raises(InputError, match="No offset of the selected keypoints is kept here"):
        tested.press("action", "release")
    tab.session.project.append(Lock(frames=(3,), joints=(WRIST,), turn=((0.1, 0.0, 0.0),)))
    with pytest.raises(InputError, match="There is nothing to keep"):
        tested.press("action", "keep")
