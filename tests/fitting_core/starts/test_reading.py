"""Results of other systems as starts: the pose and place that come back, whose they are, and which frames they have."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.fit.evidence.given_start import from_pelvis
from fitting_core.io.motion.animation_npz import write_animation_npz
from fitting_core.io.motion.smplifyx import write_smplifyx
from fitting_core.keypoints import Keypoints
from fitting_core.motion import Motion
from fitting_core.results.given_start import GivenStart
from fitting_core.starts.reading import read_start
from tests.fitting_core.io.motion.learned_files import (
    DIAGONAL,
    PHALP_CAMERA,
    SIZE,
    gvhmr,
    joblib_bytes,
    phalp,
    prompthmr,
    torch_bytes,
    wham,
    written,
)
from tests.fitting_core.io.motion.learned_files import truth as drawn
from tests.fitting_core.io.motion.per_image_files import sam_people
from tests.samples.scenes import arms_in_motion

FRAMES = 6
ALL = np.arange(FRAMES)
Write = Callable[[Path, BodyParams, np.ndarray], Path]


def truth(seed: int = 0, frames: int = FRAMES) -> BodyParams:
    """Of the mean shape: that of another body means nothing to the fitted one."""
    params = drawn(seed, frames)
    return replace(params, betas=0 * params.betas)


def clip_of(body: BodyModel, params: BodyParams, camera: Camera = DIAGONAL, first_frame: int = 0) -> Clip:
    points, exists = keypoints_in_space(body, params)
    seen = exists & (np.arange(kp.COUNT) < kp.BODY.stop)
    xy = np.zeros((len(params), kp.COUNT, 2))
    xy[:, seen] = project(camera, torch.as_tensor(points[:, seen])).numpy()
    keypoints = Keypoints(xy=xy, confidence=np.tile(0.9 * seen, (len(params), 1)))
    return Clip(keypoints=keypoints, camera=camera, frame_rate=30.0, name="walk", first_frame=first_frame)


def write_wham(folder: Path, params: BodyParams, frames: np.ndarray) -> Path:
    return written(folder / "wham_output.pkl", joblib_bytes(wham({0: (params, frames)})))


FORMS: dict[str, Write] = {
    "gvhmr": lambda f, p, t: written(f / "hmr4d_results.pt", torch_bytes(gvhmr(p))),
    "wham": write_wham,
    "prompthmr": lambda f, p, t: written(f / "results.pkl", joblib_bytes(prompthmr({0: (p, t)}))),
    "phalp": lambda f, p, t: written(f / "results" / "demo_walk.pkl", joblib_bytes(phalp({0: (p, t)}))),
}


def body_joints(body: BodyModel, params: BodyParams) -> np.ndarray:
    """Those of trunk and limbs: some systems have flat hands."""
    return joints_in_space(body, params)[:, : JOINT["right_wrist"] + 1]


def angle(one: Tensor, other: Tensor) -> float:
    """Degrees between two rotations, the largest of all frames."""
    turn = rotations.log(rotations.exp(one).transpose(1, 2) @ rotations.exp(other))
    return float(turn.norm(dim=1).rad2deg().max())


CAMERAS = {"phalp": PHALP_CAMERA}


@pytest.mark.parametrize("form", FORMS)
def test_the_pose_comes_back_before_the_clips_camera(form: str, free_body: BodyModel, tmp_path: Path):
    """Within a millimetre, where that is the system's: all joints of the body."""
    params, camera = truth(), CAMERAS.get(form, DIAGONAL)
    farther = torch.tensor([1.0, 1.0, camera.focal[0] / DIAGONAL.focal[0]], dtype=torch.float64)
    params = replace(params, camera_translation=params.camera_translation * farther)
    start = read_start(FORMS[form](tmp_path, params, ALL), clip_of(free_body, params, camera), free_body)
    assert start.there.all() and start.about.frames == FRAMES and start.about.off < 1e-3
    assert torch.allclose(start.params.body_pose, params.body_pose, atol=1e-5)
    assert np.abs(body_joints(free_body, start.params) - body_joints(free_body, params)).max() < 1e-3


def test_what_trembles_in_a_result_is_not_held(free_body: BodyModel, tmp_path: Path):
    """The pose of each frame stays what it is, as where phase 1 begins."""
    frames = 40
    params = arms_in_motion(frames)
    noise = torch.as_tensor(np.random.default_rng(5).normal(0.0, 0.05, (frames, 63)))
    trembling = replace(params, body_pose=params.body_pose + noise)
    result = FORMS["wham"](tmp_path, trembling, np.arange(frames))
    start = read_start(result, clip_of(free_body, trembling), free_body)
    assert torch.allclose(start.params.body_pose, trembling.body_pose, atol=1e-5)
    own = from_pelvis(free_body, start.params)
    jitter = [np.nanmean(np.abs(np.diff(points[start.there], 2, axis=0))) for points in (start.points, own)]
    assert jitter[0] < 0.5 * jitter[1]
    assert np.nanmax(np.abs(start.points - own)) < 0.15


def test_keypoints_in_space_start_too(free_body: BodyModel, tmp_path: Path):
    """Of two people the one who follows the clip's keypoints; the body is posed through these."""
    params = arms_in_motion(FRAMES, depth=3.5)
    away = replace(params, camera_translation=params.camera_translation + torch.tensor([0.9, 0.0, -0.6]))
    seen = [sam_people(free_body, one) for one in (away, params)]
    path = written(tmp_path / "sam.pkl", joblib_bytes([list(people) for people in zip(*seen, strict=True)]))
    found = read_start(path, clip_of(free_body, params), free_body)
    assert found.there.all() and found.about.person == 1 and found.about.format == "SAM 3D Body result"
    off = joints_in_space(free_body, found.params) - joints_in_space(free_body, params)
    assert np.linalg.norm(off[:, :22], axis=-1).mean() < 0.02


def test_smplifyx_tcfit_and_amass_start_too(free_body: BodyModel, tmp_path: Path):
    params = truth()
    clip = clip_of(free_body, params)
    folder = tmp_path / "smplifyx"
    stems = [f"{t:06d}" for t in range(FRAMES)]
    write_smplifyx(folder, params, stems=stems, camera=DIAGONAL, body=free_body, frame_rate=30)
    motion = Motion(body=free_body, params=params, camera=DIAGONAL, frame_rate=30, name="w")
    for path in (folder, tmp_path / "own.npz"):
        if path != folder:
            write_animation_npz(path, motion)
        start = read_start(path, clip, free_body)
        assert np.abs(joints_in_space(free_body, start.params) - joints_in_space(free_body, params)).max() < 1e-3


def test_a_motion_without_a_camera_is_turned_until_it_looks_like_the_keypoints(free_body: BodyModel, tmp_path: Path):
    """AMASS's world has z up and any heading."""
    params = truth()
    upright = rotations.exp(torch.tensor([[torch.pi, 0.0, 0.0]], dtype=torch.float64)).expand(FRAMES, 3, 3)
    orient = rotations.log(rotations.yaw(40.0, params.betas) @ upright)
    params = replace(params, global_orient=orient, body_pose=0.5 * params.body_pose)
    to_world = torch.tensor([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]], dtype=torch.float64)
    pose = torch.cat([rotations.log(to_world @ rotations.exp(orient)), params.body_pose, torch.zeros(FRAMES, 90)], 1)
    arrays = {"poses": pose.numpy(), "trans": np.zeros((FRAMES, 3)), "betas": np.zeros(16), "gender": "neutral"}
    turned = rotations.exp(torch.tensor([0.0, 0.0, 2.0], dtype=torch.float64))
    arrays["poses"][:, :3] = rotations.log(turned @ rotations.exp(torch.as_tensor(pose[:, :3]))).numpy()
    np.savez(tmp_path / "amass.npz", mocap_framerate=30.0, **arrays)
    start = read_start(tmp_path / "amass.npz", clip_of(free_body, params), free_body)
    assert angle(start.params.global_orient, params.global_orient) < 8
    assert start.about.focal_source == "the clip's: the motion has no camera"


def test_another_focal_length_scales_the_depth_and_turns_with_the_line_of_sight(free_body: BodyModel, tmp_path: Path):
    """What is seen on the right, a longer lens sees nearer to its axis: a body that faced the camera faces it again."""
    params = truth()
    params = replace(
        params,
        global_orient=torch.tensor([torch.pi, 0.0, 0.0], dtype=torch.float64).expand(FRAMES, 3),
        body_pose=0.3 * params.body_pose,
        camera_translation=params.camera_translation + torch.tensor([1.2, 0.0, 0.0]),
    )
    seen = clip_of(free_body, params)
    longer = replace(DIAGONAL, focal=(1600.0, 1600.0))
    start = read_start(write_wham(tmp_path, params, ALL), replace(seen, camera=longer), free_body)
    before, after = (joints_in_space(free_body, p)[:, JOINT["pelvis"]] for p in (params, start.params))
    assert after[:, 2] / before[:, 2] == pytest.approx(2, rel=0.05)
    turn = np.degrees(np.arctan2(before[:, 0], before[:, 2]) - np.arctan2(after[:, 0], after[:, 2]))
    found = rotations.log(
        rotations.exp(start.params.global_orient) @ rotations.exp(params.global_orient).transpose(1, 2)
    )
    assert np.degrees(found[:, 1].numpy()) == pytest.approx(-turn, abs=0.7)
    assert turn.min() > 5


def test_the_one_who_follows_the_keypoints_is_taken(free_body: BodyModel, tmp_path: Path):
    """Not who is in most frames; and the number that was asked for, if one was."""
    mine, other = truth(1), truth(2, 40)
    away = other.camera_translation + torch.tensor([0.8, 0.0, 0.0])
    sideways = torch.tensor([0.0, 0.0, 1.5], dtype=torch.float64).expand(40, 3)
    other = replace(other, global_orient=sideways, camera_translation=away)
    people = {4: (other, np.arange(40)), 9: (mine, ALL)}
    path = written(tmp_path / "wham_output.pkl", joblib_bytes(wham(people)))
    start = read_start(path, clip_of(free_body, mine), free_body)
    assert start.about.person == 9 and torch.allclose(start.params.body_pose, mine.body_pose, atol=1e-5)
    assert any("Number 9 was taken" in note for note in start.about.notes)
    assert read_start(path, clip_of(free_body, other[slice(FRAMES)]), free_body).about.person == 4
    with pytest.raises(InputError, match=r"keypoints of person 4 .* cm off .*another of its people"):
        read_start(path, clip_of(free_body, mine), free_body, person=4)


def test_points_are_those_of_the_results_own_body(free_body: BodyModel, tmp_path: Path):
    """A body of longer limbs: its angles go to the fitted body, and its keypoints lie where its own limbs have them."""
    params = truth()
    larger = replace(free_body, kind="smpl", template=1.1 * free_body.template)
    path = write_wham(tmp_path, params, ALL)

    def start_with(find: Callable[[str, str], BodyModel | None]) -> GivenStart:
        return read_start(path, clip_of(free_body, params), free_body, find_body=find)

    asked: list[tuple[str, str]] = []
    found = start_with(lambda kind, gender: (asked.append((kind, gender)), larger)[1])
    assert asked == [("smpl", "neutral")]
    np.testing.assert_allclose(found.points, from_pelvis(larger, params), atol=1e-4)
    assert torch.allclose(found.params.body_pose, params.body_pose, atol=1e-5)
    np.testing.assert_allclose(start_with(lambda *_: None).points, from_pelvis(free_body, params), atol=1e-4)


def test_a_result_of_another_clip_is_refused(free_body: BodyModel, tmp_path: Path):
    path = write_wham(tmp_path, truth(5), ALL)
    mine = truth(6)
    upside_down = replace(mine, global_orient=0 * mine.global_orient)
    with pytest.raises(InputError, match="expected the result of this clip and of this person, less than 15 cm off"):
        read_start(path, clip_of(free_body, upside_down), free_body)


def test_images_of_another_form_are_refused(free_body: BodyModel, tmp_path: Path):
    params = truth()
    square = replace(DIAGONAL, size=(SIZE[0], SIZE[0]))
    path = written(tmp_path / "hmr4d_results.pt", torch_bytes(gvhmr(params)))
    with pytest.raises(InputError, match="was found on images of 640 x 480 pixels"):
        read_start(path, clip_of(free_body, params, square), free_body)
