"""A fit as motion and as meshes for other programs."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitting_core.ground.level import best_grounding, level_of
from fitting_core.io.motion.animation_npz import write_animation_npz
from fitting_core.io.motion.bvh import write_bvh
from fitting_core.io.motion.mesh_sequence import FACTS_NAME, file_stem, write_obj_sequence, write_ply_sequence
from fitting_core.io.motion.smplifyx import write_smplifyx
from fitting_core.io.motion_files import MOTION_FILES
from fitting_core.io.result_files import fit_arrays
from fitting_core.motion import Progress, stated_by_frame
from tcfit_app.exports.figures import as_json
from tcfit_app.exports.source import ExportSource


def write_character(source: ExportSource, path: Path, progress: Progress) -> str | None:
    """A skinned character; says how many keys are left, where there are fewer."""
    from fitting_core.io.motion.glb import write_glb  # here: pygltflib would take 0.4 s of every start of the app

    keys = write_glb(path, source.motion(MOTION_FILES[".glb"].axes), progress, within=source.keys_within).keys
    return None if keys is None else keys.text


def write_everybody(sources: Sequence[ExportSource], path: Path, progress: Progress, *, name: str) -> str:
    """The characters of a clip's people in one GLB, all on the floor that is seen best.

    Args:
        sources: One for each person, one at least; their frames are numbered in one video.
        path: The file, which is replaced.
        progress: See `Progress`.
        name: The clip's.

    Returns:
        How many there are, whose floor it is, and how many keys are left, where there are fewer.

    Raises:
        InputError: Somebody has no fit.
        OSError: It cannot be written; nothing is left of it.
    """
    from fitting_core.io.motion.glb import write_people_glb  # here: pygltflib would take 0.4 s of every start

    groundings = [source.grounding for source in sources]
    best = best_grounding(groundings)
    motions = []
    for source in sources:
        motion = replace(source, axes=None).motion("camera")
        level = level_of(None if best is None else groundings[best], motion.camera.world)
        motions.append(replace(motion, name=source.name, level=level))
    written = write_people_glb(path, motions, name=name, progress=progress, within=sources[0].keys_within)
    count = f"{len(sources)} people" if len(sources) > 1 else sources[0].name
    floor = "" if best is None else f", on the floor of {sources[best].name}, which is seen best"
    keys = [f"{source.name}: {one.keys.text}" for source, one in zip(sources, written, strict=True) if one.keys]
    return "; ".join([count + floor, *keys])


def write_params(source: ExportSource, path: Path, progress: Progress) -> None:
    """SMPL-X's parameters."""
    write_animation_npz(path, source.motion(MOTION_FILES[".npz"].axes))


def write_skeleton(source: ExportSource, folder: Path, progress: Progress) -> str | None:
    """A skeleton, and beside it what BVH cannot hold."""
    motion = source.motion(MOTION_FILES[".bvh"].axes)
    (folder / FACTS_NAME).write_bytes(as_json(stated_by_frame(motion)))
    write_bvh(folder / f"{file_stem(motion.name)}.bvh", motion, progress)
    return None if source.keys_within is None else "BVH has no keys: every frame is there"


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


def write_obj(source: ExportSource, folder: Path, progress: Progress) -> None:
    """A mesh for each frame."""
    write_obj_sequence(folder, source.motion("y-up"), progress)


def write_ply(source: ExportSource, folder: Path, progress: Progress) -> None:
    """A mesh for each frame."""
    write_ply_sequence(folder, source.motion("z-up"), progress)
