"""Formats in and out. READERS has one line per keypoint format."""

import zipfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from fitting_core.detections import Detections
from fitting_core.errors import InputError
from fitting_core.files.regular import StrPath, regular_file
from fitting_core.io.added_readers import read_added_keypoints, read_added_motion
from fitting_core.io.keypoints.coco_wholebody import folder_holds_coco, holds_coco
from fitting_core.io.keypoints.json_points import first_bytes, is_json
from fitting_core.io.keypoints.openpose import is_openpose_json
from fitting_core.io.keypoints.pose_binary import starts_as_pose

if TYPE_CHECKING:  # keypoints are read without torch
    from fitting_core.io.motion.imported_motion import ImportedMotion
    from fitting_core.io.motion.smplifyx import Decode


def _is_openpose(path: Path, start: bytes) -> bool:
    return path.is_dir() or path.name.endswith("_keypoints.json") or (is_json(start) and is_openpose_json(start))


def _holds_coco(path: Path, start: bytes) -> bool:
    return folder_holds_coco(path) if path.is_dir() else is_json(start) and holds_coco(start)


def _holds_pose(path: Path, start: bytes) -> bool:
    return path.suffix.lower() == ".pose" or starts_as_pose(start)


READERS: dict[Callable[[Path, bytes], bool], str] = {
    _holds_coco: "fitting_core.io.keypoints.coco_wholebody:read_coco_wholebody",
    _is_openpose: "fitting_core.io.keypoints.openpose:read_openpose",
    _holds_pose: "fitting_core.io.keypoints.pose_file:read_pose",
}
"""Recognises a format by the path and its first bytes (empty for a folder) -> the function Path -> Detections.

The first match reads the path, so narrow checks stand above broad ones; the function is imported when used.
"""


def read_detections(path: Path) -> Detections:
    """Read all people in all frames from a keypoint file or folder of any known format. Raises InputError if the path
    does not exist, its format is unknown, or its content is broken."""
    if not path.exists():
        raise InputError(f"No keypoints at {path}: there is no such file or folder.")
    start = b"" if path.is_dir() else first_bytes(path)
    if (detections := read_added_keypoints(path, start)) is not None:
        return detections
    for recognises, reader in READERS.items():
        if recognises(path, start):
            module, function = reader.split(":")
            return getattr(import_module(module), function)(path)
    found = "is empty" if not start else "starts as none of these"
    raise InputError(
        f"{path} is not a readable keypoint format: it {found}. Expected a folder of OpenPose JSON files or one "
        "of them, a COCO-WholeBody JSON, predictions of mmpose's inferencer, or a .pose file."
    )


def read_motion(
    path: StrPath, *, person: int | None = None, gender: str | None = None, decode: "Decode | None" = None
) -> "ImportedMotion":
    """Read the motion of a body: SMPLify-X results, an npz of SMPL-X, AMASS or tcfit, or a result of a learned system.
    Raises InputError if the path does not exist, its format is unknown, or its content is broken.

    The content tells which.

    Args:
        path: An npz, or the folder of a fit by tcfit; or a folder of SMPLify-X results, a zip or tar of one, one of its
            pickles; or a result of a system of `learned.systems`.
        person: Number of one of several people; None: the person in most frames, or 0 in SMPLify-X results.
        gender: Of the body, which SMPLify-X does not record; None: as the files say.
        decode: For SMPLify-X results: from VPoser's numbers to axis-angle; None: VPoser is not available.
    """
    path = Path(path)
    from fitting_core.io.motion.learned.systems import SYSTEMS, read_learned
    from fitting_core.io.motion.smplifyx import read_smplifyx
    from fitting_core.io.motion.smplx_npz import read_smplx_npz
    from fitting_core.io.result_files import FIT_NAME

    if not path.exists():
        raise InputError(f"{path}: there is no such file or folder; expected the result of a fit.")
    if (path / FIT_NAME).is_file():
        path = path / FIT_NAME
    if (motion := read_added_motion(path)) is not None:
        return motion
    if (learned := read_learned(path, person=person, gender=gender)) is not None:
        return learned
    if path.is_file() and _holds_arrays(path):
        return read_smplx_npz(path)
    if path.is_file() and not _may_hold_results(path):
        raise InputError(
            f"{path}: is not a readable result of a fit. Expected SMPLify-X's output folder, a zip of it, an "
            f"npz of SMPL-X or AMASS, or a result of {', '.join(system.title for system in SYSTEMS)}."
        )
    return read_smplifyx(path, person=person or 0, gender=gender, decode=decode)


def _may_hold_results(path: Path) -> bool:
    """Whether a file is, or claims to be, a pickle of protocol 2 or later, or an archive."""
    packed = path.suffix.lower() in (".pkl", ".zip", ".tar", ".tgz", ".gz", ".xz", ".bz2")
    return packed or first_bytes(path)[:1] == b"\x80"


def _holds_arrays(path: Path) -> bool:
    """Whether a file is, or claims to be, an npz."""
    if path.suffix.lower() == ".npz":
        return True
    try:
        with zipfile.ZipFile(regular_file(path)) as archive:
            return any(name.endswith(".npy") for name in archive.namelist())
    except (OSError, ValueError, zipfile.BadZipFile):
        return False
