"""COCO-WholeBody JSON: annotation files, result lists as mmpose and DWPose write them, and mmpose's predictions."""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from jaxtyping import Float

import fitting_core.io.coco_wholebody_layout as layout
from fitting_core.errors import InputError
from fitting_core.frame_names import natural_key
from fitting_core.io.atomic import replacing
from fitting_core.io.detections import Detections
from fitting_core.io.json_points import checked_points, kind, numbers, read_json, short
from fitting_core.keypoints import Keypoints

PARTS: dict[str, tuple[slice, str]] = {
    "foot_kpts": (layout.FEET, "foot_valid"),
    "face_kpts": (layout.FACE_68, "face_valid"),
    "lefthand_kpts": (layout.LEFT_HAND_21, "lefthand_valid"),
    "righthand_kpts": (layout.RIGHT_HAND_21, "righthand_valid"),
}
"""Lists beside `keypoints` by key: their places among the 133, and the flag that says whether they count."""
_KEYPOINTS: dict[int, slice] = {133: slice(0, 133), 17: layout.BODY_17}
"""What `keypoints` can hold, by its number of points."""
_NAMES = layout.WHOLEBODY_NAMES
_ADVICE = "export it again"
_MAX_SCORE = 20.0
"""Detectors with SimCC heads give peaks of logits as scores; a percentage is none."""


@dataclass(frozen=True, kw_only=True)
class _Frame:
    """A picture, and what was found in it."""

    stem: str
    people: tuple[tuple[str, dict[str, Any]], ...]
    """Where each stands in the file, for messages; and its entry."""


@dataclass(frozen=True, kw_only=True)
class _Content:
    frames: tuple[_Frame, ...]
    size: tuple[int, int] | None = None
    frame_rate: float | None = None


def holds_coco(start: bytes) -> bool:
    """Whether a JSON file that starts so is one of those that `read_coco_wholebody` reads."""
    inside = start.lstrip(b"\xef\xbb\xbf \t\r\n")
    if inside.startswith(b"["):
        return b'"image_id"' in start
    return any(key in start for key in (b'"annotations"', b'"images"', b'"instance_info"'))


def read_coco_wholebody(path: Path) -> Detections:
    """Read an annotation file (images and annotations), a result list, or what mmpose's inferencer predicts.

    Frames come in the order of the images' names, or of the ids of pictures where names are not told. A person has
    `keypoints` of all 133 points, or of the 17 of the body beside `foot_kpts`, `face_kpts`, `lefthand_kpts` and
    `righthand_kpts`, any of which can be absent. Neck and mid-hip are made of shoulders and hips. A file whose third
    numbers are 0, 1 and 2 has COCO's visibilities, which become confidences of 0, 0.5 and 1.

    Raises:
        InputError: The file is damaged, of another format, or holds values that cannot be; it names the person.
    """
    content = read_json(path, advice=_ADVICE)
    form = next((form for fits, form in _FORMS if fits(content)), None)
    if form is None:
        found = f"an object with {', '.join(list(content)[:8]) or 'nothing'}" if isinstance(content, dict) else ""
        raise InputError(
            f"{path} is no COCO-WholeBody JSON: found {found or kind(content)}; expected 'images' and 'annotations', "
            "a list of results with 'image_id' and 'keypoints', or 'instance_info'."
        )
    known = form(path, content)
    raw = [[_raw_points(where, entry) for where, entry in frame.people] for frame in known.frames]
    scores = np.concatenate([points[:, 2] for people in raw for points in people] or [np.zeros(0)])
    visibilities = bool(np.isin(scores, (0, 1, 2)).all() and (scores == 2).any())
    most = 2.0 if visibilities else _MAX_SCORE
    notes = _notes(scores, visibilities)
    frames = []
    for frame, people in zip(known.frames, raw, strict=True):
        found = [_checked(frame.people[k][0], points, most, halved=visibilities) for k, points in enumerate(people)]
        frames.append(layout.from_wholebody(np.stack(found)) if found else np.zeros((0, 137, 3)))
    return Detections(
        frames=tuple(frames),
        stems=tuple(frame.stem for frame in known.frames),
        source=path,
        size=known.size,
        frame_rate=known.frame_rate,
        notes=notes,
    )


def write_coco_wholebody(
    file: Path,
    keypoints: Keypoints,
    *,
    name: str,
    size: tuple[int, int],
    frame_rate: float,
    first_frame: int = 0,
    image_names: Sequence[str] | None = None,
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
        },
        "images": images,
        "annotations": [_annotation(t, frame) for t, frame in enumerate(points) if frame.any()],
        "categories": [{"id": 1, "name": "person", "keypoints": list(layout.COCO_17), "skeleton": []}],
    }
    with replacing(file) as draft:
        draft.write_text(json.dumps(content), encoding="utf-8")


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


def _annotation_file(path: Path, content: dict[str, Any]) -> _Content:
    images = [_image(path, k, entry) for k, entry in enumerate(content["images"])]
    if not images:
        raise InputError(f"{path}: its list 'images' is empty; expected an image for each frame.")
    people: dict[Any, list[tuple[str, dict[str, Any]]]] = {number: [] for number, _, _ in images}
    if len(people) < len(images):
        raise InputError(f"{path}: several of its {len(images)} images have the same id; expected one id for each.")
    for k, (where, entry) in enumerate(_entries(path, "annotation", content["annotations"])):
        number = entry.get("image_id")
        if type(number) not in (int, str) or number not in people:
            raise InputError(f"{path}: annotation {k} is of the image {short(number)}, which 'images' does not have.")
        people[number].append((where, entry))
    images.sort(key=lambda image: natural_key(image[1]))
    _forbid_same_name(path, [stem for _, stem, _ in images])
    sizes = {size for _, _, size in images}
    info = content.get("info")
    rate: Any = info.get("frame_rate") if isinstance(info, dict) else None
    return _Content(
        frames=tuple(_Frame(stem=stem, people=tuple(people[number])) for number, stem, _ in images),
        size=sizes.pop() if len(sizes) == 1 else None,
        frame_rate=float(rate) if type(rate) in (int, float) and 0 < rate < 1e4 else None,
    )


def _image(path: Path, k: int, entry: Any) -> tuple[Any, str, tuple[int, int] | None]:
    """Id, stem of the name, and size."""
    if not isinstance(entry, dict) or type(entry.get("id")) not in (int, str):
        raise InputError(f"{path}: image {k} has no id; expected an object with 'id' and 'file_name'.")
    name = entry.get("file_name")
    if not isinstance(name, str) or not name:
        raise InputError(f"{path}: image {k} has the file_name {short(name)}; expected a text.")
    sides: Any = (entry.get("width"), entry.get("height"))
    size = sides if all(type(side) is int and 1 <= side <= 100_000 for side in sides) else None
    return entry["id"], _stem(name), size


def _result_list(path: Path, content: list[Any]) -> _Content:
    people: dict[int | str, list[tuple[str, dict[str, Any]]]] = {}
    for k, (where, entry) in enumerate(_entries(path, "result", content)):
        number: Any = entry.get("image_id")
        if type(number) not in (int, str) or (type(number) is int and not 0 <= number < 10**15):
            raise InputError(f"{path}: result {k} has the image_id {short(number)}; expected a number or a name.")
        people.setdefault(number, []).append((where, entry))
    if len({type(number) for number in people}) > 1:
        raise InputError(f"{path}: some image_ids are numbers and some are names; expected the results of one run.")
    stems = {number: f"image_{number:012d}" if isinstance(number, int) else _stem(number) for number in people}
    _forbid_same_name(path, list(stems.values()))
    order = sorted(people, key=lambda number: natural_key(stems[number]))
    return _Content(frames=tuple(_Frame(stem=stems[number], people=tuple(people[number])) for number in order))


def _predictions(path: Path, content: dict[str, Any]) -> _Content:
    frames: dict[int, _Frame] = {}
    for k, (_, entry) in enumerate(_entries(path, "frame", content["instance_info"])):
        number = entry.get("frame_id", k)
        if type(number) is not int or not 0 <= number < 10**15 or number in frames:
            raise InputError(f"{path}: frame {k} has the frame_id {short(number)}; expected numbers, each once.")
        people = tuple(_entries(path, f"frame {number}, person", entry.get("instances")))
        frames[number] = _Frame(stem=f"frame_{number:012d}", people=people)
    # mmpose counts frames from 1.
    first = min(frames, default=0)
    ordered = [frames[number] for number in sorted(frames)]
    if first == 1:
        ordered = [
            _Frame(stem=f"frame_{number - 1:012d}", people=frame.people) for number, frame in sorted(frames.items())
        ]
    return _Content(frames=tuple(ordered))


_FORMS: tuple[tuple[Callable[[Any], bool], Callable[[Path, Any], _Content]], ...] = (
    (
        lambda c: isinstance(c, dict) and all(isinstance(c.get(key), list) for key in ("images", "annotations")),
        _annotation_file,
    ),
    (lambda c: isinstance(c, list), _result_list),
    (lambda c: isinstance(c, dict) and isinstance(c.get("instance_info"), list), _predictions),
)
"""What tells a form by the file's content -> what reads it."""


def _entries(path: Path, what: str, entries: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    if not isinstance(entries, list):
        raise InputError(f"{path}, {what}: found {kind(entries)}; expected a list of objects.")
    for k, entry in enumerate(entries):
        if not isinstance(entry, dict):
            raise InputError(f"{path}: {what} {k} is {kind(entry)}; expected an object with 'keypoints'.")
        yield f"{path}: {what} {k}", entry


def _stem(name: str) -> str:
    return PurePosixPath(name.replace("\\", "/")).stem


def _forbid_same_name(path: Path, stems: list[str]) -> None:
    seen: set[str] = set()
    for stem in stems:
        if stem in seen:
            raise InputError(f"{path}: two images are called {short(stem)}; expected the frames of one clip.")
        seen.add(stem)


def _raw_points(where: str, entry: dict[str, Any]) -> Float[np.ndarray, "133 3"]:
    """Positions and scores as they stand there."""
    points = np.zeros((layout.WHOLEBODY_COUNT, 3))
    if "keypoints" not in entry:
        raise InputError(f"{where} has no 'keypoints' (it has {', '.join(list(entry)[:8]) or 'nothing'}).")
    values = _triples(where, "keypoints", entry)
    if len(values) not in _KEYPOINTS:
        raise InputError(
            f"{where}, keypoints: found {len(values)} points; expected 133, or the 17 of COCO beside foot_kpts, "
            "face_kpts, lefthand_kpts and righthand_kpts. Detect with a whole-body model."
        )
    points[_KEYPOINTS[len(values)]] = values
    for key, (part, flag) in PARTS.items():
        if entry.get(key) and entry.get(flag, True):
            values = _triples(where, key, entry)
            if len(values) != part.stop - part.start:
                count = part.stop - part.start
                raise InputError(f"{where}, {key}: found {len(values)} points; expected {count}, or an empty list.")
            points[part] = values
    return points


def _triples(where: str, key: str, entry: dict[str, Any]) -> Float[np.ndarray, "K 3"]:
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
    if len(values) % each or len(values) // each > layout.WHOLEBODY_COUNT:
        raise InputError(f"{where}, {key}: found {len(values)} values; expected {each} for each of 133 points.")
    names = [f"{name} ({key})" for name in _NAMES]
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


def _notes(scores: Float[np.ndarray, "n"], visibilities: bool) -> tuple[str, ...]:
    if visibilities:
        return ("The keypoints have visibilities instead of confidences: 2 counts as confidence 1, and 1 as 0.5.",)
    most = float(scores.max(initial=0))
    if 1.25 < most <= _MAX_SCORE and math.isfinite(most):
        return (f"The keypoints' scores reach {most:.3g}; those above 1 count as confidence 1.",)
    return ()
