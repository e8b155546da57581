"""Motions of other programs: round trips of each format, the way into camera space, and the frames of a clip."""

import pickle
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting_core.body import rotations
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space
from fitting_core.camera import Camera, FocalFrom
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS
from fitting_core.errors import InputError
from fitting_core.files.pickles import as_array, read_pickle
from fitting_core.ground.level import Level, upright
from fitting_core.io import read_motion
from fitting_core.io.motion.animation_npz import write_animation_npz
from fitting_core.io.motion.imported_motion import cover
from fitting_core.io.motion.smplifyx import FOCAL, RESULTS, read_smplifyx, write_smplifyx
from fitting_core.io.result_files import fit_arrays, read_fit
from fitting_core.keypoints import Keypoints
from fitting_core.motion import Motion
from fitting_core.priors.latent import LatentPrior
from fitting_core.results.fit_result import FitResult, PhaseResult
from tests.fitting_core.priors.networks import random_latents, random_network

CAMERA = Camera(
    focal=(900.0, 910.0),
    center=(310.0, 250.0),
    size=(640, 480),
    focal_from=FocalFrom.PROGRAM,
    source="told by the results",
)


def params(seed: int, frames: int, *, hands: int = 12, angle: float = 0.6) -> BodyParams:
    draw = torch.Generator().manual_seed(seed)
    neutral = BodyParams.neutral(frames, hand_components=hands)
    drawn = {n: angle * torch.randn(t.shape, generator=draw, dtype=t.dtype) for n, t in vars(neutral).items()}
    drawn["camera_translation"] += torch.tensor([0.0, 0.0, 6.0])
    return BodyParams(**drawn)


def written(folder: Path, motion: BodyParams, body: BodyModel, stems: list[str] | None = None, **more) -> Path:
    names = stems or [f"walk_{t:06d}" for t in range(len(motion))]
    write_smplifyx(folder, motion, stems=names, camera=CAMERA, body=body, frame_rate=25, **more)
    return folder


def largest_difference(one: BodyParams, other: BodyParams) -> float:
    return max(float((a - b).abs().max()) for a, b in zip(vars(one).values(), vars(other).values(), strict=True))


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), frames=st.integers(1, 4), hands=st.sampled_from([6, 12, 45]))
def test_smplifyx_results_read_back(tiny_body: BodyModel, seed: int, frames: int, hands: int):
    motion = params(seed, frames, hands=hands)
    with tempfile.TemporaryDirectory() as folder:
        found = read_motion(written(Path(folder), motion, tiny_body))
    assert largest_difference(found.on(tiny_body, CAMERA), motion) < 1e-5
    assert found.camera == CAMERA and found.frame_rate == 25 and found.body_hash == tiny_body.hash


FLOOR = Level(turn=upright(np.array([0.1, -0.9, -0.4])), height=1.3, text="a floor")


@settings(max_examples=20)
@given(
    seed=st.integers(0, 10**6),
    axes=st.sampled_from(["camera", "y-up", "z-up"]),
    hands=st.sampled_from([12, 45]),
    level=st.sampled_from([None, FLOOR]),
)
def test_animations_read_back(tiny_body: BodyModel, seed: int, axes: str, hands: int, level: Level | None):
    motion = Motion(
        body=tiny_body, params=params(seed, 3, hands=hands, angle=0.4), camera=CAMERA, frame_rate=29.97, name="w",
        first_frame=7, level=level,
    ).one_shape  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "walk.npz"
        write_animation_npz(file, motion.in_axes(axes))
        found = read_motion(file)
    posed = found.on(tiny_body, CAMERA)
    expected = motion.pose
    assert torch.allclose(replace(motion, params=posed).pose, expected, atol=1e-9)
    assert np.abs(joints_in_space(tiny_body, posed) - joints_in_space(tiny_body, motion.params)).max() < 1e-9
    assert found.numbers == (7, 8, 9) and found.frame_rate == 29.97 and found.camera is not None


def fit_of(folder: Path, phase: int, motion: BodyParams, body: BodyModel) -> dict[str, np.ndarray]:
    """Write fit.npz of one phase, from frame 40 on."""
    n = len(motion)
    result = PhaseResult(phase=phase, params=motion, objective={}, frame_cost=np.zeros(n), seconds=0.0)
    fit = FitResult(phases=(result,), camera=CAMERA, config=PRESETS["paper"], observed=np.ones((n, 55), bool))
    points = Keypoints(xy=np.zeros((n, 137, 2)), confidence=np.ones((n, 137)))
    arrays = fit_arrays(fit, Clip(keypoints=points, camera=CAMERA, frame_rate=25.0, name="w", first_frame=40), body)
    np.savez(folder / "fit.npz", allow_pickle=False, **arrays)
    return arrays


def test_a_fit_of_tcfit_reads_back(tiny_body: BodyModel, tmp_path: Path):
    """fit.npz has the hands as components and as angles; the latter are read, and pose the same body."""
    motion = Motion(body=tiny_body, params=params(3, 2), camera=CAMERA, frame_rate=25.0, name="w").one_shape
    fit_of(tmp_path, 3, motion.params, tiny_body)
    found = read_motion(tmp_path / "fit.npz")
    posed = found.on(tiny_body, CAMERA)
    assert (found.numbers, found.camera, found.placed) == ((40, 41), CAMERA, True)
    assert np.abs(joints_in_space(tiny_body, posed) - joints_in_space(tiny_body, motion.params)).max() < 1e-9


def test_a_fit_of_phase_1_alone_reads_back_where_it_was(tiny_body: BodyModel, tmp_path: Path):
    """Other programs see the mean of its frames' betas, with which the pelvis must not move."""
    motion = params(3, 4)
    arrays = fit_of(tmp_path, 1, motion, tiny_body)
    posed = read_motion(tmp_path / "fit.npz").on(tiny_body, CAMERA)
    pelvis = joints_in_space(tiny_body, posed)[:, 0]
    assert np.abs(pelvis - arrays["joints"][:, 0]).max() < 1e-9
    assert np.abs(arrays["trans"] - arrays["camera_translation"]).max() > 1e-3
    own = read_fit(tmp_path).params
    assert np.abs(joints_in_space(tiny_body, own) - arrays["joints"]).max() < 1e-9


def test_a_pickle_is_what_smplifyx_writes(tiny_body: BodyModel, tmp_path: Path):
    """Keys and shapes as its own results have them; numpy 1 finds what it asks for."""
    latent = random_latents(2)
    file = written(tmp_path, params(1, 2), tiny_body, embedding=latent) / RESULTS / "walk_000001" / "000.pkl"
    with file.open("rb") as stream:
        content = {key: as_array(value) for key, value in read_pickle(stream).items()}
    shapes = {key: value.shape for key, value in content.items()}
    assert shapes == {
        "camera_rotation": (1, 3, 3), "camera_translation": (1, 3), "betas": (1, 10), "global_orient": (1, 3),
        "left_hand_pose": (1, 12), "right_hand_pose": (1, 12), "jaw_pose": (1, 3), "leye_pose": (1, 3),
        "reye_pose": (1, 3), "expression": (1, 10), "body_pose": (1, 63), "pose_embedding": (1, 32),
        "camera_focal": (1, 2), "camera_center": (1, 2), "image_size": (1, 2),
    }  # fmt: skip
    assert {value.dtype for value in content.values()} == {np.dtype("float32")}
    assert b"numpy._core" not in file.read_bytes()
    assert np.allclose(pickle.loads(file.read_bytes())["pose_embedding"], latent[1:])


def latent_results(folder: Path, body: BodyModel, latent: torch.Tensor, **changed: object) -> Path:
    """What SMPLify-X itself leaves: VPoser's numbers for the pose, a turned camera, and no word of the focal length."""
    written(folder, params(2, len(latent)), body)
    for t, file in enumerate(sorted(folder.rglob("*.pkl"))):
        content = pickle.loads(file.read_bytes())
        content |= {"body_pose": latent[t : t + 1].numpy(), **changed}
        for key in ("camera_focal", "camera_center", "image_size"):
            del content[key]
        file.write_bytes(pickle.dumps(content, protocol=2))
    (folder / RESULTS / "about.json").unlink()
    return folder


def test_vposers_numbers_are_decoded(tiny_body: BodyModel, tmp_path: Path):
    latent, prior = random_latents(3), LatentPrior(random_network(seed=3))
    folder = latent_results(tmp_path, tiny_body, latent)
    found = read_smplifyx(folder, gender="female", decode=prior.decode)
    assert torch.allclose(found.params.body_pose, prior.decode(latent), atol=1e-9)
    assert found.gender == "female" and found.camera is None
    assert found.focal == (FOCAL, "SMPLify-X's default, as its results have none")
    with pytest.raises(InputError, match="32 VPoser numbers instead of angles"):
        read_smplifyx(folder)


def test_the_cameras_rotation_goes_into_the_root(tiny_body: BodyModel, tmp_path: Path):
    """Joints of the body, turned and moved by the camera as SMPLify-X does, against those of the composed root."""
    turn = rotations.exp(torch.tensor([0.4, -1.1, 0.3], dtype=torch.float64))
    motion = params(4, 2)
    for file in written(tmp_path, motion, tiny_body).rglob("*.pkl"):
        content = pickle.loads(file.read_bytes())
        file.write_bytes(pickle.dumps({**content, "camera_rotation": turn[None].numpy()}, protocol=2))
    composed = read_motion(tmp_path).on(tiny_body, CAMERA)
    own = replace(motion, camera_translation=torch.zeros_like(motion.camera_translation))
    expected = joints_in_space(tiny_body, own) @ turn.numpy().T + motion.camera_translation.numpy()[:, None]
    assert np.abs(joints_in_space(tiny_body, composed) - expected).max() < 1e-6


def test_one_of_several_people(tiny_body: BodyModel, tmp_path: Path):
    motion = params(5, 2)
    written(tmp_path, motion, tiny_body)
    for file in list(tmp_path.rglob("000.pkl")):
        content = pickle.loads(file.read_bytes())
        file.with_name("001.pkl").write_bytes(pickle.dumps({**content, "betas": np.ones((1, 10))}, protocol=2))
    found = read_smplifyx(tmp_path, person=1)
    assert bool((found.params.betas == 1).all()) and "Of 2 people" in found.notes[0]
    with pytest.raises(InputError, match=r"has no person 2 \(002.pkl\), only 000.pkl, 001.pkl"):
        read_smplifyx(tmp_path, person=2)


@pytest.mark.parametrize("columns", [165, 156])
def test_an_amass_file(tiny_body: BodyModel, tmp_path: Path, columns: int):
    """Its world has z up and no camera: the body comes before the clip's camera, upright, and moves as it did."""
    rng = np.random.default_rng(0)
    poses = rng.normal(0, 0.2, (5, columns))
    trans = np.array([3.0, -2.0, 0.9]) + rng.normal(0, 0.1, (5, 3))
    file = tmp_path / "walk.npz"
    np.savez(file, poses=poses, trans=trans, betas=rng.normal(size=16), gender=b"female", mocap_framerate=120.0)
    found = read_motion(file)
    assert (found.kind, found.gender, found.frame_rate) == ("smplx" if columns == 165 else "smplh", "female", 120.0)
    posed = found.on(tiny_body, CAMERA)
    hands = torch.as_tensor(poses[:, -90:-45]) - torch.as_tensor(tiny_body.hand_mean[0])
    assert torch.allclose(posed.left_hand_pose, hands) and torch.allclose(
        posed.body_pose, torch.as_tensor(poses[:, 3:66])
    )
    world = joints_in_space(tiny_body, replace(found.params, global_orient=torch.as_tensor(poses[:, :3]),
                            left_hand_pose=posed.left_hand_pose, right_hand_pose=posed.right_hand_pose,
                            camera_translation=torch.as_tensor(trans)))  # fmt: skip
    seen = joints_in_space(tiny_body, posed)
    # x right, z up, y away become x right, y down, z away, but for one shift of all.
    shift = seen - np.stack([world[..., 0], -world[..., 2], world[..., 1]], -1)
    assert np.abs(shift - shift[0, 0]).max() < 1e-9
    pixels = seen[..., :2] / seen[..., 2:] * np.array(CAMERA.focal) + np.array(CAMERA.center)
    assert seen[..., 2].min() > 0.3 and (pixels > 0).all() and (pixels < np.array(CAMERA.size)).all()


def _named(tiny_body: BodyModel, folder: Path, numbers: list[int]):
    stems = [f"walk_{n:06d}" for n in numbers]
    return read_motion(written(folder, params(0, len(numbers)), tiny_body, stems))


def test_frames_by_their_numbers_with_gaps(tiny_body: BodyModel, tmp_path: Path):
    motion = _named(tiny_body, tmp_path, [10, 11, 14, 15, 16])
    covered = cover(motion, 5, clip_first=11, clip_rate=25)
    assert covered.places.tolist() == [1, 1, 2, 2, 3] and covered.there.tolist() == [True, False, False, True, True]
    assert covered.missing == [1, 2]


def test_frames_are_those_of_the_images_that_they_are_named_after(tiny_body: BodyModel, tmp_path: Path):
    motion = _named(tiny_body, tmp_path, [3, 4, 5, 6])
    named, padded = ([f"{prefix}{n:0{width}d}" for n in range(1, 9)] for prefix, width in (("walk_", 6), ("walk_", 2)))
    for images in (named, padded):  # by their names, or by the numbers in them
        assert cover(motion, 3, clip_first=3, clip_rate=25, images=images).places.tolist() == [1, 2, 3]
    # As many frames as the clip has are its frames, unless their names say others.
    assert cover(motion, 4, clip_first=4, clip_rate=25, images=padded).places.tolist() == [0, 1, 2, 3]
    assert cover(motion, 4, clip_first=4, clip_rate=25, images=named).missing == [2, 3]
    with pytest.raises(InputError, match="for the video's frames 2 to 5; expected some of the clip's 2 frames, 6 to 7"):
        cover(motion, 2, clip_first=6, clip_rate=25, images=named)
    assert cover(motion, 4, clip_first=4, clip_rate=25, images=named, first_frame=4).places.tolist() == [0, 1, 2, 3]


NTSC = 30000 / 1001


@pytest.mark.parametrize(
    "rate, clip_rate, step", [(29.97, 30.0, 1), (30.0, 29.97, 1), (NTSC, 30.0, 1), (30.0, NTSC, 1), (59.94, 30.0, 2)]
)
def test_rates_that_mean_the_same_do_not_drift(tmp_path: Path, rate: float, clip_rate: float, step: int):
    frames = 4000 * step + 1
    np.savez(tmp_path / "a.npz", poses=np.zeros((frames, 165)), trans=np.zeros((frames, 3)), mocap_frame_rate=rate)
    covered = cover(read_motion(tmp_path / "a.npz"), 4000, clip_first=0, clip_rate=clip_rate)
    assert covered.places.tolist() == list(range(0, 4000 * step, step)) and covered.there.all()
