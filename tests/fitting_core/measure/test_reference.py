"""References: every form that is read, and what is said about files that cannot be."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluation.synthetic.truth import write_truth
from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams, full_pose
from fitting_core.body.points.positions import joints_in_space
from fitting_core.camera import Camera, World, path_of
from fitting_core.errors import InputError
from fitting_core.files.npz import write_npz
from fitting_core.io.motion.animation_npz import write_animation_npz
from fitting_core.io.truth import Truth
from fitting_core.measure.references.bodies import reference_of
from fitting_core.measure.references.files import read_reference
from fitting_core.measure.references.points import keypoint_named
from fitting_core.measure.references.reference import Reference, write_reference
from fitting_core.motion import AXES
from tests.fitting_core.io.motion.motions import swinging
from tests.samples.scenes import random_params

NAMES = ["RShoulder", "left_shoulder", "CHip", "Nose", "Wand"]
POINTS = np.random.default_rng(0).normal(size=(4, 5, 3))
TURN = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
SHIFT = np.array([0.1, 0.2, 6.0])


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    np.savez(tmp_path / "camera.npz", R=TURN, t=SHIFT[:, None], K=np.eye(3))
    return tmp_path / "camera.npz"


def trc(points: np.ndarray, unit: str = "mm", *, first: float = 0.0, names: list[str] = NAMES) -> str:
    rows = ["PathFileType\t4\t(X/Y/Z)\tx.trc", "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits"]
    rows.append(f"50\t50\t{len(points)}\t{len(names)}\t{unit}")
    rows += [
        "Frame#\tTime\t" + "\t\t\t".join(names),
        "\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(len(names))),
    ]
    factor = {"mm": 1e3, "m": 1.0}[unit]
    for i, frame in enumerate(points):
        cells = ["" if np.isnan(value) else f"{factor * value:.9f}" for value in frame.reshape(-1)]
        rows.append("\t".join([str(i + 1), f"{first + i / 50:.4f}", *cells]))
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize("name", ["RShoulder", "right_shoulder", "R-Shoulder", "Right Shoulder", "rshoulder"])
def test_markers_have_many_names(name: str):
    assert keypoint_named(name) == kp.INDEX["right_shoulder"]
    assert keypoint_named("LBigToe") == kp.INDEX["left_big_toe"] and keypoint_named("C7") is None


def test_points_get_into_the_camera(tmp_path: Path, camera: Path):
    np.savez(tmp_path / "points.npz", points=POINTS, names=np.array(NAMES), fps=60.0)
    found = read_reference(tmp_path / "points.npz", camera=camera)
    assert found.in_camera and found.frame_rate == 60 and "Wand" in found.notes[0]
    np.testing.assert_allclose(found.points[:, kp.INDEX["mid_hip"]], POINTS[:, 2] @ TURN.T + SHIFT)
    assert np.isfinite(found.points).all(-1).sum() == 4 * 4
    assert not read_reference(tmp_path / "points.npz").in_camera


def seen_by(shift: np.ndarray) -> Camera:
    """The clip's camera, where a calibration says that it stands there."""
    rows: Any = tuple(map(tuple, TURN.tolist()))
    world = World(rotation=rows, translation=(shift[0], shift[1], shift[2]))
    return Camera(focal=(800.0, 800.0), center=(320.0, 240.0), size=(640, 480), world=world)


def test_without_a_camera_the_world_of_the_calibration_counts(tmp_path: Path, camera: Path, free_body: BodyModel):
    """For what stands nowhere else, and only if it is before the camera there."""
    np.savez(tmp_path / "points.npz", points=POINTS, names=np.array(NAMES))
    given = read_reference(tmp_path / "points.npz", camera=camera)
    found = read_reference(tmp_path / "points.npz", seen_by=seen_by(SHIFT))
    assert found.in_camera and "world of the camera's calibration" in found.notes[-1]
    np.testing.assert_allclose(found.points, given.points)
    for away in (SHIFT - [0, 0, 12], SHIFT - [0, 0, -1000]):
        elsewhere = read_reference(tmp_path / "points.npz", seen_by=seen_by(away))
        assert not elsewhere.in_camera and "only form is compared" in elsewhere.notes[-1]
    told = read_reference(tmp_path / "points.npz", camera=camera, seen_by=seen_by(SHIFT - [0, 0, 12]))
    np.testing.assert_allclose(told.points, given.points)
    made = reference_of("made", "here", free_body, random_params(2), frame_rate=30.0, in_camera=True)
    write_reference(tmp_path / "stored.npz", made)
    np.testing.assert_array_equal(read_reference(tmp_path / "stored.npz", seen_by=seen_by(SHIFT)).points, made.points)


@pytest.mark.parametrize("file", ["points.npz", "x.trc"])
def test_a_reference_that_stands_along_another_axis_than_the_calibrations_world(tmp_path: Path, file: str):
    """As Pose2Sim's TRC, y up, beside its own calibration, z up. Whoever lies along x is believed."""
    names = ["RShoulder", "LShoulder", "RHip", "LHip", "Nose"]
    standing = np.array([[0.2, 1.4, 0], [-0.2, 1.4, 0], [0.15, 0.9, 0], [-0.15, 0.9, 0], [0, 1.6, 0.1]])
    seen = seen_by(SHIFT)
    assert seen.world is not None
    camera = replace(seen, world=replace(seen.world, up="z"))

    def read(points: np.ndarray) -> Reference:
        np.savez(tmp_path / "points.npz", points=points, names=np.array(names))
        (tmp_path / "x.trc").write_text(trc(points, names=names))
        return read_reference(tmp_path / file, seen_by=camera)

    y_up = np.tile(standing, (6, 1, 1))
    found = read(y_up)
    assert not found.in_camera and "points along y" in found.notes[-1] and "z is up" in found.notes[-1]
    assert not read(-y_up[..., [0, 2, 1]]).in_camera, "head down in the same world"
    for sound in (y_up[..., [2, 0, 1]], y_up[..., [1, 0, 2]]):
        assert read(sound).in_camera, "upright, and lying along x"


@pytest.mark.parametrize("numbers", ["1 0 0", " ".join(["1"] * 12), "nan " * 12, "x " * 12, "-1 0 0 0 1 0 0 0 1 0 0 0"])
def test_a_camera_that_is_none(tmp_path: Path, numbers: str):
    text = trc(POINTS).replace("x.trc", f"x.trc\tx_camera = R x + t, metres: {numbers}", 1)
    (tmp_path / "x.trc").write_text(text)
    with pytest.raises(InputError, match="not a rotation and a position"):
        read_reference(tmp_path / "x.trc")


def test_no_world_puts_a_reference_before_a_camera_that_moves(tmp_path: Path, camera: Path):
    np.savez(tmp_path / "points.npz", points=POINTS, names=np.array(NAMES))
    moving = replace(seen_by(SHIFT), path=path_of(np.tile(np.eye(3), (4, 1, 1)), np.zeros((4, 3))))
    assert not read_reference(tmp_path / "points.npz", seen_by=moving).in_camera
    with pytest.raises(InputError, match="stands still, and the clip's moves"):
        read_reference(tmp_path / "points.npz", camera=camera, seen_by=moving)


@pytest.mark.parametrize("unit", ["mm", "m"])
def test_trc(tmp_path: Path, unit: str):
    points = POINTS.copy()
    points[2, 3] = np.nan
    (tmp_path / "x.trc").write_text(trc(points, unit, first=0.2))
    found = read_reference(tmp_path / "x.trc")
    assert found.frame_rate == 50 and found.first_frame == 10 and len(found) == 4
    np.testing.assert_allclose(found.points[:, kp.INDEX["nose"]], points[:, 3], atol=1e-8)


def test_the_truth_of_a_generated_clip(tmp_path: Path, free_body: BodyModel):
    params = random_params(3)
    truth = Truth(
        params=params,
        joints=joints_in_space(free_body, params),
        keypoints=np.zeros((3, 137, 2)),
        visible=np.ones((3, 137), bool),
        exists=np.ones(137, bool),
        camera=Camera(focal=(800.0, 800.0), center=(320.0, 240.0), size=(640, 480)),
        frame_rate=25.0,
        body_hash=free_body.hash,
    )
    write_truth(tmp_path / "truth.npz", truth)
    found = read_reference(tmp_path)
    assert found.in_camera and found.body is not None and found.body.hash == free_body.hash
    assert found.joints is not None
    np.testing.assert_allclose(found.joints, truth.joints, atol=1e-9)
    write_truth(tmp_path / "truth.npz", replace(truth, body_hash="0" * 64))
    with pytest.raises(InputError, match="not on this computer"):
        read_reference(tmp_path)


def amass(body: BodyModel, params: BodyParams) -> dict[str, np.ndarray]:
    return {
        "poses": full_pose(body, params).flatten(1).numpy(),
        "trans": params.camera_translation.numpy(),
        "betas": np.concatenate([params.betas[0].numpy(), np.zeros(6)]),
        "gender": np.array("neutral"),
        "mocap_frame_rate": np.array(100.0),
    }


def test_amass_of_any_make_is_the_same_reference(tmp_path: Path, camera: Path, free_body: BodyModel):
    """Objects beside, parts in place of `poses`, a frame rate or shape for each frame: as `import` reads them."""
    params = random_params(3)
    arrays = amass(free_body, replace(params, betas=params.betas[:1].expand(3, -1)))
    arrays["body_hash"] = np.array(free_body.hash)
    write_npz(tmp_path / "a.npz", arrays)
    expected = read_reference(tmp_path / "a.npz", camera=camera)
    ends = {
        "root_orient": (0, 3),
        "pose_body": (3, 66),
        "pose_jaw": (66, 69),
        "pose_eye": (69, 75),
        "pose_hand": (75, 165),
    }
    parts = {name: arrays["poses"][:, start:stop] for name, (start, stop) in ends.items()}
    changed = arrays | {
        "labels_obs": np.array([["C7"], None], object),
        "mocap_frame_rate": np.array([100.0]),
        "betas": np.repeat(arrays["betas"][None], 3, axis=0),
    }
    np.savez(tmp_path / "b.npz", allow_pickle=True, **changed)
    of_parts = parts | {k: v for k, v in changed.items() if k != "poses"}
    np.savez(tmp_path / "c.npz", allow_pickle=True, **of_parts)
    for name in ("b.npz", "c.npz"):
        found = read_reference(tmp_path / name, camera=camera)
        assert found.frame_rate == 100 and found.joints is not None and expected.joints is not None
        np.testing.assert_allclose(found.joints, expected.joints, atol=1e-12)
        np.testing.assert_allclose(found.points, expected.points, atol=1e-12)


@pytest.mark.parametrize("axes", AXES)
def test_tcfits_own_export_of_any_world_gets_into_the_camera(tmp_path: Path, free_body: BodyModel, axes: str):
    motion = swinging(free_body)
    write_animation_npz(tmp_path / "a.npz", motion.in_axes(axes))
    found = read_reference(tmp_path / "a.npz")
    assert found.in_camera and found.first_frame == motion.first_frame and found.joints is not None
    np.testing.assert_allclose(found.joints, joints_in_space(free_body, motion.params), atol=1e-6)


def test_amass_needs_the_official_model(tmp_path: Path, free_body: BodyModel):
    arrays = amass(free_body, random_params(3))
    write_npz(tmp_path / "a.npz", arrays)
    with pytest.raises(InputError, match="official neutral SMPLX model"):
        read_reference(tmp_path / "a.npz")
    arrays["poses"] = arrays["poses"][:, :156]
    write_npz(tmp_path / "h.npz", arrays)
    with pytest.raises(InputError, match="SMPL-H"):
        read_reference(tmp_path / "h.npz")
    write_npz(tmp_path / "w.npz", arrays | {"poses": arrays["poses"][:, :72]})
    with pytest.raises(InputError, match=r"72 columns .*, expected 165 \(SMPL-X\)"):
        read_reference(tmp_path / "w.npz")


STANDING = {"Shoulder": 1.4, "Hip": 0.9, "Knee": 0.47, "Ankle": 0.06}


def standing(scale: float, folder: Path) -> Path:
    """Somebody's sides at 30 cm from each other, in a unit of which so many make a metre."""
    places = {f"{side}{part}": (x, y, 0.0) for side, x in (("L", 0.15), ("R", -0.15)) for part, y in STANDING.items()}
    points = scale * np.tile(list(places.values()), (3, 1, 1))
    np.savez(folder / "standing.npz", points=points, names=np.array(list(places)))
    return folder / "standing.npz"


@pytest.mark.parametrize(
    "scale, said",
    [
        (
            1000,
            "left_shoulder and left_hip are 500 m apart; expected metres .* They look like millimetres: divide them",
        ),
        (100, "look like centimetres: divide them by 100"),
        (3.3, "look like feet"),
        (39.4, "look like inches"),
        (0.001, "Scale the points to metres"),
        (0, "Scale the points to metres"),
    ],
)
def test_points_in_another_unit_are_refused(tmp_path: Path, scale: float, said: str):
    with pytest.raises(InputError, match=said):
        read_reference(standing(scale, tmp_path))


def test_a_stored_reference_is_the_same(tmp_path: Path, free_body: BodyModel):
    params = random_params(2)
    made = replace(reference_of("x", "made here", free_body, params, frame_rate=None, in_camera=True), notes=("a", "b"))
    write_reference(tmp_path / "reference.npz", made)
    found = read_reference(tmp_path / "reference.npz")
    assert (found.name, found.kind, found.frame_rate, found.notes, found.body) == (
        "x",
        "made here",
        None,
        ("a", "b"),
        made.body,
    )
    assert found.params is not None
    for f in fields(BodyParams):
        np.testing.assert_array_equal(getattr(found.params, f.name), getattr(params, f.name))
    np.testing.assert_array_equal(found.points, made.points)


def of_length(frames: int, *, rate: float | None = None, first: int = 0) -> Reference:
    points = np.zeros((frames, 137, 3))
    return Reference(name="r", kind="", frame_rate=rate, first_frame=first, in_camera=True, points=points)


def test_frames_are_matched_by_number_or_time():
    assert of_length(5).frames_of(4, 2, 25.0).tolist() == [2, 3, 4, -1]
    assert of_length(5, rate=25.0, first=3).frames_of(4, 2, 25.0).tolist() == [-1, 0, 1, 2]
    assert of_length(50, rate=100.0).frames_of(4, 1, 25.0).tolist() == [4, 8, 12, 16]
    assert of_length(5000, rate=29.97).frames_of(1, 4000, 30.0) == of_length(5000, rate=30.0).frames_of(1, 4000, 29.97)
    assert of_length(5000, rate=60.0).frames_of(2, 1000, 29.97).tolist() == [2000, 2002]
    assert of_length(5000, rate=29.97).frames_of(2, 4000, 60.0)[0] == 2000
    with pytest.raises(InputError, match="expected a reference of the same clip"):
        of_length(5).frames_of(4, 10, 25.0)


def cut(frames: int, folder: Path, **keys: Any) -> Reference:
    np.savez(folder / "cut.npz", points=np.tile(POINTS, (frames // 4, 1, 1)), names=np.array(NAMES), **keys)
    return read_reference(folder / "cut.npz")


def test_a_reference_as_long_as_a_later_fit_must_say_where_it_begins(tmp_path: Path):
    found = cut(40, tmp_path)
    with pytest.raises(
        InputError, match=r"40 frames, which last as long .* frame 20\. Say it with --reference-first-frame 20 if"
    ):
        found.frames_of(40, 20, 25.0)
    with pytest.raises(InputError, match="last as long as the fit's 10"):
        cut(40, tmp_path, fps=100.0).frames_of(10, 20, 25.0)
    assert found.frames_of(40, 0, 25.0)[0] == 0 and found.frames_of(10, 20, 25.0)[0] == 20
    assert found.starting_at(20, 25.0).frames_of(40, 20, 25.0).tolist() == list(range(40))
    assert found.starting_at(0, 25.0).frames_of(40, 20, 25.0)[:20].tolist() == list(range(20, 40))
    faster = cut(40, tmp_path, fps=100.0).starting_at(20, 25.0)
    assert faster.frames_of(10, 20, 25.0).tolist() == list(range(0, 40, 4))


@pytest.mark.parametrize("form", ["points", "trc", "amass", "stored"])
def test_files_say_where_a_reference_begins(tmp_path: Path, free_body: BodyModel, form: str):
    read = {"points": lambda first: cut(4, tmp_path, **first)}
    body = free_body

    def of_trc(first: dict[str, Any]) -> Reference:
        (tmp_path / "x.trc").write_text(trc(POINTS, first=first.get("first_frame", 0) / 50))
        return read_reference(tmp_path / "x.trc")

    def of_amass(first: dict[str, Any]) -> Reference:
        np.savez(tmp_path / "a.npz", body_hash=np.array(body.hash), **amass(body, random_params(4)), **first)
        return read_reference(tmp_path / "a.npz")

    def stored(first: dict[str, Any]) -> Reference:
        write_reference(tmp_path / "stored.npz", cut(4, tmp_path, **first))
        return read_reference(tmp_path / "stored.npz")

    read |= {"trc": of_trc, "amass": of_amass, "stored": stored}
    told, untold = read[form]({"first_frame": 10}), read[form]({})
    assert (told.first_frame, told.first_frame_known) == (10, True)
    assert (untold.first_frame, untold.first_frame_known) == (0, False)


def test_other_systems_results_lie_beside_the_truth(tmp_path: Path):
    """On the video's clock, which says rate and first frame; stored, they are the same."""
    points = np.tile(POINTS, (3, 1, 1))
    seconds = 0.25 + np.arange(len(points)) / 100
    np.savez(tmp_path / "p.npz", points=points, names=np.array(NAMES), time=seconds, wham=points + 0.01, scores=seconds)
    found = read_reference(tmp_path / "p.npz")
    assert found.frame_rate == pytest.approx(100) and found.first_frame == 25 and found.first_frame_known
    assert list(found.others) == ["wham"]
    np.testing.assert_allclose(found.others["wham"], found.points + 0.01)
    write_reference(tmp_path / "stored.npz", found)
    np.testing.assert_array_equal(read_reference(tmp_path / "stored.npz").others["wham"], found.others["wham"])
    np.savez(tmp_path / "p.npz", points=points, names=np.array(NAMES), time=seconds**2)
    with pytest.raises(InputError, match="not evenly spaced; expected a second of the video for each of"):
        read_reference(tmp_path / "p.npz")


def test_bad_cameras(tmp_path: Path):
    np.savez(tmp_path / "p.npz", points=POINTS, names=np.array(NAMES))
    bad = {"mirror": np.diag([1.0, 1, -1]), "scaled": 2 * np.eye(3), "flat": np.eye(2)}
    for name, rotation in bad.items():
        np.savez(tmp_path / f"{name}.npz", R=rotation, t=SHIFT)
        with pytest.raises(InputError, match=r"mirrors|no rotation|expected R"):
            read_reference(tmp_path / "p.npz", camera=tmp_path / f"{name}.npz")
    np.savez(tmp_path / "behind.npz", R=np.eye(3), t=-SHIFT)
    with pytest.raises(InputError, match="behind the camera"):
        read_reference(tmp_path / "p.npz", camera=tmp_path / "behind.npz")
    np.savez(tmp_path / "mm.npz", R=np.eye(3), t=1e3 * SHIFT)
    with pytest.raises(InputError, match=r"lies 60\d\d m in front of the camera.* Give t of --camera in metres"):
        read_reference(tmp_path / "p.npz", camera=tmp_path / "mm.npz")
