"""SAM 3D Body, whose results are of each image independently.

Documented by facebookresearch/sam-3d-body sam_3d_body/sam_3d_body_estimator.py, sam_3d_body/metadata/mhr70.py. Its body
is MHR, known here by its keypoints. What `process_one_image` returns is read as people keep it: of each person
pred_keypoints_3d (70, 3; axes of the camera), pred_cam_t (3), and focal_length, for a principal point in the image's
middle. It has no tracks: people are followed by position.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.body.model import N_BETAS
from fitting_core.detections import Detections
from fitting_core.errors import InputError
from fitting_core.files.npz import npz_names, read_npz
from fitting_core.files.regular import regular_file
from fitting_core.io.motion.learned.tracks import (
    System,
    SystemMotion,
    flat,
    positive,
    rows,
)
from fitting_core.people.everybody import track
from fitting_core.video.frame_names import image_numbers

_POINTS = 70
_KNOWN_BY = ("pred_keypoints_3d", "pred_cam_t")
_KEYS = (*_KNOWN_BY, "focal_length")
_MOST_TEXT = 2**28
_FOLLOWED = "It has no tracks: people were followed by position."
_FRAME_RATE = 30.0
"""Frames per second assumed for tracking: results do not store it."""
_NEAREST = 0.01
"""Metres: points nearer to the camera's plane are projected from there."""


@dataclass(frozen=True, eq=False)
class _Image:
    """The people of one image."""

    number: int
    stem: str
    people: list[Any]


@dataclass(frozen=True, eq=False)
class PerImage:
    """The results of all images."""

    images: list[_Image]
    named: bool
    """Whether stems are names of images."""


def of_file(path: Path) -> Any:
    """The content of a file of arrays or JSON, if it may be SAM 3D Body's; otherwise None. Raises InputError if it is
    damaged."""
    suffix = path.suffix.lower()
    if suffix == ".json":
        return _json(path)
    try:
        if suffix == ".npz" and set(_KNOWN_BY) <= set(npz_names(path)):
            return read_npz(path, (*_KEYS, "frame_index"))
    except (OSError, ValueError):
        return None
    return None


def _json(path: Path) -> Any:
    with regular_file(path).open("rb") as file:
        text = file.read(_MOST_TEXT + 1)
    if len(text) > _MOST_TEXT:
        raise InputError(f"has more than {_MOST_TEXT >> 20} MB of text, which no result does")
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, RecursionError) as error:
        raise InputError(f"is not JSON ({str(error)[:80]})") from error


def _numbers(stems: Sequence[str]) -> list[int]:
    """Numbers in the images' names if all have one, otherwise their indices."""
    numbers = {t: number for number, t in image_numbers(list(stems)).items()}
    return [numbers[t] if len(numbers) == len(stems) else t for t in range(len(stems))]


# fmt: off
_BODY = (
    "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow right_elbow left_hip right_hip "
    "left_knee right_knee left_ankle right_ankle left_big_toe left_small_toe left_heel right_big_toe right_small_toe "
    "right_heel"
).split()
# fmt: on
_FINGERS = [f"{finger}{k}" for finger in ("thumb", "index", "middle", "ring", "pinky") for k in (4, 3, 2, 1)]
_NAMES: dict[int, str] = (
    dict(enumerate(_BODY))
    | {21 + i: f"right_{name}" for i, name in enumerate(_FINGERS)}
    | {41: "right_wrist", 62: "left_wrist", 69: "neck"}
    | {42 + i: f"left_{name}" for i, name in enumerate(_FINGERS)}
)
"""The points of mhr70 that OpenPose has; its fingers run from tip to knuckle."""


def _by_frame(values: Mapping[str, Any]) -> list[list[Any]]:
    """One person's arrays as lists of people, for a result of one image."""
    if np.size(values.get("focal_length", 0)) == 1 and np.size(values["pred_cam_t"]) == 3:
        return [[dict(values)]]
    places = rows(values, "pred_cam_t", 3)
    points = rows(values, "pred_keypoints_3d", 3 * _POINTS, len(places))
    focal = rows(_with_focal(values), "focal_length", 1, len(places))
    return [[dict(zip(_KEYS, one, strict=True))] for one in zip(points, places, focal, strict=True)]


def _with_focal(person: Mapping[str, Any]) -> Mapping[str, Any]:
    """The same. Raises InputError if the focal length was not saved."""
    if "focal_length" not in person:
        raise InputError(
            "has no 'focal_length' (pixels), without which its 'pred_cam_t' is ambiguous; expected both, "
            "as SAM 3D Body's process_one_image returns them. Add it"
        )
    return person


def _images_of(content: Any) -> PerImage:
    """The return value of the system's program, as people save it."""
    entries = _kept_images(_by_frame(content) if _is_person(content) else content)
    assert entries is not None
    stems = [stem for stem, _ in entries]
    named = all(stems) and len(set(stems)) == len(stems)
    numbers = _numbers(stems) if named else list(range(len(stems)))
    images = [
        _Image(number, stem, people)
        for number, (stem, people) in sorted(zip(numbers, entries, strict=True), key=lambda pair: pair[0])
    ]
    return PerImage(images, named=named)


def _track(content: Any, person: int) -> SystemMotion:
    whole = _images_of(content)
    seen = _of_person(whole, person)
    points = np.stack([flat(one, "pred_keypoints_3d", 3 * _POINTS).reshape(-1, 3) for _, one in seen])
    focals = positive(np.concatenate([flat(_with_focal(one), "focal_length", 1) for _, one in seen]), "focal_length")
    places = np.stack([flat(one, "pred_cam_t", 3) for _, one in seen])
    focal = float(np.median(focals))
    # The images' focal lengths are unified: at another depth a body looks the same.
    places[:, 2] = positive(places[:, 2], "pred_cam_t") * focal / focals
    keypoints = np.full((len(seen), kp.COUNT, 3), np.nan)
    for place, name in _NAMES.items():
        keypoints[:, kp.INDEX[name]] = points[:, place] + places
    frames = len(seen)
    return SystemMotion(
        pose=np.zeros((frames, 66)),
        betas=np.zeros((frames, N_BETAS)),
        translation=np.zeros((frames, 3)),
        points=keypoints,
        numbers=np.array([image.number for image, _ in seen]),
        stems=tuple(image.stem for image, _ in seen) if whole.named else (),
        kind="smplx",
        focal=(lambda size: focal, "told by the result"),
        notes=(_FOLLOWED,) if max(len(image.people) for image in whole.images) > 1 else (),
    )


def _is_person(value: Any) -> bool:
    return isinstance(value, dict) and set(_KNOWN_BY) <= set(value)


def _kept_images(content: Any) -> list[tuple[str, list[Any]]] | None:
    """Names and people of all images: from a dictionary or list of them, or one image; None for other content."""
    if not isinstance(content, dict | list) or not content:
        return None
    entries = list(content.items()) if isinstance(content, dict) else [("", one) for one in content]
    if isinstance(content, list) and all(_is_person(one) for one in content):
        return [("", content)]
    lists = all(isinstance(people, list) and all(_is_person(one) for one in people) for _, people in entries)
    named = [(Path(str(name)).stem, people) for name, people in entries]
    return named if lists and any(people for _, people in named) else None


def _tracks(content: PerImage) -> dict[int, dict[int, int]]:
    """For each person, the most prominent first, the index within the image by the image's index."""
    images = content.images
    detections = Detections(
        frames=tuple(np.array([_projected(one) for one in image.people]).reshape(-1, kp.COUNT, 3) for image in images),
        stems=tuple(image.stem for image in images),
        source=Path(),
    )
    people = track(detections, _FRAME_RATE).everyone
    return {n: {t: seen.entry for t, seen in one.sightings.items()} for n, one in enumerate(people)}


def _projected(person: Mapping[str, Any]) -> Float[np.ndarray, "137 3"]:
    """Its keypoints in pixels about the principal point, all of confidence 1."""
    space = flat(person, "pred_keypoints_3d", 3 * _POINTS).reshape(-1, 3) + flat(person, "pred_cam_t", 3)
    known, found = list(_NAMES), np.zeros((kp.COUNT, 3))
    focal = flat(_with_focal(person), "focal_length", 1)
    xy = focal * space[known, :2] / np.maximum(space[known, 2:], _NEAREST)
    found[[kp.INDEX[name] for name in _NAMES.values()]] = np.column_stack([xy, np.isfinite(xy).all(1)])
    return np.nan_to_num(found, posinf=0.0, neginf=0.0)


def _of_person(content: PerImage, person: int) -> list[tuple[_Image, Any]]:
    found = _tracks(content)[person]
    return [(content.images[t], content.images[t].people[place]) for t, place in sorted(found.items())]


def _people(content: PerImage) -> Mapping[int, Sequence[int]]:
    return {n: [content.images[t].number for t in track] for n, track in _tracks(content).items()}


SYSTEMS = (
    System(
        title="SAM 3D Body",
        holds=lambda content: _is_person(content) or _kept_images(content) is not None,
        people=lambda content: _people(_images_of(content)),
        track=_track,
    ),
)
