"""What can be exported: the table of all formats, for command line and app."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

from fitting_core.errors import InputError
from fitting_core.io.motion.animation_npz import write_animation_npz
from fitting_core.io.motion.mesh_sequence import write_obj_sequence, write_ply_sequence
from fitting_core.io.motion_files import MOTION_FILES
from fitting_core.io.points.contact_table import write_contacts
from fitting_core.io.points.joint_table import write_joints_csv
from fitting_core.measure.angles.angle_files import write_angles_csv, write_mot
from fitting_core.motion import OWN_WORLD, Progress
from fitting_core.plugins import Plugin, added, failures
from fitting_core.render.overlay import ViewName
from tcfit_app.exports.blender.running import missing, write_fbx
from tcfit_app.exports.elan import write_elan
from tcfit_app.exports.figures import write_figures_csv, write_figures_json, write_report, write_summary
from tcfit_app.exports.keypoints import write_coco, write_openpose_folder, write_pose_file
from tcfit_app.exports.laboratory import write_joints_trc, write_marker_c3d, write_markers_trc
from tcfit_app.exports.motions import write_character, write_frames, write_result, write_skeleton
from tcfit_app.exports.pictures import write_chosen, write_frames_sheet, write_picture, write_side_by_side
from tcfit_app.exports.rigs import on_bvh, on_glb, write_avatar, write_avatar_motion
from tcfit_app.exports.source import ExportSource
from tcfit_app.project.packed import pack

Group = Literal["Motion", "Rigs", "Laboratory", "Meshes", "Video", "Keypoints", "Annotations", "Figures", "Project"]
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
    write: Callable[[ExportSource, Path, Progress], str | None]
    """Writes the file, or into the folder, which exists and is empty; what a person should know of it, if anything.
    What it raises leaves nothing that is offered."""
    needs: Needs = "motion"
    both: bool = False
    """It shows A and B, whichever is chosen."""
    missing: Callable[[], str] = str
    """What has to be installed before it can be written; empty when it is."""

    @property
    def many(self) -> bool:
        """It is a folder of files, which a browser gets as a zip."""
        return self.suffix.startswith("-")


EXPORTS: dict[str, Export] = {
    "glb": Export(
        title="Character (GLB)",
        group="Motion",
        suffix=".glb",
        hint="Skinned mesh with 55 joints and a moving face for Blender, Unity, Unreal, three.js; y up, metres",
        write=write_character,
    ),
    "fbx": Export(
        title="Character (FBX)",
        group="Motion",
        suffix=".fbx",
        hint="As GLB, for Unreal, Unity, Maya, MotionBuilder; written by an installed Blender; y up, centimetres",
        write=write_fbx,
        missing=missing,
    ),
    "npz": Export(
        title="SMPL-X (npz)",
        group="Motion",
        suffix=".smplx.npz",
        hint="SMPL-X's keys as AMASS and the Blender add-ons have them; by default z up",
        write=lambda source, path, progress: write_animation_npz(path, source.motion(MOTION_FILES[".npz"].axes)),
    ),
    "bvh": Export(
        title="Skeleton (BVH)",
        group="Motion",
        suffix="-bvh",
        hint="55 joints in metres and degrees; by default y up",
        write=write_skeleton,
    ),
    "smplifyx": Export(
        title="SMPLify-X (pkl)",
        group="Motion",
        suffix="-smplifyx",
        hint="A pickle for each frame, as SMPLify-X writes its results; in camera space",
        write=write_frames,
    ),
    "fit": Export(
        title="Result (fit.npz)",
        group="Motion",
        suffix=".fit.npz",
        hint="As tcfit fit writes it: every phase, joints and camera, in camera space",
        write=write_result,
        needs="run",
    ),
    "mixamo": Export(
        title="Mixamo (GLB)",
        group="Rigs",
        suffix=".mixamo.glb",
        hint="The person on Mixamo's skeleton, with their own bone lengths, from a T pose; y up, metres",
        write=on_glb("MIXAMO"),
    ),
    "mixamo-bvh": Export(
        title="Mixamo (BVH)",
        group="Rigs",
        suffix=".mixamo.bvh",
        hint="Mixamo's skeleton with the person's bone lengths, from a T pose; y up, centimetres",
        write=on_bvh("MIXAMO"),
    ),
    "unreal": Export(
        title="Unreal (GLB)",
        group="Rigs",
        suffix=".unreal.glb",
        hint="The person on the mannequin's skeleton, with their own bone lengths, from its A pose; y up, metres",
        write=on_glb("UNREAL"),
    ),
    "unreal-bvh": Export(
        title="Unreal (BVH)",
        group="Rigs",
        suffix=".unreal.bvh",
        hint="The mannequin's skeleton with the person's bone lengths, from its A pose; y up, centimetres",
        write=on_bvh("UNREAL"),
    ),
    "vrm": Export(
        title="Avatar (VRM)",
        group="Rigs",
        suffix=".vrm",
        hint="The person as a VRM 1.0 avatar in T pose; VRM holds no motion, which VRM animation has",
        write=write_avatar,
    ),
    "vrma": Export(
        title="VRM animation",
        group="Rigs",
        suffix=".vrma",
        hint="The motion for any VRM 1.0 avatar, with the face for that of this person",
        write=write_avatar_motion,
    ),
    "joints": Export(
        title="Joints (CSV)",
        group="Laboratory",
        suffix=".joints.csv",
        hint="55 joint centres by frame, metres, by default y up; with error bars where they are known",
        write=lambda source, path, progress: write_joints_csv(path, source.motion("y-up")),
    ),
    "trc": Export(
        title="Joints (TRC)",
        group="Laboratory",
        suffix=".joints.trc",
        hint="55 joint centres for OpenSim: text, millimetres, by default y up",
        write=write_joints_trc,
    ),
    "trc-markers": Export(
        title="Markers (TRC)",
        group="Laboratory",
        suffix=".markers.trc",
        hint="Markers on the skin, named as in Plug-in Gait, for OpenSim: text, millimetres, by default y up",
        write=write_markers_trc,
    ),
    "c3d": Export(
        title="Markers (C3D)",
        group="Laboratory",
        suffix=".c3d",
        hint="Markers, joint centres, foot strikes and feet off, in millimetres, by default z up",
        write=write_marker_c3d,
    ),
    "contacts": Export(
        title="Contacts (CSV)",
        group="Laboratory",
        suffix=".contacts.csv",
        hint="When which foot stands, in frames and seconds",
        write=lambda source, path, progress: write_contacts(path, source.motion("camera")),
    ),
    "angles": Export(
        title="Joint angles (CSV)",
        group="Laboratory",
        suffix=".angles.csv",
        hint="Degrees by frame, with ISB's axes and signs, which the file states; empty where not determined",
        write=lambda source, path, progress: write_angles_csv(path, source.motion("y-up")),
    ),
    "mot": Export(
        title="OpenSim (MOT)",
        group="Laboratory",
        suffix=".mot",
        hint="Coordinates of OpenSim's full-body model Rajagopal2015, by its own axes and signs",
        write=lambda source, path, progress: write_mot(path, source.motion("y-up")),
    ),
    "obj": Export(
        title="OBJ sequence",
        group="Meshes",
        suffix="-obj",
        hint="The fit's own vertices, correctives included; by default y up",
        write=lambda source, path, progress: write_obj_sequence(path, source.motion("y-up"), progress),
    ),
    "ply": Export(
        title="PLY sequence",
        group="Meshes",
        suffix="-ply",
        hint="As OBJ, binary: a third of the size; by default z up",
        write=lambda source, path, progress: write_ply_sequence(path, source.motion("z-up"), progress),
    ),
    "picture": Export(
        title="Picture",
        group="Video",
        suffix=".png",
        hint="The middle frame with the chosen fit and the keypoints, over the video or from the side",
        write=write_picture,
    ),
    "sheet": Export(
        title="Sheet",
        group="Video",
        suffix=".sheet.png",
        hint="Up to 12 frames in one picture, evenly spaced, over the video or from the side",
        write=write_frames_sheet,
    ),
    "overlay": Export(
        title="Overlay",
        group="Video",
        suffix=".overlay.mp4",
        hint="A video of the chosen fit and the keypoints, over the video or from the side",
        write=write_chosen,
    ),
    "side-by-side": Export(
        title="Side by side",
        group="Video",
        suffix=".side-by-side.mp4",
        hint="A video of A and B beside each other, with the keypoints, over the video or from the side",
        write=write_side_by_side,
        needs="run",
        both=True,
    ),
    "openpose": Export(
        title="OpenPose",
        group="Keypoints",
        suffix="-keypoints",
        hint="JSON, a file for each frame, with all corrections",
        write=write_openpose_folder,
        needs="keypoints",
    ),
    "coco": Export(
        title="COCO (133)",
        group="Keypoints",
        suffix=".coco-wholebody.json",
        hint="COCO-WholeBody: 133 points in one JSON file, with all corrections",
        write=write_coco,
        needs="keypoints",
    ),
    "pose": Export(
        title=".pose",
        group="Keypoints",
        suffix=".pose",
        hint="The sign-language field's binary format with OpenPose's points, with all corrections",
        write=write_pose_file,
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
        hint="The chosen run's errors and curves, against the project's reference if it has one; needs tcfit[report]",
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
        write=lambda source, path, progress: pack(source.folder, path, progress=progress),
        needs="keypoints",
    ),
    "project-with-video": Export(
        title="Project + video",
        group="Project",
        suffix=".video.tcfit.zip",
        hint="As one file, with the video or images, so that it can be given to others",
        write=lambda source, path, progress: pack(source.folder, path, with_media=True, progress=progress),
        needs="keypoints",
    ),
}
"""By the name on the command line, in the order of their buttons."""
DEFAULTS = ("glb", "npz", "bvh")
"""What `tcfit export` writes when nothing is wished for."""
_RETARGET = "Export {} and retarget it to your character with the tools that docs/retargeting.md lists."
REMOVED = {
    "rig-glb": _RETARGET.format("glb, mixamo, unreal or vrma"),
    "rig-bvh": _RETARGET.format("bvh, mixamo-bvh or unreal-bvh"),
}
"""What replaces formats that were removed, by their names."""
AXES_CHOICES = {"": "by format", "camera": "camera", "y-up": "y up", "z-up": "z up", OWN_WORLD: "calibration's"}
"""The last of them only where the clip's camera has a calibrated world."""
VIEW_CHOICES: dict[str, tuple[str, tuple[ViewName, ...]]] = {
    "": ("camera", ("camera",)),
    "side": ("side", ("side",)),
    "both": ("both", ("camera", "side")),
}
"""Views of pictures and videos, with their labels."""
VIEW_HINT = "For pictures and videos: as the camera saw it, over the video; or upright from the person's left side"


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


def _guarded(plugin: Plugin[Export]) -> Callable[[ExportSource, Path, Progress], str | None]:
    """Its `write`, whose errors become InputErrors; what `progress` raises, by which users cancel, passes through."""

    def write(source: ExportSource, path: Path, progress: Progress) -> str | None:
        ended: list[BaseException] = []

        def advance(share: float) -> None:
            if not 0 <= (known := float(share)) <= 1:
                raise ValueError(f"it reported {known} as the share that is done; expected 0 to 1")
            try:
                progress(known)
            except BaseException as error:
                ended.append(error)
                raise

        try:
            return plugin.thing.write(source, path, advance)
        except (InputError, OSError):
            raise
        except failures() as error:
            if error in ended:
                raise
            raise InputError(f"{plugin.thing.title} cannot be written. {plugin.reports(error)}") from error

    return write
