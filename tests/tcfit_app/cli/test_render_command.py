"""`tcfit render`: pictures that show the body where it is, from all sides; sheets and videos; and what is refused."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.camera import World, project
from fitting_core.io.result_files import write_result
from fitting_core.render import renderer
from fitting_core.render.sheets import View
from fitting_core.video.frames import FrameSource
from tcfit_app.cli.main import main
from tests.samples.media import write_video
from tests.samples.project_samples import sample_clip
from tests.samples.waving import waving_fit, waving_project

needs_gl = pytest.mark.usefixtures("off_screen_gl")


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory, free_body: BodyModel) -> Path:
    folder = tmp_path_factory.mktemp("result") / "fit"
    write_result(folder, waving_fit(2.0), sample_clip(), free_body)
    return folder


@pytest.fixture(scope="module")
def project_folder(tmp_path_factory: pytest.TempPathFactory, free_body: BodyModel) -> Path:
    """Two runs, "near" and "far", without a video."""
    return waving_project(tmp_path_factory.mktemp("project") / "walk.tcfit", free_body)


def drawn(path: Path, out: Path, *options: str) -> np.ndarray:
    """The RGB picture that is written."""
    assert main(["render", str(path), "--out", str(out), *options]) == 0
    return cv2.imread(str(out))[..., ::-1]


def body_of(picture: np.ndarray) -> np.ndarray:
    """Where something else than white is."""
    return (picture < 250).any(-1)


@needs_gl
def test_the_picture_has_the_body_where_the_camera_saw_it(result: Path, tmp_path: Path, free_body: BodyModel):
    shape = drawn(
        result, tmp_path / "a.png", "--no-video", "--view", "picture", "--frames", "9", "--size", "240", "240"
    )
    assert shape.shape == (240, 320, 3)
    fit = waving_fit(2.0)
    vertices = fit.last.params[2:3]
    from fitting_core.body.mesh import Mesh

    pixels = project(fit.camera, Mesh(free_body)(vertices)[0]).numpy() / 2
    seen = body_of(shape)
    inside = [seen[int(y), int(x)] for x, y in pixels if 0 <= x < 320 and 0 <= y < 240]
    assert np.mean(inside) > 0.97
    columns, rows = np.flatnonzero(seen.any(0)), np.flatnonzero(seen.any(1))
    assert abs(columns[0] - pixels[:, 0].min()) < 2 and abs(rows[0] - pixels[:, 1].min()) < 2


@needs_gl
def test_a_result_is_drawn_over_its_video_wherever_both_go(tmp_path: Path, free_body: BodyModel):
    (tmp_path / "made").mkdir()
    video = write_video(tmp_path / "made" / "walk.mp4", frames=20, size=(640, 480))
    write_result(tmp_path / "made" / "fit", waving_fit(2.0), replace(sample_clip(), source=video), free_body)
    (tmp_path / "made").rename(tmp_path / "moved")
    over = drawn(tmp_path / "moved" / "fit", tmp_path / "a.png", "--size", "240", "240")
    bare = drawn(
        tmp_path / "moved" / "fit", tmp_path / "b.png", "--size", "240", "240", "--no-video", "--view", "picture"
    )
    assert over.shape == bare.shape and not np.array_equal(over[0, 0], bare[0, 0])
    (tmp_path / "moved" / "walk.mp4").unlink()
    assert drawn(tmp_path / "moved" / "fit", tmp_path / "c.png", "--size", "240", "240").shape == (240, 240, 3)
    (tmp_path / "moved" / "fit" / "summary.json").write_text('{"video": 3}')
    assert drawn(tmp_path / "moved" / "fit", tmp_path / "d.png", "--size", "240", "240").shape == (240, 240, 3)


@needs_gl
def test_sides_are_told_apart_and_nothing_is_cut(result: Path, tmp_path: Path):
    plain = ["--no-floor", "--size", "200", "300", "--frames", "7"]
    widths = {}
    for view in ("front", "side", "top"):
        seen = body_of(drawn(result, tmp_path / f"{view}.png", *plain, "--view", view))
        assert not (seen[0].any() or seen[-1].any() or seen[:, 0].any() or seen[:, -1].any())
        widths[view] = seen.any(0).sum(), seen.any(1).sum()
    assert widths["front"][0] > 1.5 * widths["side"][0], "arms stretched out are wide from the front"
    assert widths["front"][1] > 2 * widths["top"][1] / 2 and widths["top"][0] > 1.5 * widths["top"][1]
    mirrored = drawn(result, tmp_path / "m.png", *plain, "--azimuth", "180")
    assert (
        np.abs(body_of(mirrored)[:, ::-1].sum(0) - body_of(drawn(result, tmp_path / "f.png", *plain)).sum(0)).max() < 9
    )


@needs_gl
def test_the_front_is_the_side_of_a_calibrated_camera_wherever_it_stands(tmp_path: Path, free_body: BodyModel):
    fit = waving_fit(2.0)
    along_x = World(rotation=((0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)), translation=(0.0, 0.0, 3.0), up="y")
    calibrated = replace(fit, camera=replace(fit.camera, world=along_x))
    write_result(tmp_path / "fit", calibrated, replace(sample_clip(), camera=calibrated.camera), free_body)
    plain = ["--no-floor", "--size", "200", "300", "--frames", "7"]
    seen = [body_of(drawn(tmp_path / "fit", tmp_path / f"{v}.png", *plain, "--view", v)) for v in ("front", "side")]
    assert seen[0].any(0).sum() > 1.5 * seen[1].any(0).sum(), "arms stretched out are wide as the camera saw them"


@needs_gl
def test_a_near_eye_sees_in_perspective_and_none_within_the_body(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    plain = ["--no-floor", "--size", "200", "200", "--view", "side"]
    far, near = (
        drawn(result, tmp_path / f"{n}.png", *plain, *more) for n, more in enumerate(([], ["--distance", "2.5"]))
    )
    assert body_of(near).sum() != body_of(far).sum()
    assert main(["render", str(result), "--out", str(tmp_path / "x.png"), "--distance", "0.3"]) == 2
    assert "the eye would stand within what is shown; expected more than" in capsys.readouterr().err
    assert not (tmp_path / "x.png").exists()


@needs_gl
def test_floor_and_background(result: Path, tmp_path: Path):
    bare = drawn(result, tmp_path / "a.png", "--no-floor", "--background", "#102030", "--elevation", "20")
    assert bare[0, 0].tolist() == [16, 32, 48]
    lined = drawn(result, tmp_path / "b.png", "--background", "#102030", "--elevation", "20")
    changed = (lined != bare).any(-1)
    assert changed[: len(changed) // 4].mean() < changed[-len(changed) // 4 :].mean()


@needs_gl
def test_a_sheet_has_the_frames_with_their_numbers(result: Path, tmp_path: Path):
    small = ["--size", "64", "64", "--view", "front", "side"]
    sheet = drawn(result, tmp_path / "a.png", *small, "--frames", ":", "--columns", "3")
    assert sheet.shape[1] == 3 * (128 + 6) and sheet.shape[0] == 2 * (64 + 18 + 6)
    few = drawn(result, tmp_path / "b.png", *small, "--frames", "7:11", "--count", "2")
    assert few.shape[1] == 2 * (128 + 6)


@needs_gl
def test_a_video_goes_once_around(result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "a.mp4"
    given = ["--view", "orbit", "--size", "65", "63", "--no-floor", "--json"]
    assert main(["render", str(result), "--out", str(out), *given]) == 0
    with FrameSource(out) as video:
        frames = [video.frame(i) for i in range(len(video))]
    assert len(frames) == 6 and frames[0].shape == (64, 66, 3)
    widths = [int((frame < 200).any(-1).any(0).sum()) for frame in frames]
    assert max(widths) > 1.3 * min(widths)
    events = [json.loads(line)["event"] for line in capsys.readouterr().out.splitlines()]
    assert events[:2] == ["started", "step"] and events[-3:] == ["step_done", "wrote", "ended"]


@needs_gl
def test_two_fits_beside_each_other(result: Path, project_folder: Path, tmp_path: Path):
    small = ["--size", "100", "100", "--view", "side", "--no-floor"]
    one = drawn(result, tmp_path / "a.png", *small)
    two = drawn(result, tmp_path / "b.png", *small, "--against", "phase1")
    assert two.shape[1] == 2 * one.shape[1]
    left, right = two[:, :100].astype(int), two[:, 100:].astype(int)
    assert (left[..., 2] - left[..., 0]).max() > 60 and (right[..., 0] - right[..., 2]).max() > 60
    runs = drawn(project_folder, tmp_path / "c.png", *small, "--run", "far", "--against", "near")
    assert runs.shape == two.shape


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "no path given; expected a project"),
        (["RESULT", "--out", "a.gif"], "a.gif: expected a name that ends in .png"),
        (["RESULT", "--size", "0", "10"], "--size 0 10: expected numbers from 16"),
        (["RESULT", "--elevation", "91"], "--elevation 91: expected degrees"),
        (["RESULT", "--distance", "-1"], "--distance -1: expected metres"),
        (["RESULT", "--background", "blau"], "--background blau: expected white"),
        (["RESULT", "--count", "0"], "--count 0: expected 1"),
        (["RESULT", "--view", "picture"], "has no video, or not where it was. Name it with --video-file"),
        (["RESULT", "--frames", "99", "--view", "front"], "--frames 99: expected frames from 7 to 12"),
        (["RESULT", "--run", "x"], "leave out --run"),
        (["nowhere"], "is neither a project nor a result"),
    ],
)
def test_refused(
    given: list[str],
    said: str,
    result: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.chdir(tmp_path)
    assert main(["render", *(str(result) if word == "RESULT" else word for word in given)]) == 2
    assert said in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_a_file_that_is_there_stays(result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "a.png").write_text("mine")
    assert main(["render", str(result), "--out", str(tmp_path / "a.png")]) == 2
    assert "Give --overwrite" in capsys.readouterr().err and (tmp_path / "a.png").read_text() == "mine"


def test_without_opengl_it_says_what_to_install(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    renderer._target.cache_clear()
    monkeypatch.setattr(renderer, "off_screen_gl", lambda: None)
    monkeypatch.setattr(renderer, "probe", lambda name: "no driver")
    assert main(["render", str(result), "--out", str(tmp_path / "a.png")]) == 2
    assert "No off-screen OpenGL was found" in capsys.readouterr().err


def test_a_view_from_a_distance_shows_its_extent_in_the_middle():
    view = View(center=(0.0, 1.0, 0.0), extent=2.0, size=(200, 300), distance=3.0)
    middle, edge, near = view.pixels(np.array([[0, 1, 0], [1, 1, 0], [0.5, 1, 1.5]]))
    assert middle.tolist() == [100, 150] and edge[0] == pytest.approx(200) and near[0] == pytest.approx(200)
