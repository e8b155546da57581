"""A fit as motion for other programs: characters, skeletons, frames, and points for laboratories."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitting_core.body.markers.joint_centres import CENTRES
from fitting_core.body.markers.marker_set import MarkerSet, marker_places
from fitting_core.body.model import JOINTS
from fitting_core.errors import InputError
from fitting_core.ground.level import best_grounding, level_of
from fitting_core.io.motion.bvh import write_bvh
from fitting_core.io.motion.mesh_sequence import FACTS_NAME, file_stem, write_obj_sequence
from fitting_core.io.motion.smplifyx import write_smplifyx
from fitting_core.io.motion_files import MOTION_FILES
from fitting_core.io.points.named_points import NamedPoints
from fitting_core.io.points.tables import events_of
from fitting_core.io.points.trc import write_trc
from fitting_core.io.result_files import fit_arrays
from fitting_core.motion import OWN_WORLD, Motion, Progress, stated_by_frame
from tcfit_app.exports.figures import as_json
from tcfit_app.exports.source import ExportSource


def write_character(source: ExportSource, path: Path, progress: Progress) -> None:
    """A skinned character."""
    from fitting_core.io.motion.glb import write_glb  # here: pygltflib would take 0.4 s of every start of the app

    write_glb(path, source.motion(MOTION_FILES[".glb"].axes), progress)


def write_all_people(sources: Sequence[ExportSource], path: Path, progress: Progress, *, name: str) -> str:
    """Write the characters of a clip's people, whose frames are numbered in one video, into one GLB, all on the floor
    that is seen best.

    Returns:
        Their number, and whose floor was used.

    Raises:
        InputError: A person has no fit.
        OSError: It cannot be written; no file is left.
    """
    from fitting_core.io.motion.glb import write_people_glb  # here: pygltflib would take 0.4 s of every start

    motions = [replace(replace(source, axes=None).motion("camera"), name=source.name) for source in sources]
    groundings = [source.grounding for source in sources]
    best = best_grounding(groundings)
    floor = None if best is None else groundings[best]
    standing = [replace(motion, level=level_of(floor, motion.camera.world)) for motion in motions]
    write_people_glb(path, standing, name=name, progress=progress)
    count = f"{len(motions)} people" if len(motions) > 1 else motions[0].name
    whose = "" if best is None else f", on the floor of {motions[best].name}, which is seen best"
    return count + whose


def write_skeleton(source: ExportSource, folder: Path, progress: Progress) -> None:
    """A skeleton, with a JSON file for what BVH cannot hold."""
    motion = source.motion(MOTION_FILES[".bvh"].axes)
    (folder / FACTS_NAME).write_bytes(as_json(stated_by_frame(motion)))
    write_bvh(folder / f"{file_stem(motion.name)}.bvh", motion, progress)


def write_meshes(source: ExportSource, folder: Path, progress: Progress) -> None:
    """An OBJ file for each frame."""
    write_obj_sequence(folder, source.motion("y-up"), progress)


def write_frames(source: ExportSource, folder: Path, progress: Progress) -> None:
    """A pickle for each frame."""
    motion = source.motion("camera").in_axes("camera")  # the pickles have no other
    numbered = [f"{file_stem(motion.name)}_{motion.first_frame + t:06d}" for t in range(len(motion))]
    write_smplifyx(
        folder,
        motion.params,
        stems=[image.stem for image in source.images] or numbered,
        camera=motion.camera,
        body=motion.body,
        frame_rate=motion.frame_rate,
        embedding=None if source.chosen is None else source.chosen.embedding,
        progress=progress,
    )


def write_result(source: ExportSource, path: Path, progress: Progress) -> None:
    """All phases, as `tcfit fit` writes them."""
    fit = source.fit
    complete = fit.shown.run.state == "finished"
    np.savez_compressed(path, allow_pickle=False, **fit_arrays(fit.fit, source.clip, fit.body, complete=complete))


# --- skeletons of animators' programs ---


def on_rig(rig: str) -> Callable[[ExportSource, Path, Progress], None]:
    """What writes the person on a rig, by its name in `known_rigs`."""

    def write(source: ExportSource, path: Path, progress: Progress) -> None:
        from fitting_core.animation import known_rigs
        from fitting_core.io.motion import rig_glb

        rig_glb.write_standard_glb(path, source.motion("y-up"), getattr(known_rigs, rig), progress)

    return write


def write_avatar(source: ExportSource, path: Path, progress: Progress) -> None:
    """The person as VRM."""
    from fitting_core.io.motion.vrm import write_vrm

    write_vrm(path, source.motion("y-up"), progress)


def write_avatar_motion(source: ExportSource, path: Path, progress: Progress) -> None:
    """The motion as VRM animation."""
    from fitting_core.io.motion.vrm import write_vrm_animation

    write_vrm_animation(path, source.motion("y-up"), progress)


# --- for laboratories ---

_SCREENS = {"camera": ("+X", "-Y"), "y-up": ("+X", "+Y"), "z-up": ("+X", "+Z")}
"""The axes to the right and up, by AXES."""
_JOINTS = {name: name for name in (*JOINTS, *CENTRES)}
"""SMPL-X's joints and the anatomical joint centres, as targets of markers."""


def write_joints_trc(source: ExportSource, path: Path, progress: Progress) -> None:
    """The 55 joints and the anatomical joint centres."""
    write_trc(path, _points(source.motion("y-up"), MarkerSet(_JOINTS)))


def write_markers_trc(source: ExportSource, path: Path, progress: Progress) -> None:
    """The markers on the skin."""
    write_trc(path, _points(source.motion("y-up"), source.markers))


def write_marker_c3d(source: ExportSource, path: Path, progress: Progress) -> None:
    """Markers, joints, joint centres and events. Raises InputError if a marker of the user's own has the name of a
    joint."""
    from fitting_core.io.points.c3d_file import write_c3d  # here: with c3d, nothing of which other formats need

    motion, markers = source.motion("z-up"), source.markers
    if same := sorted(set(markers.names) & set(_JOINTS)):
        raise InputError(f"--markers: {same[0]} is the name of a joint, which the file has too. Rename it.")
    points = _points(motion, replace(markers, targets={**markers.targets, **_JOINTS}))
    write_c3d(path, points, events=events_of(motion), screen=_screen(motion), subject=motion.name)


def _screen(motion: Motion) -> tuple[str, str] | None:
    """The axes of its world to the right and up; None if up is unknown."""
    if motion.axes != OWN_WORLD:
        return _SCREENS[motion.axes]
    up = None if motion.camera.world is None else motion.camera.world.up
    if up is None:
        return None
    return "+Y" if up[-1] == "x" else "+X", ("-" if up[0] == "-" else "+") + up[-1].upper()


def _points(motion: Motion, markers: MarkerSet) -> NamedPoints:
    return NamedPoints(
        names=markers.names,
        places=marker_places(motion.body, motion.params, markers),
        frame_rate=motion.frame_rate,
        first_frame=motion.first_frame,
        camera=motion.seen_from,
    )
