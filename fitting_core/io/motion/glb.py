"""A motion as binary glTF: an animated, skinned mesh of 55 joints, with expression and correctives as morph targets.

glTF's world is y up in metres, so a motion gets the axes "y-up". The file contains the camera: at the origin, looking
along -z, or, if the floor is known, above the origin and tilted as it was held. A moving camera starts so and is
animated. Frame t of the motion is at t / frame rate seconds. What glTF has no place for (frame rate, first frame,
intrinsics, gender, axes, the largest deviation from the fit) is in the extras of asset and scene.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gltf
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from fitting_core.animation.rig import Deviation, Rig, deviation, rig_of
from fitting_core.body.geometry import vertex_normals
from fitting_core.body.model import JOINTS, N_JOINTS
from fitting_core.files.atomic import replacing
from fitting_core.io.motion.gltf_buffer import Buffer
from fitting_core.motion import Motion, Progress, stated

_AXES = "y-up"
_ROOT, _MESH, _CAMERA, _FIRST_JOINT = range(4)
"""Nodes: the rig's root, the skinned mesh, the camera, then the joints. The next person's follow, without a camera."""
_COLORS = ([0.62, 0.68, 0.76, 1.0], [0.80, 0.62, 0.50, 1.0], [0.55, 0.72, 0.58, 1.0], [0.74, 0.60, 0.76, 1.0])


def write_glb(path: Path, motion: Motion, progress: Progress | None = None) -> Deviation:
    """Write a motion in any axes, and return how far the vertices will be from the fit's as programs show them.

    Raises:
        OSError: The file cannot be written; nothing is left of it.
    """
    return write_people_glb(path, [motion], name=motion.name, progress=progress)[0]


def write_people_glb(
    path: Path, motions: Sequence[Motion], *, name: str, progress: Progress | None = None
) -> list[Deviation]:
    """Write the motions of several people of one clip, each as in `write_glb`.

    Args:
        path: The file.
        motions: Of the same frame rate, camera and level; frames are numbered in one video.
        name: Of the clip.
        progress: Takes the share that is done.

    Raises:
        OSError: The file cannot be written; nothing is left of it.
    """
    tell = progress or (lambda _: None)
    people: list[_Person] = []
    for k, motion in enumerate(motions):
        nodes = _ONE if k == 0 else _ONE.later(1 + k * (2 + N_JOINTS))
        people.append(_person(motion.in_axes(_AXES), nodes, partial(_part_of, tell, k, len(motions))))
    with replacing(path) as draft:
        _document(people, name).save_binary(str(draft))
    return [one.deviation for one in people]


def _part_of(tell: Progress, k: int, count: int, share: float) -> None:
    tell((k + share) / count)


@dataclass(frozen=True)
class _Nodes:
    root: int
    mesh: int
    first_joint: int

    def later(self, start: int) -> "_Nodes":
        """The nodes of the person whose first node has this number."""
        return _Nodes(start, start + 1, start + 2)


_ONE = _Nodes(_ROOT, _MESH, _FIRST_JOINT)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Person:
    motion: Motion
    rig: Rig
    deviation: Deviation
    nodes: _Nodes

    @property
    def stated(self) -> dict[str, Any]:
        """The file's extras."""
        return stated(self.motion) | {
            "largest_deviation_m": round(self.deviation.largest, 7),
            "mean_deviation_m": round(self.deviation.mean, 7),
            "deviation": "of the skinned vertices from the fit's, over all frames",
        }


def _person(motion: Motion, nodes: _Nodes, tell: Progress) -> _Person:
    rig = rig_of(motion)
    return _Person(motion=motion, rig=rig, deviation=deviation(rig, motion, tell), nodes=nodes)


def _document(people: list[_Person], name: str) -> gltf.GLTF2:
    said = people[0].stated if len(people) == 1 else {"name": name, "people": [one.stated for one in people]}
    tops = [node for one in people for node in (one.nodes.root, one.nodes.mesh)]
    document = gltf.GLTF2(
        asset=gltf.Asset(version="2.0", generator="tcfit", extras=said),
        scene=0,
        scenes=[gltf.Scene(name=name, nodes=[*tops[:2], _CAMERA, *tops[2:]], extras=said)],
        nodes=_nodes(people),
        cameras=[_camera(people[0].motion)],
        materials=[_material(k) for k in range(len(people))],
    )
    buffer = Buffer(document)
    document.meshes = [_mesh(one.rig, buffer, k) for k, one in enumerate(people)]
    document.skins = [_skin(one, buffer) for one in people]
    document.animations = [_animation(people, name, buffer)]
    buffer.close()
    return document


def _skin(one: _Person, buffer: Buffer) -> gltf.Skin:
    inverse = np.tile(np.eye(4, dtype=np.float32), (N_JOINTS, 1, 1))
    inverse[:, 3, :3] = -one.rig.joints  # column-major: the translation is the last row here
    first = one.nodes.first_joint
    return gltf.Skin(
        joints=[first + j for j in range(N_JOINTS)],
        skeleton=first,
        inverseBindMatrices=buffer.add(inverse.reshape(-1, 16)),
    )


def _nodes(people: list[_Person]) -> list[gltf.Node]:
    nodes: list[gltf.Node] = []
    for k, one in enumerate(people):
        name = "body" if len(people) == 1 else f"{one.motion.name} body"
        nodes.append(gltf.Node(name=one.motion.name, children=[one.nodes.first_joint]))
        nodes.append(gltf.Node(name=name, mesh=k, skin=k))
        nodes += [_camera_node(people)] if k == 0 else []
        nodes += _joint_nodes(one)
    return nodes


def _joint_nodes(one: _Person) -> list[gltf.Node]:
    rig, first = one.rig, one.nodes.first_joint
    offsets = rig.joints.copy()
    offsets[1:] -= rig.joints[rig.parents[1:]]
    offsets[0] = rig.places[0]
    return [
        gltf.Node(
            name=JOINTS[j],
            translation=offsets[j].tolist(),
            rotation=rig.turns[0, j].tolist(),
            children=[first + int(child) for child in np.flatnonzero(rig.parents == j)],
        )
        for j in range(N_JOINTS)
    ]


def _camera_node(people: list[_Person]) -> gltf.Node:
    """Where the camera stands. A glTF camera looks along -z with y up; ours along z with y down."""
    _, places, turns = _camera_poses(people)
    return gltf.Node(name="camera", camera=0, translation=places[0].tolist(), rotation=turns[0].tolist())


def _camera_poses(people: list[_Person]) -> tuple[list[int], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"]]:
    """Frame numbers, and the camera's positions and rotations (quaternions) in them; for a static one, once."""
    places: dict[int, np.ndarray] = {}
    turns: dict[int, np.ndarray] = {}
    for motion in (one.motion for one in people):
        for t, place in enumerate(motion.camera_place.reshape(-1, 3)):
            places[motion.first_frame + t] = place
        for t, turn in enumerate(motion.camera_to_world.reshape(-1, 3, 3)):
            turns[motion.first_frame + t] = turn @ np.diag([1.0, -1.0, -1.0])
    frames = sorted(places)
    quaternions = Rotation.from_matrix([turns[frame] for frame in frames]).as_quat()
    return frames, np.array([places[frame] for frame in frames]), _without_jumps(quaternions)


def _without_jumps(quaternions: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """The quaternions with signs chosen to be near the previous one, since programs interpolate linearly."""
    crossed = (quaternions[1:] * quaternions[:-1]).sum(1) < 0
    return quaternions * np.where(np.append(False, np.cumsum(crossed) % 2 == 1), -1.0, 1.0)[:, None]


def _camera(motion: Motion) -> gltf.Camera:
    """Field of view and aspect ratio; an off-centre principal point is only in the extras."""
    (_, focal), (width, height) = motion.camera.focal, motion.camera.size
    return gltf.Camera(
        type="perspective",
        perspective=gltf.Perspective(
            yfov=2 * math.atan(height / 2 / focal), aspectRatio=width / height, znear=0.05, zfar=100.0
        ),
        extras=stated(motion)["intrinsics"],
    )


def _material(person: int) -> gltf.Material:
    return gltf.Material(
        name="body" if person == 0 else f"body {person + 1}",
        pbrMetallicRoughness=gltf.PbrMetallicRoughness(
            baseColorFactor=_COLORS[person % len(_COLORS)], metallicFactor=0.0, roughnessFactor=0.7
        ),
    )


def _mesh(rig: Rig, buffer: Buffer, person: int) -> gltf.Mesh:
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
        material=person,
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
    normals = vertex_normals(rig.vertices.astype(float), rig.faces)
    return np.where(normals.any(1, keepdims=True), normals, (0.0, 1.0, 0.0)).astype(np.float32)


def _animation(people: list[_Person], name: str, buffer: Buffer) -> gltf.Animation:
    animation = gltf.Animation(name=name, samplers=[], channels=[])
    rate = people[0].motion.frame_rate
    begins = min(one.motion.first_frame for one in people)
    ends = max(one.motion.first_frame + len(one.motion) for one in people)
    times: dict[bytes, int] = {}

    def times_of(frames: Int[np.ndarray, "n"]) -> int:
        at = ((frames - begins) / rate).astype(np.float32)
        if at.tobytes() not in times:
            times[at.tobytes()] = buffer.add(at, bounds=True)
        return times[at.tobytes()]

    def add(frames: Int[np.ndarray, "n"], node: int, path: str, values: np.ndarray, how: str = "LINEAR") -> None:
        output = buffer.add(values.astype(np.float32).ravel() if path == "weights" else values.astype(np.float32))
        animation.samplers.append(gltf.AnimationSampler(input=times_of(frames), output=output, interpolation=how))
        target = gltf.AnimationChannelTarget(node=node, path=path)
        animation.channels.append(gltf.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))

    if people[0].motion.camera.path is not None:
        frames, places, turns = _camera_poses(people)
        add(np.array(frames), _CAMERA, "translation", places)
        add(np.array(frames), _CAMERA, "rotation", turns)
    for one in people:
        rig, nodes = one.rig, one.nodes
        first, last = one.motion.first_frame, one.motion.first_frame + len(one.motion)
        frames = np.arange(first, last)
        add(frames, nodes.first_joint, "translation", rig.places)
        for j in range(N_JOINTS):
            add(frames, nodes.first_joint + j, "rotation", rig.turns[:, j])
        if rig.morphs.names:
            add(frames, nodes.mesh, "weights", rig.morphs.weights)
        if (first, last) != (begins, ends):
            turning = sorted({begins, first, min(last, ends - 1)})
            there = np.array([[float(first <= frame < last)] * 3 for frame in turning])
            add(np.array(turning), nodes.root, "scale", there, "STEP")
    return animation
