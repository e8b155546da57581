"""A project as one file: what comes out is what went in, and what others made up does not come out at all."""

import shutil
import sqlite3
import stat
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.measure.references.files import read_reference
from tcfit_app.cli.main import main, parse
from tcfit_app.cli.review_command import opened
from tcfit_app.project import packed as project_file
from tcfit_app.project.packed import ABOUT, is_packed, pack, unpack
from tcfit_app.project.project import Project
from tcfit_app.project.storage import clip, database
from tcfit_app.project.storage.media import MediaLink
from tcfit_app.project.storage.reference import NAME
from tests.samples.media import write_images, write_video
from tests.samples.project_samples import (
    BODY,
    CONFIG,
    FRAMES,
    assert_same_fit,
    random_edit,
    same_keypoints,
    sample_clip,
    sample_fit,
    sample_keypoints,
)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Edits, a mark, two runs, one of which is deleted."""
    folder = tmp_path / "walk.tcfit"
    with Project.create(folder, sample_clip()) as made:
        for seed in range(3):
            made.append(random_edit(seed), author="me")
        for seed in range(2):
            run = made.runs.start(CONFIG, body=BODY, edits_seen=1, name=f"fit {seed}")
            made.runs.finish(run.id, sample_fit(seed))
        made.runs.delete(1)
    return folder


@pytest.fixture
def packed(project: Path, tmp_path: Path) -> Path:
    pack(project, tmp_path / "walk.tcfit.zip")
    return tmp_path / "walk.tcfit.zip"


def assert_same_projects(one: Path, other: Path) -> None:
    with Project.open(one, read_only=True) as a, Project.open(other, read_only=True) as b:
        assert same_keypoints(a.detections, b.detections) and same_keypoints(a.clip.keypoints, b.clip.keypoints)
        assert a.log == b.log and replace(a.clip, keypoints=None) == replace(b.clip, keypoints=None)  # type: ignore[arg-type]
        for deleted in (False, True):
            assert a.runs.all(deleted=deleted) == b.runs.all(deleted=deleted)
        for run in (1, 2):
            assert_same_fit(a.runs.load(run), b.runs.load(run))


def test_round_trip(project: Path, packed: Path, tmp_path: Path):
    assert is_packed(packed) and not is_packed(project)
    unpack(packed, tmp_path / "elsewhere" / "copy.tcfit")
    assert_same_projects(project, tmp_path / "elsewhere" / "copy.tcfit")
    assert [p.name for p in (tmp_path / "elsewhere").iterdir()] == ["copy.tcfit"]


@pytest.fixture
def waiting(tmp_path: Path) -> Path:
    """A project that has no detections yet."""
    nothing = Keypoints(xy=np.zeros((FRAMES, COUNT, 2)), confidence=np.zeros((FRAMES, COUNT)))
    Project.create(tmp_path / "waiting.tcfit", replace(sample_clip(), keypoints=nothing)).close()
    return tmp_path / "waiting.tcfit"


def _interrupted(*_: object) -> None:
    raise KeyboardInterrupt


def test_detections_go_along_that_have_not_got_their_name_yet(
    waiting: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with Project.open(waiting) as made, monkeypatch.context() as patched:
        patched.setattr(clip, "_settle_detections", _interrupted)
        with pytest.raises(KeyboardInterrupt):
            made.take_detections(sample_keypoints(seed=3))
    pack(waiting, tmp_path / "a.tcfit.zip")
    unpack(tmp_path / "a.tcfit.zip", tmp_path / "a.tcfit")
    with Project.open(tmp_path / "a.tcfit", read_only=True) as unpacked:
        assert same_keypoints(unpacked.detections, sample_keypoints(seed=3))


def test_detections_that_come_while_a_project_is_packed(waiting: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    copies: list[Path] = []
    back_up = project_file._back_up

    def and_then(source: Path, copy: Path) -> None:
        back_up(source, copy)
        copies.append(copy)
        if len(copies) == 1:
            made.take_detections(sample_keypoints(seed=3))

    monkeypatch.setattr(project_file, "_back_up", and_then)
    with Project.open(waiting) as made:
        pack(waiting, tmp_path / "a.tcfit.zip")
    unpack(tmp_path / "a.tcfit.zip", tmp_path / "a.tcfit")
    assert len(copies) == 2
    with Project.open(tmp_path / "a.tcfit", read_only=True) as unpacked:
        assert same_keypoints(unpacked.detections, sample_keypoints(seed=3))


def test_damaged_detections_are_not_packed(project: Path, tmp_path: Path):
    (project / clip.DETECTIONS).write_bytes(b"")
    with pytest.raises(InputError, match="was changed since the project was created"):
        pack(project, tmp_path / "a.tcfit.zip")
    assert not (tmp_path / "a.tcfit.zip").exists()


def test_a_reference_goes_along(project: Path, tmp_path: Path):
    points = np.random.default_rng(0).normal(0, 0.2, (7 + len(sample_clip()), 4, 3))
    np.savez(tmp_path / "points.npz", points=points, names=np.array(["LShoulder", "RShoulder", "LHip", "RHip"]))
    with Project.open(project) as made:
        made.set_reference(read_reference(tmp_path / "points.npz"))
    pack(project, tmp_path / "with.tcfit.zip")
    unpack(tmp_path / "with.tcfit.zip", tmp_path / "with.tcfit")
    with Project.open(tmp_path / "with.tcfit") as found:
        assert found.reference is not None
    assert (tmp_path / "with.tcfit" / NAME).read_bytes() == (project / NAME).read_bytes()


def test_an_open_project_is_packed_as_it_stands(project: Path, tmp_path: Path):
    with Project.open(project) as made:
        made.append(random_edit(7))
        pack(project, tmp_path / "now.tcfit.zip")
        made.append(random_edit(8))
        assert made.last_edit == 5
    unpack(tmp_path / "now.tcfit.zip", tmp_path / "now.tcfit")
    with Project.open(tmp_path / "now.tcfit") as found:
        assert found.last_edit == 4


def test_a_run_that_goes_on_is_interrupted_in_the_copy(project: Path, tmp_path: Path):
    with Project.open(project) as made:
        run = made.runs.start(CONFIG, body=BODY, edits_seen=0)
        made.runs.store(run.id, sample_fit(5, last_phase=1))
        pack(project, tmp_path / "x.tcfit.zip")
        made.runs.end(run.id, "cancelled")
    unpack(tmp_path / "x.tcfit.zip", tmp_path / "x.tcfit")
    with Project.open(tmp_path / "x.tcfit") as found:
        assert found.runs.get(run.id).state == "interrupted"
        assert_same_fit(found.runs.load(run.id), sample_fit(5, last_phase=1))


@pytest.mark.parametrize("name", ["walk.mp4", "frames", "2024-05-01 10:30:00 vidéo.mp4", "10:30 \\ frames"])
@pytest.mark.parametrize("copied", [False, True])
def test_media(tmp_path: Path, name: str, copied: bool):
    """Also where only some systems allow their names."""
    source, images = tmp_path / "videos" / name, name.endswith("frames")
    source.parent.mkdir()
    write_images(source, "a:1.png") if images else write_video(source)
    content = (source / "a:1.png" if images else source).read_bytes()
    with Project.create(tmp_path / "p.tcfit", replace(sample_clip(), source=source), copy_media=copied):
        pass
    pack(tmp_path / "p.tcfit", tmp_path / "without.zip")
    pack(tmp_path / "p.tcfit", tmp_path / "with.zip", with_media=True)
    shutil.rmtree(source.parent)
    shutil.rmtree(tmp_path / "p.tcfit")
    for name, there in (("without", copied), ("with", True)):
        unpack(tmp_path / f"{name}.zip", tmp_path / "new" / f"{name}.tcfit")
        with Project.open(tmp_path / "new" / f"{name}.tcfit") as found:
            path = found.media.path
            assert (path is not None and not found.media.problem) == there
            if there:
                assert path is not None and path.resolve().is_relative_to(found.folder)
                assert not {":", "\\"} & set(path.name)
                (file,) = path.iterdir() if images else (path,)
                assert file.read_bytes() == content


@pytest.mark.parametrize("name", ["notes.txt", "notes.mp4", "notes.png"])
def test_only_what_decodes_is_packed_as_a_video(tmp_path: Path, name: str):
    """A link to any other file, however it came into the project, does not hand that file on; nor to none."""
    source = tmp_path / name
    source.write_text("PRIVATE")
    with Project.create(tmp_path / "p.tcfit", replace(sample_clip(), source=source)):
        pass
    with pytest.raises(InputError):
        pack(tmp_path / "p.tcfit", tmp_path / "x.zip", with_media=True)
    source.unlink()
    with pytest.raises(InputError, match="no longer there"):
        pack(tmp_path / "p.tcfit", tmp_path / "x.zip", with_media=True)
    assert not (tmp_path / "x.zip").exists()


def test_of_a_folder_of_images_only_these_are_packed(tmp_path: Path):
    source = write_images(tmp_path / "frames", "0.png", "1.png")
    (source / "key.txt").write_text("PRIVATE")
    with Project.create(tmp_path / "p.tcfit", replace(sample_clip(), source=source)):
        pass
    pack(tmp_path / "p.tcfit", tmp_path / "p.zip", with_media=True)
    with zipfile.ZipFile(tmp_path / "p.zip") as archive:
        assert [n for n in archive.namelist() if n.startswith("media/")] == ["media/frames/0.png", "media/frames/1.png"]
    shutil.rmtree(source)
    unpack(tmp_path / "p.zip", tmp_path / "new.tcfit")
    with Project.open(tmp_path / "new.tcfit") as found:
        assert found.media.path is not None and not found.media.problem
    write_images(source, "0.png", "1.png")
    (source / "key.txt").write_text("PRIVATE")
    (source / "2.png").write_text("PRIVATE")
    with (
        Project.open(tmp_path / "p.tcfit") as project,
        pytest.raises(InputError, match=r"2\.png: cannot be decoded as an image"),
    ):
        project.relink(source)
    with pytest.raises(InputError):
        pack(tmp_path / "p.tcfit", tmp_path / "x.zip", with_media=True)


def test_cancelled_packing_leaves_nothing(project: Path, tmp_path: Path):
    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pack(project, tmp_path / "x.tcfit.zip", progress=stop)
    assert [p.name for p in tmp_path.iterdir()] == ["walk.tcfit"]


# --- what others made up ---


def rewritten(packed: Path, change: Callable[[dict[str, bytes]], None]) -> Path:
    """The file with other contents."""
    with zipfile.ZipFile(packed) as archive:
        contents = {name: archive.read(name) for name in archive.namelist()}
    change(contents)
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            archive.writestr(name, content)
    return packed


def added(name: str, content: bytes = b"x") -> Callable[[Path], None]:
    return lambda packed: _append(packed, zipfile.ZipInfo(name), content)


def _append(packed: Path, entry: zipfile.ZipInfo, content: bytes) -> None:
    with zipfile.ZipFile(packed, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(entry, content)


def link(packed: Path) -> None:
    entry = zipfile.ZipInfo("media/video.mp4")
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    _append(packed, entry, b"/etc/passwd")


def encrypted(packed: Path) -> None:
    content = bytearray(packed.read_bytes())
    at = content.rfind(b"PK\x01\x02")
    content[at + 8] |= 1
    packed.write_bytes(bytes(content))


def twice(packed: Path) -> None:
    with pytest.warns(UserWarning, match="Duplicate"):
        _append(packed, zipfile.ZipInfo("detections.npz"), b"x")


def oversized(packed: Path) -> None:
    """An entry that claims a petabyte in the list of contents."""
    _append(packed, zipfile.ZipInfo("media/video.mp4"), b"tiny")
    content = bytearray(packed.read_bytes())
    at = content.rfind(b"PK\x01\x02")
    content[at + 24 : at + 28] = (0xFFFFFF00).to_bytes(4, "little")
    packed.write_bytes(bytes(content))


def truncated(packed: Path) -> None:
    packed.write_bytes(packed.read_bytes()[:-200])


def flipped(packed: Path) -> None:
    content = bytearray(packed.read_bytes())
    at = content.find(b"detections.npz") + 200
    content[at] ^= 0xFF
    packed.write_bytes(bytes(content))


def holding(name: str, content: bytes) -> Callable[[Path], Path]:
    return lambda packed: rewritten(packed, lambda contents: contents.update({name: content}))


def without(name: str) -> Callable[[Path], Path]:
    return lambda packed: rewritten(packed, lambda contents: contents.pop(name) and None)


def _relink(connection: sqlite3.Connection, relative: str) -> None:
    text = msgspec.json.encode(MediaLink(relative=relative, absolute="/nowhere", fingerprint="")).decode()
    connection.execute("UPDATE clip SET media = ?", (text,))
    connection.commit()


def linked(relative: str) -> Callable[[Path], None]:
    """A database that says that the video is there."""

    def change(contents: dict[str, bytes]) -> None:
        connection = sqlite3.connect(":memory:")
        connection.deserialize(contents[database.NAME])
        _relink(connection, relative)
        contents[database.NAME] = connection.serialize()

    return lambda packed: rewritten(packed, change) and None


BAD = {
    "traversal": (added("../evil.txt"), "not part of a tcfit project"),
    "traversal in media": (added("media/../../evil"), "not part of a tcfit project"),
    "two dots": (added("media/.."), "not part of a tcfit project"),
    "absolute": (added("/tmp/evil"), "not part of a tcfit project"),
    "drive": (added("media/C:evil"), "not part of a tcfit project"),
    "backslash": (added("media/..\\evil"), "not part of a tcfit project"),
    "deep": (added("media/a/b/c"), "not part of a tcfit project"),
    "script": (added("runs/evil.py"), "not part of a tcfit project"),
    "link": (link, "not part of a tcfit project"),
    "encrypted": (encrypted, "encrypted"),
    "twice": (twice, "twice"),
    "oversized": (oversized, "which is impossible"),
    "truncated": (truncated, "damaged"),
    "flipped": (flipped, "damaged"),
    "newer": (holding(ABOUT, b'{"format": "tcfit project", "version": 2}'), "update tcfit"),
    "foreign": (holding(ABOUT, b'{"format": "other", "version": 1}'), "'other'"),
    "unnamed": (without(ABOUT), "not a packed project"),
    "no database": (without(database.NAME), "not a tcfit project"),
    "other database": (holding(database.NAME, b"SQLite format 3\0" + bytes(4080)), "database"),
    "other detections": (holding(clip.DETECTIONS, b""), "changed after"),
    "video above": (linked("media/../../secrets"), "its video has the invalid path 'media/../../secrets'"),
    "video above in Windows": (linked("media/..\\..\\secrets"), "its video has the invalid path"),
    "video is the project": (linked("media/.."), "its video has the invalid path"),
    "video in the root": (linked("media//etc"), "its video has the invalid path"),
    "video on a drive": (linked("media/C:/secrets"), "its video has the invalid path"),
}


@pytest.mark.parametrize("name", BAD)
def test_made_up_files_are_refused_and_leave_nothing(packed: Path, tmp_path: Path, name: str):
    spoil, reason = BAD[name]
    spoil(packed)
    with pytest.raises(InputError, match=reason):
        unpack(packed, tmp_path / "deep" / "er" / "x.tcfit")
    assert not list((tmp_path / "deep" / "er").iterdir())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["deep", "walk.tcfit", "walk.tcfit.zip"]


@pytest.fixture
def secrets(tmp_path: Path) -> Path:
    """Files beside the project that its receiver never meant to hand on."""
    (tmp_path / "secrets").mkdir()
    (tmp_path / "secrets" / "key").write_text("PRIVATE")
    return tmp_path / "secrets"


def say_video(project: Path, relative: str) -> None:
    with sqlite3.connect(project / database.NAME) as connection:
        _relink(connection, relative)
    connection.close()


@pytest.mark.parametrize("with_media", [False, True])
@pytest.mark.parametrize("video", ["media/../../secrets", "media/../../secrets/key", "media/folder", "media/file"])
def test_a_video_that_leads_out_of_the_project_is_not_packed(
    project: Path, secrets: Path, tmp_path: Path, video: str, with_media: bool
):
    (project / "media").mkdir()
    (project / "media" / "folder").symlink_to(secrets)
    (project / "media" / "file").symlink_to(secrets / "key")
    say_video(project, video)
    with pytest.raises(InputError, match="outside of media"):
        pack(project, tmp_path / "x.zip", with_media=with_media)
    assert not (tmp_path / "x.zip").exists()


def test_no_image_may_lead_out_of_the_project(project: Path, secrets: Path, tmp_path: Path):
    frames = project / "media" / "frames"
    frames.mkdir(parents=True)
    (frames / "0.png").write_bytes(b"x")
    say_video(project, "media/frames")
    pack(project, tmp_path / "good.zip")
    assert "media/frames/0.png" in zipfile.ZipFile(tmp_path / "good.zip").namelist()
    (frames / "1.png").symlink_to(secrets / "key")
    with pytest.raises(InputError, match="outside of media"):
        pack(project, tmp_path / "bad.zip")


def test_a_whole_media_folder_elsewhere_is_not_packed(project: Path, secrets: Path, tmp_path: Path):
    (project / "media").symlink_to(secrets)
    say_video(project, "media/key")
    with pytest.raises(InputError, match="outside of media"):
        pack(project, tmp_path / "x.zip")


@pytest.mark.parametrize("absolute", [False, True])
def test_a_link_to_elsewhere_is_packed_as_a_link(project: Path, secrets: Path, tmp_path: Path, absolute: bool):
    say_video(project, str(secrets) if absolute else "../secrets")
    pack(project, tmp_path / "x.zip")
    assert not any("key" in name for name in zipfile.ZipFile(tmp_path / "x.zip").namelist())
    with pytest.raises(InputError, match="differs from what the project was created with"):
        pack(project, tmp_path / "y.zip", with_media=True)


def test_too_little_space_is_told_before_anything_is_written(packed: Path, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(project_file, "MOST_BYTES", 1000)
    with pytest.raises(InputError, match="GB"):
        unpack(packed, tmp_path / "x.tcfit")
    assert not (tmp_path / "x.tcfit").exists()


def test_commands_take_a_packed_project(packed: Path, project: Path, tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", str(packed), "--out", "other.tcfit"]) == 0
    assert "Unpacked the project other.tcfit" in capsys.readouterr().out
    assert_same_projects(project, tmp_path / "other.tcfit")
    with opened(parse(["review", str(packed), "--out", "third.tcfit"])) as found:
        assert found.folder.name == "third.tcfit" and found.last_edit == 3
    assert main(["new", str(packed)]) == 2
    assert "walk.tcfit: is already a project" in capsys.readouterr().err
    assert main(["new", str(packed), "--copy-video"]) == 2
