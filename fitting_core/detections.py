"""What a keypoint reader returns: every person that a detector saw, frame by frame, before one of them is chosen."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError
from fitting_core.video.frame_names import frame_numbers, split_number

PIXELS, UNIT, SIGNED, SHARES = "pixels", "0..1", "-1..1", "shares"
SCALES: dict[str, tuple[float, float]] = {UNIT: (0.0, 1.0), SIGNED: (-1.0, 1.0)}
"""OpenPose's normalised coordinates: the values of the first and of the last pixel's centre, along x and y."""

# Keypoints can be outside the image by some of its size, and no clip shows a person of 2 pixels.
_NORMALISED_LIMIT = 2.0
_SIGNED_LIMIT = -0.25
_SAME_SHAPE = 0.03
"""By how much the shares of a resized image's width and height may differ: whole pixels are rounded."""


@dataclass(frozen=True, kw_only=True)
class Detections:
    """All people in all frames of a clip, in the order of fitting_core.keypoints.NAMES.

    A keypoint that was not detected is (0, 0, 0). What follows in the pipeline never sees NaN.
    """

    frames: tuple[Float[np.ndarray, "P 137 3"], ...]
    """Per frame, its people (possibly none): x, y and confidence (0 to 1)."""
    stems: tuple[str, ...]
    """Per frame, the name that its file gives it, such as ``walk_000000000012``."""
    source: Path
    """The file or folder that was read."""
    scale: str = PIXELS
    """PIXELS, UNIT, SIGNED, SHARES of the image's width and height, or "auto" where the file does not say it."""
    size: tuple[int, int] | None = None
    """Image width and height in pixels; None if the file lacks them."""
    frame_rate: float | None = None
    """Frames per second; None if the file lacks them."""
    detector: str = ""
    """The detector, as named in `keypoint_noise.DETECTOR_TITLES`; empty if unknown."""
    notes: tuple[str, ...] = ()
    """Notes for the user on how it was read."""

    def __post_init__(self) -> None:
        assert len(self.frames) == len(self.stems) and all(f.shape[1:] == (137, 3) for f in self.frames)

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, frames: slice) -> "Detections":
        return replace(self, frames=self.frames[frames], stems=self.stems[frames])

    @property
    def most_people(self) -> int:
        """The largest number of people in one frame."""
        return max((len(people) for people in self.frames), default=0)

    @property
    def prefixes(self) -> tuple[str, ...]:
        """The different names before the frame numbers; more than one where files of several clips are mixed."""
        return tuple(sorted({split_number(stem)[0] for stem in self.stems}))

    @property
    def numbers(self) -> tuple[int, ...] | None:
        """The frame numbers in the files' names; None unless every name has one and these alone differ."""
        return frame_numbers(self.stems)

    def detected_points(self) -> Float[np.ndarray, "N 2"]:
        """Positions of everything that was detected, of all people in all frames."""
        rows = np.concatenate([people.reshape(-1, 3) for people in self.frames] or [np.zeros((0, 3))])
        return rows[rows[:, 2] > 0, :2]


def numbering(stems: Sequence[str]) -> tuple[str, ...]:
    """A note on frame numbers that are not at the end of the files' names."""
    numbers = frame_numbers(stems)
    if numbers is None or all(split_number(stem)[1] == number for stem, number in zip(stems, numbers, strict=True)):
        return ()
    return (f"The frames' numbers are those in which the names differ: {numbers[0]} of {stems[0]}.",)


def guess_scale(points: Float[np.ndarray, "N 2"]) -> str:
    """ "pixels", "0..1" or "-1..1", by the range of all positions of a clip."""
    if not len(points) or np.abs(points).max() > _NORMALISED_LIMIT:
        return PIXELS
    return SIGNED if points.min() < _SIGNED_LIMIT else UNIT


def to_pixels(
    detections: Detections, size: tuple[int, int] | None, *, keypoint_scale: str = "auto"
) -> tuple[Detections, tuple[str, ...]]:
    """Detections in pixels of the image, and notes on their scale and on an image that is of another size. Raises
    InputError for an unknown scale, or normalised coordinates of an image whose size is not known.

    Normalised coordinates are OpenPose's: 0..1 (its ``--keypoint_scale 3``) and -1..1 (``4``) run from the centre of
    the first pixel to that of the last, so a step of 1 or 2 is the image's width (or height) less one. Pixels of an
    image that has another size and the same shape are those of the image resized.

    Args:
        detections: What a reader returned.
        size: Image width and height; only normalised coordinates need it.
        keypoint_scale: "pixels", "0..1", "-1..1", or "auto" to tell by the range of the whole clip.
    """
    known = ("auto", PIXELS, *SCALES)
    if keypoint_scale not in known:
        raise InputError(f"`keypoint_scale` is {keypoint_scale!r}; expected one of {', '.join(known)}.")
    scale = detections.scale if keypoint_scale == "auto" else keypoint_scale
    how = "as the file says" if keypoint_scale == "auto" else "by the option `keypoint_scale`"
    if scale == "auto":
        scale, how = guess_scale(detections.detected_points()), "judged by their range"
    if scale == PIXELS:
        return _resized(replace(detections, scale=PIXELS), size)
    if size is None:
        raise InputError(
            f"The keypoints in {detections.source} are normalised to {scale} ({how}), so the image size is needed to "
            "turn them into pixels. Give the video, or `image_size`."
        )
    low, high = SCALES.get(scale, (0.0, 1.0))
    step = (np.array(size) - (scale in SCALES)) / (high - low)
    frames = tuple(_scaled(people, low, step) for people in detections.frames)
    note = f"The keypoints are normalised to {scale} ({how}); turned into pixels of {size[0]} x {size[1]}."
    return replace(detections, frames=frames, scale=PIXELS), (note,)


def _resized(detections: Detections, size: tuple[int, int] | None) -> tuple[Detections, tuple[str, ...]]:
    """Pixels of the image that the file tells of in those of the one that is known, and a note if it is another."""
    if detections.size is None or size is None or detections.size == size:
        return detections, ()
    shares = np.array(size) / detections.size
    stated, known = (f"{width} x {height}" for width, height in (detections.size, size))
    says = f"{detections.source.name} says that the image is {stated} pixels, and it is {known}"
    if abs(shares[0] / shares[1] - 1) > _SAME_SHAPE:
        return detections, (f"{says}, which is of another shape: the keypoints are taken as they are.",)
    # Coordinates count from the first pixel's centre.
    frames = tuple(_scaled(people, (1 / shares - 1) / 2, shares) for people in detections.frames)
    return replace(detections, frames=frames), (f"{says}: the keypoints were scaled to that.",)


def _scaled(
    people: Float[np.ndarray, "P 137 3"], low: float | Float[np.ndarray, "2"], step: Float[np.ndarray, "2"]
) -> np.ndarray:
    xy = np.where(people[..., 2:] > 0, (people[..., :2] - low) * step, 0.0)
    return np.concatenate([xy, people[..., 2:]], axis=-1)
