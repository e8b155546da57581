"""Systems that see, or write for, a crop or a padded square: VIBE, 4D-Humans (PHALP), ROMP and BEV.

A crop's camera (s, tx, ty) shows a body's point X at s (X + t), with the crop's edges at -1 and 1: b s / 2 pixels per
metre in a crop of b pixels. With the focal length f of the whole image, the body is 2 f / (b s) away.

| system | documented by | body | taken |
|---|---|---|---|
| VIBE | mkocabas/VIBE doc/demo.md, lib/utils/demo_utils.py | SMPL | by person: pose 72, betas, pred_cam (s, tx, ty), \
orig_cam (sx, sy, tx, ty), bboxes (cx, cy, w, h), frame_ids; 5000 pixels of focal length in a crop of 224 |
| 4D-Humans, PHALP | brjathu/PHALP phalp/trackers/PHALP.py, phalp/models/hmar/hmar.py, phalp/configs/base.py; \
shubham-goel/4D-Humans issues 100 and 134 | SMPL | by image: time, tid, tracked_time, size (height, width), smpl \
(global_orient, body_pose as matrices, betas), camera: the translation, for 5000 pixels in the image padded to a \
square of 256 |
| ROMP, BEV | Arthur151/ROMP simple_romp/README.md, simple_romp/{romp,bev}/{main,post_parser,utils}.py | SMPL | \
by image or of one: smpl_thetas 72, smpl_betas, cam (s, tx, ty), cam_trans, joints, track_ids; 443.4 pixels in the \
image padded to a square of 512 |
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from fitting_core.camera import Camera, FocalFrom
from fitting_core.errors import InputError
from fitting_core.files.pickles import as_array
from fitting_core.files.torch_pickles import plain
from fitting_core.io.motion.learned.tracks import (
    SMPL_JOINTS,
    System,
    Track,
    angles,
    body_angles,
    by_person,
    first_of,
    flat,
    frame_numbers,
    is_mapping_with,
    mapping,
    people_by,
    positive,
    rows,
    shape_numbers,
)
from fitting_core.video.frame_names import image_numbers, natural_key

_VIBE_FOCAL = 5000 / 224
_PHALP_FOCAL = 5000 / 256
_ROMP_FOCAL = 443.4 / 512
ROMP_KEYS = ("smpl_thetas", "smpl_betas", "cam", "cam_trans", "joints", "track_ids")
_CHILD = 1e-3
"""Lowest of BEV's age values that counts as a child."""


def vibe_track(content: Any, person: int) -> Track:
    """One of the people. VIBE's focal length is taken from the median crop: bodies are far away, almost without
    perspective."""
    values = by_person(content)[person]
    numbers = frame_numbers(values, "frame_ids")
    frames = len(numbers)
    scale = positive(rows(values, "pred_cam", 3, frames)[:, 0], "pred_cam")
    whole = rows(values, "orig_cam", 4, frames)
    width = positive(rows(values, "bboxes", 4, frames)[:, 2], "bboxes")
    size = np.median(width[:, None] * scale[:, None] / positive(whole[:, :2], "orig_cam"), axis=0)
    focal = float(np.median(width)) * _VIBE_FOCAL
    return Track(
        pose=body_angles(rows(values, "pose", 3 * SMPL_JOINTS, frames)),
        betas=shape_numbers(values, "betas", frames),
        translation=np.stack([whole[:, 2], whole[:, 3], 2 * focal / (width * scale)], 1),
        numbers=numbers,
        camera=_square_pixels(focal, size, "VIBE's, 5000 pixels in a crop of 224"),
    )


def _square_pixels(focal: float, size: Sequence[float] | np.ndarray, source: str) -> Camera:
    width, height = round(float(size[0])), round(float(size[1]))
    if not (1 <= width <= 10**5 and 1 <= height <= 10**5):
        raise InputError(f"was found on images of {width} x {height} pixels")
    middle, size = (width / 2, height / 2), (width, height)
    return Camera(focal=(focal, focal), center=middle, size=size, focal_from=FocalFrom.PROGRAM, source=source)


def _phalp_frames(content: Any, person: int | None = None) -> Iterator[tuple[str, int, int, dict[Any, Any]]]:
    """For all images: name, number, and the person's index in its lists; of all people for person None.

    Ghosts, which the tracker extrapolates but did not see, are left out.
    """
    for name, frame in content.items():
        values = mapping(frame, "an image's result")
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
        people.setdefault(track, []).append(int(frame_numbers({"time": values.get("time")}, "time")[0]))
    return people


def phalp_track(content: Any, person: int) -> Track:
    """One of the tracks."""
    found = list(_phalp_frames(content, person))
    places = [(values, _entry(values, "smpl", place), place) for _, _, place, values in found]
    turns = np.stack(
        [np.concatenate([flat(smpl, "global_orient", 9), flat(smpl, "body_pose", 207)]) for _, smpl, _ in places]
    )
    cameras = [flat({"camera": _entry(values, "camera", place)}, "camera", 3) for values, _, place in places]
    sizes = [flat({"size": _entry(values, "size", place)}, "size", 2)[::-1] for values, _, place in places]
    size = np.median(sizes, axis=0)
    return Track(
        pose=body_angles(angles(turns, "smpl")),
        betas=np.concatenate([shape_numbers(smpl, "betas", 1) for _, smpl, _ in places]),
        translation=np.stack(cameras),
        numbers=np.array([int(frame_numbers({"time": values["time"]}, "time")[0]) for values, _, _ in places]),
        stems=tuple(PurePosixPath(name.replace("\\", "/")).stem for name, _, _, _ in found),
        camera=_square_pixels(_PHALP_FOCAL * float(size.max()), size, "4D-Humans', 5000 pixels in a square of 256"),
    )


def _romp_frames(content: Any) -> list[tuple[str, int, dict[Any, Any]]]:
    """For all images: name, number and result. Numbers are those in the names, if the names differ only in these."""
    results = mapping(content["results"], "'results'")
    if is_mapping_with(results, "smpl_thetas", "cam"):
        return [("", 0, results)]
    found = {PurePosixPath(str(name)).stem: frame for name, frame in results.items() if frame is not None}
    stems = sorted(found, key=natural_key)
    told = {t: number for number, t in image_numbers(stems).items()}
    whole = len(told) == len(stems)
    return [(stem, told[t] if whole else t, mapping(found[stem], "an image's result")) for t, stem in enumerate(stems)]


def _romp_ids(values: dict[Any, Any]) -> list[int]:
    """Track numbers of an image's people; without a tracker their indices."""
    array = as_array(values.get("smpl_thetas"))
    count = array.size // (3 * SMPL_JOINTS) if array.dtype.kind == "f" else 0
    if not count or array.size % (3 * SMPL_JOINTS):
        raise InputError(f"'smpl_thetas' has the shape {array.shape}, expected people x 72")
    return frame_numbers(values, "track_ids").tolist()[:count] if "track_ids" in values else list(range(count))


def romp_people(content: Any) -> Mapping[int, Sequence[int]]:
    """Of each person, the frames."""
    people: dict[int, list[int]] = {}
    for _, number, values in _romp_frames(content):
        for track in dict.fromkeys(_romp_ids(values)):
            people.setdefault(track, []).append(number)
    return people


def _romp_translation(cam: np.ndarray, told: np.ndarray) -> np.ndarray:
    """ROMP's own translation, fitted to the projected joints, or if that failed the one of its orthographic camera.

    In that case it writes 2 (tx, ty, 1) / s, which fits no camera, or -1.
    """
    scale = positive(cam[:, :1], "cam")
    orthographic = np.concatenate([cam[:, 1:], np.full_like(scale, 2 * _ROMP_FOCAL)], 1) / scale
    none = np.concatenate([cam[:, 1:], np.ones_like(scale)], 1) * 2 / scale
    unfitted = np.isclose(told, none, atol=1e-4).all(1) | (told[:, 2] <= 0)
    return np.where(unfitted[:, None], orthographic, told)


def romp_track(content: Any, person: int) -> Track:
    """One of the people."""
    frames = [(*frame, _romp_ids(frame[2])) for frame in _romp_frames(content)]
    seen = [(values, ids.index(person), len(ids)) for _, _, values, ids in frames if person in ids]
    named = [(stem, number) for stem, number, _, ids in frames if person in ids]

    def gather(key: str, width: int) -> np.ndarray:
        found = [(as_array(values.get(key)).reshape(count, -1), place) for values, place, count in seen]
        return np.stack([rows({key: array}, key, width)[place] for array, place in found])

    width = as_array(seen[0][0].get("smpl_betas")).size // seen[0][2]
    betas, bev = gather("smpl_betas", width), width == 11
    translation, notes = gather("cam_trans", 3), []
    if not bev:
        translation = _romp_translation(gather("cam", 3), translation)
    jointed = all("joints" in values for values, _, _ in seen)
    if jointed:
        translation = translation + gather("joints", 3 * 71)[:, :3]
    if not all("track_ids" in values for values, _, _ in seen) and max(count for _, _, count in seen) > 1:
        notes.append("It has no tracks: of several people in an image, the one with this number is taken.")
    if bev and np.abs(betas[:, 10]).max() > _CHILD:
        notes.append("BEV's number for a child's age is left out: the body is an adult's.")
    return Track(
        pose=body_angles(gather("smpl_thetas", 3 * SMPL_JOINTS)),
        betas=shape_numbers({"smpl_betas": betas}, "smpl_betas", len(seen)),
        translation=translation,
        about_pelvis=jointed or bev,
        numbers=np.array([number for _, number in named]),
        stems=tuple(stem for stem, _ in named) if len(frames) > 1 else (),
        focal=(lambda size: _ROMP_FOCAL * max(size), f"{'BEV' if bev else 'ROMP'}'s, 443.4 pixels in a square of 512"),
        notes=tuple(notes),
    )


SYSTEMS = (
    System(
        title="VIBE",
        holds=lambda content: is_mapping_with(first_of(content), "pred_cam", "orig_cam"),
        people=lambda content: people_by(content, "frame_ids"),
        track=vibe_track,
    ),
    System(
        title="4D-Humans (PHALP)",
        holds=lambda content: is_mapping_with(first_of(content), "tid", "tracked_ids"),
        people=phalp_people,
        track=phalp_track,
    ),
    System(
        title="ROMP or BEV",
        holds=lambda content: is_mapping_with(content, "results"),
        people=romp_people,
        track=romp_track,
    ),
)
