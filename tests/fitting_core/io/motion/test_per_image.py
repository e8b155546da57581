"""Results of SAM 3D Body, image by image: keypoints, and who is who."""

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
from fitting_core.body.points.positions import body_keypoints_in_space, joints_in_space
from fitting_core.errors import InputError
from fitting_core.io import read_motion
from fitting_core.io.motion.learned.per_image import _NAMES
from fitting_core.starts.posing import posed_on
from tests.fitting_core.io.motion.learned_files import joblib_bytes, torch_bytes, written
from tests.fitting_core.io.motion.per_image_files import CAMERA, SAM_PLACES, sam_people
from tests.samples.scenes import arms_in_motion


def test_people_change_places_in_the_list(tmp_path: Path, free_body: BodyModel):
    one = arms_in_motion(3, depth=3.5)
    other = replace(one, camera_translation=one.camera_translation + torch.tensor([2.5, 0.0, 0.0]))
    left, right = sam_people(free_body, one), sam_people(free_body, other)
    images = [[left[0]], [right[1], left[1]], [left[2], right[2]]]
    path = written(tmp_path / "a.pkl", pickle.dumps(images))
    found = sorted((read_motion(path, person=n) for n in (0, 1)), key=len)
    assert [len(motion) for motion in found] == [2, 3] and "has no tracks" in found[0].notes[-1]
    for motion, params in zip(found, (other, one), strict=True):
        assert motion.points is not None
        wrists = motion.points[:, kp.INDEX["left_wrist"]]
        expected = body_keypoints_in_space(free_body, params)[-len(motion) :, kp.INDEX["left_wrist"]]
        assert np.abs(wrists - expected).max() < 1e-5


@pytest.mark.parametrize("shift, people", [((0.1, 0.0, 0.1), 1), ((2.0, 0.0, 0.0), 2), ((0.0, 0.0, 3.5), 2)])
def test_who_is_elsewhere_after_a_gap_is_somebody_else(tmp_path: Path, free_body: BodyModel, shift, people: int):
    params = arms_in_motion(4, depth=3.5)
    moved = replace(params, camera_translation=params.camera_translation + torch.tensor([[0.0] * 3] * 3 + [shift]))
    seen = sam_people(free_body, moved)
    path = written(tmp_path / "a.pkl", pickle.dumps([[seen[0]], [seen[1]], [], [seen[3]]]))
    motions = [read_motion(path, person=n) for n in range(people)]
    assert sum(len(motion) for motion in motions) == 3
    with pytest.raises(InputError):
        read_motion(path, person=people)


def test_sams_points_have_their_names():
    assert {name: place for place, name in _NAMES.items() if name in SAM_PLACES} == SAM_PLACES
    assert len(set(_NAMES.values())) == len(_NAMES) == 64


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
    seen = found.points
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
