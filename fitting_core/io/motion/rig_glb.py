"""A moving rig as binary glTF: the person's surface skinned to its joints, in its rest pose, animated.

Metres, y up. Nodes and skin have the same rest pose. Facts about the motion, and the surface's deviation from the
fit's, are in the extras of asset and scene. `glb.py` writes the body on its own skeleton with these parts.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gltf
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.animation.animated import RigSurface, on_standard, surface_deviation, surface_on
from fitting_core.animation.retargeting import RigMotion, Target
from fitting_core.animation.standard import Standard
from fitting_core.body.geometry import vertex_normals
from fitting_core.files.atomic import replacing
from fitting_core.motion import Motion, Progress, stated

ARMATURE, MESH, FIRST_JOINT = range(3)
"""Nodes: the rig's root, the skinned mesh, then the joints."""
_TYPES = {
    np.dtype(np.float32): gltf.FLOAT,
    np.dtype(np.uint32): gltf.UNSIGNED_INT,
    np.dtype(np.uint8): gltf.UNSIGNED_BYTE,
}
_SHAPES = {(): gltf.SCALAR, (3,): gltf.VEC3, (4,): gltf.VEC4, (16,): gltf.MAT4}
_COLORS = ([0.62, 0.68, 0.76, 1.0], [0.80, 0.62, 0.50, 1.0], [0.55, 0.72, 0.58, 1.0], [0.74, 0.60, 0.76, 1.0])


class GltfFile:
    """A glTF file of one scene being written: its document, and its data array by array.

    What is `said` becomes the extras of asset and scene; `tops` are the nodes without a parent.
    """

    def __init__(self, name: str, said: dict[str, Any], nodes: list[gltf.Node], tops: list[int]) -> None:
        self.document = gltf.GLTF2(
            asset=gltf.Asset(version="2.0", generator="tcfit", extras=said),
            scene=0,
            scenes=[gltf.Scene(name=name, nodes=tops, extras=said)],
            nodes=nodes,
        )
        self._parts, self._size = list[bytes](), 0

    def add(self, array: np.ndarray, target: int | None = None, *, bounds: bool = False) -> int:
        """Append an array; returns the number of its accessor."""
        array = np.ascontiguousarray(array)
        content = array.tobytes()
        views, accessors = self.document.bufferViews, self.document.accessors
        views.append(gltf.BufferView(buffer=0, byteOffset=self._size, byteLength=len(content), target=target))
        accessor = gltf.Accessor(
            bufferView=len(views) - 1,
            componentType=_TYPES[array.dtype],
            count=len(array),
            type=_SHAPES[array.shape[1:]],
        )
        if bounds:
            accessor.min, accessor.max = (np.atleast_1d(f(array, 0)).tolist() for f in (np.min, np.max))
        accessors.append(accessor)
        padding = -len(content) % 4
        self._parts += [content, bytes(padding)]
        self._size += len(content) + padding
        return len(accessors) - 1

    def save(self, path: Path) -> None:
        """Write the file. Raises OSError if that fails; nothing is left of it."""
        self.document.buffers = [gltf.Buffer(byteLength=self._size)]
        self.document.set_binary_blob(b"".join(self._parts))
        with replacing(path) as draft:
            self.document.save_binary(str(draft))


def write_standard_glb(path: Path, motion: Motion, standard: Standard, progress: Progress | None = None) -> None:
    """Write a motion on a standard rig; the file says how far the surface is from the fit's as programs show it. Raises
    OSError if the file cannot be written; nothing is left of it."""
    moving = on_standard(motion, standard)
    surface = surface_on(motion, moving)
    facts = stated(motion.in_axes("y-up")) | {"rig": standard.title, "rig_lengths": "the person's"}
    facts |= surface_deviation(motion, moving, surface, progress)
    file = skinned_file(motion, moving, surface, facts)
    file.document.animations = [animation_of(motion, moving, file, surface=surface)]
    file.save(path)


def skinned_file(motion: Motion, moving: RigMotion, surface: RigSurface, said: dict[str, Any]) -> GltfFile:
    """The file without animation, at rest."""
    above = [gltf.Node(name=motion.name, children=[FIRST_JOINT]), gltf.Node(name="body", mesh=0, skin=0)]
    file = GltfFile(motion.name, said, [*above, *joint_nodes(moving)], [ARMATURE, MESH])
    file.document.materials = [material_of(0)]
    file.document.meshes = [mesh_of(surface, file)]
    file.document.skins = [skin_of(moving.target, file)]
    return file


def skin_of(target: Target, file: GltfFile, first: int = FIRST_JOINT) -> gltf.Skin:
    """The joints that a mesh follows, from a node on, and how they stand at rest."""
    world = np.tile(np.eye(4), (len(target), 1, 1))
    world[:, :3, :3], world[:, :3, 3] = target.turns, target.places
    inverse = np.linalg.inv(world).swapaxes(-1, -2).astype(np.float32)  # column-major
    joints = [first + k for k in range(len(target))]
    return gltf.Skin(joints=joints, skeleton=first, inverseBindMatrices=file.add(inverse.reshape(-1, 16)))


def joint_nodes(moving: RigMotion, first: int = FIRST_JOINT, *, posed: bool = False) -> list[gltf.Node]:
    """The joints, from a node on: at rest, or `posed` as in the first frame."""
    target, nodes = moving.target, list[gltf.Node]()
    posing = moving.local[0] if posed else None
    for k, p in enumerate(target.parents):
        turn, place = target.turns[k], target.places[k]
        if p >= 0:
            turn, place = target.turns[p].T @ turn, target.turns[p].T @ (place - target.places[p])
        rotation = Rotation.from_matrix(turn).as_quat()
        if posing is not None:
            rotation, place = posing[k], moving.root[0] if k == target.root else place
        children = [first + int(child) for child in np.flatnonzero(target.parents == k)]
        nodes.append(
            gltf.Node(name=target.names[k], translation=place.tolist(), rotation=rotation.tolist(), children=children)
        )
    return nodes


class Channels:
    """An animation under construction."""

    def __init__(self, name: str, file: GltfFile) -> None:
        self.animation = gltf.Animation(name=name, samplers=[], channels=[])
        self._file, self._times = file, dict[bytes, int]()

    def add(
        self, seconds: Float[np.ndarray, "n"], node: int, path: str, values: np.ndarray, how: str = "LINEAR"
    ) -> None:
        """Set a node's translation, rotation, scale or weights at some times; channels of the same times share them."""
        at = seconds.astype(np.float32)
        if at.tobytes() not in self._times:
            self._times[at.tobytes()] = self._file.add(at, bounds=True)
        output = self._file.add(values.astype(np.float32).ravel() if path == "weights" else values.astype(np.float32))
        animation, when = self.animation, self._times[at.tobytes()]
        animation.samplers.append(gltf.AnimationSampler(input=when, output=output, interpolation=how))
        target = gltf.AnimationChannelTarget(node=node, path=path)
        animation.channels.append(gltf.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))

    def add_joints(self, seconds: Float[np.ndarray, "T"], moving: RigMotion, first: int = FIRST_JOINT) -> None:
        """The joints' rotations, and the positions of the pelvis and of joints above it."""
        target, places, local = moving.target, moving.places, moving.local
        for k, p in enumerate(target.parents):
            if k == target.root or p < 0:
                where = places[:, k] if p < 0 else (places[:, k] - places[:, p]) @ target.turns[p]
                self.add(seconds, first + k, "translation", where)
            if target.sources[k] is not None:
                self.add(seconds, first + k, "rotation", local[:, k])


def animation_of(
    motion: Motion,
    moving: RigMotion,
    file: GltfFile,
    *,
    surface: RigSurface | None = None,
    more: Sequence[tuple[int, np.ndarray]] = (),
) -> gltf.Animation:
    """The joints' rotations, the pelvis's position and the shapes' weights at the frames' times; and translations of
    more nodes."""
    channels, seconds = Channels(motion.name, file), np.arange(len(motion)) / motion.frame_rate
    channels.add_joints(seconds, moving)
    if surface is not None and surface.morphs.names:
        channels.add(seconds, MESH, "weights", surface.morphs.weights)
    for node, values in more:
        channels.add(seconds, node, "translation", values)
    return channels.animation


def mesh_of(surface: RigSurface, file: GltfFile, material: int = 0) -> gltf.Mesh:
    """A surface at rest."""
    vertices, morphs = gltf.ARRAY_BUFFER, surface.morphs
    normals = vertex_normals(surface.vertices.astype(float), surface.faces)
    normals = np.where(normals.any(1, keepdims=True), normals, (0.0, 1.0, 0.0)).astype(np.float32)
    primitive = gltf.Primitive(
        attributes=gltf.Attributes(
            POSITION=file.add(surface.vertices, vertices, bounds=True),
            NORMAL=file.add(normals, vertices),
            JOINTS_0=file.add(surface.bones.astype(np.uint8), vertices),
            WEIGHTS_0=file.add(surface.weights, vertices),
        ),
        indices=file.add(surface.faces.astype(np.uint32).ravel(), gltf.ELEMENT_ARRAY_BUFFER),
        material=material,
        targets=[gltf.Attributes(POSITION=file.add(shape, vertices, bounds=True)) for shape in morphs.directions],
    )
    extras = {"targetNames": list(morphs.names), "targetUnits": morphs.units}
    return gltf.Mesh(name="body", primitives=[primitive], extras=extras)


def material_of(person: int) -> gltf.Material:
    """A colour for each of several people."""
    return gltf.Material(
        name="body" if person == 0 else f"body {person + 1}",
        pbrMetallicRoughness=gltf.PbrMetallicRoughness(
            baseColorFactor=_COLORS[person % len(_COLORS)], metallicFactor=0.0, roughnessFactor=0.7
        ),
    )
