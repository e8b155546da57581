"""`--people all`: everybody is fitted, exported and made projects of; what is of one person is refused."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import project
from fitting_core.errors import InputError
from fitting_core.fit.events import FitEvent
from fitting_core.io.motion.smplx_npz import read_smplx_npz
from fitting_core.io.people_file import read_people_file
from fitting_core.io.result_files import read_fit
from fitting_core.keypoints import BODY
from tcfit_app.cli import fit_command
from tcfit_app.cli.main import main
from tcfit_app.project.project import Project
from tests.fitting_core.io.motion.gltf_player import Player
from tests.samples.media import write_images
from tests.tcfit_app.conftest import CAMERA, FRAMES, QUICK, motion

RATE = 10


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory, free_body: BodyModel) -> Path:
    """Somebody on the right in all six frames, whom each file has first, and somebody on the left in five."""
    folder = tmp_path_factory.mktemp("clip") / "talk"
    folder.mkdir()
    lists: list[list[dict[str, list[float]]]] = [[] for _ in range(FRAMES)]
    for x, frames in ((0.6, range(FRAMES)), (-0.7, range(FRAMES - 1))):
        params = motion()
        params.camera_translation[:, 0] += x
        points, exists = keypoints_in_space(free_body, params)
        xy = project(CAMERA, torch.as_tensor(points[:, BODY])).numpy()
        for t in frames:
            found = np.concatenate([xy[t], 0.9 * exists[BODY, None]], 1) * exists[BODY, None]
            lists[t].append({"pose_keypoints_2d": found.ravel().tolist()})
    for t, people in enumerate(lists):
        (folder / f"talk_{t:06d}_keypoints.json").write_text(json.dumps({"version": 1.3, "people": people}))
    return folder


@pytest.fixture(scope="module")
def clip(two: Path) -> list[str]:
    size = [str(side) for side in CAMERA.size]
    return ["--keypoints", str(two), "--image-size", *size, "--focal-length", "800", "--frame-rate", str(RATE)]


@pytest.fixture(scope="module", autouse=True)
def read_once(free_body: BodyModel) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fit_command, "load_body", lambda path: free_body)
        yield


@pytest.fixture(scope="module")
def fitted(clip: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both, fitted through the command line; not to be changed."""
    folder = tmp_path_factory.mktemp("results") / "talk"
    assert main(["fit", *clip, "--people", "all", "--out", str(folder), "--no-overlay", *QUICK]) == 0
    return folder


def test_each_has_a_result_from_left_to_right(fitted: Path):
    assert sorted(path.name for path in fitted.iterdir()) == ["people.json", "person-1", "person-2"]
    listed = read_people_file(fitted)
    assert listed.name == "talk" and [one.folder for one in listed.people] == ["person-1", "person-2"]
    assert [one.frames for one in listed.people] == [(0, FRAMES - 2), (0, FRAMES - 1)]
    left, right = (read_fit(fitted / one.folder) for one in listed.people)
    assert len(left.params) == FRAMES - 1 and len(right.params) == FRAMES
    assert left.joints[0, 0, 0] == pytest.approx(-0.7, abs=0.1) and right.joints[0, 0, 0] == pytest.approx(0.6, abs=0.1)
    assert left.camera == right.camera
    summary = json.loads((fitted / "person-1" / "summary.json").read_text())
    assert summary["clip"] == "talk person 1" and summary["complete"]
    assert any("Person 1 of 2, in frames 0 to 4." in warning for warning in summary["warnings"])


def test_all_are_exported_into_one_world(fitted: Path, tmp_path: Path):
    """As far apart as their fits are in camera space: one turn for both, and one floor."""
    assert main(["export", str(fitted), "--out", str(tmp_path), "--formats", "glb"]) == 0
    player = Player.of(tmp_path / "talk.glb")
    document = player.document
    assert [one["name"] for one in document.asset.extras["people"]] == ["talk person 1", "talk person 2"]
    roots = [player.matrices(0.0)[skin.joints[0], :3, 3] for skin in document.skins]
    fits = [read_fit(fitted / folder) for folder in ("person-1", "person-2")]
    apart = np.linalg.norm(fits[0].joints[0, 0] - fits[1].joints[0, 0])
    assert np.linalg.norm(roots[0] - roots[1]) == pytest.approx(apart, abs=1e-4)


def test_the_export_of_everybody(fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["export", str(fitted), "--out", str(tmp_path), "--formats", "glb", "npz", "--frames", "1:5"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "talk person 1.smplx.npz",
        "talk person 2.smplx.npz",
        "talk.glb",
    ]
    lengths = [len(np.load(tmp_path / f"talk person {k}.smplx.npz")["poses"]) for k in (1, 2)]
    assert lengths == [FRAMES - 2, FRAMES - 1]
    assert [one["frames"] for one in Player.of(tmp_path / "talk.glb").document.asset.extras["people"]] == lengths
    assert main(["export", str(fitted), "--out", str(tmp_path), "--formats", "glb"]) == 2
    assert "talk.glb: already exists" in capsys.readouterr().err
    assert main(["export", str(fitted), "--out", str(tmp_path / "b"), "--frames", "7:9"]) == 2
    assert "no person is visible; expected frames from 0 to 5" in capsys.readouterr().err
    # Who has gone by then is left out.
    assert main(["export", str(fitted), "--out", str(tmp_path / "c"), "--formats", "npz", "--frames", "5"]) == 0
    assert [path.name for path in (tmp_path / "c").iterdir()] == ["talk person 2.smplx.npz"]


def test_what_is_about_one_person_says_whose_folders_there_are(fitted: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["import", str(fitted), "x.npz"]) == 2
    said = f"holds several people. Give the folder of one of them, such as {fitted / 'person-1'}"
    assert said in capsys.readouterr().err


def test_a_next_fit_takes_the_last_one_s_place(fitted: Path, clip: list[str], tmp_path: Path):
    """Whoever it does not have is gone; nothing is mixed."""
    folder = tmp_path / "out"
    shutil.copytree(fitted, folder)
    (folder / "people.glb").touch()  # of an earlier version
    # Of the last frames too few are left for the left one.
    again = ["fit", *clip, "--people", "all", "--first-frame", "1", "--out", str(folder), "--no-overlay", *QUICK]
    assert main([*again, "--set", "last_phase=1"]) == 0
    assert sorted(path.name for path in folder.iterdir()) == ["people.json", "person-1"]
    assert [one.frames for one in read_people_file(folder).people] == [(1, FRAMES - 1)]


@pytest.mark.parametrize("other", ["note.txt", "fit.npz", "person-3/fit.npz", "person-1/note.txt"])
def test_nothing_of_others_is_mixed_with_it(
    other: str, fitted: Path, clip: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    folder = tmp_path / "out"
    shutil.copytree(fitted, folder)
    (folder / other).parent.mkdir(exist_ok=True)
    (folder / other).write_text("mine")
    assert main(["fit", *clip, "--people", "all", "--out", str(folder)]) == 2
    assert "contains files that are not a result of several people" in capsys.readouterr().err
    assert (folder / other).read_text() == "mine" and (folder / "person-1" / "summary.json").is_file()


@pytest.mark.parametrize(
    ("command", "options", "said"),
    [
        ("fit", ["--person", "1"], "--people all cannot be combined with --person,"),
        ("new", ["--person", "1"], "--people all cannot be combined with --person,"),
        ("fit", ["--shape", "s.npz"], "--people all cannot be combined with --shape"),
        ("fit", ["--start", "a.npz", "--start-person", "2"], "--people all cannot be combined with --start-person"),
        ("new", ["--reference", "r.npz"], "--people all cannot be combined with --reference"),
        ("new", ["--height", "172"], "--people all cannot be combined with --height"),
        ("fit", ["--last-frame", "2"], "Nobody is found for 5 frames"),
        ("fit", ["--start", "none.npz"], "none.npz"),
    ],
)
def test_refused(
    command: str,
    options: list[str],
    said: str,
    clip: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    assert main([command, *clip, "--people", "all", "--out", "out", *options]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_start_is_for_whoever_follows_it(
    fitted: Path, clip: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    given = str(fitted / "person-2" / "fit.npz")
    arguments = ["--people", "all", "--no-overlay", "--start", given, *QUICK, "--set", "last_phase=1"]
    assert main(["fit", *clip, "--out", str(tmp_path / "out"), *arguments]) == 0
    assert "Phase 1 begins with fit.npz" in capsys.readouterr().err
    summaries = [json.loads((tmp_path / "out" / f"person-{k}" / "summary.json").read_text()) for k in (1, 2)]
    assert summaries[1]["start"] is not None


def test_a_project_of_each_and_one_copy_of_the_images(two: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    images = write_images(tmp_path / "images", *(f"{number}.png" for number in range(FRAMES)), size=(640, 480))
    arguments = ["new", str(images), "--keypoints", str(two), "--frame-rate", str(RATE), "--people", "all"]
    for name, options in (("linked", []), ("copied", ["--copy-video"])):
        assert main([*arguments, "--out", str(tmp_path / name), *options]) == 0
        assert "Made the projects of 2 people in" in capsys.readouterr().out
    assert not (tmp_path / "linked" / "media").exists()
    shutil.move(tmp_path / "copied", tmp_path / "elsewhere")
    assert sum(1 for path in (tmp_path / "elsewhere").rglob("*.png")) == FRAMES
    listed = read_people_file(tmp_path / "elsewhere")
    assert [one.frames for one in listed.people] == [(0, FRAMES - 2), (0, FRAMES - 1)]
    for one in listed.people:
        with Project.open(tmp_path / "linked" / one.folder) as linked:
            assert linked.clip.source and linked.clip.source.samefile(images)
        with Project.open(tmp_path / "elsewhere" / one.folder) as copied:
            assert copied.clip.source and copied.clip.source.resolve() == tmp_path / "elsewhere" / "media" / "images"
            assert len(copied.clip) == one.frames[1] + 1 and not copied.media.problem
    assert main([*arguments, "--out", str(tmp_path / "linked")]) == 2
    assert "is already a folder of several people" in capsys.readouterr().err
    # Keypoints of everybody, from the projects.
    assert main(["export", str(tmp_path / "linked"), "--out", str(tmp_path / "k"), "--formats", "coco"]) == 0
    assert len(list((tmp_path / "k").iterdir())) == 2


def test_a_cancelled_fit_leaves_the_last_one_until_somebody_has_a_result(
    fitted: Path, clip: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def cancelled(*arguments: Any, **options: Any) -> Iterator[FitEvent]:
        raise KeyboardInterrupt
        yield

    folder = tmp_path / "out"
    shutil.copytree(fitted, folder)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    monkeypatch.setattr("fitting_core.fit.fitting.fit_events", cancelled)
    assert main(["fit", *clip, "--people", "all", "--out", str(folder), "--no-overlay", *QUICK]) == 130
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


@pytest.mark.thorough
def test_a_killed_fit_leaves_a_folder_of_several_people(
    clip: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Which lists who has a result, and which a next fit may replace."""
    listed: list[list[str]] = []
    whole = fit_command.write_result

    def seen(folder: Path, *arguments: Any, **options: Any) -> dict[str, Any]:
        listed.append([one.folder for one in read_people_file(folder.parent).people])
        return whole(folder, *arguments, **options)

    arguments = ["fit", *clip, "--people", "all", "--out", str(tmp_path / "out"), "--no-overlay", *QUICK]
    arguments += ["--set", "last_phase=1"]
    with monkeypatch.context() as patch:
        patch.setattr(fit_command, "write_result", seen)
        assert main(arguments) == 0
    assert listed == [["person-1"], ["person-1", "person-2"]]
    (tmp_path / "out" / "person-2" / ".fit.npz.partial").mkdir()
    assert main(arguments) == 0
    assert not list(tmp_path.rglob("*.partial"))


@pytest.mark.thorough
@pytest.mark.parametrize("written", [0, 1, 2, 3, 4, 5])
def test_after_a_full_disk_every_result_says_whether_it_is_finished(
    clip: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    written: int,
):
    """The disk is full after so many writes: three for each of two people."""
    whole, out, left = fit_command.write_result, tmp_path / "out", iter(range(written))

    def until_full(*arguments: Any, **options: Any) -> dict[str, Any]:
        if next(left, None) is None:
            raise InputError("the disk is full")
        return whole(*arguments, **options)

    monkeypatch.setattr(fit_command, "write_result", until_full)
    assert main(["fit", *clip, "--people", "all", "--out", str(out), "--no-overlay", *QUICK]) == 2
    err = capsys.readouterr().err
    assert "the disk is full" in err and f"{written // 3} of 2 people are fitted." in err
    people = read_people_file(out).people if written else ()
    assert [one.folder for one in people] == ["person-1", "person-2"][: (written + 2) // 3]
    for number, one in enumerate(people):
        result, phase = out / one.folder, min(3, written - 3 * number)
        reports = (
            ["export", str(result), "--formats", "npz", "--out", str(tmp_path / f"exported-{number}")],
            [
                "evaluate",
                str(result),
                "--reference",
                str(result / "fit.npz"),
                "--out",
                str(tmp_path / f"rated-{number}"),
            ],
        )
        for command in reports:
            assert main(command) == 0
            said = "".join(capsys.readouterr())
            assert (f"only what phase {phase} found" in said) == (phase < 3), (command, said)
        assert bool(read_smplx_npz(result / "fit.npz").notes) == (phase < 3)
