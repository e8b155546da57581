"""All motion capture that something is trained on, and what is kept apart."""

from collections.abc import Sequence
from pathlib import Path

from build_assets.motion_capture.overlap import unlike
from build_assets.motion_capture.retarget import MotionClip, load

HELD_OUT = ("cmu05", "cmu13", "cmu14")
"""Subjects that training never sees."""


def captured_motion(folder: Path) -> list[MotionClip]:
    """All clips that a folder holds.

    Raises:
        InputError: A file is missing or broken.
    """
    clips = load(folder)
    if (folder / "cmu_expmap").is_dir():
        clips += unlike(load(folder, ("cmu_expmap",)), split(clips)[1])
    return clips


def split(clips: Sequence[MotionClip]) -> tuple[list[MotionClip], list[MotionClip]]:
    """Clips to train on, and those of the subjects held out."""
    held = [clip for clip in clips if clip.subject in HELD_OUT]
    return [clip for clip in clips if clip.subject not in HELD_OUT], held
