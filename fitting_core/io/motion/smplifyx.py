"""Results of SMPLify-X: one pickle per person and frame, `results/<stem>/000.pkl`.

| key | shape | |
|---|---|---|
| camera_rotation, camera_translation | (1, 3, 3), (1, 3) | from the body's space into that of the camera |
| betas, expression | (1, 10) | |
| global_orient, jaw_pose, leye_pose, reye_pose | (1, 3) | axis-angle |
| left_hand_pose, right_hand_pose | (1, 12) | components over the mean hand, or (1, 45) axis-angle over it |
| body_pose | (1, 32) or (1, 63) | numbers of the VPoser that it was fitted with, or axis-angle |
| pose_embedding | (1, 32) | as tcfit writes it beside axis-angle: numbers of the pose prior |
| camera_focal, camera_center, image_size | (1, 2) | as tcfit writes them; SMPLify-X keeps no camera |

tcfit writes results/about.json beside them with body, frame rate and axes, and reads it if present.
"""

import io
import pickle
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body.model import N_BETAS, N_EXPRESSION, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera, FocalFrom
from fitting_core.errors import InputError, some_of
from fitting_core.files.archives import Member, open_members
from fitting_core.files.atomic import replacing
from fitting_core.files.pickles import as_array, read_pickle
from fitting_core.io.motion.imported_motion import ImportedMotion, body_params
from fitting_core.motion import AXES
from fitting_core.video.frame_names import frame_numbers, natural_key

LATENT, BODY = 32, 63
"""Lengths of a body_pose: VPoser's numbers, or axis-angle of 21 joints."""
WIDTHS: dict[str, tuple[int, ...]] = {
    "global_orient": (3,),
    "jaw_pose": (3,),
    "leye_pose": (3,),
    "reye_pose": (3,),
    "left_hand_pose": tuple(range(1, 46)),
    "right_hand_pose": tuple(range(1, 46)),
    "body_pose": (LATENT, BODY),
    "betas": tuple(range(N_BETAS, 301)),
    "expression": tuple(range(N_EXPRESSION, 101)),
    "camera_translation": (3,),
}
"""Allowed lengths of each key."""
CAMERA = ("camera_focal", "camera_center", "image_size")
_MAX_BYTES = 16 * 2**20
"""Limit for one pickle; SMPLify-X's have 3 kB."""
_MAX_VALUE = 1e6


@dataclass(frozen=True, kw_only=True, eq=False)
class ResultFrame:
    """One person in one frame."""

    stem: str
    """Name of the folder around the pickle, which is the image's stem."""
    values: dict[str, Float[np.ndarray, "n"]]
    """By key, flat."""
    rotation: Float[np.ndarray, "3 3"]
    """From the body's space into that of the camera."""


def read_result(path: Path, member: Member) -> ResultFrame:
    """Read a pickle. Raises InputError if it is damaged, refers to code, lacks a key, or has invalid values.

    Args:
        path: What the user gave, for messages.
        member: The pickle: the path itself, or inside it.
    """
    itself = path.is_file() and member.path.name == path.name
    where = path if itself else path / member.path.relative_to(member.path.parts[0])
    if member.size > _MAX_BYTES:
        raise InputError(f"{where}: has {member.size / 2**20:.0f} MB; expected a result of SMPLify-X, some kilobytes.")
    try:
        with member.open() as stream:
            content = read_pickle(io.BytesIO(stream.read(_MAX_BYTES)))
        values = {key: _values(content, key, widths) for key, widths in WIDTHS.items()}
        values |= {key: _values(content, key, (2,)) for key in CAMERA if key in content}
        if "transl" in content:
            values["transl"] = _values(content, "transl", (3,))
        rotation = _rotation(content)
    except InputError as error:
        raise InputError(f"{where}: {error}. Expected a result of SMPLify-X; write it again.") from error
    return ResultFrame(stem=member.path.parent.name, values=values, rotation=rotation)


def _values(content: dict[str, Any], key: str, widths: tuple[int, ...]) -> Float[np.ndarray, "n"]:
    if key not in content:
        raise InputError(f"has no '{key}' (it has {some_of(content)})")
    try:
        array = as_array(content[key])
    except InputError as error:
        raise InputError(f"'{key}' is {error}") from error
    if array.dtype.kind not in "fiu" or array.size not in widths or array.ndim > 3:
        expected = " or ".join(map(str, widths)) if len(widths) < 4 else f"{widths[0]} to {widths[-1]}"
        raise InputError(f"'{key}' has the shape {array.shape} of {array.dtype}, expected {expected} numbers")
    flat = array.reshape(-1).astype(np.float64)
    if not (np.abs(flat) <= _MAX_VALUE).all():
        bad = flat[~(np.abs(flat) <= _MAX_VALUE)][0]
        raise InputError(f"'{key}' holds {bad:g}, expected finite numbers up to {_MAX_VALUE:g}")
    return flat


def _rotation(content: dict[str, Any]) -> Float[np.ndarray, "3 3"]:
    if "camera_rotation" not in content:
        return np.eye(3)
    matrix = _values(content, "camera_rotation", (9,)).reshape(3, 3)
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-3 or np.linalg.det(matrix) < 0:
        raise InputError("'camera_rotation' is not a rotation matrix")
    return matrix


def pickled(arrays: dict[str, np.ndarray]) -> bytes:
    """Arrays as the pickle of a dictionary, in float32."""
    content = pickle.dumps({name: array.astype(np.float32) for name, array in arrays.items()}, protocol=2)
    # numpy 2 names a module that numpy 1 lacks; both know the old name. Protocol 2 ends names with a newline.
    return content.replace(b"cnumpy._core.multiarray\n", b"cnumpy.core.multiarray\n")


FOCAL = 5000.0
"""Pixels: SMPLify-X's default focal length, which its results do not record."""
RESULTS, ABOUT = "results", "about.json"
Decode = Callable[[Float[Tensor, "T 32"]], Float[Tensor, "T 63"]]
"""From the pose prior's latent numbers to axis-angle."""
_MAX_ABOUT = 2**16
_NUMBERED = re.compile(r"\d+\.pkl")


class ResultAbout(msgspec.Struct, frozen=True, kw_only=True):
    """The content of about.json."""

    generator: str = ""
    axes: str = ""
    gender: Literal["neutral", "male", "female", "child"] | None = None
    body_kind: Literal["smplx", "smplh", "smpl"] = "smplx"
    body_hash: str = ""
    frame_rate: Annotated[float, msgspec.Meta(gt=0, le=2000)] | None = None
    focal_px: tuple[float, float] | None = None
    center_px: tuple[float, float] | None = None
    image_size_px: tuple[int, int] | None = None
    note: str = ""


def read_smplifyx(
    path: Path, *, person: int = 0, gender: str | None = None, decode: Decode | None = None
) -> ImportedMotion:
    """Read a folder of results, an archive of one, or a single pickle. Raises InputError if there are no results, one
    is damaged or invalid, or the pose needs a VPoser.

    Frames are the folders around the pickles, ordered by number.

    Args:
        path: SMPLify-X's output folder, `results` in it, one frame's folder, one pickle, or a zip or tar of them.
        person: Number of the pickle in each frame: 0 is 000.pkl.
        gender: Of the fitted body, which SMPLify-X does not record; None: as about.json says, or neutral.
        decode: Of the VPoser that it was fitted with; None: not available.
    """
    with open_members(path) as members:
        pickles = [member for member in members if _NUMBERED.fullmatch(member.path.name)]
        if path.is_file() and len(members) == 1 and not pickles:
            pickles, chosen = members, members
        else:
            chosen = [member for member in pickles if int(member.path.stem) == person]
        if not chosen:
            raise InputError(_nothing(path, pickles, members, person))
        frames = [read_result(path, member) for member in chosen]
        about = next((_about(path, member) for member in members if member.path.name == ABOUT), ResultAbout())
    frames.sort(key=lambda frame: natural_key(frame.stem))
    _forbid_mixed(path, frames)
    others = len({member.path.stem for member in pickles}) - 1
    notes = (f"Of {others + 1} people in its frames the one in {person:03d}.pkl was taken.",) if others else ()
    numbers, numbered = _numbers([frame.stem for frame in frames])
    camera = _camera(path, frames)
    return ImportedMotion(
        source=path,
        format="SMPLify-X results",
        kind=about.body_kind,
        gender=gender or about.gender or "neutral",
        body_hash=about.body_hash if gender in (None, about.gender) else "",
        frame_rate=about.frame_rate,
        params=_params(path, frames, decode),
        whole_hands=False,
        turn=torch.as_tensor(np.stack([frame.rotation for frame in frames])),
        numbers=numbers,
        numbered=numbered,
        stems=tuple(frame.stem for frame in frames),
        camera=camera,
        focal=None if camera else (FOCAL, "SMPLify-X's default, as its results have none"),
        notes=notes,
    )


def write_smplifyx(
    folder: Path,
    params: BodyParams,
    *,
    stems: Sequence[str],
    camera: Camera,
    body: BodyModel,
    frame_rate: float,
    embedding: Float[Tensor, "T 32"] | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Write `results/<stem>/000.pkl` for each frame, and about.json with what does not fit into pickles. Raises OSError
    if it cannot be written.

    Pickles contain only float32 arrays, which numpy 1 and 2 and SMPLify-X's own scripts read.

    Args:
        folder: Parent of `results`; made if it does not exist.
        params: T frames in camera space. Hands stay as they are: components, or 45 numbers over the mean.
        stems: Of the frames' images.
        camera: The one that sees them.
        body: Whose parameters these are.
        frame_rate: Frames per second.
        embedding: The poses in the pose prior's numbers; None: it has none.
        progress: Takes the share that is done; an exception from it ends the writing.
    """
    assert len(stems) == len(set(stems)) == len(params)
    (folder / RESULTS).mkdir(parents=True, exist_ok=True)
    intrinsics = (camera.focal, camera.center, camera.size)
    for t, stem in enumerate(stems):
        arrays = {f.name: getattr(params, f.name)[t : t + 1].detach().cpu().numpy() for f in fields(BodyParams)}
        arrays |= {"camera_rotation": np.eye(3)[None], "pose_embedding": np.zeros((1, 0))}
        arrays |= {name: np.array(value)[None] for name, value in zip(CAMERA, intrinsics, strict=True)}
        if embedding is None:
            del arrays["pose_embedding"]
        else:
            arrays["pose_embedding"] = embedding[t : t + 1].detach().cpu().numpy()
        target = folder / RESULTS / stem / "000.pkl"
        target.parent.mkdir(exist_ok=True)
        with replacing(target) as draft:
            draft.write_bytes(pickled(arrays))
        progress((t + 1) / len(stems))
    about = ResultAbout(
        generator="tcfit",
        axes=f"camera: {AXES['camera'].text}; metres; axis-angle in radians; camera_translation is added to the body",
        gender=body.gender,  # pyright: ignore[reportArgumentType]
        body_kind=body.kind,  # pyright: ignore[reportArgumentType]
        body_hash=body.hash,
        frame_rate=frame_rate,
        focal_px=camera.focal,
        center_px=camera.center,
        image_size_px=camera.size,
        note="body_pose is axis-angle (1, 63); pose_embedding has the pose prior's numbers, where it has some",
    )
    with replacing(folder / RESULTS / ABOUT) as draft:
        draft.write_bytes(msgspec.json.format(msgspec.json.encode(about), indent=2) + b"\n")


def _about(path: Path, member: Member) -> ResultAbout:
    with member.open() as stream:
        content = stream.read(_MAX_ABOUT)
    try:
        return msgspec.json.decode(content, type=ResultAbout)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(
            f"{path}: its {ABOUT} was not written by tcfit ({error}). Remove it, or write the results again."
        ) from error


def _nothing(path: Path, pickles: list[Member], members: list[Member], person: int) -> str:
    if pickles:
        people = sorted({member.path.name for member in pickles})
        return (
            f"{path}: has no person {person} ({person:03d}.pkl), only {some_of(people, most=5)}. Choose one of these."
        )
    found = some_of((member.path.name for member in members), most=5)
    return (
        f"{path}: holds no results of SMPLify-X (found {found}); expected results/<name of the image>/000.pkl. Give "
        "its output folder."
    )


def _forbid_mixed(path: Path, frames: list[ResultFrame]) -> None:
    seen: set[str] = set()
    for frame in frames:
        if frame.stem in seen:
            raise InputError(f"{path}: has two results of the frame {frame.stem}; expected those of one clip.")
        seen.add(frame.stem)
        for key in ("body_pose", "left_hand_pose", "right_hand_pose"):
            if frame.values[key].shape != frames[0].values[key].shape:
                found, first = len(frame.values[key]), len(frames[0].values[key])
                raise InputError(
                    f"{path}: '{key}' has {found} numbers in {frame.stem} and {first} in {frames[0].stem}; expected "
                    "the results of one run."
                )


def _numbers(stems: list[str]) -> tuple[tuple[int, ...], bool]:
    """Frame numbers, and whether they come from the names."""
    numbers = frame_numbers(stems)
    if numbers is None or len(set(numbers)) < len(stems):
        return tuple(range(len(stems))), False
    return numbers, True


def _params(path: Path, frames: list[ResultFrame], decode: Decode | None) -> BodyParams:
    arrays = {key: np.stack([frame.values[key] for frame in frames]) for key in WIDTHS}
    if arrays["body_pose"].shape[1] == LATENT:
        arrays["body_pose"] = _decoded(path, arrays["body_pose"], decode)
    arrays["betas"] = arrays["betas"][:, :N_BETAS]
    arrays["expression"] = arrays["expression"][:, :N_EXPRESSION]
    # Some forks move the body before the camera does.
    moves = np.stack([frame.rotation @ frame.values.get("transl", np.zeros(3)) for frame in frames])
    arrays["camera_translation"] = arrays["camera_translation"] + moves
    hands = {arrays[f"{side}_hand_pose"].shape[1] for side in ("left", "right")}
    if len(hands) > 1:
        raise InputError(
            f"{path}: the left hand has a different number of components than the right; expected the same."
        )
    return body_params(arrays, hands.pop())


def _decoded(path: Path, latent: np.ndarray, decode: Decode | None) -> np.ndarray:
    if decode is None:
        raise InputError(
            f"{path}: its body_pose has {LATENT} VPoser numbers instead of angles, and no VPoser was added. Get "
            "the VPoser that it was fitted with (SMPLify-X: version 1) from its official site, and run `tcfit models "
            "add` with the download."
        )
    with torch.no_grad():
        return decode(torch.as_tensor(latent)).cpu().numpy()


def _camera(path: Path, frames: list[ResultFrame]) -> Camera | None:
    if not all(key in frame.values for key in CAMERA for frame in frames):
        return None
    (fx, fy), (cx, cy), (width, height) = (frames[0].values[key].tolist() for key in CAMERA)
    if not (min(fx, fy) > 0 and min(width, height) >= 1):
        raise InputError(f"{path}: has a focal length of {fx:g} x {fy:g} for {width:g} x {height:g} pixels.")
    size = (int(width), int(height))
    return Camera(
        focal=(fx, fy), center=(cx, cy), size=size, focal_from=FocalFrom.PROGRAM, source="told by the results"
    )
