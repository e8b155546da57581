"""Pictures of the clips in sight, made when they are first asked for: of the person in the middle of the clip.

Those of projects are kept in them, where a fit has drawn its body into it; those of others in the user's cache.
"""

import hashlib
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import platformdirs
from jaxtyping import Float, UInt8

from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz
from fitting_core.files.regular import regular_file
from fitting_core.video.frames import FrameSource
from tcfit_app.home.catalogue import Catalogue, Entry
from tcfit_app.home.found import RESULT
from tcfit_app.project.picture import NAME, SIZE, as_jpeg, crop_around, keep

_MOST_BYTES = 1 << 20
"""Of a picture from another author of the project."""
_DETECTIONS = "detections.npz"
_CONFIDENT = 0.3
_MARGIN = 1.25
"""Height of the picture, in those of the person."""
_LEAST = 40
"""Pixels of the image that the picture shows at least in height."""


def picture_of(entry: Entry, catalogue: Catalogue) -> bytes:
    """A JPEG, or empty. Takes some 0.1 s if it is made. Thread-safe."""
    kind, path = entry.found.kind, entry.found.path
    kept = path / NAME if kind == "project" else _in_cache(path)
    with suppress(OSError, InputError, ValueError):
        if not entry.found.is_footage or catalogue.has_length(entry.found.key):
            return regular_file(kept, most=_MOST_BYTES).read_bytes()
    try:
        made = _of_footage(entry, catalogue) if entry.found.is_footage else _of_person(entry)
    except (InputError, OSError, ValueError, KeyError, cv2.error):
        return b""  # a clip without a picture is a clip all the same
    with suppress(OSError):  # where nothing can be written it is made again
        keep(kept, made)
    return made


def _in_cache(path: Path) -> Path:
    status = path.stat()
    about = f"{path} {status.st_size} {status.st_mtime_ns}"
    name = hashlib.sha256(about.encode(errors="surrogateescape")).hexdigest()[:32]
    return platformdirs.user_cache_path("tcfit", appauthor=False, ensure_exists=True) / "pictures" / f"{name}.jpg"


def _of_footage(entry: Entry, catalogue: Catalogue) -> bytes:
    with FrameSource(entry.found.footage) as source:
        catalogue.knows_length(entry.found.key, source.count, source.count / (source.frame_rate or 30.0))
        return as_jpeg(_cut(source.frame(source.count // 2), None))


def _keypoints(entry: Entry) -> tuple[Float[np.ndarray, "T 137 2"], Float[np.ndarray, "T 137"]]:
    """Pixels, and confidence."""
    if entry.found.kind == "result":
        found = np.asarray(read_npz(entry.found.path / RESULT, ("keypoints",))["keypoints"], float)
        return found[..., :2], found[..., 2]
    arrays = read_npz(entry.found.path / _DETECTIONS, ("xy", "confidence"))
    return np.asarray(arrays["xy"], float), np.asarray(arrays["confidence"], float)


def _of_person(entry: Entry) -> bytes:
    xy, confidence = _keypoints(entry)
    frames = len(xy)
    seen = (confidence > _CONFIDENT).sum(1)
    good = np.flatnonzero(seen >= 0.9 * seen.max()) if seen.any() else np.array([frames // 2])
    frame = int(good[np.argmin(abs(good - frames // 2))])
    points = xy[frame][confidence[frame] > _CONFIDENT]
    media = next((path for path in entry.media if path.exists()), None)
    if media is None:
        return _drawn(xy[frame], confidence[frame])
    with FrameSource(media) as source:
        return as_jpeg(_cut(source.frame(entry.first_frame + frame), points if len(points) else None))


def _cut(image: UInt8[np.ndarray, "H W 3"], points: Float[np.ndarray, "n 2"] | None) -> UInt8[np.ndarray, "h w 3"]:
    """The part around some points, or the middle, in the picture's proportions."""
    height, width = image.shape[:2]
    around = np.array([(width / 2, 0.0), (width / 2, height)]) if points is None else points
    margin = 1.0 if points is None else _MARGIN
    left, top, right, bottom = crop_around(
        around, (width, height), shape=SIZE[0] / SIZE[1], margin=margin, least=_LEAST
    )
    return image[top:bottom, left:right]


def _drawn(xy: Float[np.ndarray, "137 2"], confidence: Float[np.ndarray, "137"]) -> bytes:
    """The keypoints alone, of a clip whose images are not there."""
    from fitting_core.render.overlay import draw_keypoints

    seen = confidence > _CONFIDENT
    if not seen.any():
        raise ValueError("nothing to draw")
    low, high = xy[seen].min(0), xy[seen].max(0)
    size = np.array([2 * SIZE[0], 2 * SIZE[1]])
    scale = (size / np.maximum((high - low) * _MARGIN, 1)).min()
    image = np.full((size[1], size[0], 3), 40, np.uint8)
    draw_keypoints(image, (xy - (low + high) / 2) * scale + size / 2, confidence)
    return as_jpeg(image)
