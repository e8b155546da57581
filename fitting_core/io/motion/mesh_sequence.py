"""A motion as a folder of meshes, one per frame: OBJ or binary PLY, with motion.json beside them.

Vertices are those of the fit in the motion's world, metres, with all that moves them: shape, expression, pose
correctives, translation. Files are named <name>_<number of the frame in the video>.
"""

import re
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Float

from fitting_core.files.regular import StrPath
from fitting_core.motion import Motion, Progress, stated_by_frame

FACTS_NAME = "motion.json"

MeshWriter = Callable[[Path, Float[np.ndarray, "V 3"], list[str]], None]


def write_obj_sequence(folder: StrPath, motion: Motion, progress: Progress | None = None) -> None:
    """Write an OBJ file for each frame; vertices to 0.001 mm.

    Args:
        folder: An existing, empty folder.
        motion: To write.
        progress: See `Progress`.
    """
    folder = Path(folder)
    faces = motion.body.faces + 1
    tail = ("f %d %d %d\n" * len(faces)) % tuple(faces.ravel().tolist())
    pattern = "v %.6f %.6f %.6f\n" * len(motion.body.template)

    def write(path: Path, vertices: np.ndarray, comments: list[str]) -> None:
        head = "".join(f"# {line}\n" for line in comments)
        path.write_text(head + pattern % tuple(vertices.ravel().tolist()) + tail, encoding="ascii", newline="\n")

    _write(folder, motion, ".obj", write, progress)


def write_ply_sequence(folder: StrPath, motion: Motion, progress: Progress | None = None) -> None:
    """Write a binary PLY file for each frame, in single precision; arguments as for `write_obj_sequence`."""
    folder = Path(folder)
    faces = np.zeros(len(motion.body.faces), np.dtype([("count", "u1"), ("vertices", "<i4", 3)]))
    faces["count"], faces["vertices"] = 3, motion.body.faces

    def write(path: Path, vertices: np.ndarray, comments: list[str]) -> None:
        head = _ply_head(len(vertices), len(faces), comments).encode("ascii")
        path.write_bytes(head + vertices.astype("<f4").tobytes() + faces.tobytes())

    _write(folder, motion, ".ply", write, progress)


def _write(folder: Path, motion: Motion, suffix: str, write: MeshWriter, progress: Progress | None) -> None:
    facts = stated_by_frame(motion)
    (folder / FACTS_NAME).write_bytes(msgspec.json.format(msgspec.json.encode(facts), indent=1) + b"\n")
    stem = file_stem(motion.name)
    for t, vertices in enumerate(motion.vertices()):
        frame = motion.first_frame + t
        write(folder / f"{stem}_{frame:06d}{suffix}", vertices, _comments(facts, t, frame))
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


def _ply_head(vertices: int, faces: int, comments: list[str]) -> str:
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {line}" for line in comments),
        f"element vertex {vertices}",
        *(f"property float {axis}" for axis in "xyz"),
        f"element face {faces}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    return "\n".join(lines) + "\n"
