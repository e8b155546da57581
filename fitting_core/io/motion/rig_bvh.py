"""A moving rig as BVH: its joints by name, rotated from a rest pose whose axes are the world's.

The root has a position, and so does the pelvis if the rig has a root above it; every joint rotates by Z, X and Y in
this order (R = Rz Rx Ry), as in `io/motion/bvh.py`.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.animation.retargeting import RigMotion
from fitting_core.files.atomic import replacing
from fitting_core.io.motion.bvh import continuous_euler
from fitting_core.motion import Progress

_TURNS = "Zrotation Xrotation Yrotation"
_PLACES = "Xposition Yposition Zposition"
_END = 0.2
"""Length of the end site, as a share of the last bone."""


def write_rig_bvh(
    path: Path,
    moving: RigMotion,
    frame_rate: float,
    *,
    unit: float = 1.0,
    progress: Progress | None = None,
) -> None:
    """Write the skeleton and its motion. Raises OSError if the file cannot be written; nothing is left of it.

    Args:
        path: The file.
        moving: What moves.
        frame_rate: Frames per second.
        unit: Factor for the rig's lengths: 100 for centimetres instead of metres.
        progress: See `Progress`.
    """
    tree = _Tree(moving, sorted(_of_pelvis(moving)), unit)
    rows = tree.rows()
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(["HIERARCHY", *tree.lines()]))
        file.write(f"\nMOTION\nFrames: {len(rows)}\nFrame Time: {1 / frame_rate:.9f}\n")
        for done, values in enumerate(rows, 1):
            file.write(" ".join(f"{value:.6f}" for value in values) + "\n")
            if progress:
                progress(done / len(rows))


def _of_pelvis(moving: RigMotion) -> list[int]:
    """The topmost joint above the pelvis, and all its descendants."""
    parents, top = moving.target.parents, moving.target.root
    while parents[top] >= 0:
        top = int(parents[top])
    found = {top}
    for k in range(top + 1, len(parents)):
        if int(parents[k]) in found:
            found.add(k)
    return list(found)


@dataclass(frozen=True, eq=False)
class _Tree:
    moving: RigMotion
    kept: list[int]
    unit: float

    @property
    def top(self) -> int:
        return self.kept[0]

    def parent(self, k: int) -> int:
        return -1 if k == self.top else int(self.moving.target.parents[k])

    @cached_property
    def children(self) -> dict[int, list[int]]:
        found: dict[int, list[int]] = {k: [] for k in self.kept}
        for k in self.kept[1:]:
            found[self.parent(k)].append(k)
        return found

    def has_place(self, k: int) -> bool:
        return k in (self.top, self.moving.target.root)

    def depth_first(self) -> list[int]:
        order, waiting = [], [self.top]
        while waiting:
            order.append(waiting.pop())
            waiting += reversed(self.children[order[-1]])
        return order

    def rows(self) -> Float[np.ndarray, "T n"]:
        """The channels' values, joint by joint in the hierarchy's order."""
        moved, places, order = self.moving.moved, self.moving.places, self.depth_first()
        local = np.stack([self._against_parent(moved, k) @ moved[:, k] for k in order], 1)
        vectors = Rotation.from_matrix(local.reshape(-1, 3, 3)).as_rotvec().reshape(*local.shape[:2], 3)
        columns = []
        for k, angles in zip(order, continuous_euler(vectors).swapaxes(0, 1), strict=True):
            if self.has_place(k):
                p = self.parent(k)
                away = places[:, k] - (places[:, p] if p >= 0 else 0.0)
                columns.append(self.unit * (self._against_parent(moved, k) @ away[..., None])[..., 0])
            columns.append(angles)
        return np.concatenate(columns, 1)

    def _against_parent(self, moved: np.ndarray, k: int) -> Float[np.ndarray, "T 3 3"]:
        p = self.parent(k)
        return moved[:, p].swapaxes(-1, -2) if p >= 0 else np.broadcast_to(np.eye(3), moved[:, k].shape)

    def lines(self) -> list[str]:
        """The hierarchy, iteratively: a chain of joints may exceed Python's recursion limit."""
        lines: list[str] = []
        opened: list[int] = []
        for k in self.depth_first():
            while opened and opened[-1] != self.parent(k):
                lines.append("\t" * (len(opened) - 1) + "}")
                opened.pop()
            lines += self._joint(k, "\t" * len(opened))
            opened.append(k)
        return lines + ["\t" * depth + "}" for depth in reversed(range(len(opened)))]

    def _joint(self, k: int, indent: str) -> list[str]:
        """A joint without its children, and without the closing brace."""
        target, inner, p = self.moving.target, indent + "\t", self.parent(k)
        offset = self.unit * (target.places[k] - (target.places[p] if p >= 0 else 0.0))
        channels = f"6 {_PLACES} {_TURNS}" if self.has_place(k) else f"3 {_TURNS}"
        name = "_".join(target.names[k].split()) or "joint"  # a blank would split the name
        lines = [f"{indent}{'JOINT' if p >= 0 else 'ROOT'} {name}", f"{indent}{{"]
        lines += [_offset(offset, inner), f"{inner}CHANNELS {channels}"]
        if not self.children[k]:
            lines += [f"{inner}End Site", f"{inner}{{", _offset(_END * offset, inner + "\t"), f"{inner}}}"]
        return lines


def _offset(offset: np.ndarray, indent: str) -> str:
    return f"{indent}OFFSET " + " ".join(f"{value:.6f}" for value in offset)
