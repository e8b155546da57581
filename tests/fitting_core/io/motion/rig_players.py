"""Rigs in files, played by readers of their own: nothing of tcfit's writers or readers is used."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tests.fitting_core.io.motion.gltf_player import Player


def glb_joints(path: Path, time: float) -> dict[str, np.ndarray]:
    """4 x 4 of every node by its name, at a time in seconds."""
    player = Player.of(path)
    return dict(zip((node.name for node in player.document.nodes), player.matrices(time), strict=True))


@dataclass(frozen=True)
class Bvh:
    """A BVH file: joints by name."""

    names: list[str]
    parents: list[int]
    offsets: np.ndarray
    channels: list[list[str]]
    frames: np.ndarray
    frame_time: float

    @staticmethod
    def of(path: Path) -> "Bvh":
        names: list[str] = []
        parents, offsets, channels, above = [], [], [], [-1]
        hierarchy, motion = path.read_text().split("MOTION")
        end = False
        for line in hierarchy.splitlines():
            words = line.split()
            if words[:1] in (["ROOT"], ["JOINT"]):
                assert len(words) == 2
                names.append(words[1])
                parents.append(above[-1])
                above.append(len(names) - 1)
            elif words[:2] == ["End", "Site"]:
                end = True
                above.append(-9)
            elif words[:1] == ["OFFSET"] and not end:
                offsets.append([float(word) for word in words[1:]])
            elif words[:1] == ["CHANNELS"]:
                assert int(words[1]) == len(words) - 2
                channels.append(words[2:])
            elif words[:1] == ["}"]:
                end = False
                above.pop()
        lines = motion.split("\n")
        rows = np.array([[float(v) for v in line.split()] for line in lines[3:] if line])
        assert int(lines[1].split()[1]) == len(rows) and rows.shape[1] == sum(map(len, channels))
        return Bvh(names, parents, np.array(offsets), channels, rows, float(lines[2].split()[2]))

    def joints(self, frame: int) -> dict[str, np.ndarray]:
        """4 x 4 of every joint in the world."""
        world: list[np.ndarray] = []
        values = iter(self.frames[frame])
        for name_channels, parent, offset in zip(self.channels, self.parents, self.offsets, strict=True):
            local = np.eye(4)
            local[:3, 3] = offset
            place = np.zeros(3)
            for channel in name_channels:
                value = next(values)
                axis = np.eye(3)["XYZ".index(channel[0])]
                if channel.endswith("position"):
                    place += value * axis
                else:
                    local[:3, :3] = local[:3, :3] @ Rotation.from_rotvec(np.radians(value) * axis).as_matrix()
            if any(channel.endswith("position") for channel in name_channels):
                local[:3, 3] = place
            world.append(local if parent < 0 else world[parent] @ local)
        return dict(zip(self.names, world, strict=True))
