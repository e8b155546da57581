"""Figures of exported fits: a table by frame, and the summary; and the corrected keypoints."""

import csv
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fitting_core.clip import Clip
from fitting_core.io.keypoints.coco_wholebody import write_coco_wholebody
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.io.keypoints.pose_file import write_pose
from fitting_core.io.motion.mesh_sequence import file_stem
from fitting_core.io.summary import summary
from fitting_core.lens import filmed_keypoints
from fitting_core.motion import Progress
from tcfit_app.analysis.curves import CURVES
from tcfit_app.exports.source import ExportSource


def write_figures_csv(source: ExportSource, path: Path, progress: Progress) -> None:
    """A row for each frame, a column for each curve of each fit; unknown values are empty."""
    columns = _figures(source, progress)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([_cell(value) for value in row] for row in zip(*columns.values(), strict=True))


def write_summary(source: ExportSource, path: Path, progress: Progress) -> None:
    """As summary.json of `tcfit fit`."""
    fit = source.fit
    complete = fit.shown.run.state == "finished"
    path.write_bytes(as_json(summary(fit.fit, source.clip, fit.body, complete=complete, command="tcfit export")))


def _figures(source: ExportSource, progress: Progress) -> dict[str, np.ndarray]:
    """Columns by title: the frame's number and time, and the curves of the timeline for A and B, or for the run alone.

    The time counts from the video's first frame, as ELAN's does.
    """
    clip = source.clip
    frames = clip.first_frame + np.arange(len(clip))
    columns: dict[str, np.ndarray] = {"frame": frames, "time_ms": np.rint(1000 * frames / clip.frame_rate).astype(int)}
    fits = dict(zip("AB", source.compared, strict=True)) if len(source.compared) == 2 else {"": source.fit}
    for done, (name, fit) in enumerate(fits.items()):
        posed = fit.posed(clip)
        for step, kind in enumerate(CURVES.values()):
            progress((done + step / len(CURVES)) / len(fits))
            title = f"{name} {kind.title}{f' [{kind.unit}]' if kind.unit else ''}"
            columns[title.strip()] = kind.values(posed)
    return columns


def _cell(value: float) -> str:
    """A cell's text; empty if unknown."""
    return "" if not np.isfinite(value) else f"{value:.6g}" if isinstance(value, float) else str(value)


def as_json(content: object) -> bytes:
    """Readable JSON."""
    return msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n"


def clip_stated(clip: Clip) -> dict[str, Any]:
    """The clip's facts, for formats that cannot hold them."""
    return {
        "clip": clip.name,
        "frames": len(clip),
        "first_frame": clip.first_frame,
        "frame_rate": clip.frame_rate,
        "axes": "pixels: x right, y down, from the image's upper left corner",
        "intrinsics": msgspec.to_builtins(clip.camera),
        "generator": "tcfit",
    }


# --- the corrected keypoints of a project, as detectors write theirs: on the pictures as they were filmed ---


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
