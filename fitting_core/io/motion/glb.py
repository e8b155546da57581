"""A motion as binary glTF: one skinned mesh of 55 joints, its expression and correctives as morph targets, animated.

glTF's world is y up in metres, so a motion gets the axes "y-up". The camera is in the file: it stands at the origin and
looks along -z, or, where the floor is known, stands above the origin and looks as it was held. One that moves begins
so, and is animated. Frame t of the motion is at t / frame rate seconds. Everything that glTF has no place for (frame
rate, first frame, intrinsics, gender, axes, the largest deviation from the fit) is in the extras of asset and scene.
"""

import math
from pathlib import Path

import numpy as np
import pygltflib as gltf
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.body.geometry import vertex_normals
from fitting_core.body.model import JOINTS, N_JOINTS
from fitting_core.files.atomic import replacing
from fitting_core.io.motion.fitted_motion import Motion, Progress, stated
from fitting_core.io.motion.rig import Deviation, Rig, deviation, rig_of

_AXES = "y-up"
_ROOT, _MESH, _CAMERA, _FIRST_JOINT = range(4)
"""Nodes: the rig as a whole, what is skinned, the camera, and the joints one after the other."""
_COLOR = [0.62, 0.68, 0.76, 1.0]
_TYPES = {
    np.dtype(np.float32): gltf.FLOAT,
    np.dtype(np.uint32): gltf.UNSIGNED_INT,
    np.dtype(np.uint8): gltf.UNSIGNED_BYTE,
}
_SHAPES = {(): gltf.SCALAR, (3,): gltf.VEC3, (4,): gltf.VEC4, (16,): gltf.MAT4}


def write_glb(path: Path, motion: Motion, progress: Progress | None = None) -> Deviation:
    """Write a motion; how far its vertices will be from the fit's where a program shows it.

    Raises:
        OSError: The file cannot be written; nothing is left of it.
    """
    upright = motion.in_axes(_AXES)
    rig = rig_of(upright)
    found = deviation(rig, upright, progress)
    with replacing(path) as draft:
        _document(rig, upright, found).save_binary(str(draft))
    return found


class _Buffer:
    """The file's data, array by array."""

    def __init__(self, document: gltf.GLTF2) -> None:
        self._document, self._parts, self._size = document, [], 0

    def add(self, array: np.ndarray, target: int | None = None, *, bounds: bool = False) -> int:
        """Append an array; the number of its accessor."""
        array = np.ascontiguousarray(array)
        content = array.tobytes()
        document = self._document
        document.bufferViews.append(
            gltf.BufferView(buffer=0, byteOffset=self._size, byteLength=len(content), target=target)
        )
        accessor = gltf.Accessor(
            bufferView=len(document.bufferViews) - 1,
            componentType=_TYPES[array.dtype],
            count=len(array),
            type=_SHAPES[array.shape[1:]],
        )
        if bounds:
            accessor.min, accessor.max = (np.atleast_1d(f(array, 0)).tolist() for f in (np.min, np.max))
        document.accessors.append(accessor)
        padding = -len(content) % 4
        self._parts += [content, bytes(padding)]
        self._size += len(content) + padding
        return len(document.accessors) - 1

    def close(self) -> None:
        """Make it the document's."""
        self._document.buffers = [gltf.Buffer(byteLength=self._size)]
        self._document.set_binary_blob(b"".join(self._parts))


def _document(rig: Rig, motion: Motion, found: Deviation) -> gltf.GLTF2:
    said = stated(motion) | {
        "largest_deviation_m": round(found.largest, 7),
        "mean_deviation_m": round(found.mean, 7),
        "deviation": "of the skinned vertices from the fit's, over all frames",
    }
    document = gltf.GLTF2(
        asset=gltf.Asset(version="2.0", generator="tcfit", extras=said),
        scene=0,
        scenes=[gltf.Scene(name=motion.name, nodes=[_ROOT, _MESH, _CAMERA], extras=said)],
        nodes=_nodes(rig, motion),
        cameras=[_camera(motion)],
        materials=[_material()],
    )
    buffer = _Buffer(document)
    document.meshes = [_mesh(rig, buffer)]
    inverse = np.tile(np.eye(4, dtype=np.float32), (N_JOINTS, 1, 1))
    inverse[:, 3, :3] = -rig.joints  # column-major: the translation is the last row here
    joints = [_FIRST_JOINT + j for j in range(N_JOINTS)]
    document.skins = [
        gltf.Skin(joints=joints, skeleton=_FIRST_JOINT, inverseBindMatrices=buffer.add(inverse.reshape(-1, 16)))
    ]
    document.animations = [_animation(rig, motion, buffer)]
    buffer.close()
    return document


def _nodes(rig: Rig, motion: Motion) -> list[gltf.Node]:
    offsets = rig.joints.copy()
    offsets[1:] -= rig.joints[rig.parents[1:]]
    offsets[0] = rig.places[0]
    joints = [
        gltf.Node(
            name=JOINTS[j],
            translation=offsets[j].tolist(),
            rotation=rig.turns[0, j].tolist(),
            children=[_FIRST_JOINT + int(child) for child in np.flatnonzero(rig.parents == j)],
        )
        for j in range(N_JOINTS)
    ]
    return [
        gltf.Node(name=motion.name, children=[_FIRST_JOINT]),
        gltf.Node(name="body", mesh=0, skin=0),
        _camera_node(motion),
        *joints,
    ]


def _camera_node(motion: Motion) -> gltf.Node:
    """Where the camera stands. That of glTF looks along -z with y up: the one here along z with y down."""
    places, turns = _camera_poses(motion)
    return gltf.Node(name="camera", camera=0, translation=places[0].tolist(), rotation=turns[0].tolist())


def _camera_poses(motion: Motion) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"]]:
    """Where it is and how it is turned, a unit quaternion, once or in each frame."""
    turn = motion.camera_to_world.reshape(-1, 3, 3) @ np.diag([1.0, -1.0, -1.0])
    return motion.camera_place.reshape(-1, 3), _without_jumps(Rotation.from_matrix(turn).as_quat())


def _without_jumps(quaternions: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """The same turns by quaternions of which each is on the side of the one before: programs go straight between."""
    crossed = (quaternions[1:] * quaternions[:-1]).sum(1) < 0
    return quaternions * np.where(np.append(False, np.cumsum(crossed) % 2 == 1), -1.0, 1.0)[:, None]


def _camera(motion: Motion) -> gltf.Camera:
    """The opening angle and the proportions; where the principal point is off the middle, only the extras say it."""
    (_, focal), (width, height) = motion.camera.focal, motion.camera.size
    return gltf.Camera(
        type="perspective",
        perspective=gltf.Perspective(
            yfov=2 * math.atan(height / 2 / focal), aspectRatio=width / height, znear=0.05, zfar=100.0
        ),
        extras=stated(motion)["intrinsics"],
    )


def _material() -> gltf.Material:
    return gltf.Material(
        name="body",
        pbrMetallicRoughness=gltf.PbrMetallicRoughness(baseColorFactor=_COLOR, metallicFactor=0.0, roughnessFactor=0.7),
    )


def _mesh(rig: Rig, buffer: _Buffer) -> gltf.Mesh:
    vertices = gltf.ARRAY_BUFFER
    attributes = gltf.Attributes(
        POSITION=buffer.add(rig.vertices, vertices, bounds=True),
        NORMAL=buffer.add(_normals(rig), vertices),
        JOINTS_0=buffer.add(rig.bones.astype(np.uint8), vertices),
        WEIGHTS_0=buffer.add(rig.weights, vertices),
    )
    primitive = gltf.Primitive(
        attributes=attributes,
        indices=buffer.add(rig.faces.astype(np.uint32).ravel(), gltf.ELEMENT_ARRAY_BUFFER),
        material=0,
        targets=[gltf.Attributes(POSITION=buffer.add(shape, vertices, bounds=True)) for shape in rig.morphs.directions],
    )
    mesh = gltf.Mesh(
        name="body",
        primitives=[primitive],
        extras={"targetNames": list(rig.morphs.names), "targetUnits": rig.morphs.units},
    )
    if rig.morphs.names:
        mesh.weights = rig.morphs.weights[0].tolist()
    return mesh


def _normals(rig: Rig) -> Float[np.ndarray, "V 3"]:
    """Unit normals of the rest pose."""
    normals = vertex_normals(rig.vertices.astype(float), rig.faces)
    return np.where(normals.any(1, keepdims=True), normals, (0.0, 1.0, 0.0)).astype(np.float32)


def _animation(rig: Rig, motion: Motion, buffer: _Buffer) -> gltf.Animation:
    times = buffer.add((np.arange(len(motion)) / motion.frame_rate).astype(np.float32), bounds=True)
    animation = gltf.Animation(name=motion.name, samplers=[], channels=[])

    def add(node: int, path: str, values: np.ndarray) -> None:
        output = buffer.add(values.astype(np.float32))
        animation.samplers.append(gltf.AnimationSampler(input=times, output=output, interpolation="LINEAR"))
        target = gltf.AnimationChannelTarget(node=node, path=path)
        animation.channels.append(gltf.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))

    if motion.camera.path is not None:
        places, turns = _camera_poses(motion)
        add(_CAMERA, "translation", places)
        add(_CAMERA, "rotation", turns)
    add(_FIRST_JOINT, "translation", rig.places)
    for j in range(N_JOINTS):
        add(_FIRST_JOINT + j, "rotation", rig.turns[:, j])
    if rig.morphs.names:
        add(_MESH, "weights", rig.morphs.weights.ravel())
    return animation
