"""The variants of COCO-WholeBody JSON: which entries belong to which frame, before their numbers are checked."""

from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any

from fitting_core.errors import InputError
from fitting_core.io.keypoints.json_points import kind, short
from fitting_core.video.frame_names import natural_key


@dataclass(frozen=True, kw_only=True)
class CocoFrame:
    """A picture, and what was found in it."""

    stem: str
    people: tuple[tuple[str, dict[str, Any]], ...]
    """Each one's place in the file, for messages; and its entry."""
    names: Mapping[Any, Any] = field(default_factory=dict)
    """The keypoints' names in the order of the file as it states them, by category; under None, of every category."""

    def names_of(self, entry: dict[str, Any]) -> Any:
        """The names of an entry's keypoints; None if the file does not state them."""
        categories = list(self.names)
        only = categories[0] if len(categories) == 1 else None
        category = entry.get("category_id", only)
        return self.names.get(category if isinstance(category, Hashable) else only)


@dataclass(frozen=True, kw_only=True)
class CocoContent:
    """All frames of a file."""

    frames: tuple[CocoFrame, ...]
    size: tuple[int, int] | None = None
    frame_rate: float | None = None
    detector: Any = None
    """As the file states it."""


def _annotation_file(path: Path, content: dict[str, Any]) -> CocoContent:
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
    known: dict[str, Any] = info if isinstance(info, dict) else {}
    names = {category["id"]: category.get("keypoints") for category in _categories(content.get("categories"))}
    rate: Any = known.get("frame_rate")
    return CocoContent(
        frames=tuple(CocoFrame(stem=stem, people=tuple(people[number]), names=names) for number, stem, _ in images),
        size=sizes.pop() if len(sizes) == 1 else None,
        frame_rate=float(rate) if type(rate) in (int, float) and 0 < rate <= 2000 else None,
        detector=known.get("detector"),
    )


def _categories(stated: Any) -> Iterator[dict[str, Any]]:
    for category in stated if isinstance(stated, list) else ():
        if isinstance(category, dict) and type(category.get("id")) in (int, str):
            yield category


def _image(path: Path, k: int, entry: Any) -> tuple[Any, str, tuple[int, int] | None]:
    if not isinstance(entry, dict) or type(entry.get("id")) not in (int, str):
        raise InputError(f"{path}: image {k} has no id; expected an object with 'id' and 'file_name'.")
    name = entry.get("file_name")
    if not isinstance(name, str) or not name:
        raise InputError(f"{path}: image {k} has the file_name {short(name)}; expected a text.")
    sides: Any = (entry.get("width"), entry.get("height"))
    size = sides if all(type(side) is int and 1 <= side <= 100_000 for side in sides) else None
    return entry["id"], _stem(name), size


def _result_list(path: Path, content: list[Any]) -> CocoContent:
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
    return CocoContent(frames=tuple(CocoFrame(stem=stems[number], people=tuple(people[number])) for number in order))


def _predictions(path: Path, content: Any) -> CocoContent:
    names = _mmpose_names(content)
    frames: dict[int, CocoFrame] = {}
    for k, (_, entry) in enumerate(_entries(path, "frame", _mmpose(content))):
        number = entry.get("frame_id", k)
        if type(number) is not int or not 0 <= number < 10**15 or number in frames:
            raise InputError(f"{path}: frame {k} has the frame_id {short(number)}; expected numbers, each once.")
        people = tuple(_entries(path, f"frame {number}, person", entry.get("instances")))
        frames[number] = CocoFrame(stem="", people=people, names=names)
    # mmpose's demos count frames from 1, its inferencer from 0.
    first = int(min(frames, default=0) == 1)
    return CocoContent(
        frames=tuple(replace(frame, stem=f"frame_{n - first:012d}") for n, frame in sorted(frames.items()))
    )


def _one_image(path: Path, content: Any) -> CocoContent:
    people = tuple(_entries(path, "person", _mmpose(content)))
    return CocoContent(frames=(CocoFrame(stem=path.stem, people=people, names=_mmpose_names(content)),))


def _has(content: Any, key: str) -> bool:
    """Whether it is a list whose first object has this key."""
    return isinstance(content, list) and bool(content) and isinstance(content[0], dict) and key in content[0]


def _mmpose(content: Any) -> Any:
    """mmpose's predictions: its demos nest them in 'instance_info', its inferencer writes them alone."""
    return content.get("instance_info") if isinstance(content, dict) else content


def _mmpose_names(content: Any) -> dict[Any, Any]:
    """The keypoints' names that mmpose and Sapiens state beside 'instance_info', under None."""
    about = content.get("meta_info") if isinstance(content, dict) else None
    names = about.get("keypoint_id2name") if isinstance(about, dict) else None
    if isinstance(names, dict) and all(str(key).isdecimal() for key in names):
        names = [name for _, name in sorted(names.items(), key=lambda item: int(item[0]))]
    return {} if names is None else {None: names}


FORMS: tuple[tuple[Callable[[Any], bool], Callable[[Path, Any], CocoContent]], ...] = (
    (
        lambda c: isinstance(c, dict) and all(isinstance(c.get(key), list) for key in ("images", "annotations")),
        _annotation_file,
    ),
    (lambda c: _has(c, "image_id"), _result_list),
    (lambda c: _has(_mmpose(c), "keypoints") or _mmpose(c) == [], _one_image),
    (
        lambda c: _has(c, "instances") or (isinstance(c, dict) and isinstance(c.get("instance_info"), list)),
        _predictions,
    ),
    (lambda c: isinstance(c, list), _result_list),
)
"""A check of the file's content -> the reader for that variant."""


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
