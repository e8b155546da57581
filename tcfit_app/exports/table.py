"""The table of all export formats, for command line and app."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

from fitting_core.errors import InputError
from fitting_core.io.motion.animation_npz import write_animation_npz
from fitting_core.io.motion_files import MOTION_FILES
from fitting_core.io.points.tables import write_contacts, write_joints_csv
from fitting_core.measure.angles.angle_files import write_angles_csv, write_mot
from fitting_core.motion import OWN_WORLD, Motion, Progress
from fitting_core.plugins import Plugin, added, failures
from fitting_core.render.overlay import ViewName
from tcfit_app.exports.blender.running import missing, write_fbx
from tcfit_app.exports.elan import write_elan
from tcfit_app.exports.figures import (
    write_coco,
    write_figures_csv,
    write_openpose_folder,
    write_pose_file,
    write_summary,
)
from tcfit_app.exports.motions import (
    on_rig,
    write_avatar,
    write_avatar_motion,
    write_character,
    write_frames,
    write_joints_trc,
    write_marker_c3d,
    write_markers_trc,
    write_meshes,
    write_result,
    write_skeleton,
)
from tcfit_app.exports.pictures import write_chosen, write_frames_sheet, write_picture, write_side_by_side
from tcfit_app.exports.source import ExportSource

Group = Literal["Blender", "Unity, Unreal", "ELAN", "OpenSim", "Python", "Video"]
"""The program that reads a format."""
Needs = Literal["motion", "run", "keypoints"]
"""The required source: any fit; a project with a run; a project."""
Write = Callable[[ExportSource, Path, Progress], str | None]
"""Writes a file, or into an existing empty folder; returns a note for the user. If it raises, nothing is kept."""


@dataclass(frozen=True, kw_only=True)
class Export:
    """A format."""

    title: str
    group: Group
    suffix: str
    """Appended to the clip's name; a folder's begins with a hyphen."""
    hint: str
    write: Write
    needs: Needs = "motion"
    both: bool = False
    """It contains both A and B."""
    missing: Callable[[], str] = str
    """What must be installed to write it; empty if nothing."""

    @property
    def many(self) -> bool:
        """Whether it is a folder of files, which a browser gets as a zip."""
        return self.suffix.startswith("-")


def _of_motion(write: Callable[[Path, Motion], object], axes: str) -> Write:
    """Adapt a writer of a motion in given axes."""

    def written(source: ExportSource, path: Path, progress: Progress) -> None:
        write(path, source.motion(axes))

    return written


def _group(group: Group, formats: dict[str, tuple[str, str, Write, str]], **common: Any) -> dict[str, Export]:
    """Formats of a group, by name: title, suffix, writer and hint. `common` are fields of all of them."""
    return {
        name: Export(title=title, group=group, suffix=suffix, hint=hint, write=write, **common)
        for name, (title, suffix, write, hint) in formats.items()
    }


# fmt: off
EXPORTS: dict[str, Export] = {
    **_group("Blender", {
        "glb": ("Character (GLB)", ".glb", write_character,
                "Skinned mesh with 55 joints and a moving face for Blender, Unity, Unreal, three.js; y up, metres"),
        "bvh": ("Skeleton (BVH)", "-bvh", write_skeleton, "55 joints in metres and degrees; by default y up"),
        "obj": ("OBJ sequence", "-obj", write_meshes,
                "The fit's own vertices, correctives included; by default y up")}),
    **_group("Unity, Unreal", {
        "fbx": ("Character (FBX)", ".fbx", write_fbx,
                "As GLB, for Unreal, Unity, Maya, MotionBuilder; written by an installed Blender; y up, centimetres"),
    }, missing=missing),
    **_group("Unity, Unreal", {
        "mixamo": ("Mixamo", ".mixamo.glb", on_rig("MIXAMO"),
                   "Skinned character on Mixamo's joints, with the person's bone lengths, from a T pose; y up, metres"),
        "unreal": ("Unreal", ".unreal.glb", on_rig("UNREAL"),
                   "The same on the mannequin's joints, from its A pose"),
        "vrm": ("Avatar (VRM)", ".vrm", write_avatar,
                "The person as a VRM 1.0 avatar in T pose; VRM holds no motion, which VRM animation has"),
        "vrma": ("VRM animation", ".vrma", write_avatar_motion,
                 "The motion for any VRM 1.0 avatar, with the face for that of this person")}),
    **_group("ELAN", {
        "elan": ("Tiers (.eaf)", ".eaf", write_elan,
                 "Tiers over the video: notes, flags, review; phases and handshapes of each hand of the chosen fit"),
    }, needs="run"),
    **_group("ELAN", {
        "pose": (".pose", ".pose", write_pose_file,
                 "The sign-language field's binary format with OpenPose's points, with all corrections"),
    }, needs="keypoints"),
    **_group("OpenSim", {
        "mot": ("Coordinates (MOT)", ".mot", _of_motion(write_mot, "y-up"),
                "Coordinates of OpenSim's full-body model Rajagopal2015, by its own axes and signs"),
        "trc": ("Joints (TRC)", ".joints.trc", write_joints_trc,
                "SMPL-X's 55 joints and 12 anatomical joint centres for OpenSim: text, millimetres, by default y up"),
        "trc-markers": ("Markers (TRC)", ".markers.trc", write_markers_trc,
                        "Markers on the skin, named as in Plug-in Gait, for OpenSim: text, millimetres, by default y "
                        "up"),
        "c3d": ("Markers (C3D)", ".c3d", write_marker_c3d,
                "Markers, joints, joint centres, foot strikes and feet off, in millimetres, by default z up"),
        "angles": ("Joint angles (CSV)", ".angles.csv", _of_motion(write_angles_csv, "y-up"),
                   "Degrees by frame, with ISB's axes and signs, which the file states; empty where not determined"),
        "contacts": ("Contacts (CSV)", ".contacts.csv", _of_motion(write_contacts, "camera"),
                     "When which foot stands, in frames and seconds")}),
    **_group("Python", {
        "fit": ("Result (fit.npz)", ".fit.npz", write_result,
                "As tcfit fit writes it: every phase, joints and camera, in camera space"),
    }, needs="run"),
    **_group("Python", {
        "npz": ("SMPL-X (npz)", ".smplx.npz", _of_motion(write_animation_npz, MOTION_FILES[".npz"].axes),
                "SMPL-X's keys as AMASS and the Blender add-ons have them; by default z up"),
        "smplifyx": ("SMPLify-X (pkl)", "-smplifyx", write_frames,
                     "A pickle for each frame, as SMPLify-X writes its results; in camera space"),
        "joints": ("Joints (CSV)", ".joints.csv", _of_motion(write_joints_csv, "y-up"),
                   "SMPL-X's 55 joints by frame, metres, by default y up; with error bars where they are known")}),
    **_group("Python", {
        "figures": ("Curves (CSV)", ".figures.csv", write_figures_csv,
                    "All curves of the timeline by frame, of A and B, as a table"),
    }, needs="run", both=True),
    **_group("Python", {
        "summary": ("Summary (JSON)", ".summary.json", write_summary,
                    "Errors, jitter, settings and versions of the chosen run"),
    }, needs="run"),
    **_group("Python", {
        "openpose": ("OpenPose (JSON)", "-keypoints", write_openpose_folder,
                     "The keypoints with all corrections, a file for each frame"),
        "coco": ("COCO (JSON)", ".coco-wholebody.json", write_coco,
                 "COCO-WholeBody: 133 keypoints with all corrections, in one file"),
    }, needs="keypoints"),
    **_group("Video", {
        "overlay": ("Overlay", ".overlay.mp4", write_chosen,
                    "A video of the chosen fit and the keypoints, over the video or from the side"),
        "picture": ("Picture", ".png", write_picture,
                    "The middle frame with the chosen fit and the keypoints, over the video or from the side"),
        "sheet": ("Sheet", ".sheet.png", write_frames_sheet,
                  "Up to 12 frames in one picture, evenly spaced, over the video or from the side")}),
    **_group("Video", {
        "side-by-side": ("Side by side", ".side-by-side.mp4", write_side_by_side,
                         "A video of A and B beside each other, with the keypoints, over the video or from the side"),
    }, needs="run", both=True),
}
# fmt: on
"""By the name on the command line, in the order of their buttons."""
PROGRAMS: dict[Group, dict[str, str]] = {
    "Blender": {"glb": "GLB with body, fingers and face"},
    "Unity, Unreal": {
        "fbx": "FBX with body, fingers and face",
        "glb": "GLB with body, fingers and face; for FBX, install Blender",
    },
    "ELAN": {"elan": "EAF with notes, hand phases, handshapes"},
    "OpenSim": {"mot": "MOT for the model Rajagopal2015"},
    "Python": {"fit": "NPZ with parameters, joints, camera"},
    "Video": {"overlay": "MP4 of the fit over the video"},
}
"""What each program's button writes: the first of these formats that can be written, and what it has."""
DEFAULTS = ("glb", "npz", "bvh")
"""The formats that `tcfit export` writes by default."""
_PROJECT = "A project is a folder: close it, and pack the folder and its video with any archiver."
_RETARGET = "Export {} and retarget it to your character with the tools that docs/retargeting.md lists."
REMOVED = {
    "rig-glb": _RETARGET.format("glb, mixamo, unreal or vrma"),
    "mixamo-bvh": "Export mixamo, or bvh.",
    "unreal-bvh": "Export unreal, or bvh.",
    "figures-json": "Export figures, a table of the same values.",
    "ply": "Export obj.",
    "project": _PROJECT,
    "project-with-video": _PROJECT,
    "report": "Use tcfit evaluate PROJECT, which writes report.html.",
    "rig-bvh": _RETARGET.format("bvh, mixamo or unreal"),
}
"""Replacements of removed formats."""
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
    """EXPORTS, followed by those of plugins."""
    return EXPORTS | {
        name: replace(plugin.thing, write=_guarded(plugin))
        for name, plugin in added("tcfit.exports", Export, taken=EXPORTS).items()
        if _is_sound(plugin)
    }


def _is_sound(plugin: Plugin[Export]) -> bool:
    export, groups = plugin.thing, get_args(Group)
    wrong = {
        f"its group is {export.group!r}; expected one of {'; '.join(groups)}": export.group in groups,
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
    """Its `write`, whose errors become InputErrors. Exceptions of `progress`, by which users cancel, pass through."""

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
