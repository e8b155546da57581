"""A fit for laboratories: joints and markers as TRC and C3D."""

from pathlib import Path

import numpy as np

from fitting_core.body.markers.marker_set import marker_places
from fitting_core.body.model import JOINTS
from fitting_core.errors import InputError
from fitting_core.io.points.contact_table import events_of
from fitting_core.io.points.named_points import NamedPoints
from fitting_core.io.points.trc import write_trc
from fitting_core.motion import OWN_WORLD, Motion, Progress
from tcfit_app.exports.source import ExportSource

_SCREENS = {"camera": ("+X", "-Y"), "y-up": ("+X", "+Y"), "z-up": ("+X", "+Z")}
"""The axes to the right and up, by AXES."""


def write_joints_trc(source: ExportSource, path: Path, progress: Progress) -> None:
    """The 55 joint centres."""
    motion = source.motion("y-up")
    write_trc(path, _points(motion, tuple(JOINTS), motion.joints()))


def write_markers_trc(source: ExportSource, path: Path, progress: Progress) -> None:
    """The markers on the skin."""
    motion = source.motion("y-up")
    write_trc(path, _points(motion, source.markers.names, marker_places(motion.body, motion.params, source.markers)))


def write_marker_c3d(source: ExportSource, path: Path, progress: Progress) -> None:
    """Markers, joint centres and events. Raises InputError if a marker of the user's own has the name of a joint."""
    from fitting_core.io.points.c3d_file import write_c3d  # here: with c3d, nothing of which other formats need

    motion = source.motion("z-up")
    markers = source.markers
    if same := sorted(set(markers.names) & set(JOINTS)):
        raise InputError(f"--markers: {same[0]} is the name of a joint, which the file has too. Rename it.")
    places = np.concatenate([marker_places(motion.body, motion.params, markers), motion.joints()], 1)
    points = _points(motion, (*markers.names, *JOINTS), places)
    write_c3d(path, points, events=events_of(motion), screen=_screen(motion), subject=motion.name)


def _screen(motion: Motion) -> tuple[str, str] | None:
    """The axes of its world to the right and up; None if up is unknown."""
    if motion.axes != OWN_WORLD:
        return _SCREENS[motion.axes]
    up = None if motion.camera.world is None else motion.camera.world.up
    if up is None:
        return None
    return "+Y" if up[-1] == "x" else "+X", ("-" if up[0] == "-" else "+") + up[-1].upper()


def _points(motion: Motion, names: tuple[str, ...], places: np.ndarray) -> NamedPoints:
    return NamedPoints(
        names=names,
        places=places,
        frame_rate=motion.frame_rate,
        first_frame=motion.first_frame,
        camera=motion.seen_from,
    )
