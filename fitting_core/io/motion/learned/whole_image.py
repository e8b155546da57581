"""Systems that place a body before the camera of the whole image: GVHMR, GEM, WHAM, TRAM and PromptHMR.

| system | documented by | body | taken |
|---|---|---|---|
| GVHMR | zju3dv/GVHMR tools/demo/demo.py, hmr4d/model/gvhmr/gvhmr_pl_demo.py | SMPL-X, mean hands | \
smpl_params_incam (global_orient, body_pose 63, betas, transl), K_fullimg |
| GEM (GENMO) | NVlabs/GENMO tools/demo/demo_slam.py | as GVHMR | as GVHMR |
| WHAM | yohanshin/WHAM demo.py, lib/utils/imutils.py | SMPL | by person: pose 72, betas, trans, frame_ids; the focal \
length is the image's diagonal |
| TRAM | yufu-wang/tram scripts/estimate_humans.py, estimate_camera.py, lib/models/hmr_vimo.py | SMPL | pred_rotmat, \
pred_shape, pred_trans, frame; camera.npy: img_focal, img_center |
| PromptHMR | yufu-wang/PromptHMR pipeline/pipeline.py, phmr_vid.py | SMPL-X, flat hands | by person: smplx_cam (pose, \
shape, trans), frames; camera: img_focal, img_center |

All of them also give a motion in the world, for a moving camera; it is not read.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fitting_core.camera import Camera
from fitting_core.io.motion.learned.tracks import (
    BODY,
    SMPL_JOINTS,
    System,
    Track,
    angles,
    body_angles,
    by_person,
    centred,
    first_of,
    flat,
    frame_numbers,
    is_mapping_with,
    mapping,
    people_by,
    rows,
    shape_numbers,
)

_TOLD = "told by the result"


def gvhmr_people(content: Any) -> Mapping[int, Sequence[int]]:
    """One, in all frames."""
    return {0: range(len(rows(content.get("smpl_params_incam"), "transl", 3)))}


def gvhmr_track(content: Any, person: int) -> Track:
    """The person."""
    values = content["smpl_params_incam"]
    translation = rows(values, "transl", 3)
    frames = len(translation)
    matrix = rows(content, "K_fullimg", 9, frames)[0].reshape(3, 3)
    return Track(
        pose=np.concatenate([rows(values, "global_orient", 3, frames), rows(values, "body_pose", 63, frames)], 1),
        betas=shape_numbers(values, "betas", frames),
        translation=translation,
        kind="smplx",
        camera=centred(float(matrix[0, 0]), matrix[:2, 2].tolist(), _TOLD),
    )


def wham_track(content: Any, person: int) -> Track:
    """One of the people."""
    values = by_person(content)[person]
    numbers = frame_numbers(values, "frame_ids")
    return Track(
        pose=body_angles(rows(values, "pose", 3 * SMPL_JOINTS, len(numbers))),
        betas=shape_numbers(values, "betas", len(numbers)),
        translation=rows(values, "trans", 3, len(numbers)),
        numbers=numbers,
        focal=(lambda size: math.hypot(*size), "WHAM's, the image's diagonal"),
    )


def tram_people(content: Any) -> Mapping[int, Sequence[int]]:
    """Of each track, the frames."""
    return people_by(content["tracks"], "frame")


def tram_track(content: Any, person: int) -> Track:
    """One of the tracks; its shape is the mean over its frames, as TRAM shows it."""
    values = content["tracks"][person]
    numbers = frame_numbers(values, "frame")
    shape = shape_numbers(values, "pred_shape", len(numbers))
    camera = content["camera"]
    lost = "It has no camera.npy beside its folder hps, so its focal length is not known; give TRAM's folder."
    return Track(
        pose=angles(rows(values, "pred_rotmat", 9 * SMPL_JOINTS, len(numbers)), "pred_rotmat")[:, : 3 * BODY],
        betas=np.broadcast_to(shape.mean(0), shape.shape),
        translation=rows(values, "pred_trans", 3, len(numbers)),
        numbers=numbers,
        camera=None if camera is None else _camera(camera),
        notes=(lost,) if camera is None else (),
    )


def prompthmr_people(content: Any) -> Mapping[int, Sequence[int]]:
    """Of each person, the frames."""
    return people_by(mapping(content["people"], "'people'"), "frames")


def prompthmr_track(content: Any, person: int) -> Track:
    """One of the people. `pose` continues with jaw and eyes, which are zero."""
    track = by_person(content["people"])[person]
    values = mapping(track, "a person").get("smplx_cam")
    numbers = frame_numbers(track, "frames")
    return Track(
        pose=rows(values, "pose", 75, len(numbers))[:, :66],
        betas=shape_numbers(values, "shape", len(numbers)),
        translation=rows(values, "trans", 3, len(numbers)),
        numbers=numbers,
        kind="smplx",
        flat_hands=True,
        camera=_camera(content.get("camera")),
    )


def _camera(values: Any) -> Camera:
    return centred(float(flat(values, "img_focal", 1)[0]), flat(values, "img_center", 2).tolist(), _TOLD)


SYSTEMS = (
    System(
        title="GVHMR",
        holds=lambda content: is_mapping_with(content, "smpl_params_incam", "smpl_params_global"),
        people=gvhmr_people,
        track=gvhmr_track,
    ),
    System(
        title="WHAM",
        holds=lambda content: is_mapping_with(first_of(content), "pose_world", "trans_world"),
        people=lambda content: people_by(content, "frame_ids"),
        track=wham_track,
    ),
    System(
        title="TRAM", holds=lambda content: is_mapping_with(content, "tracks"), people=tram_people, track=tram_track
    ),
    System(
        title="PromptHMR",
        holds=lambda content: is_mapping_with(content, "people") and is_mapping_with(content, "camera"),
        people=prompthmr_people,
        track=prompthmr_track,
    ),
)
