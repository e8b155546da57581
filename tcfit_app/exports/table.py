"""What can be exported: one function for each format, and the table of them for command line and app."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from fitting_core.errors import InputError
from fitting_core.io.keypoints.coco_wholebody import write_coco_wholebody
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.io.keypoints.pose_file import write_pose
from fitting_core.io.motion.animation_npz import write_animation_npz
from fitting_core.io.motion.bvh import write_bvh
from fitting_core.io.motion.fitted_motion import Progress, stated_by_frame
from fitting_core.io.motion.mesh_sequence import FACTS_NAME, file_stem, write_obj_sequence, write_ply_sequence
from fitting_core.io.motion.smplifyx import write_smplifyx
from fitting_core.io.motion_files import MOTION_FILES
from fitting_core.io.result_files import fit_arrays
from fitting_core.lens import filmed_keypoints
from fitting_core.plugins import Plugin, added
from fitting_core.video.frames import image_files
from tcfit_app.exports.elan import write_elan
from tcfit_app.exports.figures import (
    as_json,
    clip_stated,
    write_figures_csv,
    write_figures_json,
    write_report,
    write_summary,
)
from tcfit_app.exports.overlay_video import write_side_by_side
from tcfit_app.exports.source import ExportSource
from tcfit_app.project.packed import pack

Group = Literal["Motion", "Meshes", "Video", "Keypoints", "Annotations", "Figures", "Project"]
Needs = Literal["motion", "run", "keypoints"]
"""Any fit; a project with a run; a project."""


@dataclass(frozen=True, kw_only=True)
class Export:
    """A format."""

    title: str
    group: Group
    suffix: str
    """Behind the clip's name. Of a folder it begins with a hyphen."""
    hint: str
    write: Callable[[ExportSource, Path, Progress], None]
    """Writes the file, or into the folder, which exists and is empty. What it raises leaves nothing that is offered."""
    needs: Needs = "motion"
    both: bool = False
    """It shows A and B, whichever is chosen."""

    @property
    def many(self) -> bool:
        """It is a folder of files, which a browser gets as a zip."""
        return self.suffix.startswith("-")


# --- motion ---


def _glb(source: ExportSource, path: Path, progress: Progress) -> None:
    from fitting_core.io.motion.glb import write_glb  # here: pygltflib would take 0.4 s of every start of the app

    write_glb(path, source.motion(MOTION_FILES[".glb"].axes), progress)


def _npz(source: ExportSource, path: Path, progress: Progress) -> None:
    write_animation_npz(path, source.motion(MOTION_FILES[".npz"].axes))


def _bvh(source: ExportSource, folder: Path, progress: Progress) -> None:
    motion = source.motion(MOTION_FILES[".bvh"].axes)
    (folder / FACTS_NAME).write_bytes(as_json(stated_by_frame(motion)))
    write_bvh(folder / f"{file_stem(motion.name)}.bvh", motion, progress)


def _smplifyx(source: ExportSource, folder: Path, progress: Progress) -> None:
    motion = source.motion("camera").in_axes("camera")  # the pickles have no other
    numbered = [f"{file_stem(motion.name)}_{motion.first_frame + t:06d}" for t in range(len(motion))]
    write_smplifyx(
        folder,
        motion.params,
        stems=[image.stem for image in _images(source)] or numbered,
        camera=motion.camera,
        body=motion.body,
        frame_rate=motion.frame_rate,
        embedding=None if source.chosen is None else source.chosen.embedding,
        progress=progress,
    )


def _fit(source: ExportSource, path: Path, progress: Progress) -> None:
    fit = source.fit
    complete = fit.shown.run.state == "finished"
    np.savez_compressed(path, allow_pickle=False, **fit_arrays(fit.fit, source.clip, fit.body, complete=complete))


# --- meshes ---


def _obj(source: ExportSource, folder: Path, progress: Progress) -> None:
    write_obj_sequence(folder, source.motion("y-up"), progress)


def _ply(source: ExportSource, folder: Path, progress: Progress) -> None:
    write_ply_sequence(folder, source.motion("z-up"), progress)


# --- video ---


def _overlay(source: ExportSource, path: Path, progress: Progress) -> None:
    _video(source, [source.fit], path, progress)


def _side_by_side(source: ExportSource, path: Path, progress: Progress) -> None:
    _video(source, list(source.compared) or [source.fit], path, progress)


def _video(source: ExportSource, fits: list, path: Path, progress: Progress) -> None:
    panels = [(fit.shown.title, fit.shown.params, fit.body, fit.shown.camera) for fit in fits]
    write_side_by_side(path, source.clip, panels, progress=lambda frames: progress(frames / len(source.clip)))


# --- keypoints ---


def _openpose(source: ExportSource, folder: Path, progress: Progress) -> None:
    clip = source.clip
    write_openpose(
        folder,
        filmed_keypoints(clip.keypoints, clip.camera.lens),
        name=file_stem(clip.name),
        first_frame=clip.first_frame,
        image_stems=[image.stem for image in _images(source)],
    )
    (folder / "clip.json").write_bytes(as_json(clip_stated(clip)))


def _coco(source: ExportSource, path: Path, progress: Progress) -> None:
    clip = source.clip
    write_coco_wholebody(
        path,
        filmed_keypoints(clip.keypoints, clip.camera.lens),
        name=clip.name,
        size=clip.camera.size,
        frame_rate=clip.frame_rate,
        first_frame=clip.first_frame,
        image_names=[image.name for image in _images(source)],
    )


def _pose(source: ExportSource, path: Path, progress: Progress) -> None:
    clip = source.clip
    keypoints = filmed_keypoints(clip.keypoints, clip.camera.lens)
    write_pose(path, keypoints, size=clip.camera.size, frame_rate=clip.frame_rate, first_frame=clip.first_frame)


def _images(source: ExportSource) -> tuple[Path, ...]:
    """A clip's images, whose names tell a reader more than a number: that may be in the name of another one."""
    clip = source.known_clip
    if clip is None:  # a result alone
        return ()
    images = image_files(clip.source)[clip.first_frame : clip.first_frame + len(clip)]
    return images if len({image.stem for image in images}) == len(clip) else ()


# --- the project ---


def _project(source: ExportSource, path: Path, progress: Progress) -> None:
    pack(source.folder, path, progress=progress)


def _project_with_video(source: ExportSource, path: Path, progress: Progress) -> None:
    pack(source.folder, path, with_media=True, progress=progress)


EXPORTS: dict[str, Export] = {
    "glb": Export(
        title="Character (GLB)",
        group="Motion",
        suffix=".glb",
        hint="Skinned mesh with 55 joints and a moving face for Blender, Unity, Unreal, three.js; y up, metres",
        write=_glb,
    ),
    "npz": Export(
        title="SMPL-X (npz)",
        group="Motion",
        suffix=".smplx.npz",
        hint="SMPL-X's keys as AMASS and the Blender add-ons have them; by default z up",
        write=_npz,
    ),
    "bvh": Export(
        title="Skeleton (BVH)",
        group="Motion",
        suffix="-bvh",
        hint="55 joints in metres and degrees; by default y up",
        write=_bvh,
    ),
    "smplifyx": Export(
        title="SMPLify-X (pkl)",
        group="Motion",
        suffix="-smplifyx",
        hint="A pickle for each frame, as SMPLify-X writes its results; in camera space",
        write=_smplifyx,
    ),
    "fit": Export(
        title="Result (fit.npz)",
        group="Motion",
        suffix=".fit.npz",
        hint="As tcfit fit writes it: every phase, joints and camera, in camera space",
        write=_fit,
        needs="run",
    ),
    "obj": Export(
        title="OBJ sequence",
        group="Meshes",
        suffix="-obj",
        hint="The fit's own vertices, correctives included; by default y up",
        write=_obj,
    ),
    "ply": Export(
        title="PLY sequence",
        group="Meshes",
        suffix="-ply",
        hint="As OBJ, binary: a third of the size; by default z up",
        write=_ply,
    ),
    "overlay": Export(
        title="Overlay",
        group="Video",
        suffix=".overlay.mp4",
        hint="The chosen fit and the keypoints over the video",
        write=_overlay,
        needs="run",
    ),
    "side-by-side": Export(
        title="Side by side",
        group="Video",
        suffix=".side-by-side.mp4",
        hint="A and B beside each other over the video, with the keypoints",
        write=_side_by_side,
        needs="run",
        both=True,
    ),
    "openpose": Export(
        title="OpenPose",
        group="Keypoints",
        suffix="-keypoints",
        hint="JSON, a file for each frame, with all corrections",
        write=_openpose,
        needs="keypoints",
    ),
    "coco": Export(
        title="COCO (133)",
        group="Keypoints",
        suffix=".coco-wholebody.json",
        hint="COCO-WholeBody: 133 points in one JSON file, with all corrections",
        write=_coco,
        needs="keypoints",
    ),
    "pose": Export(
        title=".pose",
        group="Keypoints",
        suffix=".pose",
        hint="The sign-language field's binary format with OpenPose's points, with all corrections",
        write=_pose,
        needs="keypoints",
    ),
    "elan": Export(
        title="ELAN (.eaf)",
        group="Annotations",
        suffix=".eaf",
        hint="Tiers over the video: notes, flags, review; phases and handshapes of each hand of the chosen fit",
        write=write_elan,
        needs="run",
    ),
    "figures": Export(
        title="CSV",
        group="Figures",
        suffix=".figures.csv",
        hint="All curves of the timeline by frame, of A and B, as a table",
        write=write_figures_csv,
        needs="run",
        both=True,
    ),
    "figures-json": Export(
        title="JSON",
        group="Figures",
        suffix=".figures.json",
        hint="All curves of the timeline by frame, of A and B",
        write=write_figures_json,
        needs="run",
        both=True,
    ),
    "report": Export(
        title="Report (HTML)",
        group="Figures",
        suffix=".report.html",
        hint="The chosen run's errors and curves, against the project's reference if it has one, with its worst frames",
        write=write_report,
        needs="run",
    ),
    "summary": Export(
        title="Summary",
        group="Figures",
        suffix=".summary.json",
        hint="Errors, jitter, settings and versions of the chosen run, as JSON",
        write=write_summary,
        needs="run",
    ),
    "project": Export(
        title="Project",
        group="Project",
        suffix=".tcfit.zip",
        hint="Corrections, runs and marks as one file, which tcfit review opens; without a video that is only linked",
        write=_project,
        needs="keypoints",
    ),
    "project-with-video": Export(
        title="Project + video",
        group="Project",
        suffix=".video.tcfit.zip",
        hint="As one file, with the video or images, so that it can be given to others",
        write=_project_with_video,
        needs="keypoints",
    ),
}
"""By the name on the command line, in the order of their buttons."""
DEFAULTS = ("glb", "npz", "bvh")
"""What `tcfit export` writes when nothing is wished for."""


# --- of plugins ---


def exports() -> dict[str, Export]:
    """EXPORTS, and behind them those that plugins add."""
    return EXPORTS | {
        name: replace(plugin.thing, write=_guarded(plugin))
        for name, plugin in added("tcfit.exports", Export, taken=EXPORTS).items()
        if _is_sound(plugin)
    }


def _is_sound(plugin: Plugin[Export]) -> bool:
    export = plugin.thing
    wrong = {
        f"its group is {export.group!r}; expected one of {', '.join(get_args(Group))}": export.group in get_args(Group),
        f"it needs {export.needs!r}; expected one of {', '.join(get_args(Needs))}": export.needs in get_args(Needs),
        f"its suffix is {export.suffix!r}; expected '.' or '-' and letters": _SUFFIX.fullmatch(str(export.suffix)),
    }
    for reason, right in wrong.items():
        if not right:
            plugin.reports(reason)
            return False
    return True


_SUFFIX = re.compile(r"[.-][A-Za-z0-9][A-Za-z0-9._-]*")


def _guarded(plugin: Plugin[Export]) -> Callable[[ExportSource, Path, Progress], None]:
    """Its writing, whose faults come as InputError; but what `progress` raises, by which users cancel, goes through."""

    def write(source: ExportSource, path: Path, progress: Progress) -> None:
        ended: list[BaseException] = []

        def advance(share: float) -> None:
            try:
                progress(share)
            except BaseException as error:
                ended.append(error)
                raise

        try:
            plugin.thing.write(source, path, advance)
        except (InputError, OSError):
            raise
        except Exception as error:
            if error in ended:
                raise
            raise InputError(f"{plugin.thing.title} cannot be written. {plugin.reports(error)}") from error

    return write
