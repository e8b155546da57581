"""Systems that place a body before the camera of the whole image: GVHMR, GEM, WHAM, PromptHMR and 4D-Humans (PHALP).

| system | documented by | body | taken |
|---|---|---|---|
| GVHMR | zju3dv/GVHMR tools/demo/demo.py, hmr4d/model/gvhmr/gvhmr_pl_demo.py | SMPL-X, mean hands | \
smpl_params_incam (global_orient, body_pose 63, betas, transl), K_fullimg |
| GEM (GENMO) | NVlabs/GENMO tools/demo/demo_slam.py | as GVHMR | as GVHMR |
| WHAM | yohanshin/WHAM demo.py, lib/utils/imutils.py | SMPL | by person: pose 72, betas, trans, frame_ids; the focal \
length is the image's diagonal |
| PromptHMR | yufu-wang/PromptHMR pipeline/pipeline.py, phmr_vid.py | SMPL-X, flat hands | by person: smplx_cam (pose, \
shape, trans), frames; camera: img_focal, img_center |
| 4D-Humans, PHALP | brjathu/PHALP phalp/trackers/PHALP.py, phalp/models/hmar/hmar.py, phalp/configs/base.py; \
shubham-goel/4D-Humans issues 100 and 134 | SMPL | by image: time, tid, tracked_time, size (height, width), smpl \
(global_orient, body_pose as matrices, betas), camera: the translation, for 5000 pixels in the image padded to a \
square of 256 |

All but 4D-Humans also give a motion in the world, for a moving camera; it is not read.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from fitting_core.camera import Camera, FocalFrom
from fitting_core.errors import InputError
from fitting_core.files.torch_pickles import plain
from fitting_core.io.motion.learned.tracks import (
    SMPL_JOINTS,
    System,
    SystemMotion,
    as_mapping,
    axis_angles,
    body_angles,
    by_person,
    centred,
    first_of,
    flat,
    is_mapping_with,
    people_by,
    rows,
    shape_numbers,
    stated_frames,
)

_TOLD = "told by the result"
_PHALP_FOCAL = 5000 / 256


def gvhmr_people(content: Any) -> Mapping[int, Sequence[int]]:
    """One, in all frames."""
    return {0: range(len(rows(content.get("smpl_params_incam"), "transl", 3)))}


def gvhmr_track(content: Any, person: int) -> SystemMotion:
    """The person."""
    values = content["smpl_params_incam"]
    translation = rows(values, "transl", 3)
    frames = len(translation)
    matrix = rows(content, "K_fullimg", 9, frames)[0].reshape(3, 3)
    return SystemMotion(
        pose=np.concatenate([rows(values, "global_orient", 3, frames), rows(values, "body_pose", 63, frames)], 1),
        betas=shape_numbers(values, "betas", frames),
        translation=translation,
        kind="smplx",
        camera=centred(float(matrix[0, 0]), matrix[:2, 2].tolist(), _TOLD),
    )


def wham_track(content: Any, person: int) -> SystemMotion:
    """One of the people."""
    values = by_person(content)[person]
    numbers = stated_frames(values, "frame_ids")
    return SystemMotion(
        pose=body_angles(rows(values, "pose", 3 * SMPL_JOINTS, len(numbers))),
        betas=shape_numbers(values, "betas", len(numbers)),
        translation=rows(values, "trans", 3, len(numbers)),
        numbers=numbers,
        focal=(lambda size: math.hypot(*size), "WHAM's, the image's diagonal"),
    )


def prompthmr_people(content: Any) -> Mapping[int, Sequence[int]]:
    """Of each person, the frames."""
    return people_by(as_mapping(content["people"], "'people'"), "frames")


def prompthmr_track(content: Any, person: int) -> SystemMotion:
    """One of the people. `pose` continues with jaw and eyes, which are zero."""
    track = by_person(content["people"])[person]
    values = as_mapping(track, "a person").get("smplx_cam")
    numbers = stated_frames(track, "frames")
    return SystemMotion(
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


def _phalp_frames(content: Any, person: int | None = None) -> Iterator[tuple[str, int, int, dict[Any, Any]]]:
    """For all images: name, number, and the person's index in its lists; of all people for person None.

    Ghosts, which the tracker extrapolates but did not see, are left out.
    """
    for name, frame in content.items():
        values = as_mapping(frame, "an image's result")
        ids = _list(values, "tid")
        unseen = _list(values, "tracked_time") if "tracked_time" in values else [0] * len(ids)
        for place, track in enumerate(ids):
            seen = place >= len(unseen) or unseen[place] == 0
            if seen and (person is None or track == person):
                yield str(name), track, place, values


def _list(values: Mapping[Any, Any], key: str) -> list[Any]:
    found = values.get(key)
    if not isinstance(found, list):
        raise InputError(f"'{key}' is {'absent' if found is None else 'not a list'}, expected a list of the people")
    return [plain(one) for one in found]


def _entry(values: Mapping[Any, Any], key: str, place: int) -> Any:
    found = values.get(key)
    if not isinstance(found, list) or place >= len(found):
        raise InputError(f"'{key}' has no entry for each person in 'tid'")
    return found[place]


def phalp_people(content: Any) -> Mapping[int, Sequence[int]]:
    """Of each track, the frames."""
    people: dict[int, list[int]] = {}
    for _, track, _, values in _phalp_frames(content):
        if type(track) is not int:
            raise InputError("'tid' holds something other than numbers of people")
        people.setdefault(track, []).append(int(stated_frames({"time": values.get("time")}, "time")[0]))
    return people


def phalp_track(content: Any, person: int) -> SystemMotion:
    """One of the tracks."""
    found = list(_phalp_frames(content, person))
    places = [(values, _entry(values, "smpl", place), place) for _, _, place, values in found]
    turns = np.stack(
        [np.concatenate([flat(smpl, "global_orient", 9), flat(smpl, "body_pose", 207)]) for _, smpl, _ in places]
    )
    cameras = [flat({"camera": _entry(values, "camera", place)}, "camera", 3) for values, _, place in places]
    sizes = [flat({"size": _entry(values, "size", place)}, "size", 2)[::-1] for values, _, place in places]
    size = np.median(sizes, axis=0)
    return SystemMotion(
        pose=body_angles(axis_angles(turns, "smpl")),
        betas=np.concatenate([shape_numbers(smpl, "betas", 1) for _, smpl, _ in places]),
        translation=np.stack(cameras),
        numbers=np.array([int(stated_frames({"time": values["time"]}, "time")[0]) for values, _, _ in places]),
        stems=tuple(PurePosixPath(name.replace("\\", "/")).stem for name, _, _, _ in found),
        camera=_phalp_camera(size),
    )


def _phalp_camera(size: np.ndarray) -> Camera:
    width, height = round(float(size[0])), round(float(size[1]))
    if not (1 <= width <= 10**5 and 1 <= height <= 10**5):
        raise InputError(f"was found on images of {width} x {height} pixels")
    focal = _PHALP_FOCAL * float(size.max())
    return Camera(
        focal=(focal, focal),
        center=(width / 2, height / 2),
        size=(width, height),
        focal_from=FocalFrom.PROGRAM,
        source="4D-Humans', 5000 pixels in a square of 256",
    )


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
        title="PromptHMR",
        holds=lambda content: is_mapping_with(content, "people") and is_mapping_with(content, "camera"),
        people=prompthmr_people,
        track=prompthmr_track,
    ),
    System(
        title="4D-Humans (PHALP)",
        holds=lambda content: is_mapping_with(first_of(content), "tid", "tracked_ids"),
        people=phalp_people,
        track=phalp_track,
    ),
)
