"""Readers that plugins add, of keypoints and of moving bodies. They are tried before tcfit's own."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from fitting_core.detections import Detections
from fitting_core.errors import InputError
from fitting_core.plugins import Plugin, added, failures

if TYPE_CHECKING:  # keypoints are read without torch
    from fitting_core.io.motion.imported_motion import ImportedMotion

_Read = TypeVar("_Read")


@dataclass(frozen=True, kw_only=True)
class KeypointReader:
    """A format of keypoints."""

    title: str
    """For the user."""
    recognises: Callable[[Path, bytes], bool]
    """Takes the path and the first 64 kB of a file (empty for a folder). True for nothing but this format."""
    read: Callable[[Path], Detections]
    """Raises InputError, with a message for the user, if it cannot read the path."""


@dataclass(frozen=True, kw_only=True)
class MotionReader:
    """A format of moving bodies: results of other systems."""

    title: str
    """For the user."""
    recognises: Callable[[Path], bool]
    """Takes a file or folder that exists. True for nothing but this format."""
    read: "Callable[[Path], ImportedMotion]"
    """Raises InputError, with a message for the user, if it cannot read the path."""


def keypoint_readers() -> dict[str, Plugin[KeypointReader]]:
    """By name."""
    return added("tcfit.readers", KeypointReader, MotionReader)


def motion_readers() -> dict[str, Plugin[MotionReader]]:
    """By name."""
    return added("tcfit.readers", MotionReader, KeypointReader)


def read_added_keypoints(path: Path, start: bytes) -> Detections | None:
    """What the first plugin that recognises a path reads from it; None if none does. Raises InputError if it cannot be
    read, or the plugin fails."""
    for plugin in keypoint_readers().values():
        if _recognised(plugin, lambda reader: reader.recognises(path, start)):
            return _read(plugin, path, plugin.thing.read, Detections)
    return None


def read_added_motion(path: Path) -> "ImportedMotion | None":
    """As `read_added_keypoints`."""
    from fitting_core.io.motion.imported_motion import ImportedMotion

    for plugin in motion_readers().values():
        if _recognised(plugin, lambda reader: reader.recognises(path)):
            return _read(plugin, path, plugin.thing.read, ImportedMotion)
    return None


_Reader = TypeVar("_Reader", KeypointReader, MotionReader)


def _recognised(plugin: Plugin[_Reader], recognises: Callable[[_Reader], bool]) -> bool:
    try:
        return bool(recognises(plugin.thing))
    except failures() as error:
        plugin.reports(error)
        return False


def _read(plugin: Plugin, path: Path, read: Callable[[Path], _Read], kind: type[_Read]) -> _Read:
    try:
        found = read(path)
    except (InputError, OSError):
        raise
    except failures() as error:
        raise InputError(f"{path}: cannot be read as {plugin.thing.title}. {plugin.reports(error)}") from error
    if not isinstance(found, kind):
        said = plugin.reports(f"it returned {type(found).__name__}; expected {kind.__name__}")
        raise InputError(f"{path}: cannot be read as {plugin.thing.title}. {said}")
    return found
