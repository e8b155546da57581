"""Results image by image: SMPLer-X's parameters, Multi-HMR's meshes and SAM 3D Body's keypoints, and who is who."""

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import body_keypoints_in_space, joints_in_space
from fitting_core.camera import project
from fitting_core.errors import InputError
from fitting_core.io import read_motion
from fitting_core.io.motion.learned.followed import followed
from fitting_core.io.motion.learned.per_image import _SAM_NAMES
from fitting_core.starts.posing import posed_on
from tests.fitting_core.io.motion.learned_files import joblib_bytes, torch_bytes, truth, written
from tests.fitting_core.io.motion.per_image_files import CAMERA, SAM_PLACES, multi_hmr, sam_people, smplerx
from tests.samples.scenes import arms_in_motion

ALL = np.arange(5)


def whole(seed: int = 0) -> BodyParams:
    """With hands, jaw and expression."""
    draw, params = torch.Generator().manual_seed(seed), truth(seed)
    drawn = {
        name: 0.2 * torch.randn(getattr(params, name).shape, generator=draw, dtype=torch.float64)
        for name in ("left_hand_pose", "right_hand_pose", "jaw_pose", "expression")
    }
    return replace(params, **drawn)


def test_smplerx(tmp_path: Path, tiny_body: BodyModel):
    """The pose is the same, and the body where each crop's camera saw it, in one camera for all frames."""
    params = whole()
    found = read_motion(smplerx(tmp_path, {0: (params, ALL + 1)}))
    assert found.format == "SMPLer-X result" and found.numbers == (1, 2, 3, 4, 5) and not found.notes
    camera = found.camera_for(CAMERA)
    placed = found.on(tiny_body, camera)
    joints, expected = joints_in_space(tiny_body, placed), joints_in_space(tiny_body, params)
    rooted = (joints - joints[:, :1]) - (expected - expected[:, :1])
    assert np.abs(rooted).max() < 1e-3 and torch.allclose(placed.expression, params.expression)
    pixels = project(camera, placed.camera_translation) - project(CAMERA, params.camera_translation)
    assert float(pixels.abs().max()) < 1e-6
    sizes = placed.camera_translation[:, 2] / camera.focal[0] / (params.camera_translation[:, 2] / 800)
    assert torch.allclose(sizes, torch.ones_like(sizes))


def test_people_change_places_in_the_list(tmp_path: Path):
    one, other = whole(1), whole(2)
    other = replace(other, camera_translation=other.camera_translation + torch.tensor([2.5, 0.0, 0.0]))
    folder = smplerx(tmp_path, {0: (one, ALL), 1: (other, ALL[1:])})
    found = [read_motion(folder, person=n) for n in (0, 1)]
    found.sort(key=len)
    assert [len(motion) for motion in found] == [4, 5] and "has no tracks" in found[0].notes[-1]
    assert torch.allclose(found[1].params.body_pose, one.body_pose)
    assert torch.allclose(found[0].params.body_pose, other.body_pose[:4])


def test_who_is_gone_for_long_or_elsewhere_is_somebody_else():
    still, near = np.array([0.0, 0, 4]), np.array([0.1, 0, 4.1])
    assert followed([[still], [near], [], [still]]) == {0: {0: 0, 1: 0, 3: 0}}
    assert len(followed([[still], [still - [2, 0, 0]]])) == 2 and len(followed([[still], [2 * still]])) == 2
    assert len(followed([[still], *[[]] * 40, [still]])) == 2


def with_smplx_mesh(body: BodyModel) -> BodyModel:
    """With as many vertices as SMPL-X: its own, repeated."""
    many = np.resize(np.arange(len(body.template)), 10475)
    regressor = np.zeros((55, 10475))
    regressor[:, : len(body.template)] = body.joint_regressor
    names = ("template", "shape_directions", "expression_directions", "skinning_weights")
    parts = {name: getattr(body, name)[many] for name in names}
    corrective = body.pose_directions.astype(np.float32)[many]
    return replace(body, joint_regressor=regressor, pose_directions=corrective, **parts)


def test_multi_hmr(tmp_path: Path, tiny_body: BodyModel):
    """A body of the same mesh is within 1 mm of it; another one is told what is missing."""
    body, params = with_smplx_mesh(tiny_body), whole()[:2]
    bent = ("body_pose", "left_hand_pose", "right_hand_pose", "jaw_pose")
    params = replace(params, **{name: 0.3 * getattr(params, name) for name in bent})
    away = replace(params, camera_translation=params.camera_translation + torch.tensor([2.0, 0.0, 0.0]))
    found = read_motion(multi_hmr(tmp_path / "out", body, [params, away]), person=1)
    assert found.format == "Multi-HMR result" and found.stems == ("image3", "image4") and found.numbers == (3, 4)
    assert found.camera_for(CAMERA).focal[0] == pytest.approx(640 / 2 * 3**0.5)
    posed = posed_on(found, body)
    error = joints_in_space(body, posed.on(body, CAMERA)) - joints_in_space(body, away)
    assert np.abs(error).max() < 1e-3 and "no poses" in posed.notes[-1]
    with pytest.raises(InputError, match="has meshes of 10475 vertices and no poses, and the smplx body here has 440"):
        posed_on(found, tiny_body)


def test_what_multi_hmrs_model_returns(tmp_path: Path, tiny_body: BodyModel):
    params = whole(3)
    left, right = (torch.as_tensor(mean) for mean in tiny_body.hand_mean)
    hands = [params.left_hand_pose + left, params.right_hand_pose + right]
    rotvec = torch.cat([params.global_orient, params.body_pose, *hands, params.jaw_pose], 1).view(-1, 53, 3)
    pelvis = joints_in_space(tiny_body, params)[:, :1]
    people = [
        {
            "rotvec": rotvec[t].float(),
            "shape": params.betas[t].float(),
            "expression": params.expression[t].float(),
            "transl_pelvis": torch.as_tensor(pelvis[t]).float(),
            "verts_smplx": torch.zeros(10475, 3),
        }
        for t in ALL
    ]
    found = read_motion(written(tmp_path / "humans.pt", torch_bytes({f"{t + 1:03d}.jpg": [people[t]] for t in ALL})))
    assert found.format == "Multi-HMR result" and found.numbers == (1, 2, 3, 4, 5) and found.points is None
    joints = joints_in_space(tiny_body, found.on(tiny_body, CAMERA))
    assert np.abs(joints - joints_in_space(tiny_body, params)).max() < 1e-3


def test_sams_points_have_their_names():
    assert {name: place for place, name in _SAM_NAMES.items() if name in SAM_PLACES} == SAM_PLACES
    assert len(set(_SAM_NAMES.values())) == len(_SAM_NAMES) == 64


SAM_FILES: dict[str, tuple[str, Callable[[list[dict[str, Any]]], bytes]]] = {
    "images by name": ("a.pkl", lambda people: pickle.dumps({f"{t + 1:04d}.jpg": [p] for t, p in enumerate(people)})),
    "list of images": ("a.joblib", lambda people: joblib_bytes([[one] for one in people])),
    "torch": ("a.pt", lambda people: torch_bytes({f"{t:04d}.png": [p] for t, p in enumerate(people)})),
    "json": ("a.json", lambda people: json.dumps([[plain(one)] for one in people]).encode()),
}


def plain(person: dict[str, Any]) -> dict[str, Any]:
    return {key: getattr(value, "tolist", lambda v=value: v)() for key, value in person.items() if "vert" not in key}


@pytest.mark.parametrize("kind", SAM_FILES)
def test_sam_3d_body_is_read(kind: str, tmp_path: Path, free_body: BodyModel):
    name, write = SAM_FILES[kind]
    people = sam_people(free_body, arms_in_motion(3, depth=3.5))
    found = read_motion(written(tmp_path / name, write(people)))
    assert found.format == "SAM 3D Body result" and len(found) == 3 and found.points is not None
    seen = found.points.keypoints
    assert seen is not None
    expected = body_keypoints_in_space(free_body, arms_in_motion(3, depth=3.5))
    there = np.isfinite(seen[:, kp.BODY]) & np.isfinite(expected)
    assert there[:, :, 0].sum() == 3 * 24 and np.abs(seen[:, kp.BODY] - expected)[there].max() < 1e-5


def test_sam_3d_body_is_followed(tmp_path: Path, free_body: BodyModel):
    """From arrays by frame; the body's keypoints lie where its are, whatever focal length each image has."""
    params = arms_in_motion(3, depth=3.5)
    people = [sam_people(free_body, params, focal=focal)[t] for t, focal in enumerate((800.0, 700.0, 800.0))]
    keys = ("pred_keypoints_3d", "pred_cam_t", "focal_length")
    np.savez(tmp_path / "a.npz", allow_pickle=False, **{key: np.stack([one[key] for one in people]) for key in keys})
    found = read_motion(tmp_path / "a.npz")
    assert found.camera_for(CAMERA).focal[0] == 800
    posed = posed_on(found, free_body)
    placed = posed.on(free_body, CAMERA)
    off = body_keypoints_in_space(free_body, placed) - body_keypoints_in_space(free_body, params)
    off[:, kp.INDEX["mid_hip"]] = 0  # which it does not tell
    assert np.nanmax(np.linalg.norm(off, axis=-1)) < 0.01 and "of another body" in posed.notes[-1]
    joints = joints_in_space(free_body, placed) - joints_in_space(free_body, params)
    assert np.linalg.norm(joints, axis=-1).mean() < 0.01
