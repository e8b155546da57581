"""A moving camera: the poses of a file, matched to the frames of a clip."""

from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation, Slerp

from fitting_core.frame_alignment import IN_ORDER, Timeline, counted
from fitting_core.video.frame_names import frame_numbers, image_numbers, spans

_LONGEST_GAP = 0.5
"""Longest gap in seconds that is interpolated: often only every tenth frame of a video is reconstructed."""
_LISTED = 3
_NOWHERE = -(2**31)
"""The place of an image that is not in the clip."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Poses:
    """Where a camera is in N images, in the file's units: x_camera = rotation x_world + translation."""

    rotation: Float[np.ndarray, "N 3 3"]
    translation: Float[np.ndarray, "N 3"]
    names: tuple[str, ...] = ()
    """Of the images, with or without folders and suffixes."""
    numbers: tuple[int, ...] | None = None
    """Of the frames, in the clip's count; with neither names nor numbers, those of all frames in order."""

    def __len__(self) -> int:
        return len(self.rotation)

    @property
    def move(self) -> bool:
        """Whether they differ by more than rounding."""
        far = 1e-6 * max(1.0, float(abs(self.translation).max()))
        turned, moved = np.ptp(self.rotation, axis=0).max(), np.ptp(self.translation, axis=0).max()
        return bool(turned > 1e-6 or moved > far)


@dataclass(frozen=True, kw_only=True)
class ClipFrames:
    """The frames that are used."""

    timeline: Timeline
    part: slice
    """Places in it."""
    frame_rate: float

    @property
    def numbers(self) -> range:
        """In the clip's count."""
        return self.timeline.numbers[self.part]


def in_frames(poses: Poses, frames: ClipFrames) -> tuple[Poses, tuple[str, ...]]:
    """The poses of all used frames, and notes on them; interpolated where a few frames lack theirs. Raises ValueError
    if they are not of these frames, or too many frames have no pose."""
    places, how = _places(poses, frames)
    found = np.array(places)
    order = np.argsort(found)[(found == _NOWHERE).sum() :]
    at, count = found[order] - frames.part.start, len(frames.numbers)
    if len(np.unique(at)) < len(at):
        raise ValueError(f"has several poses for one frame of the clip ({how})")
    inside = (at >= 0) & (at < count)
    if not inside.any():
        raise ValueError(
            f"has {len(poses)} poses, but none of frames {frames.numbers[0]} to {frames.numbers[-1]} ({how}); expected "
            "the path of this clip's camera"
        )
    missing = sorted(set(range(count)) - set(at.tolist()))
    beyond = [frame for frame in missing if not at[0] <= frame <= at[-1]]
    gap = int(np.diff(at).max(initial=0))
    most = max(1, round(_LONGEST_GAP * frames.frame_rate))
    if beyond or (missing and gap > most):
        some = beyond or missing
        numbers = spans([frames.numbers[frame] for frame in some], _LISTED)
        first, last = frames.numbers[0] + at[inside][0], frames.numbers[0] + at[inside][-1]
        raise ValueError(
            f"has no pose for frame{'s' * (len(some) > 1)} {numbers} of the clip (poses and frames were matched "
            f"{how}); expected one for each, or gaps of at most {most} frames. Choose frames by "
            f"`first_frame` and `last_frame`: {first} and {last} are the first and the last with a pose"
        )
    known = Poses(rotation=poses.rotation[order], translation=poses.translation[order])
    plain = not missing and len(poses) == count
    note = f"has poses for {inside.sum()} of {count} frames, matched {how}"
    between = f"; those of {len(missing)} frames are interpolated" if missing else ""
    return _between(known, at, count), () if plain else (f"{note}{between}.",)


def _places(poses: Poses, frames: ClipFrames) -> tuple[list[int], str]:
    """The place of each pose in the timeline, _NOWHERE for other images; and how that was found, in words."""
    timeline = frames.timeline
    if poses.numbers is not None:
        return [number - timeline.numbers[0] for number in poses.numbers], "by their numbers"
    if not poses.names:
        return _in_order(poses, frames)
    stems = [_stem(name) for name in poses.names]
    named = {stem: place for place, stem in enumerate(timeline.stems or ())}
    if set(stems) & set(named):
        return [named.get(stem, _NOWHERE) for stem in stems], "by the images' names"
    numbers = frame_numbers(stems)
    if numbers is None:
        listed = ", ".join(poses.names[:_LISTED])
        raise ValueError(
            f"has {len(poses)} cameras ({listed}), whose names do not say which frames of the clip they are; expected "
            "the names of its images, or names that differ in one number, the frame's. Say by `camera_name` which "
            "one it is, if it stands still"
        )
    of_image = image_numbers(timeline.stems or ())
    if set(numbers) & set(of_image):
        return [of_image.get(number, _NOWHERE) for number in numbers], "by the numbers in the images' names"
    places, how = counted(numbers, timeline.numbers)
    beyond = max(places.values()) >= len(timeline.numbers)
    if how == IN_ORDER or (beyond and min(numbers) not in (timeline.numbers[0], 1)):
        raise ValueError(
            f"has poses of images that are numbered from {min(numbers)} to {max(numbers)}, and the clip has frames "
            f"{timeline.numbers[0]} to {timeline.numbers[-1]}; expected numbers of its frames"
        )
    return [places[k] for k in range(len(numbers))], how


def _in_order(poses: Poses, frames: ClipFrames) -> tuple[list[int], str]:
    """Poses without names and numbers are those of all frames of the video, or of all used frames."""
    whole, part = len(frames.timeline.numbers), len(frames.numbers)
    if len(poses) not in (whole, part):
        looked_at = "" if whole == part else f", of which {part} are used"
        raise ValueError(
            f"has {len(poses)} poses, does not say of which frames, and the clip has {whole} frames{looked_at}; "
            "expected as many poses, or the frames' numbers beside them"
        )
    first = 0 if len(poses) == whole else frames.part.start
    return list(range(first, first + len(poses))), "in their order"


def _stem(name: str) -> str:
    """Without folders and suffix; a number after the last dot is not a suffix."""
    path = PurePosixPath(name.replace("\\", "/"))
    return path.name if path.suffix[1:].isdigit() else path.stem


def _between(known: Poses, at: Int[np.ndarray, "N"], count: int) -> Poses:
    """One per frame, with rotation (slerp) and position interpolated evenly."""
    frames = np.arange(count)
    places = -np.einsum("nji,nj->ni", known.rotation, known.translation)
    if len(at) == 1:
        return known
    rotation = Slerp(at, Rotation.from_matrix(known.rotation))(frames).as_matrix()
    place = np.stack([np.interp(frames, at, axis) for axis in places.T], 1)
    exact = np.isin(at, frames)
    rotation[at[exact]] = known.rotation[exact]
    return Poses(rotation=rotation, translation=-np.einsum("nij,nj->ni", rotation, place))
