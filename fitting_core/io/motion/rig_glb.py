"""A moving standard rig as binary glTF: the person's surface skinned to its joints, in its rest pose, animated.

Like `io/motion/glb.py`, which writes the body on its own skeleton. Metres, y up. Nodes and skin have the same rest
pose. Facts about the motion, and the surface's deviation from the fit's, are in the extras of asset and scene.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gltf
from scipy.spatial.transform import Rotation

from fitting_core.animation.animated import RigSurface, on_standard, surface_deviation, surface_on
from fitting_core.animation.retargeting import RigMotion
from fitting_core.animation.rig import Deviation
from fitting_core.animation.standard import Standard
from fitting_core.body.geometry import vertex_normals
from fitting_core.files.atomic import replacing
from fitting_core.io.motion.gltf_buffer import Buffer
from fitting_core.motion import Motion, Progress, stated

ARMATURE, MESH, FIRST_JOINT = range(3)
"""Nodes: the rig's root, the skinned mesh, then the joints."""
_COLOR = [0.62, 0.68, 0.76, 1.0]


def write_standard_glb(path: Path, motion: Motion, standard: Standard, progress: Progress | None = None) -> Deviation:
    """Write a motion on a standard rig; returns how far the surface will be from the fit's as programs show it. Raises
    OSError if the file cannot be written; nothing is left of it."""
    moving = on_standard(motion, standard)
    surface = surface_on(motion, moving)
    found = surface_deviation(motion, moving, surface, progress)
    document, buffer = skinned_document(motion, moving, surface, said_of(motion, standard, found))
    document.animations = [animation_of(motion, moving, buffer, surface=surface)]
    buffer.close()
    with replacing(path) as draft:
        document.save_binary(str(draft))
    return found


def said_of(motion: Motion, standard: Standard, found: Deviation) -> dict[str, Any]:
    """For the extras."""
    return stated(motion.in_axes("y-up")) | {
        "rig": standard.title,
        "rig_lengths": "the person's",
        "largest_deviation_m": round(found.largest, 7),
        "mean_deviation_m": round(found.mean, 7),
        "deviation": "of the skinned vertices, over at most 64 frames; the joints are where the fit has them",
    }


def skinned_document(
    motion: Motion, moving: RigMotion, surface: RigSurface, said: dict[str, Any]
) -> tuple[gltf.GLTF2, Buffer]:
    """The file without animation, at rest; its buffer is still open."""
    target = moving.target
    document = gltf.GLTF2(
        asset=gltf.Asset(version="2.0", generator="tcfit", extras=said),
        scene=0,
        scenes=[gltf.Scene(name=motion.name, nodes=[ARMATURE, MESH], extras=said)],
        nodes=[gltf.Node(name=motion.name, children=[FIRST_JOINT]), gltf.Node(name="body", mesh=0, skin=0)],
        materials=[_material()],
    )
    document.nodes += joint_nodes(moving)
    buffer = Buffer(document)
    document.meshes = [_mesh(surface, buffer)]
    world = np.tile(np.eye(4), (len(target), 1, 1))
    world[:, :3, :3], world[:, :3, 3] = target.turns, target.places
    inverse = np.linalg.inv(world).swapaxes(-1, -2).astype(np.float32)  # column-major
    document.skins = [
        gltf.Skin(
            joints=[FIRST_JOINT + k for k in range(len(target))],
            skeleton=FIRST_JOINT,
            inverseBindMatrices=buffer.add(inverse.reshape(-1, 16)),
        )
    ]
    return document, buffer


def joint_nodes(moving: RigMotion) -> list[gltf.Node]:
    """The joints at rest, from node FIRST_JOINT on."""
    target = moving.target
    nodes = []
    for k, p in enumerate(target.parents):
        turn, place = target.turns[k], target.places[k]
        if p >= 0:
            turn, place = target.turns[p].T @ turn, target.turns[p].T @ (place - target.places[p])
        children = [FIRST_JOINT + int(child) for child in np.flatnonzero(target.parents == k)]
        rotation = Rotation.from_matrix(turn).as_quat().tolist()
        nodes.append(gltf.Node(name=target.names[k], translation=place.tolist(), rotation=rotation, children=children))
    return nodes


def animation_of(
    motion: Motion, moving: RigMotion, buffer: Buffer, *, surface: RigSurface | None = None
) -> gltf.Animation:
    """The joints' rotations, the pelvis's position and the shapes' weights at the frames' times."""
    target, times = moving.target, np.arange(len(motion)) / motion.frame_rate
    animation = gltf.Animation(name=motion.name, samplers=[], channels=[])
    when = buffer.add(times.astype(np.float32), bounds=True)

    def add(node: int, path: str, values: np.ndarray) -> None:
        output = buffer.add(values.astype(np.float32))
        animation.samplers.append(gltf.AnimationSampler(input=when, output=output, interpolation="LINEAR"))
        channel = gltf.AnimationChannelTarget(node=node, path=path)
        animation.channels.append(gltf.AnimationChannel(sampler=len(animation.samplers) - 1, target=channel))

    places, local = moving.places, moving.local
    for k, p in enumerate(target.parents):
        if k == target.root or p < 0:
            where = places[:, k]
            if p >= 0:
                where = (where - places[:, p]) @ target.turns[p]
            add(FIRST_JOINT + k, "translation", where)
        if target.sources[k] is not None:
            add(FIRST_JOINT + k, "rotation", local[:, k])
    if surface is not None and surface.morphs.names:
        add(MESH, "weights", surface.morphs.weights.ravel())
    return animation


def _mesh(surface: RigSurface, buffer: Buffer) -> gltf.Mesh:
    vertices, morphs = gltf.ARRAY_BUFFER, surface.morphs
    normals = vertex_normals(surface.vertices.astype(float), surface.faces)
    normals = np.where(normals.any(1, keepdims=True), normals, (0.0, 1.0, 0.0)).astype(np.float32)
    primitive = gltf.Primitive(
        attributes=gltf.Attributes(
            POSITION=buffer.add(surface.vertices, vertices, bounds=True),
            NORMAL=buffer.add(normals, vertices),
            JOINTS_0=buffer.add(surface.bones.astype(np.uint8), vertices),
            WEIGHTS_0=buffer.add(surface.weights, vertices),
        ),
        indices=buffer.add(surface.faces.astype(np.uint32).ravel(), gltf.ELEMENT_ARRAY_BUFFER),
        material=0,
        targets=[gltf.Attributes(POSITION=buffer.add(shape, vertices, bounds=True)) for shape in morphs.directions],
    )
    extras = {"targetNames": list(morphs.names), "targetUnits": morphs.units}
    return gltf.Mesh(name="body", primitives=[primitive], extras=extras)


def _material() -> gltf.Material:
    return gltf.Material(
        name="body",
        pbrMetallicRoughness=gltf.PbrMetallicRoughness(baseColorFactor=_COLOR, metallicFactor=0.0, roughnessFactor=0.7),
    )
