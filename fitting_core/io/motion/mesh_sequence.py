"""A motion as a folder of meshes: an OBJ file per frame, with motion.json beside them.

Vertices are those of the fit in the motion's world, metres, with all that moves them: shape, expression, pose
correctives, translation. Files are named <name>_<number of the frame in the video>.
"""

import re
from pathlib import Path

import msgspec

from fitting_core.files.regular import StrPath
from fitting_core.motion import Motion, Progress, stated_by_frame

FACTS_NAME = "motion.json"


def write_obj_sequence(folder: StrPath, motion: Motion, progress: Progress | None = None) -> None:
    """Write an OBJ file for each frame; vertices to 0.001 mm.

    Args:
        folder: An existing, empty folder.
        motion: To write.
        progress: See `Progress`.
    """
    folder, facts, stem = Path(folder), stated_by_frame(motion), file_stem(motion.name)
    (folder / FACTS_NAME).write_bytes(msgspec.json.format(msgspec.json.encode(facts), indent=1) + b"\n")
    faces = motion.body.faces + 1
    tail = ("f %d %d %d\n" * len(faces)) % tuple(faces.ravel().tolist())
    pattern = "v %.6f %.6f %.6f\n" * len(motion.body.template)
    for t, vertices in enumerate(motion.vertices()):
        frame = motion.first_frame + t
        head = "".join(f"# {line}\n" for line in _comments(facts, t, frame))
        text = head + pattern % tuple(vertices.ravel().tolist()) + tail
        (folder / f"{stem}_{frame:06d}.obj").write_text(text, encoding="ascii", newline="\n")
        if progress:
            progress((t + 1) / len(motion))


def file_stem(name: str) -> str:
    """A name that every system accepts for a file."""
    return re.sub(r"[^\w.-]+", "_", name, flags=re.ASCII).strip("._") or "motion"


def _comments(facts: dict, t: int, frame: int) -> list[str]:
    camera = facts["intrinsics"]
    return [
        f"tcfit, frame {frame} of the video at {facts['frame_rate']:g} frames per second",
        f"axes: {facts['axes_text']}",
        f"intrinsics in pixels: focal {camera['focal_px']}, center {camera['center_px']}, "
        f"image {camera['image_size_px']}",
        f"gender {facts['gender']}; translation {facts['translation'][t]}, already in the vertices",
    ]
