"""Whether the project that lies where a command line would make one is that very project."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.keypoints import Keypoints
from tcfit_app.options.clip_input import refusal
from tcfit_app.project.packed import packed_creation_time
from tcfit_app.project.storage.clip import clip_store, creation_time, read_clip
from tcfit_app.project.storage.media import fingerprint


def check_same_clip(folder: Path, clip: Clip, given: Sequence[str]) -> None:
    """Refuse a project that is not of the clip that a command line names.

    Args:
        folder: The project's.
        clip: What would be made a project of.
        given: The options that say which part of the clip, and the camera.

    Raises:
        InputError: The project is of another video, or has other keypoints; or the options would have made another one.
    """
    with clip_store(folder) as store:
        made, link = read_clip(folder, store)
    choice = f"Give --out for a new project, or open that one as it is: tcfit review {folder}"
    if clip.source and (link is None or link.fingerprint != fingerprint(clip.source)):
        raise InputError(f"{folder}: is a project of another clip than {clip.source}. {choice}")
    if given and _frames_and_camera(made) != _frames_and_camera(clip):
        raise InputError(f"{folder}: was made before, of other frames or with another camera. {refusal(given)}")
    if not _detected(clip.keypoints) or _same(made.keypoints, clip.keypoints):
        return
    if not _detected(made.keypoints):
        raise InputError(
            f"{folder}: was made of the video alone. Open it (tcfit review {folder}) and import the keypoints in its "
            "panel Start, or give --out for a new project."
        )
    raise InputError(f"{folder}: was made with other keypoints, of another person or other frames. {choice}")


def check_same_packed(folder: Path, path: Path) -> None:
    """Refuse a project that was not unpacked from this file, or from another one of the same project.

    Raises:
        InputError: It is another project, or one of both cannot be read.
    """
    if creation_time(folder) != packed_creation_time(path):
        raise InputError(f"{folder}: is another project than the one in {path}. Give --out for a new one.")


def _frames_and_camera(clip: Clip) -> tuple[object, ...]:
    """Without the words that say where the focal length comes from."""
    camera = clip.camera
    return clip.first_frame, len(clip), clip.frame_rate, camera.focal, camera.center, camera.size


def _detected(keypoints: Keypoints) -> bool:
    return bool(keypoints.confidence.any())


def _same(one: Keypoints, other: Keypoints) -> bool:
    return np.array_equal(one.xy, other.xy) and np.array_equal(one.confidence, other.confidence)
