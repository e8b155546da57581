"""Plays a GLB file by the specification of glTF 2.0, from pygltflib's data: nothing of tcfit's writer is used."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pygltflib
from scipy.spatial.transform import Rotation, Slerp

_NUMBERS = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@dataclass(frozen=True)
class Player:
    """A file with skinned meshes and one animation."""

    document: pygltflib.GLTF2

    @staticmethod
    def of(path: Path) -> "Player":
        document = pygltflib.GLTF2().load_binary(str(path))  # whatever its name ends in
        assert document is not None
        return Player(document)

    def array(self, accessor: int) -> np.ndarray:
        """An accessor's numbers, (count, width)."""
        about = self.document.accessors[accessor]
        view = self.document.bufferViews[about.bufferView]
        blob = self.document.binary_blob()
        width = _WIDTHS[about.type]
        start = (view.byteOffset or 0) + (about.byteOffset or 0)
        assert start % np.dtype(_NUMBERS[about.componentType]).itemsize == 0, "accessors are aligned"
        values = np.frombuffer(blob, _NUMBERS[about.componentType], about.count * width, start).reshape(-1, width)
        for bound, found in ((about.min, values.min(0)), (about.max, values.max(0))):
            assert not bound or np.array_equal(np.float32(bound), found)
        return values

    @property
    def times(self) -> np.ndarray:
        return self.array(self.document.animations[0].samplers[0].input)[:, 0]

    def values(self, node: int, path: str, time: float) -> np.ndarray | None:
        """What the animation sets, between two keys as LINEAR has it; None if it does not."""
        animation = self.document.animations[0]
        found = [c for c in animation.channels if (c.target.node, c.target.path) == (node, path)]
        if not found:
            return None
        sampler = animation.samplers[found[0].sampler]
        assert sampler.interpolation in ("LINEAR", "STEP")
        times, keys = self.array(sampler.input)[:, 0], self.array(sampler.output).astype(float)
        keys = keys.reshape(len(times), -1)
        after = min(int(np.searchsorted(times, time, side="right")), len(times) - 1)
        before = max(after - 1, 0)
        share = 0.0 if after == before else np.clip((time - times[before]) / (times[after] - times[before]), 0, 1)
        if sampler.interpolation == "STEP":
            share = np.floor(share)
        if path == "rotation" and after > before:
            return Slerp([0, 1], Rotation.from_quat(keys[[before, after]]))(share).as_quat()
        return (1 - share) * keys[before] + share * keys[after]

    def matrices(self, time: float | None) -> np.ndarray:
        """Every node's transform into the world, with the scale of what is above it; None: at rest."""
        nodes = self.document.nodes
        found = np.tile(np.eye(4), (len(nodes), 1, 1))
        waiting = [(n, np.eye(4)) for n in self.document.scenes[self.document.scene].nodes]
        while waiting:
            n, above = waiting.pop()
            rest = {
                "translation": nodes[n].translation or (0, 0, 0),
                "rotation": nodes[n].rotation or (0, 0, 0, 1),
                "scale": nodes[n].scale or (1, 1, 1),
            }
            played = {} if time is None else {path: self.values(n, path, time) for path in rest}
            now = rest | {path: value for path, value in played.items() if value is not None}
            local = np.eye(4)
            local[:3, :3] = Rotation.from_quat(now["rotation"]).as_matrix() * now["scale"]
            local[:3, 3] = now["translation"]
            found[n] = above @ local
            waiting += [(child, found[n]) for child in nodes[n].children or []]
        return found

    def joints(self, time: float) -> np.ndarray:
        """The skin's joints in the world, (J, 3)."""
        return self.matrices(time)[self.document.skins[0].joints, :3, 3]

    def vertices(self, time: float, person: int = 0) -> np.ndarray:
        """A skinned mesh in the world, (V, 3): morph targets, then the joints' matrices times inverse binds."""
        document = self.document
        mesh_node = [n for n, node in enumerate(document.nodes) if node.skin is not None][person]
        (primitive,) = document.meshes[document.nodes[mesh_node].mesh].primitives
        attributes, skin = primitive.attributes, document.skins[document.nodes[mesh_node].skin]
        moved = self.array(attributes.POSITION).astype(float)
        weights = self.values(mesh_node, "weights", time)
        for weight, target in zip([] if weights is None else weights, primitive.targets or [], strict=True):
            moved += weight * self.array(target["POSITION"])
        inverse = self.array(skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
        bones = self.matrices(time)[skin.joints] @ inverse
        blended = np.einsum("vk,vkij->vij", self.array(attributes.WEIGHTS_0), bones[self.array(attributes.JOINTS_0)])
        return np.einsum("vij,vj->vi", blended[:, :3, :3], moved) + blended[:, :3, 3]
