"""The body that a project opens with is on the page before the app is loaded, and never one that no longer holds."""

import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

import cv2
import msgspec
import numpy as np
import pytest

from fitting_core.files.npz import read_npz, write_npz
from tcfit_app.fitting.bodies import Bodies, record_of
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.project import Project
from tcfit_app.project.storage.opening_body import OpeningBody, read_opening_body
from tcfit_app.review.app import ReviewApp, keep_opening_body
from tcfit_app.review.browser.channel import web_files
from tcfit_app.review.early_tabs import EarlyTabs
from tcfit_app.review.session.session import Session
from tcfit_app.review.shared.drawing_data import DrawingData, FrameBody
from tcfit_app.server.serving import review_server
from tests.drivers.review_page import PATIENCE, until
from tests.samples.posed_clips import shipped_body
from tests.samples.project_samples import CONFIG, FRAMES, sample_clip
from tests.samples.sessions import OneBody
from tests.samples.waving import waving_fit

if TYPE_CHECKING:
    from playwright.sync_api import Browser


def project_of_a_walk(root: Path) -> Path:
    """A project of two runs and two edits, with pictures; it was opened and closed."""
    (root / "images").mkdir(parents=True)
    for number in range(sample_clip().first_frame + FRAMES):
        cv2.imwrite(str(root / "images" / f"{number}.png"), np.full((480, 640, 3), 10 * number, np.uint8))
    (root / "model.npz").touch()
    record = msgspec.structs.replace(record_of(shipped_body()), source=str(root / "model.npz"))
    with Project.create(root / "walk.tcfit", replace(sample_clip(), source=root / "images")) as project:
        for name, shift in (("near", 0.0), ("far", 2.0)):
            run = project.runs.start(CONFIG, body=record, edits_seen=0, name=name)
            project.runs.finish(run.id, waving_fit(shift))
        for frame in (0, 1):
            project.append(MarkBad(frames=(frame,), joints=(4,)), author="me")
    close_app(root / "walk.tcfit")
    return root / "walk.tcfit"


@contextmanager
def drawing(folder: Path) -> Iterator[tuple[DrawingData, FrameBody]]:
    """What an app draws from, and the body on show."""
    with Project.open(folder) as project:
        data = DrawingData(Session(project, cast(Bodies, OneBody(shipped_body()))), lambda: None)
        shown = data.session.fits.show(FitChoice())
        assert shown is not None
        yield data, FrameBody(shown=shown, frame=0)
        data.session.close()
        data.close()


def close_app(folder: Path) -> np.ndarray:
    """Open and close a project; returns the body that was on show."""
    with drawing(folder) as (data, body):
        keep_opening_body(data)
        return data.vertices(body)


def stored(folder: Path) -> OpeningBody | None:
    found = read_opening_body(folder)
    return None if found is None else found[0]


def test_what_is_stored_is_what_a_project_opens_with(tmp_path: Path):
    folder = project_of_a_walk(tmp_path)
    found = read_opening_body(folder)
    assert found is not None
    body, source, first = found
    assert (source, first, body.run) == (tmp_path / "images", sample_clip().first_frame, 2)
    with drawing(folder) as (data, shown):
        assert np.abs(body.vertices - data.vertices(shown)).max() < 2e-5
        np.testing.assert_array_equal(body.faces, data.meshes(shown.shown).faces)
        assert body.opacities is not None and body.opacities.min() < 255, "a keypoint is marked bad"
        assert (body.camera, body.fit_camera) == (data.session.project.footage.camera, shown.shown.camera)
    assert stored(folder) is not None, "opening changes nothing"


def edit(folder: Path) -> None:
    with Project.open(folder) as project:
        project.append(MarkBad(frames=(0,), joints=(7,)), author="me")


def undo(folder: Path) -> None:
    with Project.open(folder) as project:
        assert project.undo(author="me")


def delete_the_newest(folder: Path) -> None:
    with Project.open(folder) as project:
        project.runs.delete(2)


def fit_again(folder: Path) -> None:
    with Project.open(folder) as project:
        run = project.runs.start(CONFIG, body=project.runs.get(1).body, edits_seen=0)
        project.runs.finish(run.id, waving_fit(1.0))


def put_another_result(folder: Path) -> None:
    shutil.copyfile(folder / "runs" / "000001.npz", folder / "runs" / "000002.npz")


def touch_the_model(folder: Path) -> None:
    (folder.parent / "model.npz").write_bytes(b"another")


def edit_arrays(**changes: np.ndarray) -> Callable[[Path], None]:
    return lambda folder: write_npz(folder / "opening.npz", read_npz(folder / "opening.npz") | changes)


def cut_off(folder: Path) -> None:
    content = (folder / "opening.npz").read_bytes()
    (folder / "opening.npz").write_bytes(content[: len(content) // 2])


@pytest.mark.parametrize(
    "change",
    [
        edit,
        undo,
        delete_the_newest,
        fit_again,
        put_another_result,
        touch_the_model,
        edit_arrays(faces=np.full((4, 3), 2**20)),
        edit_arrays(bounds=np.full((2, 3), np.nan)),
        edit_arrays(opacities=np.zeros(3, np.uint8)),
        edit_arrays(about=np.array('{"format": "tcfit opening 0"}')),
        cut_off,
        lambda folder: (folder / "opening.npz").unlink(),
    ],
)
def test_a_body_that_no_longer_holds_is_not_used(tmp_path: Path, change: Callable[[Path], None]):
    folder = project_of_a_walk(tmp_path)
    assert stored(folder) is not None
    change(folder)
    assert stored(folder) is None
    vertices, body = close_app(folder), stored(folder)
    assert body is not None and np.abs(body.vertices - vertices).max() < 2e-5


WATCH = """
  window.__seen = [];
  const look = () => {
    const nodes = Object.entries(window.__viserSceneTree?.getState?.() ?? {});
    const body = nodes.find(([name]) => name === "/posters/0/body0")?.[1].message.props;
    const place = window.tcfit?.place?.(0, 0);
    const now = JSON.stringify([Boolean(body), body?.visible ?? true, place ? place.map(Math.round) : null]);
    if (__seen.at(-1) !== now) __seen.push(now);
    requestAnimationFrame(look);
  };
  look();
"""
"""Notes whether the body is there, and where the picture's corner is, whenever either changes."""
BODY = """() => {
  const props = window.__viserSceneTree.getState()["/posters/0/body0"]?.message.props;
  return props && [...new Float32Array(props.vertices.slice().buffer)];
}"""


def test_the_app_takes_over_what_is_on_the_page(browser: "Browser", tmp_path: Path):
    folder = project_of_a_walk(tmp_path)
    with review_server("test", port=0, open_browser=False, scripts=web_files(), say=lambda text: None) as server:
        early = EarlyTabs(server.viser, folder)
        tab = browser.new_context(viewport={"width": 960, "height": 640}).new_page()
        tab.add_init_script(WATCH)
        tab.goto(server.gate.link)
        tab.wait_for_selector("html.tcfit-drawn", state="attached")
        before = np.array(tab.wait_for_function(BODY).json_value()).reshape(-1, 3)
        assert len(before) == len(shipped_body().template)
        with Project.open(folder) as project:
            app = ReviewApp(Session(project, cast(Bodies, OneBody(shipped_body()))), server.viser, early=early)
            thread = threading.Thread(target=app.run)
            thread.start()
            try:
                tab.wait_for_selector("html.tcfit-ready", state="attached")
                after = np.array(tab.evaluate(BODY)).reshape(-1, 3)
                assert np.abs(after - before).max() < 1e-4 and (after != before).any(), "the live one replaces it"
                seen = tab.evaluate("() => __seen.map(JSON.parse)")
                drawn = [look for look in seen if look[0]]
                assert seen[-len(drawn) :] == drawn and len({str(place) for *_, place in drawn}) == 1, seen
                app.post(lambda: app.pages[0].tab.set(b=FitChoice(run=1)))
                until(lambda: np.abs(np.array(tab.evaluate(BODY)).reshape(-1, 3) - before).max() > 0.01, "another fit")
            finally:
                app.stop()
                thread.join(PATIENCE)
                app.close()
                tab.context.close()
