"""Results of learned systems: written as they write them, of known poses, and read back: joints, pixels and frames."""

import bz2
import gzip
import json
import lzma
import os
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
from fitting_core.camera import Camera, project
from fitting_core.errors import InputError
from fitting_core.io import read_motion
from fitting_core.io.motion.imported_motion import ImportedMotion
from fitting_core.io.motion.learned.per_image import _NAMES
from fitting_core.io.motion.learned.systems import people_in
from fitting_core.starts.posing import posed_on
from tests.fitting_core.io.motion.learned_files import (
    DIAGONAL,
    FRAMES,
    PHALP_CAMERA,
    SIZE,
    gvhmr,
    joblib_bytes,
    phalp,
    prompthmr,
    torch_bytes,
    truth,
    wham,
    written,
    zlib_packed,
)
from tests.fitting_core.io.motion.per_image_files import CAMERA, SAM_PLACES, sam_people
from tests.samples.scenes import arms_in_motion

ALL = np.arange(FRAMES)
LATE = np.array([2, 3, 5, 6, 7])
People = dict[int, tuple[BodyParams, np.ndarray]]
Write = Callable[[Path, People, BodyModel], Path]


def one(people: People) -> tuple[BodyParams, np.ndarray]:
    return next(iter(people.values()))


# Name -> the system's title, how it is written, the camera that it has, and whether its hands are flat.
CASES: dict[str, tuple[str, Write, Camera, bool]] = {
    "gvhmr": (
        "GVHMR",
        lambda f, p, b: written(f / "hmr4d_results.pt", torch_bytes(gvhmr(one(p)[0]))),
        DIAGONAL,
        False,
    ),
    "gvhmr before 1.6": (
        "GVHMR",
        lambda f, p, b: written(
            f / "hmr4d_results.pt", torch_bytes(gvhmr(one(p)[0]), _use_new_zipfile_serialization=False)
        ),
        DIAGONAL,
        False,
    ),
    "wham": ("WHAM", lambda f, p, b: written(f / "wham_output.pkl", joblib_bytes(wham(p))), DIAGONAL, False),
    "prompthmr": ("PromptHMR", lambda f, p, b: written(f / "results.pkl", joblib_bytes(prompthmr(p))), DIAGONAL, True),
    "phalp": (
        "4D-Humans (PHALP)",
        lambda f, p, b: written(f / "results" / "demo_walk.pkl", joblib_bytes(phalp(p))),
        PHALP_CAMERA,
        False,
    ),
}
ALONE = ("gvhmr", "gvhmr before 1.6")
"""Those of which a file has one person, in all frames."""


def of_body(body: BodyModel, params: BodyParams, flat: bool) -> BodyParams:
    """The same with flat hands."""
    if not flat:
        return params
    left, right = (torch.as_tensor(mean).expand(len(params), 45) for mean in body.hand_mean)
    return replace(params, left_hand_pose=-left, right_hand_pose=-right)


def camera_of(found: ImportedMotion) -> Camera:
    if found.camera is not None:
        return found.camera
    told = found.focal_for(SIZE)
    assert told is not None
    return Camera(focal=(told[0], told[0]), center=(SIZE[0] / 2, SIZE[1] / 2), size=SIZE)


@pytest.mark.parametrize("name", CASES)
def test_a_result_reads_back(name: str, tmp_path: Path, tiny_body: BodyModel):
    title, write, camera, flat = CASES[name]
    params = truth()
    numbers = ALL if name in ALONE else LATE
    found = read_motion(write(tmp_path, {4: (params, numbers)}, tiny_body))
    assert found.format == f"{title} result" and found.gender == "neutral"
    assert found.kind == ("smplx" if title in ("GVHMR", "PromptHMR") else "smpl")
    assert found.numbers == tuple(numbers) and found.numbered == (name not in ALONE)
    own = camera_of(found)
    assert np.allclose([*own.focal, *own.center, *own.size], [*camera.focal, *camera.center, *camera.size], rtol=1e-5)
    joints = joints_in_space(tiny_body, found.on(tiny_body, own))
    expected = joints_in_space(tiny_body, of_body(tiny_body, params, flat))
    assert np.abs(joints - expected).max() < 1e-3
    pixels = [project(lens, torch.as_tensor(at)) for lens, at in ((own, joints), (camera, expected))]
    assert float((pixels[0] - pixels[1]).abs().max()) < 0.3
    assert torch.allclose(found.params.body_pose, params.body_pose, atol=1e-5)


@pytest.mark.parametrize("name", [name for name in CASES if name not in ALONE])
def test_of_several_people_the_one_in_most_frames(name: str, tmp_path: Path, tiny_body: BodyModel):
    _, write, _, _ = CASES[name]
    few, many = truth(1, 2), truth(2)
    path = write(tmp_path, {3: (few, np.array([3, 6])), 7: (many, LATE)}, tiny_body)
    found = read_motion(path)
    assert found.numbers == tuple(LATE)
    assert torch.allclose(found.params.body_pose, many.body_pose, atol=1e-5)
    assert found.notes[0] == "It has 2 people: 7 (5 frames), 3 (2 frames). Number 7 was taken."
    other = read_motion(path, person=3)
    assert other.numbers == (3, 6) and torch.allclose(other.params.body_pose, few.body_pose, atol=1e-5)
    assert [(person.number, person.numbers) for person in people_in(path)] == [(7, tuple(LATE)), (3, (3, 6))]
    assert other.people == people_in(path)
    with pytest.raises(InputError, match="has no person 5, only 7, 3; choose one of these"):
        read_motion(path, person=5)


PACKED: dict[str, Callable[[bytes], bytes]] = {
    "zlib": zlib_packed,
    "gzip": gzip.compress,
    "bz2": bz2.compress,
    "xz": lzma.compress,
    "lzma": lambda data: lzma.compress(data, format=lzma.FORMAT_ALONE),
}


@pytest.mark.parametrize("packing", PACKED)
@pytest.mark.parametrize("alignment", [None, 16])
def test_packed_files_of_joblib(packing: str, alignment: int | None, tmp_path: Path):
    params = truth()
    content = wham({0: (params, LATE)}, verts=np.asfortranarray(np.ones((5, 9, 3))))
    found = read_motion(written(tmp_path / "wham.pkl", PACKED[packing](joblib_bytes(content, alignment=alignment))))
    assert torch.allclose(found.params.body_pose, params.body_pose, atol=1e-5) and found.numbers == tuple(LATE)


@pytest.mark.parametrize("kind", [torch.float16, torch.bfloat16, torch.float32, torch.float64])
@pytest.mark.parametrize("new", [True, False])
def test_tensors_of_every_kind(kind: torch.dtype, new: bool, tmp_path: Path):
    """Views too: a slice of a larger tensor, turned."""
    params = truth()
    whole = torch.zeros(70, FRAMES, dtype=kind)
    whole[4:67] = params.body_pose.T.to(kind)
    content = gvhmr(params, incam={"body_pose": whole[4:67].T})
    path = written(tmp_path / "a.pt", torch_bytes(content, _use_new_zipfile_serialization=new))
    error = float((read_motion(path).params.body_pose - params.body_pose).abs().max())
    assert error < {torch.float16: 1e-3, torch.bfloat16: 1e-2}.get(kind, 1e-6)


def test_a_systems_folder_holds_its_file(tmp_path: Path, tiny_body: BodyModel):
    for name in ("gvhmr", "wham", "prompthmr"):
        CASES[name][1](tmp_path / name, {0: (truth(), ALL)}, tiny_body)
        assert read_motion(tmp_path / name).format == f"{CASES[name][0]} result"


def test_images_are_told_by_name(tmp_path: Path, tiny_body: BodyModel):
    found = read_motion(CASES["phalp"][1](tmp_path, {4: (truth(), LATE)}, tiny_body))
    assert found.stems == tuple(f"{t + 1:06d}" for t in LATE)


def test_a_pickle_of_smplifyx_is_not_taken_for_another(tmp_path: Path):
    result: dict[str, Any] = {
        "camera_rotation": np.eye(3)[None],
        "camera_translation": np.array([[0.0, 0.0, 9.0]]),
        "betas": np.zeros((1, 10)),
        "expression": np.zeros((1, 10)),
        "body_pose": np.zeros((1, 63)),
        "left_hand_pose": np.zeros((1, 12)),
        "right_hand_pose": np.zeros((1, 12)),
        **{key: np.zeros((1, 3)) for key in ("global_orient", "jaw_pose", "leye_pose", "reye_pose")},
    }
    for name in ("000.pkl", "upload.pkl"):
        found = read_motion(written(tmp_path / name, pickle.dumps(result, protocol=2)))
        assert found.format == "SMPLify-X results"


def slim(people: dict[int, Any]) -> dict[int, Any]:
    """Without meshes: most changed bytes then are of what is read."""
    return {number: {**values, "verts": np.zeros(3)} for number, values in people.items()}


FORMS: dict[str, Callable[[], bytes]] = {
    "torch.pt": lambda: torch_bytes(gvhmr(truth())),
    "old.pt": lambda: torch_bytes(gvhmr(truth()), _use_new_zipfile_serialization=False),
    "wham.pkl": lambda: joblib_bytes(slim(wham({1: (truth(), ALL)}))),
    "plain.pkl": lambda: pickle.dumps(slim(wham({1: (truth(), ALL)}))),
    "packed.pkl": lambda: zlib_packed(joblib_bytes(slim(wham({1: (truth(), ALL)})))),
    "results.pkl": lambda: joblib_bytes(prompthmr({1: (truth(), ALL)})),
    "demo.pkl": lambda: joblib_bytes(phalp({1: (truth(), ALL)})),
}


@pytest.mark.parametrize("name", FORMS)
def test_changed_and_missing_bytes(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A file that is cut off, or of which bytes are changed, is read or refused in one error, and nothing runs."""
    monkeypatch.setattr(os, "system", lambda command: pytest.fail("something was run"))
    whole, rng = FORMS[name](), np.random.default_rng(5)
    refused = 0
    for _ in range(60):
        data = bytearray(whole)
        if rng.random() < 0.2:
            del data[rng.integers(len(data)) :]
        for place in rng.integers(min(len(data), 3000) or 1, size=rng.choice([1, 2, 10])):
            if place < len(data):
                data[place] = data[place] ^ (1 << rng.integers(8)) if rng.random() < 0.5 else rng.integers(256)
        path = written(tmp_path / name, bytes(data))
        try:
            read_motion(path)
        except InputError as error:
            refused += 1
            assert name in str(error) and len(str(error)) < 700
    assert refused > 10


# --- SAM 3D Body, image by image ---


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
    """Arrays by frame; body keypoints match those of the body under each image's own focal length."""
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
