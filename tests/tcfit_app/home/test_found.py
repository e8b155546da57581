"""What is found in a folder, and what is left alone."""

import os
from pathlib import Path

import pytest

from fitting_core.io.result_files import FIT_NAME, SUMMARY_NAME
from tcfit_app.home import catalogue
from tcfit_app.home.found import RESULT, are_frames, find
from tcfit_app.project.storage.database import NAME
from tests.samples.media import write_images


def touch(*paths: Path) -> None:
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x")


def test_projects_results_and_videos_at_any_depth(tmp_path: Path):
    touch(
        tmp_path / "b" / "two.tcfit" / NAME,
        tmp_path / "b" / "two.tcfit" / "media" / "inside.mp4",
        tmp_path / "fits" / "c000" / FIT_NAME,
        tmp_path / "fits" / "c000" / "overlay.mp4",
        tmp_path / "a" / "deep" / "er" / "walk.MOV",
        tmp_path / "a" / "notes.txt",
        tmp_path / "clips.batch" / "first" / "x" / FIT_NAME,
        tmp_path / ".hidden" / "three.tcfit" / NAME,
        tmp_path / "a" / ".walk.mp4",
    )
    found = find(tmp_path)
    assert [(one.place, one.kind) for one in found] == [
        ("a/deep/er/walk.MOV", "video"),
        ("b/two.tcfit", "project"),
        ("fits/c000", "result"),
    ]
    assert len({one.key for one in found}) == 3 and find(tmp_path) == found


def frames(folder: Path, pattern: str, count: int = 12, size: int = 200) -> None:
    write_images(folder, *map(pattern.format, range(count)), size=(size, size))


def test_folders_of_frames_and_not_of_thumbnails_or_photos(tmp_path: Path):
    frames(tmp_path / "a clip", "frame_{:04}.png")
    frames(tmp_path / "layout" / "images", "{}.jpg")
    touch(tmp_path / "layout" / "keypoints" / "0_keypoints.json")
    frames(tmp_path / "thumbnails", "{:04}.jpg", size=120)
    frames(tmp_path / "photos", "IMG_{:04}.jpg")
    frames(tmp_path / "few", "{}.png", count=9)
    found = find(tmp_path)
    assert [(one.place, one.kind) for one in found] == [("a clip", "images"), ("layout", "images")]
    assert [one.footage for one in found] == [tmp_path / "a clip", tmp_path / "layout" / "images"]
    assert [next(one.project_places()).name for one in found] == ["a clip.tcfit", "layout.tcfit"]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ([f"{i}.png" for i in range(10)], True),
        ([f"walk-{i:05}.jpg" for i in range(100, 160, 2)], True),
        ([f"{i}.png" for i in [*range(10), 400]], False),
        ([f"{i}.png" for i in range(10)] + ["10.jpg"], False),
        ([f"{i}.png" for i in range(10)] + ["mask.png"], False),
        ([f"Screenshot ({i}).png" for i in range(20)], False),
        ([f"IMG_20240101_12{i * i:04}.jpg" for i in range(20)], False),
        ([f"DSCF{i:04}.JPG" for i in range(20)], False),
        ([], False),
    ],
)
def test_names_of_frames(names: list[str], expected: bool):
    assert are_frames(names) is expected


def test_links_are_not_followed(tmp_path: Path):
    outside = tmp_path / "outside"
    touch(outside / "one.tcfit" / NAME, outside / "walk.mp4")
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "folder").symlink_to(outside)
    (inside / "walk.mp4").symlink_to(outside / "walk.mp4")
    (inside / "circle").symlink_to(inside)
    assert find(inside) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_what_cannot_be_read_is_left_out(tmp_path: Path):
    touch(tmp_path / "shut" / "one.tcfit" / NAME, tmp_path / "open.mp4")
    (tmp_path / "shut").chmod(0)
    try:
        assert [one.place for one in find(tmp_path)] == ["open.mp4"]
    finally:
        (tmp_path / "shut").chmod(0o755)


def test_names_that_are_known_elsewhere_are_the_same():
    assert (RESULT, catalogue.SUMMARY) == (FIT_NAME, SUMMARY_NAME)
