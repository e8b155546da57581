"""fit.npz and summary.json: what they hold, that they read back, and what happens to broken ones."""

import json
import os
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.files.reading import load_body
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera, Lens, project
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS
from fitting_core.errors import InputError
from fitting_core.io import result_files
from fitting_core.io.result_files import fit_arrays, read_fit, write_result
from fitting_core.keypoints import Keypoints
from fitting_core.results.fit_result import FitResult, PhaseResult
from fitting_core.results.provenance import Provenance
from tests.samples.body_files import VERTICES, body_arrays, write_npz
from tests.samples.project_samples import sample_error_bars, sample_view
from tests.samples.walkers import HEIGHT, TILT, grounding_of_a_walk

FRAMES = 5
CAMERA = Camera(focal=(700.0, 710.0), center=(310.0, 250.0), size=(640, 480), source="as given")
NAMES = [f.name for f in fields(BodyParams)]
Result = tuple[FitResult, Clip, BodyModel]


@pytest.fixture(scope="module")
def body(tmp_path_factory: pytest.TempPathFactory) -> BodyModel:
    arrays = body_arrays()
    # Few bones, one for each vertex: more would make the face contour's tables slow to compile.
    arrays["weights"] = np.eye(55)[np.arange(VERTICES) % 5 * 11]
    return load_body(write_npz(tmp_path_factory.mktemp("body") / "SMPLX_FEMALE.npz", arrays))


def _params(seed: int, *, components: int = 12, shared: bool = True) -> BodyParams:
    generator = torch.Generator().manual_seed(seed)
    neutral = BodyParams.neutral(FRAMES, hand_components=components)
    drawn = {n: 0.2 * torch.randn(t.shape, generator=generator, dtype=t.dtype) for n, t in vars(neutral).items()}
    drawn["camera_translation"] += torch.tensor([0.0, 0.0, 12.0])
    if shared:
        drawn["betas"] = drawn["betas"][:1].expand(FRAMES, -1)
    return BodyParams(**drawn)


def _phase(number: int, params: BodyParams) -> PhaseResult:
    terms = {"data": 2.0, "total": 2.0}
    return PhaseResult(phase=number, params=params, objective=terms, frame_cost=np.ones(FRAMES), seconds=number / 2)


@pytest.fixture
def result(body: BodyModel) -> Callable[..., Result]:
    """result(last_phase=3, components=12): a random fit, and a clip with keypoints (3, 4) px off its phase 1."""

    def build(last_phase: int = 3, components: int = 12) -> Result:
        params = [_params(seed, components=components, shared=seed > 1) for seed in range(1, last_phase + 1)]
        phases = tuple(_phase(number, p) for number, p in enumerate(params, 1))
        points, exists = keypoints_in_space(body, params[0])
        points[:, ~exists, 2] = 1
        xy = project(CAMERA, torch.as_tensor(points)).numpy() + np.array([3.0, 4.0])
        clip = Clip(
            keypoints=Keypoints(xy=xy, confidence=np.full(xy.shape[:2], 0.9)),
            camera=CAMERA,
            frame_rate=29.97,
            name="walk",
            first_frame=7,
            detector="mediapipe",
        )
        observed = np.random.default_rng(0).random((FRAMES, 55)) < 0.5
        fit = FitResult(
            phases=phases, camera=CAMERA, config=PRESETS["paper"], observed=observed, warnings=("gap in 3",), size=0.9
        )
        return fit, clip, body

    return build


def _with_bars(fit: FitResult) -> FitResult:
    return replace(fit, phases=(*fit.phases[:-1], replace(fit.last, error_bars=sample_error_bars(1, FRAMES))))


def _same(a: BodyParams, b: BodyParams) -> bool:
    return all(torch.equal(getattr(a, name), getattr(b, name)) for name in NAMES)


@pytest.mark.parametrize("last_phase", [1, 2, 3])
@pytest.mark.parametrize("components", [12, 45])
def test_round_trip(tmp_path: Path, result: Callable[..., Result], last_phase: int, components: int):
    fit, clip, body = result(last_phase, components)
    write_result(tmp_path / "new" / "out", fit, clip, body, complete=last_phase == 3)
    stored = read_fit(tmp_path / "new" / "out")
    assert _same(stored.params, fit.last.params) and _same(stored.phase1, fit.phases[0].params)
    assert (stored.camera, stored.frame_rate, stored.first_frame) == (CAMERA, 29.97, 7)
    assert (stored.gender, stored.body_kind, stored.body_hash) == ("female", "smplx", body.hash)
    assert (stored.last_phase, stored.complete) == (last_phase, last_phase == 3)
    assert (stored.observed == fit.observed).all() and stored.provenance is None and stored.size == 0.9
    assert stored.keypoints is not None and stored.detector == "mediapipe"
    np.testing.assert_allclose(stored.keypoints.xy, clip.keypoints.xy, rtol=1e-6)
    np.testing.assert_allclose(stored.keypoints.confidence, clip.keypoints.confidence, rtol=1e-6)
    assert np.allclose(stored.joints, Mesh(body, dtype=torch.float64).joints(fit.last.params).numpy(), atol=1e-9)


@pytest.mark.parametrize("phases", [(1,), (1, 3), (3,)])
def test_joints_are_those_of_the_parameters_that_are_read_back(
    tmp_path: Path, result: Callable[..., Result], phases: tuple[int, ...]
):
    """Also where another program has found a shape for each frame."""
    fit, clip, body = result(1)
    params = fit.last.params
    write_result(tmp_path, replace(fit, phases=tuple(_phase(number, params) for number in phases)), clip, body)
    stored = read_fit(tmp_path)
    np.testing.assert_allclose(stored.joints, joints_in_space(body, stored.params), atol=1e-9)
    np.testing.assert_allclose(stored.joints[:, 0], joints_in_space(body, params)[:, 0], atol=1e-9)


def test_the_ground_reads_back_and_old_files_open_without(tmp_path: Path, result: Callable[..., Result]):
    fit, clip, body = result()
    known = replace(fit, grounding=grounding_of_a_walk(FRAMES))
    summary = write_result(tmp_path / "known", known, clip, body)
    stored = read_fit(tmp_path / "known").grounding
    assert stored is not None and stored.ground is not None and stored.ground.offset == pytest.approx(HEIGHT, abs=0.1)
    assert summary["ground"]["seen"] and summary["ground"]["camera_height_m"] == stored.ground.offset
    assert summary["ground"]["text"] == stored.text and summary["ground"]["camera_tilt_degrees"] == pytest.approx(TILT)
    with np.load(tmp_path / "known" / "fit.npz", allow_pickle=False) as file:
        assert (file["gravity"].shape, file["ground"].shape, file["contacts"].shape) == ((3,), (4,), (FRAMES, 2))
        assert file["gravity"][1] > 0.9, "things fall along y, which points down in the image"
    assert write_result(tmp_path / "old", fit, clip, body)["ground"] is None
    assert read_fit(tmp_path / "old").grounding is None


def test_error_bars_read_back_and_old_files_open_without(tmp_path: Path, result: Callable[..., Result]):
    fit, clip, body = result()
    bars = sample_error_bars(1, FRAMES)
    write_result(tmp_path / "known", _with_bars(fit), clip, body)
    stored = read_fit(tmp_path / "known").error_bars
    assert stored is not None
    np.testing.assert_array_equal(stored.joints, bars.joints)
    np.testing.assert_array_equal(stored.angles, bars.angles)
    write_result(tmp_path / "old", fit, clip, body)
    assert read_fit(tmp_path / "old").error_bars is None


def test_other_views_read_back(tmp_path: Path, result: Callable[..., Result]):
    fit, clip, body = result()
    first = sample_view(clip, name="b", count=4)
    lens = Lens(focal=(700.0, 700.0), center=(300.0, 250.0), distortion=(0.1, 0.0, 0.0, 0.0))
    second = replace(sample_view(clip, name="c", count=6, times=np.arange(6.0) ** 1.5), relation=first.relation)
    second = replace(second, clip=replace(second.clip, camera=replace(CAMERA, lens=lens), first_frame=3))
    write_result(tmp_path, fit, replace(clip, views=(first, second)), body)
    stored = read_fit(tmp_path).views
    assert [view.relation for view in stored] == [first.relation, second.relation]
    assert stored[0].times is None and stored[1].times is not None and second.times is not None
    np.testing.assert_array_equal(stored[1].times, second.times)
    for found, view in zip(stored, (first, second), strict=True):
        np.testing.assert_allclose(found.clip.keypoints.xy, view.clip.keypoints.xy, rtol=1e-6)
        plain = [(c.camera, c.name, c.frame_rate, c.first_frame, c.detector) for c in (found.clip, view.clip)]
        assert plain[0] == plain[1]


def test_error_bars_of_six_angles_are_those_of_earlier_versions(tmp_path: Path, result: Callable[..., Result]):
    fit, clip, body = result()
    bars = sample_error_bars(1, FRAMES)
    arrays: dict = fit_arrays(_with_bars(fit), clip, body)
    arrays["angle_error_bars"] = bars.angles[:, :6]
    np.savez(tmp_path / "fit.npz", **arrays)
    stored = read_fit(tmp_path).error_bars
    assert stored is not None and np.isnan(stored.angles[:, 6:]).all()
    np.testing.assert_array_equal(stored.angles[:, :6], bars.angles[:, :6])


def test_keys_of_smplx_tools(result: Callable[..., Result]):
    fit, clip, body = result()
    arrays = fit_arrays(fit, clip, body)
    last = fit.last.params
    shapes = {"poses": 165, "trans": 3, "expressions": 10, "root_orient": 3, "pose_body": 63, "pose_hand": 90}
    for name, width in (shapes | {"pose_jaw": 3, "pose_eye": 6}).items():
        assert arrays[name].shape == (FRAMES, width)
    parts = [arrays[n] for n in ("root_orient", "pose_body", "pose_jaw", "pose_eye", "pose_hand")]
    assert (np.concatenate(parts, 1) == arrays["poses"]).all()
    assert arrays["betas"].shape == (10,) and (arrays["betas"] == last.betas[0].numpy()).all()
    assert arrays["mocap_frame_rate"] == arrays["mocap_framerate"] == 29.97
    assert str(arrays["surface_model_type"]) == "smplx" and str(arrays["gender"]) == "female"
    assert str(arrays["detector"]) == "mediapipe"
    left = body.hand_mean[0] + last.left_hand_pose.numpy() @ body.hand_components[0, :12]
    assert np.allclose(arrays["pose_hand"][:, :45], left)
    assert arrays["frames"].tolist() == [7, 8, 9, 10, 11]
    assert "y down" in str(arrays["axes"])


def test_where_frames_came_from_is_told_in_numbers_and_in_english(tmp_path: Path, result: Callable[..., Result]):
    fit, clip, body = result()
    provenance = Provenance(np.array([1, 5, 6, 1, 14], np.uint8), np.array([1, 1, 2, 3, 5], np.uint8))
    last = replace(fit.last, provenance=provenance)
    write_result(tmp_path, replace(fit, phases=(*fit.phases[:-1], last)), clip, body)
    stored = read_fit(tmp_path).provenance
    assert stored is not None
    assert (stored.start == provenance.start).all() and (stored.stopped == provenance.stopped).all()
    with np.load(tmp_path / "fit.npz", allow_pickle=False) as file:
        assert file["start_texts"][file["start"]][1] == "a sitting pose"
        assert file["stopped_texts"][file["stopped"]][2] == "the limit of iterations was reached"


def test_summary(tmp_path: Path, result: Callable[..., Result]):
    fit, clip, body = result()
    write_result(tmp_path, fit, clip, body, command="tcfit fit x")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["complete"] is True and summary["frames"] == FRAMES and summary["first_frame"] == 7
    assert summary["seconds"] == {"phase1": 0.5, "phase2": 1.0, "phase3": 1.5, "total": 3.0}
    first = summary["reprojection_px"]["phase1"]
    assert first["median"] == pytest.approx(5) and first["p95"] == first["body_p95"] == pytest.approx(5)
    assert summary["reprojection_px"]["phase3"]["median"] > 5
    assert set(summary["objective"]) == {"phase1", "phase2", "phase3"}
    joints = Mesh(body, dtype=torch.float64).joints(fit.last.params).numpy()
    accelerations = joints[2:] - 2 * joints[1:-1] + joints[:-2]
    expected = 1e3 * np.linalg.norm(accelerations, axis=-1).mean()
    assert summary["jitter"]["phase3"]["camera_space_mm_per_frame2"] == pytest.approx(expected)
    seen = {"focal": [700, 710], "center": [310, 250], "size": [640, 480], "focal_from": "given", "source": "as given"}
    assert summary["camera"] == seen | {"lens": None, "world": None, "moves": False}
    assert summary["body"] == {"kind": "smplx", "gender": "female", "source": "SMPLX_FEMALE.npz", "hash": body.hash}
    assert summary["config"]["temporal"]["window_size"] == 7 and summary["warnings"] == ["gap in 3"]
    assert {"tcfit", "torch", "numpy", "python"} == set(summary["versions"])
    assert summary["command"] == "tcfit fit x" and summary["detector"] == "mediapipe"


def test_only_confident_keypoints_inside_count(tmp_path: Path, result: Callable[..., Result]):
    fit, clip, body = result(1)
    confidence = np.zeros_like(clip.keypoints.confidence)
    neck, wrist, elbow = (kp.INDEX[name] for name in ("neck", "left_wrist", "left_elbow"))
    confidence[:, [neck, wrist]], confidence[:, elbow] = 0.31, 0.29
    xy = clip.keypoints.xy.copy()
    xy[:, elbow] += 100
    xy[:, wrist] = [639, 240]  # at the border: cut off
    other = replace(clip, keypoints=Keypoints(xy=xy, confidence=confidence))
    found = write_result(tmp_path, fit, other, body)["reprojection_px"]["phase1"]
    assert (found["median"], found["p95"], found["keypoints"]) == (pytest.approx(5), pytest.approx(5), FRAMES)
    assert found["body_median"] is None and found["hands_p95"] is None, "the neck counts in no part"
    none = replace(clip, keypoints=Keypoints(xy=xy, confidence=0 * confidence))
    assert write_result(tmp_path, fit, none, body)["reprojection_px"]["phase1"]["median"] is None


def test_costs_that_are_not_finite_stay_valid_json(tmp_path: Path, result: Callable[..., Result]):
    fit, clip, body = result(1)
    broken = replace(fit.last, objective={"total": float("inf"), "data": float("nan")})
    write_result(tmp_path, replace(fit, phases=(broken,)), clip, body)
    text = (tmp_path / "summary.json").read_text()
    assert "Infinity" not in text and json.loads(text)["objective"]["phase1"] == {"total": None, "data": None}


def test_names_that_are_not_utf_8_can_be_told(tmp_path: Path, result: Callable[..., Result]):
    """As the names of files come on the command line; they must not end a fit that has gone through."""
    fit, clip, body = result()
    name = os.fsdecode(b"w\xe4lk")
    config = replace(fit.config, pose_prior=f"{name}.npz")
    fit = replace(fit, warnings=(name,), pose_prior=name, config=config)
    body = replace(body, source=Path(f"{name}.npz"))
    write_result(tmp_path, fit, replace(clip, name=name), body, command=f"tcfit fit {name}")
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert summary["clip"] == "w\ufffdlk" and summary["command"] == "tcfit fit w\ufffdlk"
    assert summary["config"]["pose_prior"] == "w\ufffdlk.npz" == summary["body"]["source"]
    assert read_fit(tmp_path).gender == body.gender


def test_failing_write_leaves_the_old_file(
    tmp_path: Path, result: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
):
    write_result(tmp_path, *result(1))
    old = (tmp_path / "fit.npz").read_bytes()

    def full(path: Path, **arrays: object) -> None:
        Path(path).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(result_files.np, "savez_compressed", full)
    with pytest.raises(InputError, match="No space left on device"):
        write_result(tmp_path, *result(3))
    assert (tmp_path / "fit.npz").read_bytes() == old
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fit.npz", "summary.json"]


def _without(name: str) -> Callable[[dict], dict]:
    return lambda arrays: {k: v for k, v in arrays.items() if k != name}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_without("phase1_jaw_pose"), "lacks 'phase1_jaw_pose'"),
        (_without("format"), "an npz of another program"),
        (lambda a: a | {"format": np.asarray("tcfit fit 99")}, "is 'tcfit fit 99'; expected 'tcfit fit 1'"),
        (lambda a: a | {"body_pose": a["body_pose"][:3]}, r"body_pose has the shape \(3, 63\), expected \(5, 63\)"),
        (lambda a: a | {"betas": np.zeros(16)}, r"betas has the shape \(16,\), expected \(10,\)"),
        (lambda a: a | {"camera_focal": np.float64(3.0)}, "is damaged"),
        (lambda a: a | {"poses": np.float64(3.0)}, "is damaged"),
        (lambda a: a | {"angle_error_bars": a["angle_error_bars"][:, :7]}, "has the shape"),
        (lambda a: a | {"joint_error_bars": a["joint_error_bars"][:-1]}, "has the shape"),
        (lambda a: a | {"angle_error_bars": -a["angle_error_bars"]}, "below 0"),
        (_without("angle_error_bars"), "lacks"),
        (lambda a: a | {"size": np.float64(np.nan)}, "its size is nan"),
        (_without("view1_keypoints"), "lacks 'view1_keypoints'"),
        (lambda a: a | {"view3_name": np.asarray("d")}, "lacks 'view2_keypoints'"),
        (lambda a: a | {"view1_keypoints": np.zeros((4, 25, 3))}, r"view1_keypoints .* expected .* \(4, 137, 3\)"),
        (lambda a: a | {"view1_rotation": np.ones((3, 3))}, "is not a rotation"),
        (lambda a: a | {"view1_offset": np.asarray("soon")}, "view1_offset is <U4 .* expected finite numbers"),
        (lambda a: a | {"view1_times": np.zeros(4)}, "do not rise"),
        (lambda a: a | {"view1_frame_rate": np.float64(0)}, "frame rate of a view is 0"),
        (_without("view1_camera_focal"), "lacks 'view1_camera_focal'"),
    ],
)
def test_broken_files_are_named(
    tmp_path: Path, result: Callable[..., Result], change: Callable[[dict], dict], message: str
):
    path, (fit, clip, body) = tmp_path / "fit.npz", result(1)
    clip = replace(clip, views=(sample_view(clip, name="b", count=4),))
    np.savez(path, **change(fit_arrays(_with_bars(fit), clip, body)))
    with pytest.raises(InputError, match=message):
        read_fit(path)
