"""Size, rate and number of a clip's frames: from the video, from options, or guessed."""

import os
import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitting_core.detections import Detections
from fitting_core.errors import InputError
from fitting_core.frame_alignment import Timeline
from fitting_core.video.frames import FrameSource

DEFAULT_FRAME_RATE = 30.0
_MAX_FRAME_RATE = 2000.0
_FRAME_MEMORY = 35_000
"""Bytes that a frame takes while it is fitted, at the least: 43,000 were measured with the keypoints of the body alone,
a copy of these among them."""
_SQUARE = 0.01
"""Allowed difference of a pixel's width and height, for rounded numbers in files."""

_LANDSCAPE = ((320, 240), (640, 480), (854, 480), (1280, 720), (1920, 1080), (2560, 1440), (3840, 2160), (7680, 4320))
_COMMON_SIZES = sorted([*_LANDSCAPE, *((h, w) for w, h in _LANDSCAPE)], key=lambda size: size[0] * size[1])


@dataclass(frozen=True, kw_only=True)
class Footage:
    """A video or a folder of images; without one, nothing about it is known."""

    path: Path | None = None
    size: tuple[int, int] | None = None
    frame_rate: float | None = None
    timeline: Timeline | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, path: Path | None) -> "Footage":
        """Look at a video or a folder of images, if there is one. Raises InputError if it cannot be read."""
        if path is None:
            return cls()
        with FrameSource(path) as frames:
            notes = frames.notes()
            if frames.count < frames.declared_count:
                notes.append(
                    f"{path.name} is truncated: its header states {frames.declared_count} frames, but only "
                    f"{frames.count} can be decoded; these are used."
                )
            if frames.uneven:
                notes.append(uneven_note(frames))
            if abs(frames.pixel_aspect - 1) > _SQUARE:
                notes.append(_pixel_note(path, frames.pixel_aspect))
            timeline = Timeline(numbers=range(frames.count), stems=frames.stems, source=path)
            return cls(path=path, size=frames.size, frame_rate=frames.frame_rate, timeline=timeline, notes=tuple(notes))

    def known_size(self, option: tuple[int, int] | None) -> tuple[int, int] | None:
        """Width and height in pixels, its own or the user's. Raises InputError if these contradict each other."""
        if option is None:
            return self.size
        if not all(1 <= side <= 100_000 and side == int(side) for side in option):
            raise InputError(f"`image_size` is {option[0]} x {option[1]}; expected width and height in whole pixels.")
        if self.size and self.size != tuple(option):
            raise InputError(
                f"`image_size` is {option[0]} x {option[1]}, but {self.path} is {self.size[0]} x {self.size[1]} "
                "pixels. Leave the option out."
            )
        return (int(option[0]), int(option[1]))

    def known_rate(self, option: float | None, told: float | None) -> tuple[float, tuple[str, ...]]:
        """Frames per second, and notes: the user's, its own, the keypoints', or the usual one.

        Raises InputError if the user's is implausible.
        """
        if option is not None and not 0 < option <= _MAX_FRAME_RATE:
            raise InputError(
                f"`frame_rate` is {option:g}; expected frames per second, above 0 and up to {_MAX_FRAME_RATE:g}."
            )
        known = self.frame_rate or told
        if option is None and known is None:
            note = (
                f"The frame rate is not known; {DEFAULT_FRAME_RATE:g} frames per second are assumed. Give `frame_rate`."
            )
            return DEFAULT_FRAME_RATE, (note,)
        if option is None:
            return known or DEFAULT_FRAME_RATE, ()
        if known and abs(option - known) > 0.01:
            says = "the video" if self.frame_rate else "the keypoint file"
            return option, (f"The frame rate is {option:g} as given; {says} says {known:g}.",)
        return option, ()


def uneven_note(frames: FrameSource) -> str:
    """The note on a video whose frames are unevenly spaced in time."""
    says = f" (its header states {frames.declared_frame_rate:.4g})" if frames.declared_frame_rate else ""
    return (
        f"The frames of {frames.path.name} are not evenly spaced in time, but are taken as if they were: "
        f"{frames.frame_rate:.4g} per second on average{says}. Re-encode it at a constant frame rate if motion looks "
        "jerky, and detect the keypoints on the result."
    )


def check_memory(path: Path, frames: int) -> None:
    """Raise InputError if a clip has more frames than this computer can fit at once."""
    if not hasattr(os, "sysconf"):  # Windows
        return
    needed, there = frames * _FRAME_MEMORY, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > there:
        raise InputError(
            f"{path} has {frames:,} frames to fit, which takes {needed / 1e9:.0f} GB of memory; this computer has "
            f"{there / 1e9:.0f}. Fit it in parts (tcfit batch --part-minutes 10), or choose fewer frames "
            "(`first_frame`, `last_frame`)."
        )


def locate(video: Path | None, keypoints: Path | None) -> tuple[Path | None, Path | None]:
    """The paths of the frames and of the keypoints, given the user's. Without keypoints there is a video to find them
    in. Raises InputError if nothing was given, or a folder in SMPLify-X layout lacks its images."""
    inside = video if video is not None and (video / "images").is_dir() else None
    images = inside / "images" if inside else video
    if keypoints is not None:
        return images, keypoints
    if video is None:
        raise InputError("Neither a video nor keypoints were given; expected at least one of them.")
    found = video / "keypoints"
    if found.is_dir() and not inside:
        raise InputError(
            f"{video} has keypoints/, but as a folder in SMPLify-X layout it lacks images/. Give the keypoints alone "
            f"({found}), or put the images there."
        )
    return images, found if found.is_dir() else None


def _pixel_note(path: Path, aspect: float) -> str:
    come_out = "thin" if aspect > 1 else "wide"
    made = f"{shlex.quote(path.name)} -vf scale=iw*sar:ih,setsar=1 {shlex.quote(path.stem)}-square.mp4"
    return (
        f"The pixels of {path.name} are {aspect:.3g} times as wide as high, but are assumed square, so that a person "
        f"comes out too {come_out}. Convert it (ffmpeg -i {made}), and detect the keypoints on the result."
    )


def guessed_size(detections: Detections) -> tuple[tuple[int, int], tuple[str, ...]]:
    """The smallest common image size that holds all keypoints."""
    points = detections.detected_points()
    width, height = np.ceil(points.max(0)).astype(int) + 1 if len(points) else (1, 1)
    fitting = [size for size in _COMMON_SIZES if width <= size[0] and height <= size[1]]
    size = fitting[0] if fitting else (int(width), int(height))
    note = (
        f"The image size is not known; {size[0]} x {size[1]} is assumed, the smallest common size that holds all "
        f"keypoints (they reach {width} x {height}). Give `image_size` for a correct camera."
    )
    return size, (note,)
