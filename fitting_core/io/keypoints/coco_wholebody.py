"""COCO-WholeBody JSON: annotation files, result lists as mmpose and DWPose write them, and mmpose's predictions."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from fitting_core import wholebody as layout
from fitting_core.detections import Detections, numbering
from fitting_core.errors import InputError, some_of
from fitting_core.files.atomic import replacing
from fitting_core.io.keypoints.coco_forms import FORMS, CocoContent
from fitting_core.io.keypoints.json_points import (
    checked_points,
    first_bytes,
    json_files,
    kind,
    numbers,
    read_keypoint_json,
    stated_detector,
    stray_confidences,
)
from fitting_core.keypoint_noise import COCO_WHOLEBODY
from fitting_core.keypoints import Keypoints

PARTS: dict[str, tuple[slice, str]] = {
    "foot_kpts": (layout.FEET, "foot_valid"),
    "face_kpts": (layout.FACE_68, "face_valid"),
    "lefthand_kpts": (layout.LEFT_HAND_21, "lefthand_valid"),
    "righthand_kpts": (layout.RIGHT_HAND_21, "righthand_valid"),
}
"""Lists beside `keypoints`, by key: their indices among the 133, and the flag that says whether they are valid."""
_KEYPOINTS: dict[int, slice] = {133: slice(0, 133), 17: layout.BODY_17}
"""Variants of `keypoints`, by number of points."""
_NAMES = layout.WHOLEBODY_NAMES
_ADVICE = "export it again"
_MAX_SCORE = 20.0
"""Detectors with SimCC heads give logit peaks as scores; percentages are refused."""


def holds_coco(start: bytes) -> bool:
    """Whether a JSON file with this start is one that `read_coco_wholebody` reads."""
    inside = start.lstrip(b"\xef\xbb\xbf \t\r\n")
    if inside.startswith(b"["):
        return any(key in start for key in (b'"image_id"', b'"instances"', b'"keypoints"'))
    return any(key in start for key in (b'"annotations"', b'"images"', b'"instance_info"', b'"meta_info"'))


def folder_holds_coco(folder: Path) -> bool:
    """Whether the first conclusive JSON file of a folder holds the people of an image, as mmpose writes."""
    starts = (first_bytes(file).lstrip() for file in json_files(folder))
    said = next((start for start in starts if start.strip(b"[] \t\r\n")), b"")
    return holds_coco(said) if said.startswith(b"[") else b'"instance_info"' in said or b'"meta_info"' in said


def read_coco_wholebody(path: Path) -> Detections:
    """Read an annotation file (images and annotations), a result list, or predictions of mmpose's inferencer.

    Those are a file for a video, or a folder with a file for each image.

    Frames come in the order of the images' names, or of the ids of the images if there are no names. A person has
    `keypoints` of all 133 points, or of the 17 of the body beside `foot_kpts`, `face_kpts`, `lefthand_kpts` and
    `righthand_kpts`, any of which can be absent. Neck and mid-hip are means of shoulders and hips. A file whose third
    numbers are 0, 1 and 2 has COCO's visibilities, which become confidences of 0, 0.5 and 1. If the file states the
    keypoints' names (`categories`, or mmpose's `meta_info`), points are taken by name.

    Raises:
        InputError: The file is damaged, of another format, or holds invalid values; the message names the person.
    """
    known = _of_folder(path) if path.is_dir() else _of_file(path)
    raw = [
        [_raw_points(where, entry, frame.names_of(entry)) for where, entry in frame.people] for frame in known.frames
    ]
    scores = np.concatenate([points[:, 2] for people in raw for points in people] or [np.zeros(0)])
    visibilities = bool(np.isin(scores, (0, 1, 2)).all() and (scores == 2).any())
    most = 2.0 if visibilities else _MAX_SCORE
    detector, of_detector = (COCO_WHOLEBODY, ()) if known.detector is None else stated_detector(path, known.detector)
    frames = []
    for frame, people in zip(known.frames, raw, strict=True):
        found = [_checked(frame.people[k][0], points, most, halved=visibilities) for k, points in enumerate(people)]
        frames.append(layout.from_wholebody(np.stack(found)) if found else np.zeros((0, 137, 3)))
    stems = tuple(frame.stem for frame in known.frames)
    return Detections(
        frames=tuple(frames),
        stems=stems,
        source=path,
        size=known.size,
        frame_rate=known.frame_rate,
        detector=detector,
        notes=(*of_detector, *(numbering(stems) if path.is_dir() else ()), *_notes(path, scores, visibilities)),
    )


def _of_file(path: Path) -> CocoContent:
    content = read_keypoint_json(path, advice=_ADVICE)
    form = next((form for fits, form in FORMS if fits(content)), None)
    if form is None:
        found = f"an object with {some_of(content)}" if isinstance(content, dict) else ""
        raise InputError(
            f"{path} is not COCO-WholeBody JSON: found {found or kind(content)}; expected 'images' and 'annotations', "
            "a list of results with 'image_id' and 'keypoints', or 'instance_info'."
        )
    return form(path, content)


def _of_folder(folder: Path) -> CocoContent:
    """Each file holds a frame."""
    read = {file: _of_file(file) for file in json_files(folder)}
    for file, content in read.items():
        if len(content.frames) != 1:
            raise InputError(
                f"{file}: holds {len(content.frames)} frames; expected one per file in a folder. Give this file "
                "alone, if it is the clip's."
            )
    return CocoContent(frames=tuple(replace(content.frames[0], stem=file.stem) for file, content in read.items()))


def write_coco_wholebody(
    file: Path,
    keypoints: Keypoints,
    *,
    name: str,
    size: tuple[int, int],
    frame_rate: float,
    first_frame: int = 0,
    image_names: Sequence[str] | None = None,
    detector: str = "",
) -> None:
    """Write one person's keypoints as an annotation file; the third numbers are confidences.

    Neck, mid-hip and pupils have no place in it. Reading gives the others exactly as they were, and the first two as
    means. A frame in which none of the 133 is detected has an image and no annotation.

    Args:
        file: Replaced at once if it exists.
        keypoints: Pixels and confidences.
        name: What the images' names start with.
        size: Image width and height in pixels.
        frame_rate: Frames per second, kept under "info".
        first_frame: Number of the first image.
        image_names: The images' own names, if they are files.
        detector: Who detected them, kept under "info"; a file that does not say it has COCO-WholeBody's points.
    """
    names = image_names or [f"{name}_{first_frame + t:012d}.jpg" for t in range(len(keypoints))]
    assert len(names) == len(keypoints)
    points = layout.to_wholebody(np.concatenate([keypoints.xy, keypoints.confidence[..., None]], -1))
    images = [
        {"id": t, "file_name": image, "width": size[0], "height": size[1], "frame_id": first_frame + t}
        for t, image in enumerate(names)
    ]
    content = {
        "info": {
            "description": f"{name}: keypoints in pixels, x right, y down; the third number is a confidence, 0 to 1",
            "frame_rate": frame_rate,
            "first_frame": first_frame,
            **({"detector": detector} if detector else {}),
        },
        "images": images,
        "annotations": [_annotation(t, frame) for t, frame in enumerate(points) if frame.any()],
        "categories": [{"id": 1, "name": "person", "keypoints": list(layout.COCO_17), "skeleton": []}],
    }
    with replacing(file) as draft:
        draft.write_bytes(msgspec.json.encode(content))


def _annotation(image: int, points: Float[np.ndarray, "133 3"]) -> dict[str, Any]:
    seen = points[points[:, 2] > 0, :2]
    corner, extent = seen.min(0), np.ptp(seen, axis=0)
    lists = {key: points[part].ravel().tolist() for key, (part, _) in PARTS.items()}
    flags = {flag: bool(points[part, 2].any()) for part, flag in PARTS.values()}
    return {
        "id": image,
        "image_id": image,
        "category_id": 1,
        "iscrowd": 0,
        "bbox": [*corner.tolist(), *extent.tolist()],
        "area": float(extent.prod()),
        "num_keypoints": int((points[layout.BODY_17, 2] > 0).sum()),
        "keypoints": points[layout.BODY_17].ravel().tolist(),
        **lists,
        **flags,
    }


def _raw_points(where: str, entry: dict[str, Any], names: Any) -> Float[np.ndarray, "133 3"]:
    points = np.zeros((layout.WHOLEBODY_COUNT, 3))
    if "keypoints" not in entry:
        raise InputError(f"{where} has no 'keypoints' (it has {some_of(entry)}).")
    values = _triples(where, "keypoints", entry)
    if len(values) not in _KEYPOINTS:
        raise InputError(
            f"{where}, keypoints: found {len(values)} points; expected 133, or COCO's 17 beside foot_kpts, "
            "face_kpts, lefthand_kpts and righthand_kpts. Detect with a whole-body model."
        )
    points[_KEYPOINTS[len(values)]] = values[_order(where, names, len(values))]
    for key, (part, flag) in PARTS.items():
        if entry.get(key) and entry.get(flag, True):
            values = _triples(where, key, entry, first=part.start)
            if len(values) != part.stop - part.start:
                count = part.stop - part.start
                raise InputError(f"{where}, {key}: found {len(values)} points; expected {count}, or an empty list.")
            points[part] = values
    return points


def _order(where: str, names: Any, count: int) -> list[int]:
    """For each of our points its place among those of a file with these names. Raises InputError if they are of other
    points, which nothing else would tell."""
    if not names:
        return list(range(count))
    if not isinstance(names, list):
        raise InputError(f"{where}: the names of its keypoints are {kind(names)}; expected a list of {count} names.")
    order, differing = _places(tuple(map(str, names)), count)
    if order is None:
        found = f"other names ({some_of(differing, most=5)})" if differing else f"{len(names)} names, some twice"
        raise InputError(
            f"{where}: its keypoints have {found}; expected COCO's: {', '.join(layout.COCO_17)}. Rename them, or "
            "export them as COCO keypoints."
        )
    return order


@cache
def _places(names: tuple[str, ...], count: int) -> tuple[list[int] | None, list[str]]:
    stated = [re.sub(r"[\s_-]+", "_", name.strip().lower()) for name in names]
    wanted, body = list(_NAMES[:count]), list(_NAMES[: len(layout.COCO_17)])
    if stated[: len(body)] == body and (count == len(body) or len(stated) in (len(body), count)):
        return list(range(count)), []  # programs name the points of hands and face differently, in one order
    if sorted(stated) == sorted(wanted):
        return [stated.index(name) for name in wanted], []
    return None, [name for name in stated if name not in wanted]


@cache
def _labels(key: str, first: int) -> list[str]:
    return [f"{name} ({key})" for name in _NAMES[first:]]


def _triples(where: str, key: str, entry: dict[str, Any], *, first: int = 0) -> Float[np.ndarray, "K 3"]:
    """x, y and score: one flat list, a list for each point, or with the scores in a list of their own."""
    values, scores = entry[key], entry.get("keypoint_scores") if key == "keypoints" else None
    if not isinstance(values, list):
        raise InputError(f"{where}, {key}: found {kind(values)}; expected a list of numbers x, y, confidence, ...")
    each = 3 if scores is None else 2
    if values and all(isinstance(value, list) for value in values):
        if wrong := [k for k, value in enumerate(values) if len(value) != each]:
            found = len(values[wrong[0]])
            raise InputError(f"{where}, {key}: point {wrong[0]} has {found} values; expected {each} for each.")
        values = [number for value in values for number in value]
    if len(values) % each or len(values) // each > layout.WHOLEBODY_COUNT - first:
        raise InputError(f"{where}, {key}: found {len(values)} values; expected {each} for each of 133 points.")
    names = _labels(key, first)
    xy = numbers(where, values, names, each=each).reshape(-1, each)
    if scores is None:
        return xy
    if not isinstance(scores, list) or len(scores) != len(xy):
        found = f"{len(scores)} values" if isinstance(scores, list) else kind(scores)
        raise InputError(f"{where}, keypoint_scores: found {found}; expected one for each of {len(xy)} keypoints.")
    return np.column_stack([xy, numbers(where, scores, names, each=1)])


def _checked(where: str, points: np.ndarray, most: float, *, halved: bool) -> Float[np.ndarray, "133 3"]:
    if halved:
        points = points * [1, 1, 0.5]
    return checked_points(where, points, _NAMES, most=most)


def _notes(path: Path, scores: Float[np.ndarray, "n"], visibilities: bool) -> tuple[str, ...]:
    if visibilities:
        return ("The keypoints have visibilities instead of confidences: 2 counts as confidence 1, and 1 as 0.5.",)
    most = float(scores.max(initial=0))
    if 1.25 < most <= _MAX_SCORE and math.isfinite(most):
        note = f"The keypoints' scores reach {most:.3g}; those above 1 count as confidence 1."
        return (note, *stray_confidences(path, scores[scores < 0]))
    return stray_confidences(path, scores)
