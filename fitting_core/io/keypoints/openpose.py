"""OpenPose JSON: one file per frame with all people in it. Reads all variants in use, and writes."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fitting_core.detections import PIXELS, SHARES, UNIT, Detections, guess_scale, numbering
from fitting_core.errors import InputError, some_of
from fitting_core.files.atomic import replacing
from fitting_core.io.keypoints.json_points import (
    checked_points,
    first_bytes,
    is_json,
    json_files,
    kind,
    numbers,
    read_keypoint_json,
    short,
    stated_detector,
    stray_confidences,
)
from fitting_core.keypoint_noise import OPENPOSE
from fitting_core.keypoints import BODY, BODY_25, COUNT, FACE, INDEX, LEFT_HAND, NAMES, RIGHT_HAND, Keypoints
from fitting_core.video.frame_names import frame_numbers, natural_key

SUFFIX = "_keypoints.json"
DETECTOR = "detector"
"""Key beside "people" under which our files name the detector. OpenPose's own do not have it."""

_CANVAS = ("canvas_width", "canvas_height")

_COCO_18 = [name for name in BODY_25[:19] if name != "mid_hip"]
"""The order of OpenPose's COCO model: BODY_25 without mid-hip and feet."""
_HIPS = [INDEX["right_hip"], INDEX["left_hip"]]


def _indices(part: slice) -> list[int]:
    return list(range(COUNT)[part])


_COCO_PLACES = [INDEX[name] for name in _COCO_18]

PARTS: dict[str, dict[int, list[int]]] = {
    "pose_keypoints": {25: _indices(BODY), 18: _COCO_PLACES},
    "hand_left_keypoints": {21: _indices(LEFT_HAND)},
    "hand_right_keypoints": {21: _indices(RIGHT_HAND)},
    "face_keypoints": {70: _indices(FACE), 68: _indices(FACE)[:68]},
}
"""By the list's key (with or without "_2d"): its possible layouts, as number of points -> indices among the 137."""

_IN_ORDER = ("pose_keypoints", "face_keypoints", "hand_left_keypoints", "hand_right_keypoints")
_WRITTEN = {key: next(iter(PARTS[key].values())) for key in _IN_ORDER}
"""The whole lists in OpenPose's own order."""

_ADVICE = "run the detector again, or remove the file so that its frame counts as not detected"


def read_openpose(path: Path) -> Detections:
    """Read a folder with a file for each frame, or one file.

    If files are named as OpenPose names them, ``<name>_keypoints.json``, only these are read, otherwise all with
    people.
    Frames come in the order of their numbers, the one number in which the names differ. Body lists can be BODY_25 or
    COCO-18 (feet are then not detected, and mid-hip is the mean of the hips); any list can be empty or absent;
    ``person_id`` and 3D lists are ignored. Positions stay as in the files, pixels or normalised. Confidences slightly
    below 0 or above 1 count as 0 and 1, which is noted. Beside the people a file can name the detector, as
    `write_openpose` does; otherwise it was OpenPose. A file of ControlNet or ComfyUI states the size of its canvas,
    may hold positions as shares of it, and may hold a list of frames.

    Raises:
        InputError: Nothing to read, or files broken or of different layouts; the message names file, person, keypoint.
    """
    found = [one for file in (_json_files(path) if path.is_dir() else [path]) for one in _frames(file, path.is_dir())]
    _forbid_same_number(found)
    frames = tuple(_people(one) for one in found)
    _forbid_mixed_layouts(found)
    for what in ("detectors", "canvases"):
        _forbid_mixed(what, found)
    canvas = found[0].canvas
    points = np.concatenate([people.reshape(-1, 3) for people in frames])
    shares = canvas is not None and guess_scale(points[points[:, 2] > 0, :2]) == UNIT
    detector, of_detector = stated_detector(path, found[0].content.get(DETECTOR, OPENPOSE))
    stems = tuple(one.stem for one in found)
    return Detections(
        frames=frames,
        stems=stems,
        source=path,
        scale=SHARES if shares else "auto" if canvas is None else PIXELS,
        size=canvas,
        detector=detector,
        notes=(*of_detector, *numbering(stems), *stray_confidences(path, _confidences(found))),
    )


@dataclass(frozen=True, kw_only=True)
class _Frame:
    name: str
    """The file's name; for one of a list in a file, with its index."""
    where: str
    """The same, with the folder."""
    stem: str
    content: dict[str, Any]

    @property
    def people(self) -> list[Any]:
        return self.content["people"]

    @property
    def canvas(self) -> tuple[int, int] | None:
        """Width and height of the image, as ControlNet and ComfyUI write them."""
        sides: Any = [self.content.get(key) for key in _CANVAS]
        if sides == [None, None]:
            return None
        if not all(type(side) in (int, float) and 1 <= side <= 100_000 and side == int(side) for side in sides):
            raise InputError(
                f"{self.where}: has {' and '.join(_CANVAS)} {short(sides[0])} and {short(sides[1])}; expected the "
                "image's width and height in pixels."
            )
        return int(sides[0]), int(sides[1])


def _frames(file: Path, one_each: bool) -> list[_Frame]:
    """The frames of a file: one, or a list of them from ComfyUI.

    Args:
        file: To read.
        one_each: Whether other files beside it hold the other frames.
    """
    content = read_keypoint_json(file, advice=_ADVICE)
    stem = stem_of(file.name)
    if not isinstance(content, list) or not content or not all(isinstance(one, dict) for one in content):
        return [_frame(content, name=file.name, where=str(file), stem=stem)]
    if len(content) > 1 and one_each:
        raise InputError(
            f"{file}: holds {len(content)} frames; expected one per file in a folder. Give this file alone, if it "
            "is the clip's."
        )
    return [
        _frame(
            one,
            name=f"{file.name}, frame {k}",
            where=f"{file}, frame {k}",
            stem=stem if one_each else f"{stem}_{k:012d}",
        )
        for k, one in enumerate(content)
    ]


def _frame(content: Any, *, name: str, where: str, stem: str) -> _Frame:
    if not isinstance(content, dict) or not isinstance(content.get("people"), list):
        found = f"an object with {some_of(content)}" if isinstance(content, dict) else kind(content)
        raise InputError(f"{where} is not OpenPose JSON: found {found}; expected an object with a list 'people'.")
    return _Frame(name=name, where=where, stem=stem, content=content)


def write_openpose(
    folder: Path,
    keypoints: Keypoints,
    *,
    name: str,
    first_frame: int = 0,
    image_stems: Sequence[str] = (),
    detector: str = "",
) -> list[Path]:
    """Write one person's keypoints, as `write_all_people` does."""
    points = np.concatenate([keypoints.xy, keypoints.confidence[..., None]], axis=-1)[:, None]
    return write_all_people(
        folder, list(points), name=name, first_frame=first_frame, image_stems=image_stems, detector=detector
    )


def write_all_people(
    folder: Path,
    people: Sequence[Float[np.ndarray, "P 137 3"]],
    *,
    name: str,
    first_frame: int = 0,
    image_stems: Sequence[str] = (),
    detector: str = "",
) -> list[Path]:
    """Write everybody's keypoints as BODY_25 JSON, ``<name>_<12 digits>_keypoints.json`` per frame; return the paths.
    Raises InputError if the folder holds other keypoint files, which would be read as frames of this clip.

    A part (hands, face) that no frame has is an empty list, as OpenPose writes it when that part is switched off.
    People without a detected keypoint in a frame are left out of it. Reading gives back exactly the same positions
    and confidences.

    Args:
        folder: Made if it does not exist. Files of the same names are replaced, each at once.
        people: The people of each frame: x, y in pixels and confidence; those of confidence 0 are not detected.
        name: What the files' names start with.
        first_frame: Number of the first file.
        image_stems: The images' own names without suffixes, if they are files: the keypoint files are named after them,
            as OpenPose does.
        detector: The detector whose points they resemble, if known (`Detected.points`).
    """
    folder.mkdir(parents=True, exist_ok=True)
    stems = image_stems or [f"{name}_{first_frame + t:012d}" for t in range(len(people))]
    paths = [folder / f"{stem}{SUFFIX}" for stem in stems]
    assert len(paths) == len(people)
    others = sorted({file.name for file in folder.glob(f"*{SUFFIX}")} - {path.name for path in paths})
    if others:
        raise InputError(
            f"{folder} already holds {len(others)} other keypoint files, such as {others[0]}. Together with the "
            f"{len(paths)} new ones they would read as one clip; choose an empty folder."
        )
    parts = {key: part for key, part in _WRITTEN.items() if any((frame[:, part, 2] > 0).any() for frame in people)}
    head = {"version": 1.3, **({DETECTOR: detector} if detector else {})}
    for path, frame in zip(paths, people, strict=True):
        entries = [_entry(points, parts) for points in frame if (points[:, 2] > 0).any()]
        with replacing(path) as draft:
            draft.write_text(json.dumps({**head, "people": entries}), encoding="utf-8")
    return paths


def _entry(points: Float[np.ndarray, "137 3"], parts: dict[str, list[int]]) -> dict[str, list]:
    points = np.where(points[:, 2:] > 0, points, 0.0)
    lists = {f"{key}_2d": points[parts[key]].ravel().tolist() if key in parts else [] for key in _WRITTEN}
    return {"person_id": [-1], **lists}


def stem_of(name: str) -> str:
    """The name of a keypoint file without its ending."""
    return re.sub(rf"({SUFFIX}|\.json)$", "", name, flags=re.IGNORECASE)


def _json_files(folder: Path) -> list[Path]:
    # macOS and network drives leave files that start with a dot beside the real ones.
    entries = [entry for entry in folder.iterdir() if not entry.name.startswith(".")]
    files = [entry for entry in entries if entry.name.lower().endswith(SUFFIX)] or [
        entry for entry in json_files(folder) if is_openpose_json(first_bytes(entry))
    ]
    if not files:
        names = sorted(entry.name for entry in entries)
        found = f"{len(names)} other files, such as {names[0]}" if names else "an empty folder"
        raise InputError(
            f"No keypoint files in {folder}: found {found}; expected one JSON file per frame with a list 'people', as "
            "OpenPose's --write_json makes them."
        )
    return sorted(files, key=lambda file: natural_key(stem_of(file.name)))


def is_openpose_json(start: bytes) -> bool:
    """Whether a JSON file with this start is, or claims to be, one of OpenPose's."""
    return not start.strip() or (is_json(start) and b'"people"' in start)


def _forbid_same_number(found: Sequence[_Frame]) -> None:
    seen: dict[int, _Frame] = {}
    for one, number in zip(found, frame_numbers([one.stem for one in found]) or (), strict=False):
        if other := seen.get(number):
            raise InputError(f"Frame {number} is there twice: {other.where} and {one.name}. Remove one of them.")
        seen[number] = one


def _people(one: _Frame) -> Float[np.ndarray, "P 137 3"]:
    frame = np.zeros((len(one.people), COUNT, 3))
    for k, entry in enumerate(one.people):
        where = f"{one.where}: person {k}"
        if not isinstance(entry, dict):
            raise InputError(f"{where} is {kind(entry)}; expected an object with the list 'pose_keypoints_2d'.")
        if not any(_list(entry, key) is not None for key in PARTS):
            keys = ", ".join(f"{key}_2d" for key in PARTS)
            raise InputError(f"{where} has no list of keypoints; expected at least one of {keys}.")
        for key, layouts in PARTS.items():
            values = _list(entry, key)
            if values not in (None, []):
                places = _places(where, key, values, layouts)
                frame[k, places] = _points(where, key, values, places)
                if places is _COCO_PLACES:
                    frame[k, INDEX["mid_hip"]] = _mid_hip(frame[k, _HIPS])
    return frame


def _list(entry: dict[str, Any], key: str) -> Any:
    return entry.get(f"{key}_2d", entry.get(key))


def _places(where: str, key: str, values: Any, layouts: dict[int, list[int]]) -> list[int]:
    if not isinstance(values, list):
        raise InputError(f"{where}, {key}: found {kind(values)}; expected a list of numbers x, y, confidence, ...")
    if len(values) % 3 or len(values) // 3 not in layouts:
        expected = " or ".join(f"{3 * count} ({count} points)" for count in layouts)
        raise InputError(f"{where}, {key}: found {len(values)} values; expected {expected}, or an empty list.")
    return layouts[len(values) // 3]


def _points(where: str, key: str, values: list[Any], places: list[int]) -> Float[np.ndarray, "K 3"]:
    names = [f"{NAMES[place]} ({key})" for place in places]
    return checked_points(where, numbers(where, values, names).reshape(-1, 3), names)


def _confidences(found: Sequence[_Frame]) -> Float[np.ndarray, "n"]:
    lists = [_list(entry, key) or () for one in found for entry in one.people for key in PARTS]
    return np.array([confidence for values in lists for confidence in values[2::3]], float)


def _mid_hip(hips: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "3"]:
    both = (hips[:, 2] > 0).all()
    return np.array([*hips[:, :2].mean(0), hips[:, 2].min()]) if both else np.zeros(3)


def _forbid_mixed_layouts(found: Sequence[_Frame]) -> None:
    first: dict[int, str] = {}
    for one in found:
        for entry in one.people:
            if values := _list(entry, "pose_keypoints"):
                first.setdefault(len(values) // 3, one.name)
    if len(first) > 1:
        (count, name), (other_count, other) = list(first.items())[:2]
        raise InputError(
            f"Different body layouts in one clip: {name} has {count} points, {other} has {other_count}. Keep the files "
            "of one detector run only."
        )


def _forbid_mixed(what: str, found: Sequence[_Frame]) -> None:
    """All frames of a clip must have the same detector and canvas."""
    stated = [one.content.get(DETECTOR, OPENPOSE) if what == "detectors" else one.canvas for one in found]
    if other := next((k for k, one in enumerate(stated) if one != stated[0]), None):
        raise InputError(
            f"Different {what} in one clip: {found[0].name} says {short(stated[0])}, {found[other].name} says "
            f"{short(stated[other])}. Keep the files of one detector run only."
        )
