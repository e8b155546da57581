"""Everything typed into a page that is a path: a page that is open elsewhere reads no file of the user's."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tcfit_app.project.storage.run_record import Given, Source
from tcfit_app.server.page_files import PageFiles
from tests.drivers.lone_page import LonePage, sample_project
from tests.samples.media import write_video
from tests.samples.spot_clips import empty_project, spot_video
from tests.tcfit_app.hostile.paths import hostile_paths

PRESSED = {
    "video": ("New location", "review.relink"),
    "result": ("Path", "import.path"),
    "camera": ("Camera file", "fit.camera"),
    "keypoints": ("Path", "start.import"),
}
"""By what is named: the field, and the button that takes it."""
_WITHOUT_KEYPOINTS = ("keypoints",)


@pytest.fixture(params=PRESSED)
def named(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def page(named: str, page_of: Callable[..., LonePage], tmp_path: Path) -> LonePage:
    folder = tmp_path / "new.tcfit"
    if named in _WITHOUT_KEYPOINTS:
        made = page_of(empty_project(folder, spot_video(tmp_path / "spots")))
    else:
        made = page_of(sample_project(folder, "a run"))
    made.draw()
    return made


def name(page: LonePage, named: str, path: str) -> list[str]:
    """Type it and press the button; what is told."""
    field, button = PRESSED[named]
    page.draw()
    page.field(field)._impl.value = path
    page.notices.clear()
    page.page.tab.do(lambda: page.press(button))
    page.settle()
    return [notice.text for notice in page.notices]


def untouched(page: LonePage) -> bool:
    project = page.page.tab.session.project
    return project.media.path is None or project.media.path.name == "spots"


@pytest.mark.parametrize("here", [False, True])
def test_no_path_of_a_page_elsewhere_is_read_and_none_outside_the_folder_for_them(
    page: LonePage, named: str, here: bool, tmp_path: Path
):
    secret = write_video(tmp_path / "secret.mp4")
    (tmp_path / "clips").mkdir()
    (tmp_path / "clips" / "link.mp4").symlink_to(secret)
    page.page.tab.files = PageFiles(here=here, root=tmp_path / "clips" if here else None)
    for path in (str(secret), "/etc/passwd", "/nowhere", *(("link.mp4", "../secret.mp4") if here else ("~",))):
        (told,) = name(page, named, path)
        assert "does not lie in" in told if here else "Upload the file instead" in told and path not in told.split()
    assert untouched(page) and not page.page.tab.session.source.busy


@pytest.mark.thorough
def test_what_is_no_such_file_is_told_as_the_users_mistake(page: LonePage, named: str, tmp_path: Path):
    """Every kind of path that commands are tried with, and one that no command line can have."""
    for kind, path in {**hostile_paths(tmp_path / "hostile"), "NUL": "a\0b"}.items():
        if "UTF-8" in kind:
            path = path.encode("utf-8", "replace").decode()  # as a browser sends what is no text
        began = time.monotonic()
        name(page, named, path)
        page.until(lambda: not page.page.tab.session.source.busy)
        going = page.page.tab.session.source.going
        told = [(notice.title, notice.text) for notice in page.notices]
        if going is not None and going.state == "failed":
            told.append((going.title, going.text))
            page.page.tab.session.source.going = None
        assert told and "Something went wrong" not in str(told), (kind, told)
        assert time.monotonic() - began < 20, kind
    assert untouched(page)


@pytest.mark.parametrize("named", ["video"], indirect=True)
def test_only_a_video_is_taken_for_one(page: LonePage, tmp_path: Path):
    (tmp_path / "key.txt").write_text("PRIVATE")
    for path in (tmp_path / "key.txt", tmp_path, page.page.tab.session.project.folder / "project.sqlite"):
        assert len(name(page, "video", str(path))) == 1 and page.page.tab.session.project.media.path is None
    name(page, "video", str(write_video(tmp_path / "walk.mp4")))
    found = page.page.tab.session.project.media.path
    assert found is not None and found.samefile(tmp_path / "walk.mp4")


@pytest.mark.parametrize("named", ["video"], indirect=True)
@pytest.mark.parametrize("part", ["start", "shape"])
def test_no_start_and_no_shape_by_their_paths(page: LonePage, part: str, tmp_path: Path):
    """Nor by the settings of a run that has been made with them."""
    file = tmp_path / "result.npz"
    file.write_bytes(b"")
    tab = page.page.tab
    for files in (PageFiles(here=False), PageFiles(here=True, root=tmp_path / "new.tcfit")):
        tab.files = files
        for path in (file, tmp_path / "nowhere") if part == "shape" else ():
            page.enter("Path of the shape", str(path))
            (problem,) = [why for name, why in tab.state.settings.problems if name == part]
            assert "does not lie in" in problem or "Upload the file" in problem
            assert tab.state.settings.given == Given()
        given = Given(**{part: Source(path=str(file))})
        tab.set(settings=replace(tab.state.settings, given=given, problems=()))
        page.notices.clear()
        tab.do(page.page.gestures.fitting.everything)
        (notice,) = page.notices
        assert "does not lie in" in notice.text or "Upload the file" in notice.text
        tab.set(settings=replace(tab.state.settings, given=Given()))
    tab.files = PageFiles(here=True)
    page.enter("Path of the shape", str(file))
    assert tab.state.settings.given.shape == Source(path=str(file))


@pytest.mark.parametrize("named", ["video"], indirect=True)
def test_no_pose_prior_by_its_path(page: LonePage, tmp_path: Path):
    prior = tmp_path / "prior.npz"
    prior.write_bytes(b"")
    settings = page.page.tab.state.settings
    for files in (PageFiles(here=False), PageFiles(here=True, root=tmp_path / "new.tcfit")):
        page.page.tab.files = files
        for path in (prior, tmp_path / "nowhere"):
            page.field("TOML")._impl.value = f'pose_prior = "{path}"'
            page.notices.clear()
            page.page.tab.do(lambda: page.press("fit.source"))
            (notice,) = page.notices
            assert "does not lie in" in notice.text or "Upload the file" in notice.text
            assert page.page.tab.state.settings.config == settings.config
    page.page.tab.files = PageFiles(here=True)
    page.page.tab.do(lambda: page.press("fit.source"))
    page.field("TOML")._impl.value = f'pose_prior = "{prior}"'
    page.press("fit.source")
    assert page.page.tab.state.settings.config.pose_prior == str(prior)
