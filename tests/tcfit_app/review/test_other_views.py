"""Another view of the person: added, shown in step beside the picture, corrected there, and removed. No browser."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import viser
from scipy.spatial.transform import Rotation

from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.clip import OtherView, Relation
from fitting_core.clips import other_views
from fitting_core.clips.options import CameraOptions
from fitting_core.detect.detecting import DetectionProgress
from fitting_core.detect.found import Tell
from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT, INDEX, Keypoints
from tcfit_app.analysis.suspicion import ReviewQueue
from tcfit_app.analysis.view_scale import scale_of
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.project import Project
from tcfit_app.review.app import ReviewApp
from tcfit_app.review.browser.page_events import Drag, Key, Select
from tcfit_app.review.panels.correct.correct_panel import CorrectPanel
from tcfit_app.review.panels.fit.fit_panel import FitPanel
from tcfit_app.review.scene.other_view import other_camera
from tcfit_app.review.scene.poster import relief, world_of_pixels
from tcfit_app.review.session.session import Session
from tcfit_app.review.shared import drawing_data
from tcfit_app.review.tab.tab import Tab
from tests.drivers.lone_page import LonePage
from tests.drivers.raw_tab import RawTab, admitted, raw_tab
from tests.drivers.review_page import serving
from tests.drivers.waiting import until
from tests.samples.scenes import arms_in_motion, clip_of
from tests.samples.sessions import FRAMES, OneBody

TURN = Rotation.from_euler("y", 70, degrees=True).as_matrix()
SHIFT = np.array([-2.6, 0.1, 1.9])
CAMERA = Camera(focal=(700.0, 710.0), center=(330.0, 240.0), size=(640, 480))
LATER = 2
"""Frames by which the other clip starts later than the first."""
WRIST = INDEX["right_wrist"]


def second_view(body: BodyModel) -> OtherView:
    """The small clip's person as another camera has them, at twice the frame rate: each frame twice."""
    points, exists = keypoints_in_space(body, arms_in_motion(FRAMES))
    there = torch.as_tensor(np.nan_to_num(points) @ TURN.T + SHIFT)
    xy = project(CAMERA, there).numpy()[LATER:].repeat(2, axis=0)
    confidence = np.where(exists, 0.9, 0.0) * np.ones((len(xy), COUNT))
    clip = replace(clip_of(Keypoints(xy=xy, confidence=confidence), CAMERA), name="kitchen", frame_rate=50.0)
    a, b, c = (tuple(row) for row in TURN.tolist())
    x, y, z = SHIFT.tolist()
    relation = Relation(
        rotation=(a, b, c),
        translation=(x, y, z),
        offset=-LATER / 25,
        rotation_deviation=2.0,
        direction_deviation=1.0,
        offset_deviation=0.01,
        disagreement=0.004,
        overlap=(FRAMES - LATER) / 25,
        vertical_off=1.0,
    )
    return OtherView(clip=clip, relation=relation)


@pytest.fixture
def tested(tested: LonePage) -> LonePage:
    tested.only(FitPanel, CorrectPanel)
    return tested


def heard(tested: LonePage) -> dict[str, Any]:
    """The messages that the page has received, after it has drawn once more."""
    page = tested.page
    page.tab.look()
    assert page.picture.draw()
    return page.tab.channel._sent


def kinds(tested: LonePage) -> list[str]:
    return [poster.kind for poster in heard(tested)["layout"].posters]


def add(tested: LonePage, path: str = "/videos/kitchen.mp4") -> None:
    tested.page.tab.set(folds=frozenset({"fit.view"}))
    tested.draw()
    tested.enter("Video", path)
    tested.click("Add this view")
    tested.settle()


def key(tested: LonePage, action: str) -> None:
    tested.page.receive(Key(action=action, repeat=False))


def test_a_view_is_added_shown_in_step_corrected_and_removed(
    tested: LonePage, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    tab, made = tested.page.tab, second_view(tiny_body)
    project = tab.session.project
    monkeypatch.setattr(other_views, "read_view", lambda first, path, **more: made)
    assert kinds(tested) == ["picture", "side"]
    add(tested)

    (view,) = project.views
    assert tab.state.side_from == view.id and kinds(tested) == ["picture", "view"]
    assert project.clip.views[0].relation == made.relation, "the next fit takes it"
    shown = tested.html()
    assert "kitchen" in shown and "70°" in shown and "0.08 s later" in shown
    told_now = heard(tested)
    assert told_now["view"].image == CAMERA.size and told_now["layout"].posters[1].label.endswith("moment")
    assert not any(told_now["view_keypoints"].confidence), "the other clip begins later"
    for frame in (LATER, LATER + 3):
        tab.seek(frame)
        points = heard(tested)["view_keypoints"]
        assert points.frame == 2 * (frame - LATER)
        assert np.allclose(points.xy, made.clip.keypoints.xy[points.frame], atol=0.01)

    before, own = view.corrected.records.tobytes(), project.corrected.records.tobytes()
    tested.page.receive(Select((WRIST,), "replace", view=True))
    for phase in ("start", "move", "end"):
        tested.page.receive(Drag(phase, (WRIST,), 5.0, -3.0, LATER + 3, view=True))
    points = heard(tested)["view_keypoints"]
    assert np.allclose(points.xy[WRIST], made.clip.keypoints.xy[6, WRIST] + (5.0, -3.0), atol=0.01)
    assert points.edited == (WRIST,) and "in kitchen" in tested.html()
    key(tested, "bad")
    assert heard(tested)["view_keypoints"].bad == (WRIST,)
    with pytest.raises(InputError, match="kitchen can be dragged"):
        key(tested, "interpolate")
    assert project.corrected.records.tobytes() == own, "the first clip's keypoints are as they were"
    key(tested, "undo")
    key(tested, "undo")
    (view,) = project.views
    assert view.corrected.records.tobytes() == before

    tested.click("Remove")
    assert not project.views and not project.clip.views and kinds(tested) == ["picture", "side"]
    key(tested, "undo")
    assert [one.id for one in project.views] == [view.id] and kinds(tested) == ["picture", "view"]
    key(tested, "turn_side")
    assert kinds(tested) == ["picture", "side"], "the side view is the next"


def test_why_a_video_is_refused_stays_on_show(tested: LonePage, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch):
    reason = "kitchen.mp4 is no other view of this clip: expected the same person at the same time."

    def refuse(*given: Any, **more: Any) -> OtherView:
        raise InputError(reason)

    monkeypatch.setattr(other_views, "read_view", refuse)
    add(tested)
    assert reason in tested.html() and tested.notices[-1].text == reason
    assert not tested.page.tab.session.project.views and tested.page.tab.state.side_from == "right"


def test_a_view_that_is_being_read_is_given_up(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    project, steps = tested.page.tab.session.project, list[int]()

    def endless(first: Any, path: Path, *, clip: Any, camera: Any, tell: Tell) -> OtherView:
        while True:
            steps.append(len(steps))
            tell(DetectionProgress(done=12, total=60, kept=0))

    monkeypatch.setattr(other_views, "read_view", endless)
    tested.page.tab.set(folds=frozenset({"fit.view"}))
    tested.page.gestures.views.add(Path("/videos/kitchen.mp4"))
    tested.until(lambda: steps)
    assert "Adding kitchen.mp4: 12 of 60 frames" in tested.html()
    with pytest.raises(InputError, match="wait for it"):
        tested.page.gestures.views.add(Path("/videos/hall.mp4"))
    tested.click("Cancel")
    tested.settle()
    assert not project.views and project.last_edit == 0


def test_an_upload_is_read_under_its_own_name_and_kept_in_the_project(
    tested: LonePage, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    seen, project = list[tuple[str, bytes, float]](), tested.page.tab.session.project

    def read(first: Any, path: Path, *, camera: CameraOptions, **more: Any) -> OtherView:
        seen.append((path.name, path.read_bytes(), camera.focal_length_35mm or 0.0))
        made = second_view(tiny_body)
        return replace(made, clip=replace(made.clip, source=path, name=path.stem))

    monkeypatch.setattr(other_views, "read_view", read)
    upload = viser.UploadedFile(name="../../My kitchen.MOV", content=b"frames")
    for wrong in ("wide", "-26"):
        with pytest.raises(InputError, match=f"Focal length: {wrong}; expected millimetres"):
            tested.page.gestures.views.add(upload, wrong)
    tested.page.gestures.views.add(upload, "26")
    tested.settle()
    assert seen == [("_.._My kitchen.MOV", b"frames", 26.0)]
    (view,) = project.views
    assert view.view.clip.name == "_.._My kitchen" and view.media.path is not None
    assert view.media.path.is_relative_to(project.folder) and view.media.path.read_bytes() == b"frames"


def test_an_upload_that_breaks_off_leaves_nothing_and_the_next_one_is_read(
    fitted_walk: Path, tiny_body: BodyModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The connection ends after one of two parts; the user comes back and uploads the file again."""
    folder, part, begun = Path(shutil.copytree(fitted_walk, tmp_path / "walk.tcfit")), bytes(512 << 10), list[str]()

    def read(first: Any, path: Path, **more: Any) -> OtherView:
        begun.append(path.name)
        assert path.read_bytes() == 2 * part
        return second_view(tiny_body)

    def upload(tab: RawTab, *parts: bytes) -> None:
        made = [message for message in tab.messages if message["type"] == "GuiUploadButtonMessage"]
        field = next(message["uuid"] for message in made if message["props"]["label"] == "Upload a video")
        about = {"source_component_uuid": field, "transfer_uuid": "kitchen"}
        start = {"filename": "kitchen.mp4", "mime_type": "", "part_count": 2, "size_bytes": 2 * len(part)}
        tab.send({"type": "FileTransferStartUpload", **about, **start})
        for index, content in enumerate(parts):
            tab.send({"type": "FileTransferPart", **about, "part_index": index, "content": content})

    def files() -> set[Path]:
        return {path for path in folder.rglob("*") if not path.name.startswith("project.sqlite")}

    monkeypatch.setattr(other_views, "read_view", read)
    with (
        Project.open(folder) as project,
        serving("test", lambda server: ReviewApp(Session(project, OneBody(tiny_body)), server.viser)) as (app, server),  # pyright: ignore[reportArgumentType]
    ):
        cookie, before = admitted(server.gate.link), files()

        def opened(tab: RawTab) -> Tab:
            tab.open("the same")
            page = app.pages[max(app.pages)]
            app.post(lambda: page.tab.set(folds=frozenset({"fit.view"})))
            until(lambda: "Add this view" in str(tab.messages), "the field")
            return page.tab

        with raw_tab(server.address.url, cookie) as tab:
            opened(tab)
            upload(tab, part)
            until(lambda: any(message["type"] == "FileTransferPartAck" for message in tab.messages), "the first part")
        until(lambda: not app.pages, "the end of the tab")
        assert not begun and files() == before and not project.views and not app.session.tasks.busy
        with raw_tab(server.address.url, cookie) as tab:
            opened(tab)
            upload(tab, part, part)
            until(lambda: project.views, "the view")
        assert begun == ["kitchen.mp4"]


def test_frames_that_look_fine_stay_so_until_the_fit_moves(
    tested: LonePage, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    """Another view changes what all frames are fitted to, but no fit before the next one."""
    tab, asked = tested.page.tab, list[frozenset[int]]()
    project, shown = tab.session.project, tested.shown

    def queue(found: Any, *, checked: frozenset[int], limbs: Any) -> ReviewQueue:
        asked.append(checked)
        return ReviewQueue(left=(), looked_at=0)

    def fine() -> frozenset[int]:
        tested.until(lambda: tab.data.queue(shown) is not None)  # pyright: ignore[reportArgumentType]
        return asked[-1]

    monkeypatch.setattr(drawing_data, "review_queue", queue)
    project.marks.set([1, 2], "checked", author="me")
    project.add_view(second_view(tiny_body))
    assert fine() == {1, 2}
    project.undo()
    assert fine() == {1, 2}
    project.append(MarkBad(frames=(1,), joints=(WRIST,)))
    assert fine() == {2}
    run = tested.fit()
    shown = tab.session.fits.show(FitChoice(run=run.id))
    assert shown is not None and fine() == frozenset()


def test_the_body_stays_in_place_in_the_other_view_while_its_distance_is_computed(
    tested: LonePage, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    data, view = tested.page.tab.data, second_view(tiny_body)

    def scale() -> float:
        return data.view_scale(view, tested.shown)

    monkeypatch.setattr(drawing_data, "scale_of", lambda *given: 1.25)
    assert scale() == 1.0
    tested.until(lambda: scale() == 1.25)
    tested.fit()
    assert scale() == 1.25, "that of the new fit is not known yet"


def test_the_body_is_drawn_where_the_other_camera_has_it(tiny_body: BodyModel):
    view = second_view(tiny_body)
    points = keypoints_in_space(tiny_body, arms_in_motion(FRAMES))[0][:, :25]
    for size in (1.0, 1.25):  # a person of another height, as far away as that makes them
        scale = scale_of(view, size * points, np.arange(FRAMES) / 25)
        assert scale == pytest.approx(size, abs=1e-6)
        camera = other_camera(view, scale)
        known = np.isfinite(points[LATER]).all(-1)
        (drawn,) = relief([camera.seen(size * points[LATER][known])], CAMERA)
        expected = world_of_pixels(view.clip.keypoints.xy[0, :25][known], CAMERA.size)
        assert drawn[:, :2] == pytest.approx(expected, abs=1e-4)
