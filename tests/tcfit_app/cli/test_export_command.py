"""`tcfit export`: of a project and of a result, chosen runs, phases and frames, and what a cancelled one leaves."""

import json
import pickle
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation

from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import joints_in_space
from fitting_core.camera import World, path_of
from fitting_core.clip import Clip
from fitting_core.clips.reading import read_clip
from fitting_core.config.schema import FitConfig
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.io.result_files import read_fit, write_result
from fitting_core.keypoints import INDEX
from fitting_core.motion import AXES, rest_joints
from fitting_core.priors.pose import make_prior
from fitting_core.results.fit_result import FitResult
from tcfit_app.cli.main import main
from tcfit_app.exports.exporting import _replacing_folder, file_name, write_export
from tcfit_app.exports.source import ExportSource
from tcfit_app.exports.table import EXPORTS
from tcfit_app.fitting.bodies import record_of
from tcfit_app.project.project import Project
from tests.drivers.processes import INTERRUPTIBLE
from tests.drivers.waiting import until
from tests.fitting_core.io.motion.gltf_player import Player
from tests.samples.clip_options import as_options
from tests.samples.media import write_images
from tests.samples.project_samples import CONFIG, sample_clip, sample_grounding, sample_keypoints
from tests.samples.waving import waving_fit, waving_project
from tests.tcfit_app.conftest import FRAMES, FinishedRun, motion


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory, free_body: BodyModel) -> Path:
    """Two runs, "near" and "far"."""
    return waving_project(tmp_path_factory.mktemp("export") / "walk.tcfit", free_body)


def exported(project: Path, out: Path, *options: str) -> list[str]:
    """Names of the files that an export makes."""
    assert main(["export", str(project), "--out", str(out), *options]) == 0
    return sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())


def test_a_project_s_newest_run(project: Path, free_body: BodyModel, tmp_path: Path):
    names = exported(project, tmp_path)
    assert names == ["walk-bvh/motion.json", "walk-bvh/walk.bvh", "walk.glb", "walk.smplx.npz"]
    player = Player.of(tmp_path / "walk.glb")
    expected = Mesh(free_body)(waving_fit(2.0).last.params).numpy() @ np.array(AXES["y-up"].from_camera).T
    for frame in (0, 3, 5):
        assert np.linalg.norm(player.vertices(float(player.times[frame])) - expected[frame], axis=1).max() < 1e-3


@pytest.mark.parametrize(
    ("options", "depth"),
    [
        ([], 4.5 + 2.3),
        (["--phase", "1"], 4.5 + 2.1),
        (["--run", "near"], 4.5 + 0.3),
        (["--run", "1", "--phase", "1"], 4.5 + 0.1),
        (["--run", "#2"], 4.5 + 2.3),
    ],
)
def test_run_and_phase_are_chosen(project: Path, tmp_path: Path, options: list[str], depth: float):
    exported(project, tmp_path, "--formats", "npz", "--axes", "camera", *options)
    with np.load(tmp_path / "walk.smplx.npz", allow_pickle=False) as read:
        assert np.allclose(read["trans"][:, 2], depth)


def test_frames_are_those_of_the_video(project: Path, tmp_path: Path):
    formats = ("obj", "openpose", "npz", "fit", "figures", "summary")
    names = exported(project, tmp_path, "--formats", *formats, "--frames", "8:9")
    assert [n for n in names if n.endswith(".obj")] == ["walk-obj/walk_000008.obj", "walk-obj/walk_000009.obj"]
    assert [n for n in names if n.endswith("_keypoints.json")] == [
        f"walk-keypoints/walk_{n:012d}_keypoints.json" for n in (8, 9)
    ]
    with np.load(tmp_path / "walk.smplx.npz", allow_pickle=False) as read:
        assert int(read["first_frame"]) == 8 and len(read["poses"]) == 2
    stored = read_fit(tmp_path / "walk.fit.npz")
    assert stored.first_frame == 8 and len(stored.params) == 2
    assert torch.equal(stored.params.body_pose, motion().body_pose[1:3])
    assert (tmp_path / "walk.figures.csv").read_text().splitlines()[1].startswith("8,")
    summary = json.loads((tmp_path / "walk.summary.json").read_text())
    cost = float(waving_fit(2.0).last.frame_cost[1:3].mean())
    assert summary["frames"] == 2 and summary["objective"]["phase3"] == pytest.approx({"by frame": cost})
    assert f"A part of a fit of {FRAMES} frames" in summary["warnings"][-1]


def test_a_result_of_tcfit_fit(finished: FinishedRun, free_body: BodyModel, tmp_path: Path):
    wished = ["--formats", "obj", "smplifyx", "--out", str(tmp_path), "--axes", "camera"]
    assert main(["export", str(finished.folder), *wished]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["wave-obj", "wave-smplifyx"]
    stored = read_fit(finished.folder)
    expected = Mesh(free_body)(stored.params).numpy()
    read = trimesh.load(tmp_path / "wave-obj" / "wave_000002.obj", process=False)
    assert np.allclose(read.vertices, expected[2], atol=1e-6)


def test_smplifyx_pickles_hold_the_latent_pose_of_the_prior_in_use(free_body: BodyModel, tmp_path: Path):
    prior = make_prior("tcfit", dtype=torch.float64, device="cpu")
    fit = replace(waving_fit(0.0), config=FitConfig(pose_prior="tcfit"), pose_prior=prior.title)
    with Project.create(tmp_path / "walk.tcfit", sample_clip(FRAMES)) as made:
        for name, result in (("latent", fit), ("other weights", replace(fit, pose_prior="tcfit pose prior (0123)"))):
            run = made.runs.start(fit.config, body=record_of(free_body), edits_seen=0, name=name)
            made.runs.finish(run.id, result)
    for name, held in (("latent", True), ("other weights", False)):
        out = tmp_path / name
        exported(tmp_path / "walk.tcfit", out, "--formats", "smplifyx", "--run", name)
        read = pickle.loads(next(out.rglob("000.pkl")).read_bytes())
        assert ("pose_embedding" in read) == held
        if held:
            decoded = prior.decode(torch.as_tensor(read["pose_embedding"], dtype=torch.float64))
            assert read["pose_embedding"].shape == (1, 32)
            # The prior cannot express every pose; what it encodes lies near.
            np.testing.assert_allclose(decoded, read["body_pose"], atol=0.1)


def write_both(folder: Path, clip: Clip, fit: FitResult, body: BodyModel) -> None:
    """A project and a result of the same fit."""
    with Project.create(folder / "walk.tcfit", clip) as made:
        made.runs.finish(made.runs.start(CONFIG, body=record_of(body), edits_seen=0).id, fit)
    write_result(folder / "result", fit, clip, body)


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("axes", [["--axes", "world"], []])
def test_a_calibrated_camera_s_motion_stands_in_its_world(
    free_body: BodyModel, tmp_path: Path, axes: list[str], moves: bool
):
    turn, at = Rotation.from_rotvec([1.7, 1.0, -0.4]), np.array([0.3, 0.9, 2.9])
    one, two, three = ((x, y, z) for x, y, z in turn.as_matrix().tolist())
    world = World(rotation=(one, two, three), translation=(0.3, 0.9, 2.9), up="z")
    clip = sample_clip(FRAMES)
    turns = Rotation.from_rotvec(np.linspace(0, 1, FRAMES)[:, None] * [0.1, 0.5, 0.2]).as_matrix()
    path = path_of(turns, np.linspace(0, 1, FRAMES)[:, None] * [0.4, 0.1, -0.3]) if moves else None
    clip = replace(clip, camera=replace(clip.camera, world=world, path=path))
    fit = replace(waving_fit(0.0), camera=clip.camera)
    write_both(tmp_path, clip, fit, free_body)
    pelvises = joints_in_space(free_body, fit.last.params)[:, 0]
    if path is not None:
        pelvises = np.einsum("tji,tj->ti", turns, pelvises - np.array(path.translation))
    expected = turn.inv().apply(pelvises - at)
    for source in ("walk.tcfit", "result"):
        exported(tmp_path / source, tmp_path / f"from {source}", "--formats", "npz", *axes)
        (file,) = (tmp_path / f"from {source}").iterdir()
        with np.load(file, allow_pickle=False) as read:
            shape = replace(fit.last.params, betas=torch.as_tensor(read["betas"][None, :10]).expand(FRAMES, -1))
            pelvis = rest_joints(free_body, shape)[:, 0].numpy() + read["trans"]
            assert np.allclose(pelvis, expected, atol=1e-5)  # z is up: also where the format chooses
            place = read["camera_place"][0] if moves else read["camera_place"]
            assert np.allclose(place, world.place) and "calibration" in str(read["axes"])


@pytest.mark.parametrize("source", ["walk.tcfit", "result"])
def test_axes_of_a_world_that_nobody_told(free_body: BodyModel, tmp_path: Path, source: str, capsys):
    fit, clip = waving_fit(0.0), sample_clip(FRAMES)
    write_both(tmp_path, clip, fit, free_body)
    wished = ["export", str(tmp_path / source), "--formats", "npz", "--axes", "world", "--out", str(tmp_path / "out")]
    assert main(wished) == 2 and "--camera" in capsys.readouterr().err
    assert not [path for path in (tmp_path / "out").rglob("*") if path.is_file()]


def test_a_known_floor_is_at_height_0_whatever_frames_are_exported(free_body: BodyModel, tmp_path: Path):
    known, clip = sample_grounding(1, FRAMES), sample_clip(FRAMES)
    fit = replace(waving_fit(0.0), grounding=known)
    write_both(tmp_path, clip, fit, free_body)
    assert known.ground is not None
    heights = known.ground.height(joints_in_space(free_body, fit.last.params)[:, 0])
    for source, frames in (("walk.tcfit", slice(0, 3)), ("result", slice(None))):
        out = tmp_path / f"from {source}"
        chosen = [] if frames == slice(None) else ["--frames", f"{clip.first_frame}:{clip.first_frame + 2}"]
        exported(tmp_path / source, out, "--formats", "npz", "bvh", *chosen)
        with np.load(next(out.glob("*.smplx.npz"))) as written:
            pelvis = written["trans"] + free_body.with_shape(written["betas"][:10]).rest_joints[0]
            assert written["camera_place"].tolist() == [0, 0, 1.5] and str(written["ground"]) == known.text
        np.testing.assert_allclose(pelvis[:, 2], heights[frames], atol=1e-6)
        stated = json.loads(next(out.rglob("motion.json")).read_bytes())
        np.testing.assert_allclose(np.array(stated["pelvis"])[:, 1], heights[frames], atol=1e-6)


def test_standard_rigs_of_a_result_s_frames(project: Path, tmp_path: Path):
    names = exported(project, tmp_path, "--formats", "mixamo", "unreal", "vrma", "--frames", "8:10")
    assert names == ["walk.mixamo.glb", "walk.unreal.glb", "walk.vrma"]
    assert {len(Player.of(tmp_path / name).times) for name in names[:2]} == {3}


@pytest.mark.usefixtures("off_screen_gl")
def test_side_by_side_from_the_command_line(project: Path, tmp_path: Path):
    exported(project, tmp_path, "--formats", "side-by-side", "overlay", "--against", "near", "--frames", "7:8")
    widths = []
    for name in ("side-by-side", "overlay"):
        video = cv2.VideoCapture(str(tmp_path / f"walk.{name}.mp4"))
        assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == 2
        widths.append(int(video.get(cv2.CAP_PROP_FRAME_WIDTH)))
    assert widths == [2 * 640 + 4, 640]


@pytest.mark.usefixtures("off_screen_gl")
def test_pictures_of_a_project_and_of_a_result(project: Path, free_body: BodyModel, tmp_path: Path):
    """A result is drawn over the video that it names, and on grey if that is gone."""
    formats = ["--formats", "picture", "sheet"]
    names = exported(project, tmp_path / "a", *formats, "--frames", "7:9")
    assert names == ["walk.png", "walk.sheet.png"]
    alone, sheet = (cv2.imread(str(tmp_path / "a" / name)) for name in names)
    assert alone.shape == (480, 640, 3) and sheet.shape[0] < 480
    assert sheet.shape[1] == pytest.approx(3 * sheet.shape[0] * 640 / 480, rel=0.1), "three frames in a row"
    exported(project, tmp_path / "b", *formats, "--frames", "7:9", "--view", "camera", "side")
    both = cv2.imread(str(tmp_path / "b" / "walk.png"))
    assert both.shape == (480, 640 + 4 + 480, 3) and np.array_equal(both[:, :640], alone)
    write_result(tmp_path / "fit", waving_fit(2.0), sample_clip(), free_body)
    (name,) = exported(tmp_path / "fit", tmp_path / "c", "--formats", "overlay", "--frames", "7:8")
    assert int(cv2.VideoCapture(str(tmp_path / "c" / name)).get(cv2.CAP_PROP_FRAME_COUNT)) == 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--formats", "maya"], "expected some of glb, bvh, obj"),
        (["--formats", "npz", "rig-bvh"], "rig-bvh: was removed. Export bvh, mixamo or unreal and retarget it"),
        (["--run", "middle"], "'near' (#1), 'far' (#2)"),
        (["--frames", "0:3"], "from 7 to 12"),
        (["--frames", "9:8"], "from 7 to 12"),
        (["--frames", "a"], "FIRST:LAST"),
        (["--against", "middle"], "no such run"),
    ],
)
def test_wrong_options_are_explained(project: Path, tmp_path: Path, options: list[str], said: str, capsys):
    assert main(["export", str(project), "--out", str(tmp_path / "o"), *options]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_wrong_paths_are_explained(finished: FinishedRun, tmp_path: Path, capsys):
    cases = {
        (): "no path given",
        (str(tmp_path),): "neither a project nor a result",
        (str(tmp_path / "nothing"),): "neither a project nor a result",
        (str(finished.folder), "--formats", "coco"): "neither keypoints nor video",
        (str(finished.folder), "--run", "x"): "leave out --run",
        (str(finished.folder), "--phase", "2"): "phases 1 and 3",
    }
    for arguments, said in cases.items():
        assert main(["export", *arguments, "--out", str(tmp_path / "o")]) == 2
        assert said in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_a_result_says_whether_its_run_was_finished(project: Path, tmp_path: Path):
    copy = Path(shutil.copytree(project, tmp_path / "walk.tcfit"))
    with Project.open(copy) as opened:
        run = opened.runs.start(FitConfig(), body=opened.runs.all()[0].body, edits_seen=0, name="stopped")
        opened.runs.store(run.id, waving_fit(1.0))
        opened.runs.end(run.id, "cancelled")
    for name, complete in (("near", True), ("stopped", False)):
        exported(copy, tmp_path / name, "--formats", "fit", "--run", name)
        assert read_fit(tmp_path / name / "walk.fit.npz").complete == complete


def test_keypoints_of_a_part_of_numbered_images_come_back_in_their_places(tmp_path: Path):
    stems = [f"img_{number:04d}" for number in range(1, 13)]
    images = write_images(tmp_path / "images", *(f"{stem}.png" for stem in stems), size=(640, 480))
    write_openpose(tmp_path / "keypoints", sample_keypoints(12), name="x", image_stems=stems)
    part = {"first_frame": 4, "last_frame": 9, "focal_length": 700.0, "frame_rate": 25.0}
    clip = read_clip(images, tmp_path / "keypoints", **as_options(part))
    with Project.create(tmp_path / "walk.tcfit", replace(clip, name="walk")):
        pass
    names = exported(tmp_path / "walk.tcfit", tmp_path / "out", "--formats", "openpose", "coco")
    assert "walk-keypoints/img_0005_keypoints.json" in names
    for kind in ("walk-keypoints", "walk.coco-wholebody.json"):
        again = read_clip(images, tmp_path / "out" / kind, **as_options(part)).keypoints
        seen = clip.keypoints.confidence[:, INDEX["nose"]] > 0
        assert seen.any() and np.abs(again.xy - clip.keypoints.xy)[seen, INDEX["nose"]].max() < 1e-6, kind


def test_nothing_is_replaced_without_being_asked(project: Path, tmp_path: Path, capsys):
    exported(project, tmp_path, "--formats", "npz", "bvh")
    (tmp_path / "walk-bvh" / "mine.txt").write_text("x")
    for name in ("npz", "bvh"):
        assert main(["export", str(project), "--out", str(tmp_path), "--formats", name]) == 2
        assert "--overwrite" in capsys.readouterr().err
    assert (tmp_path / "walk-bvh" / "mine.txt").exists()
    asked = ["export", str(project), "--out", str(tmp_path), "--formats", "bvh", "--overwrite"]
    assert main(asked) == 2 and "does not replace, such as mine.txt" in capsys.readouterr().err
    assert (tmp_path / "walk-bvh" / "mine.txt").read_text() == "x"
    (tmp_path / "walk-bvh" / "mine.txt").unlink()
    (tmp_path / "walk-bvh" / "walk.bvh").write_text("old")
    assert main(asked) == 0 and (tmp_path / "walk-bvh" / "walk.bvh").read_text() != "old"
    assert sorted(path.name for path in tmp_path.iterdir() if path.name[0] == ".") == []


def test_a_link_to_a_folder_stays_a_link_and_a_file_stays(project: Path, tmp_path: Path, capsys):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "walk-bvh").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "walk-obj").write_text("x")
    asked = ["export", str(project), "--out", str(tmp_path), "--overwrite", "--formats"]
    assert main([*asked, "bvh"]) == 0
    assert (tmp_path / "walk-bvh").is_symlink() and (tmp_path / "elsewhere" / "walk.bvh").is_file()
    assert main([*asked, "obj"]) == 2 and "is a file; expected a folder" in capsys.readouterr().err
    assert (tmp_path / "walk-obj").read_text() == "x"
    assert sorted(path.name for path in tmp_path.iterdir() if path.name[0] == ".") == []


def test_all_formats_are_listed(capsys):
    assert main(["export", "--formats", "list"]) == 0
    out = capsys.readouterr().out
    assert all(f"{name} " in out and export.hint in out for name, export in EXPORTS.items())


def test_names_of_clips_are_as_long_as_file_systems_take(tmp_path: Path):
    clip = replace(sample_clip(), name="走" * 80)
    Project.create(tmp_path / "walk.tcfit", clip).close()
    source = ExportSource(name=clip.name, known_clip=clip, project=tmp_path / "walk.tcfit")
    for export in EXPORTS.values():
        for zipped in (False, True):
            name = file_name(export, clip.name, zipped=zipped)
            assert name.startswith("走" * 60) and export.suffix in name and len(name.encode()) <= 225
            if export.needs == "keypoints":
                write_export(export, source, tmp_path / name, lambda share: None, zipped=zipped)
                assert (tmp_path / name).exists()


@pytest.mark.thorough
def test_ctrl_c_leaves_nothing_half_written(project: Path, tmp_path: Path):
    code = f"{INTERRUPTIBLE}import sys; from tcfit_app.cli.main import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "export", str(project), "--out", str(tmp_path)]
    process = subprocess.Popen([*command, "--formats", "npz", "obj", "bvh"], stderr=subprocess.PIPE, text=True)
    until(lambda: list(tmp_path.glob(".walk-obj.*/walk-obj/*.obj")))
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130 and "cancelled" in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["walk.smplx.npz"]


@pytest.mark.parametrize("stopped", [1, 2])
@pytest.mark.parametrize("reason", [KeyboardInterrupt, OSError])
def test_a_folder_is_there_whatever_stops_its_replacement(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reason: type[BaseException], stopped: int
):
    out, rename, calls = tmp_path / "walk-obj", Path.rename, []
    out.mkdir()
    (out / "000.obj").write_text("old")

    def interrupted(self: Path, target: Path) -> Path:
        calls.append(target)
        if len(calls) == stopped:
            raise reason
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(reason), _replacing_folder(out) as draft:
        (draft / "000.obj").write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == ["walk-obj"]
    assert (out / "000.obj").read_text() == "old"
