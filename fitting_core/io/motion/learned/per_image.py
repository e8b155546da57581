"""Systems that write each image's people independently: SMPLer-X, Multi-HMR, and SAM 3D Body.

| system | documented by | body | taken |
|---|---|---|---|
| SMPLer-X | caizhongang/SMPLer-X main/inference.py, main/SMPLer_X.py, common/utils/human_models.py | SMPL-X | \
smplx/<frame>_<person>.npz: global_orient, body_pose (21, 3), left_hand_pose, right_hand_pose (15, 3, over the mean \
hand), jaw_pose, betas, expression, transl; meta/<frame>_<person>.json: focal, princpt of that person's crop |
| Multi-HMR | naver/multi-hmr demo.py, model.py, blocks/smpl_layer.py | SMPL-X's mesh | <image>.npy: (people, 10475, \
3) in camera space; 60 degrees of view over the image padded to a square. Or what its model returns, as it is kept: of \
each person rotvec (53, 3: root, 21 of the body, 15 of each hand, jaw; hands with their mean), shape, expression, \
transl_pelvis |
| SAM 3D Body | facebookresearch/sam-3d-body sam_3d_body/sam_3d_body_estimator.py, sam_3d_body/metadata/mhr70.py | \
MHR, by keypoints | what `process_one_image` returns, as it is kept: of each person pred_keypoints_3d (70, 3; axes \
of the camera), pred_cam_t (3), focal_length, for a principal point in the image's middle |

SMPLest-X, which follows SMPLer-X, writes only pictures (its main/inference.py). None of them has tracks: people are
followed by position.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.body.files.forms import KINDS
from fitting_core.body.model import N_BETAS, POSE_COLUMNS
from fitting_core.errors import InputError
from fitting_core.files.npz import npz_names, read_npz
from fitting_core.files.regular import refusal, regular_file
from fitting_core.io.motion.imported_motion import SeenPoints
from fitting_core.io.motion.learned.followed import followed
from fitting_core.io.motion.learned.tracks import (
    Focal,
    System,
    Track,
    finite,
    flat,
    mapping,
    positive,
    rows,
    shape_numbers,
)
from fitting_core.video.frame_names import image_numbers, natural_key

_VERTICES = KINDS["smplx"].vertices
_MULTI_HMR_FOCAL = 1 / (2 * math.tan(math.radians(60) / 2))
_SAM_POINTS = 70
_SAM_KNOWN_BY = ("pred_keypoints_3d", "pred_cam_t")
_SAM_KEYS = (*_SAM_KNOWN_BY, "focal_length")
_MOST_FILES, _MOST_BYTES, _MOST_TEXT = 10**5, 2**31, 2**28
_MULTI_HMR_KEYS = ("rotvec", "shape", "transl_pelvis")
_MULTI_HMR_FOCAL_RULE: Focal = (
    lambda size: _MULTI_HMR_FOCAL * max(size),
    "Multi-HMR's, 60 degrees over the longer side",
)
_SMPLERX, _MULTI_HMR, _SAM = "SMPLer-X", "Multi-HMR", "SAM 3D Body"
_FOLLOWED = "It has no tracks: people were followed by position."
_SMPLERX_PARTS = ("left_hand_pose", "right_hand_pose", "jaw_pose", "expression")


@dataclass(frozen=True, eq=False)
class _Image:
    """The people of one image with their positions: camera space, metres."""

    number: int
    stem: str
    people: list[Any]
    places: list[Float[np.ndarray, "3"]]


@dataclass(frozen=True, eq=False)
class PerImage:
    """The output of one of these systems."""

    system: str
    images: list[_Image]
    named: bool
    """Whether stems are names of images."""


def of_folder(path: Path) -> PerImage | None:
    """The files of all images; None if it is not such a folder. Raises InputError if they are not as written."""
    if (path / "smplx").is_dir():
        return _smplerx(path)
    return _multi_hmr([file for file in path.glob("*.npy") if not refusal(file)])


def of_file(path: Path) -> Any:
    """The content of a file of arrays or JSON if it is SAM 3D Body's, or Multi-HMR's of one image; otherwise None.
    Raises InputError if it is damaged."""
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return _multi_hmr([path])
    if suffix == ".json":
        return _json(path)
    try:
        if suffix == ".npz" and set(_SAM_KNOWN_BY) <= set(npz_names(path)):
            return read_npz(path, (*_SAM_KEYS, "frame_index"))
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
    told = {t: number for number, t in image_numbers(list(stems)).items()}
    return [told[t] if len(told) == len(stems) else t for t in range(len(stems))]


# --- SMPLer-X ---


def _smplerx(path: Path) -> PerImage:
    files: dict[int, list[tuple[int, Path]]] = {}
    for file in sorted((path / "smplx").glob("*.npz"))[:_MOST_FILES]:
        frame, _, person = file.stem.rpartition("_")
        if frame.isdecimal() and person.isdecimal() and not refusal(file):
            files.setdefault(int(frame), []).append((int(person), file))
    images = []
    for frame, people in sorted(files.items()):
        found = [_smplerx_person(file, path / "meta" / f"{file.stem}.json") for _, file in sorted(people)]
        images.append(_Image(frame, "", found, [_at_corner(one) for one in found]))
    return PerImage(_SMPLERX, images, named=False)


def _smplerx_person(file: Path, beside: Path) -> dict[str, Any]:
    if not beside.is_file() or refusal(beside):
        raise InputError(f"has smplx/{file.name} but no meta/{beside.name}, which has the camera")
    try:
        arrays = read_npz(file, ("global_orient", "body_pose", "betas", "transl", *_SMPLERX_PARTS))
    except (OSError, ValueError) as error:
        raise InputError(f"smplx/{file.name}: {error}") from error
    return {**arrays, **mapping(_json(beside), f"meta/{beside.name}")}


def _at_corner(person: dict[str, Any]) -> Float[np.ndarray, "3"]:
    """Translation for a focal length of 1 pixel and a principal point in the image's corner.

    The crop's camera (focal f, centre c) shows the point at f x / z + c; a camera of focal F shows it there at the same
    size from the depth z F / f.
    """
    shift = flat(person, "transl", 3)
    focal, center = positive(flat(person, "focal", 2), "focal"), flat(person, "princpt", 2)
    positive(shift[2:], "transl")
    return np.array([*(shift[:2] + center * shift[2] / focal), shift[2] / focal.mean()])


def _smplerx_track(content: PerImage, person: int) -> Track:
    seen = _of_person(content, person)
    people = [one for _, one in seen]

    def gather(key: str, width: int) -> np.ndarray:
        return np.stack([flat(one, key, width) for one in people])

    focal = float(np.median([flat(one, "focal", 2).mean() for one in people]))
    places = np.stack([_at_corner(one) for one in people])
    widths = {name: POSE_COLUMNS[name].stop - POSE_COLUMNS[name].start for name in _SMPLERX_PARTS[:3]}
    return Track(
        pose=np.concatenate([gather("global_orient", 3), gather("body_pose", 63)], 1),
        more={name: gather(name, widths.get(name, 10)) for name in _SMPLERX_PARTS},
        betas=np.concatenate([shape_numbers(one, "betas", 1) for one in people]),
        translation=places * [1.0, 1.0, focal],
        from_corner=True,
        numbers=np.array([image.number for image, _ in seen]),
        kind="smplx",
        focal=(lambda size: focal, "SMPLer-X's, the middle of its crops'"),
        notes=_notes(content),
    )


# --- Multi-HMR ---


def _multi_hmr(files: Sequence[Path]) -> PerImage | None:
    files = sorted(files, key=lambda file: natural_key(file.stem))[:_MOST_FILES]
    found = {file.stem: array for file in files if (array := _meshes(file)) is not None}
    if not found or sum(array.nbytes for array in found.values()) > _MOST_BYTES:
        if found:
            raise InputError(f"has meshes of more than {_MOST_BYTES >> 30} GB, expected those of one clip")
        return None
    numbers = _numbers(list(found))
    images = [
        _Image(number, stem, list(meshes), [finite(mesh.mean(0), stem) for mesh in meshes])
        for number, (stem, meshes) in sorted(zip(numbers, found.items(), strict=True), key=lambda pair: pair[0])
    ]
    return PerImage(_MULTI_HMR, images, named=len(found) > 1)


def _meshes(file: Path) -> np.ndarray | None:
    """An array of SMPL-X meshes, memory-mapped; None if it is something else."""
    try:
        array = np.load(regular_file(file), mmap_mode="r", allow_pickle=False)
    except Exception:  # numpy passes on what Python's own reader of such headers raises
        return None
    right = isinstance(array, np.ndarray) and array.ndim == 3 and array.shape[1:] == (_VERTICES, 3)
    return array if right and array.dtype.kind == "f" else None


def _meshed_track(content: PerImage, person: int) -> Track:
    seen = _of_person(content, person)
    vertices = np.stack([finite(np.asarray(mesh), image.stem) for image, mesh in seen])
    return _of_points(content, seen, SeenPoints(vertices=vertices), focal=_MULTI_HMR_FOCAL_RULE)


def _multi_hmr_people(content: Any) -> PerImage:
    """Of its meshes, or of what its model returned."""
    return content if isinstance(content, PerImage) else _kept(content, _MULTI_HMR, _MULTI_HMR_KEYS, "transl_pelvis")


def _multi_hmr_track(content: Any, person: int) -> Track:
    if isinstance(content, PerImage):
        return _meshed_track(content, person)
    whole = _multi_hmr_people(content)
    seen = _of_person(whole, person)
    pose = np.stack([flat(one, "rotvec", 159) for _, one in seen])
    parts = {"left_hand_pose": pose[:, 66:111], "right_hand_pose": pose[:, 111:156], "jaw_pose": pose[:, 156:]}
    if all("expression" in one for _, one in seen):
        parts["expression"] = np.stack([flat(one, "expression", 10) for _, one in seen])
    return Track(
        pose=pose[:, :66],
        more=parts,
        betas=np.concatenate([shape_numbers(one, "shape", 1) for _, one in seen]),
        translation=np.stack([flat(one, "transl_pelvis", 3) for _, one in seen]),
        about_pelvis=True,
        flat_hands=True,
        numbers=np.array([image.number for image, _ in seen]),
        stems=tuple(image.stem for image, _ in seen) if whole.named else (),
        kind="smplx",
        focal=_MULTI_HMR_FOCAL_RULE,
        notes=_notes(whole),
    )


# --- SAM 3D Body ---

# fmt: off
_SAM_BODY = (
    "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow right_elbow left_hip right_hip "
    "left_knee right_knee left_ankle right_ankle left_big_toe left_small_toe left_heel right_big_toe right_small_toe "
    "right_heel"
).split()
# fmt: on
_SAM_FINGERS = [f"{finger}{k}" for finger in ("thumb", "index", "middle", "ring", "pinky") for k in (4, 3, 2, 1)]
_SAM_NAMES: dict[int, str] = (
    dict(enumerate(_SAM_BODY))
    | {21 + i: f"right_{name}" for i, name in enumerate(_SAM_FINGERS)}
    | {41: "right_wrist", 62: "left_wrist", 69: "neck"}
    | {42 + i: f"left_{name}" for i, name in enumerate(_SAM_FINGERS)}
)
"""The points of mhr70 that OpenPose has; its fingers run from tip to knuckle."""


def _by_frame(values: Mapping[str, Any]) -> list[list[Any]]:
    """One person's arrays as lists of people, for a result of one image."""
    if np.size(values.get("focal_length", 0)) == 1 and np.size(values["pred_cam_t"]) == 3:
        return [[dict(values)]]
    places = rows(values, "pred_cam_t", 3)
    points = rows(values, "pred_keypoints_3d", 3 * _SAM_POINTS, len(places))
    focal = rows(_with_focal(values), "focal_length", 1, len(places))
    return [[dict(zip(_SAM_KEYS, one, strict=True))] for one in zip(points, places, focal, strict=True)]


def _with_focal(person: Mapping[str, Any]) -> Mapping[str, Any]:
    """The same. Raises InputError if the focal length was not saved."""
    if "focal_length" not in person:
        raise InputError(
            "has no 'focal_length' (pixels), without which its 'pred_cam_t' is ambiguous; expected both, "
            "as SAM 3D Body's process_one_image returns them. Add it"
        )
    return person


def _sam(content: Any) -> PerImage:
    own = _by_frame(content) if _is_person(content, _SAM_KNOWN_BY) else content
    return _kept(own, _SAM, _SAM_KNOWN_BY, "pred_cam_t")


def _sam_track(content: Any, person: int) -> Track:
    whole = _sam(content)
    seen = _of_person(whole, person)
    points = np.stack([flat(one, "pred_keypoints_3d", 3 * _SAM_POINTS).reshape(-1, 3) for _, one in seen])
    focals = positive(np.concatenate([flat(_with_focal(one), "focal_length", 1) for _, one in seen]), "focal_length")
    places = np.stack([flat(one, "pred_cam_t", 3) for _, one in seen])
    focal = float(np.median(focals))
    # The images' focal lengths are unified: at another depth a body looks the same.
    places[:, 2] = positive(places[:, 2], "pred_cam_t") * focal / focals
    keypoints = np.full((len(seen), kp.COUNT, 3), np.nan)
    for place, name in _SAM_NAMES.items():
        keypoints[:, kp.INDEX[name]] = points[:, place] + places
    told = SeenPoints(keypoints=keypoints)
    return _of_points(whole, seen, told, focal=(lambda size: focal, "told by the result"))


# --- all ---


def _is_person(value: Any, keys: Sequence[str]) -> bool:
    return isinstance(value, dict) and set(keys) <= set(value)


def _kept_images(content: Any, keys: Sequence[str]) -> list[tuple[str, list[Any]]] | None:
    """Names and people of all images: from a dictionary or list of them, or one image; None if it is none of these."""
    if not isinstance(content, dict | list) or not content:
        return None
    entries = list(content.items()) if isinstance(content, dict) else [("", one) for one in content]
    if isinstance(content, list) and all(_is_person(one, keys) for one in content):
        return [("", content)]
    lists = all(isinstance(people, list) and all(_is_person(one, keys) for one in people) for _, people in entries)
    named = [(Path(str(name)).stem, people) for name, people in entries]
    return named if lists and any(people for _, people in named) else None


def _kept(content: Any, system: str, keys: Sequence[str], place: str) -> PerImage:
    """The return value of a system's program, as people save it."""
    entries = _kept_images(content, keys)
    assert entries is not None
    stems = [stem for stem, _ in entries]
    named = all(stems) and len(set(stems)) == len(stems)
    numbers = _numbers(stems) if named else list(range(len(stems)))
    images = [
        _Image(number, stem, people, [flat(one, place, 3) for one in people])
        for number, (stem, people) in sorted(zip(numbers, entries, strict=True), key=lambda pair: pair[0])
    ]
    return PerImage(system, images, named=named)


def _of_points(content: PerImage, seen: list[tuple[_Image, Any]], points: SeenPoints, **told: Any) -> Track:
    frames = len(seen)
    return Track(
        pose=np.zeros((frames, 66)),
        betas=np.zeros((frames, N_BETAS)),
        translation=np.zeros((frames, 3)),
        points=points,
        numbers=np.array([image.number for image, _ in seen]),
        stems=tuple(image.stem for image, _ in seen) if content.named else (),
        kind="smplx",
        notes=_notes(content),
        **told,
    )


def _notes(content: PerImage) -> tuple[str, ...]:
    return (_FOLLOWED,) if max(len(image.people) for image in content.images) > 1 else ()


def _tracks(content: PerImage) -> dict[int, dict[int, int]]:
    """For each person, the index within the image by the image's index."""
    return followed([image.places for image in content.images])


def _of_person(content: PerImage, person: int) -> list[tuple[_Image, Any]]:
    found = _tracks(content)[person]
    return [(content.images[t], content.images[t].people[place]) for t, place in sorted(found.items())]


def _people(content: PerImage) -> Mapping[int, Sequence[int]]:
    return {n: [content.images[t].number for t in track] for n, track in _tracks(content).items()}


def _is_of(content: Any, system: str) -> bool:
    return isinstance(content, PerImage) and content.system == system


SYSTEMS = (
    System(title="SMPLer-X", holds=lambda content: _is_of(content, _SMPLERX), people=_people, track=_smplerx_track),
    System(
        title="Multi-HMR",
        holds=lambda c: _is_of(c, _MULTI_HMR) or _kept_images(c, _MULTI_HMR_KEYS) is not None,
        people=lambda content: _people(_multi_hmr_people(content)),
        track=_multi_hmr_track,
    ),
    System(
        title="SAM 3D Body",
        holds=lambda content: _is_person(content, _SAM_KNOWN_BY) or _kept_images(content, _SAM_KNOWN_BY) is not None,
        people=lambda content: _people(_sam(content)),
        track=_sam_track,
    ),
)
