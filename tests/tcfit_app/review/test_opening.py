"""Opening a project: what is read ahead, the body that is on the page before the app, and the first picture."""

import gc
import platform
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

import cv2
import msgspec
import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz, write_npz
from tcfit_app.cli.review_command import body_ahead
from tcfit_app.fitting.bodies import Bodies, record_of
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.project import Project
from tcfit_app.project.storage.opening_body import OpeningBody, read_opening_body
from tcfit_app.review.app import ReviewApp, keep_opening_body
from tcfit_app.review.browser.channel import web_files
from tcfit_app.review.early_tabs import EarlyTabs
from tcfit_app.review.opening import load_app
from tcfit_app.review.session.session import Session
from tcfit_app.review.shared.drawing_data import DrawingData, FrameBody
from tcfit_app.server.serving import review_server
from tests.drivers.lone_page import sample_project
from tests.drivers.review_page import PATIENCE, opened, reviewing
from tests.drivers.waiting import until
from tests.samples.posed_clips import shipped_body
from tests.samples.project_samples import CONFIG, FRAMES, sample_clip
from tests.samples.sessions import QUICK, OneBody, small_clip
from tests.samples.spot_clips import empty_project, spot_video
from tests.samples.waving import waving_fit

if TYPE_CHECKING:
    from typing import Literal

    from playwright.sync_api import Browser

    Scheme = Literal["light", "dark"]


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


# --- the first picture ---


CORNERS = """
  window.corners = new Set();
  const look = () => {
    const layout = window.tcfit?.state?.("layout");
    let drawn = false;
    for (const [name, node] of Object.entries(window.__viserMutable?.nodeRefFromName ?? {}))
      if (name.endsWith("/video")) node?.traverse((child) => (drawn ||= Boolean(child.material?.map?.image?.width)));
    if (layout?.image && drawn) {
      const places = [tcfit.place(0, 0), tcfit.place(...layout.image)].flat().map(Math.round);
      corners.add([...places, Math.round(__viserMutable.canvas.getBoundingClientRect().bottom)].join(" "));
    }
    requestAnimationFrame(look);
  };
  look();
"""
"""Notes where the corners of the picture are, from when it is there."""


@pytest.mark.thorough
@pytest.mark.parametrize("size", [(720, 1280), (1280, 720)])
def test_the_first_picture_is_drawn_where_it_stays(browser: "Browser", tmp_path: Path, size: tuple[int, int]):
    clip = sample_clip()
    center = size[0] / 2, size[1] / 2
    folder = tmp_path / "clip.tcfit"
    Project.create(folder, replace(clip, camera=replace(clip.camera, size=size, center=center))).close()
    with reviewing(folder, browser) as first:
        review = opened(first.app, first.server, browser, script=CORNERS)
        review.tab.wait_for_function("corners.size > 0")
        review.tab.wait_for_selector("html.tcfit-ready", state="attached")
        review.rest()
        found = review.tab.evaluate("[...corners]")
        assert len(found) == 1, found
        left, top, right, bottom, end = map(int, found[0].split())
        assert (right - left) / (bottom - top) == pytest.approx(size[0] / size[1], rel=0.02) and bottom <= end


SEEN = """
  window.seen = new Set();
  const look = () => {
    requestAnimationFrame(look);
    if (!document.getElementById("unhurried"))
      document.head?.insertAdjacentHTML("beforeend", `<style id="unhurried">html::before { animation: none }</style>`);
    if (!document.querySelector("#root > *")) return;
    const { display, visibility, left, backgroundColor } = getComputedStyle(document.documentElement, "::before");
    const behind = display === "none" || visibility === "hidden" ? "nothing" : left === "0px" ? "all" : "panel";
    seen.add([behind, document.querySelector("[role=tab]") !== null, backgroundColor].join());
  };
  requestAnimationFrame(look);
"""
"""Notes, once viser has drawn something, what is behind the curtain, whether the panels are there, and its colour. The
curtain waits for them for as long as a slow machine takes."""
WHITE, DARK = "rgb(255, 255, 255)", "rgb(26, 27, 30)"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("scheme", "chosen", "color"),
    [("light", "", WHITE), ("dark", "", DARK), ("light", "dark", DARK), ("dark", "light", WHITE)],
)
def test_viser_s_own_panel_is_never_seen(browser: "Browser", tmp_path: Path, scheme: "Scheme", chosen: str, color: str):
    sample_project(tmp_path / "walk.tcfit", "first").close()
    with reviewing(tmp_path / "walk.tcfit", browser) as first:
        context = browser.new_context(viewport={"width": 960, "height": 640}, color_scheme=scheme)
        context.add_cookies([{"name": "tcfit-theme", "value": chosen, "url": first.server.gate.link}])
        tab = context.new_page()
        tab.add_init_script(SEEN)
        tab.goto(first.server.gate.link)
        tab.wait_for_selector("html.tcfit-ready", state="attached")
        seen = tab.evaluate("[...seen]")
        assert f"all,false,{color}" in seen and not [one for one in seen if one.startswith("nothing,false")]
        assert tab.evaluate("() => getComputedStyle(document.documentElement, '::before').display") == "none"


LATE_PICTURES = """
  const { get, set } = Object.getOwnPropertyDescriptor(HTMLImageElement.prototype, "src");
  Object.defineProperty(HTMLImageElement.prototype, "src", {
    get, set(value) { setTimeout(() => set.call(this, value), 1500); }
  });
"""
"""As in a browser that is busy: viser has drawn its nodes before their first pictures are decoded."""


@pytest.mark.thorough
def test_a_picture_that_comes_late_is_seen(browser: "Browser", tmp_path: Path):
    """Not the white of a material that was compiled before."""
    folder = tmp_path / "clip.tcfit"
    media = spot_video(tmp_path / "spots")
    empty_project(folder, media)
    with reviewing(folder, browser) as first:
        review = opened(first.app, first.server, browser, script=LATE_PICTURES)
        review.rest()
        width, height = review.session.project.clip.camera.size
        (left, top), (right, bottom) = (
            review.tab.evaluate("([x, y]) => tcfit.place(x, y)", corner) for corner in ([0, 0], [width, height])
        )

        def is_seen() -> bool:
            pixels = cv2.imdecode(np.frombuffer(review.tab.screenshot(), np.uint8), cv2.IMREAD_COLOR)
            assert pixels is not None
            shown = pixels[round(top) + 2 : round(bottom) - 2, round(left) + 2 : round(right) - 2]
            return shown.std() > 5 and np.median(shown) < 250

        until(is_seen, "the picture")


# --- what is read ahead ---


@pytest.fixture
def project(tmp_path: Path, tiny_body: BodyModel) -> Path:
    folder = tmp_path / "a.tcfit"
    Project.create(folder, small_clip(tiny_body)).close()
    return folder


def add_run(folder: Path, body: BodyModel) -> None:
    with Project.open(folder) as project:
        project.runs.start(QUICK, body=record_of(body), edits_seen=0)


def test_the_newest_run_s_body_is_read_once(project: Path, monkeypatch: pytest.MonkeyPatch):
    add_run(project, shipped_body())
    ahead = body_ahead(project)
    body = ahead.result(10)
    assert body is not None and body.hash == shipped_body().hash
    monkeypatch.setattr("tcfit_app.fitting.bodies.load_body", lambda path: pytest.fail("it was there"))
    bodies = Bodies(ahead=ahead)
    assert bodies.of(record_of(shipped_body())) is body
    assert bodies.find() is body


def test_another_body_is_not_taken_for_it(project: Path):
    ahead: Future[BodyModel | None] = Future()
    ahead.set_result(replace(shipped_body(), hash="another", source=Path("elsewhere.npz")))
    found = Bodies(ahead=ahead).of(record_of(shipped_body()))
    assert found.hash == shipped_body().hash


@pytest.mark.parametrize("source", ["", "gone/SMPLX_NEUTRAL.npz"])
def test_a_body_that_is_not_there_is_left_to_who_needs_it(project: Path, source: str):
    add_run(project, replace(shipped_body(), source=Path(source) if source else None))
    ahead = body_ahead(project)
    assert ahead.result(10) is None
    assert Bodies(ahead=ahead).of(record_of(shipped_body())).hash == shipped_body().hash


def test_without_a_run_or_a_project_nothing_is_read(project: Path, tmp_path: Path):
    assert body_ahead(project).result(10) is None
    assert body_ahead(tmp_path).result(10) is None
    (project / "project.sqlite").write_bytes(b"no database at all, whatever its name says" * 100)
    assert body_ahead(project).result(10) is None
    with pytest.raises(InputError):
        Project.open(project)


def test_a_damaged_body_file_is_left_to_who_needs_it(project: Path, tmp_path: Path):
    broken = tmp_path / "SMPLX_NEUTRAL.npz"
    np.savez(broken, nothing=np.zeros(3))
    add_run(project, replace(shipped_body(), source=broken))
    assert body_ahead(project).result(10) is None


def test_garbage_is_collected_again_after_loading():
    load_app()
    assert gc.isenabled()


HEAPS = """
import ctypes, threading
from tcfit_app.cli.main import main
main(['settings'])
libc = ctypes.CDLL(None)
libc.fdopen.restype, libc.fdopen.argtypes = ctypes.c_void_p, [ctypes.c_int, ctypes.c_char_p]
libc.malloc_info.argtypes, libc.fflush.argtypes = [ctypes.c_int, ctypes.c_void_p], [ctypes.c_void_p]
together = threading.Barrier(9)
def work():
    libc.malloc(5000)
    together.wait()
for _ in range(8):
    threading.Thread(target=work).start()
together.wait()
told = libc.fdopen(1, b"w")
libc.malloc_info(0, told)
libc.fflush(told)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="needs glibc's malloc")
def test_threads_share_heaps():
    """What a heap of its own keeps for each thread grows with every clip that is opened."""
    made = subprocess.run([sys.executable, "-c", HEAPS], capture_output=True, text=True, check=True)
    assert 1 <= made.stdout.count("<heap nr=") <= 2, made.stdout
