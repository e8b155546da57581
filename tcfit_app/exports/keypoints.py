"""The corrected keypoints of a project, as detectors write theirs: on the pictures as they were filmed."""

from pathlib import Path

from fitting_core.io.keypoints.coco_wholebody import write_coco_wholebody
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.io.keypoints.pose_file import write_pose
from fitting_core.io.motion.mesh_sequence import file_stem
from fitting_core.lens import filmed_keypoints
from fitting_core.motion import Progress
from tcfit_app.exports.figures import as_json, clip_stated
from tcfit_app.exports.source import ExportSource


def write_openpose_folder(source: ExportSource, folder: Path, progress: Progress) -> None:
    """A JSON file for each frame."""
    clip = source.clip
    write_openpose(
        folder,
        filmed_keypoints(clip.keypoints, clip.camera.lens),
        name=file_stem(clip.name),
        first_frame=clip.first_frame,
        image_stems=[image.stem for image in source.images],
        detector=clip.detector,
    )
    (folder / "clip.json").write_bytes(as_json(clip_stated(clip)))


def write_coco(source: ExportSource, path: Path, progress: Progress) -> None:
    """One JSON file."""
    clip = source.clip
    write_coco_wholebody(
        path,
        filmed_keypoints(clip.keypoints, clip.camera.lens),
        name=clip.name,
        size=clip.camera.size,
        frame_rate=clip.frame_rate,
        first_frame=clip.first_frame,
        image_names=[image.name for image in source.images],
        detector=clip.detector,
    )


def write_pose_file(source: ExportSource, path: Path, progress: Progress) -> None:
    """One binary file."""
    clip = source.clip
    keypoints = filmed_keypoints(clip.keypoints, clip.camera.lens)
    write_pose(path, keypoints, size=clip.camera.size, frame_rate=clip.frame_rate, first_frame=clip.first_frame)
