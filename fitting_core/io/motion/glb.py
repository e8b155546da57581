"""A motion as binary glTF: an animated, skinned mesh of 55 joints, with expression and correctives as morph targets.

glTF's world is y up in metres, so a motion gets the axes "y-up". The file contains the camera: at the origin, looking
along -z, or, if the floor is known, above the origin and tilted as it was held. A moving camera starts so and is
animated. Frame t of the motion is at t / frame rate seconds. What glTF has no place for (frame rate, first frame,
intrinsics, gender, axes, the largest deviation from the fit) is in the extras of asset and scene.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gltf
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.animation.animated import RigSurface, on_own_skeleton, surface_deviation, surface_on
from fitting_core.animation.retargeting import RigMotion, same_hemisphere
from fitting_core.body.model import N_JOINTS
from fitting_core.io.motion.rig_glb import Channels, GltfFile, joint_nodes, material_of, mesh_of, skin_of
from fitting_core.motion import Motion, Progress, stated

_AXES = "y-up"
_ROOT, _MESH, _CAMERA, _FIRST_JOINT = range(4)
"""Nodes: the rig's root, the skinned mesh, the camera, then the joints. The next person's follow, without a camera."""


def write_glb(path: Path, motion: Motion, progress: Progress | None = None) -> None:
    """Write a motion in any axes; the file says how far the vertices are from the fit's as programs show them.

    Raises:
        OSError: The file cannot be written; nothing is left of it.
    """
    write_people_glb(path, [motion], name=motion.name, progress=progress)


def write_people_glb(path: Path, motions: Sequence[Motion], *, name: str, progress: Progress | None = None) -> None:
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
        people.append(_person(motion.in_axes(_AXES), k, lambda share, k=k: tell((k + share) / len(motions))))
    _file_of(people, name).save(path)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Person:
    motion: Motion
    moving: RigMotion
    surface: RigSurface
    stated: dict[str, Any]
    """The file's extras."""
    root: int
    """The first of its nodes; the mesh is the second one."""
    first_joint: int


def _person(motion: Motion, k: int, tell: Progress) -> _Person:
    moving = on_own_skeleton(motion)
    surface = surface_on(motion, moving)
    said = stated(motion) | surface_deviation(motion, moving, surface, tell)
    root, first_joint = (1 + k * (2 + N_JOINTS), 3 + k * (2 + N_JOINTS)) if k else (_ROOT, _FIRST_JOINT)
    return _Person(motion=motion, moving=moving, surface=surface, stated=said, root=root, first_joint=first_joint)


def _file_of(people: list[_Person], name: str) -> GltfFile:
    said = people[0].stated if len(people) == 1 else {"name": name, "people": [one.stated for one in people]}
    tops = [node for one in people for node in (one.root, one.root + _MESH)]
    file = GltfFile(name, said, _nodes(people), [*tops[:2], _CAMERA, *tops[2:]])
    document = file.document
    document.cameras = [_camera(people[0].motion)]
    document.materials = [material_of(k) for k in range(len(people))]
    document.meshes = [mesh_of(one.surface, file, k) for k, one in enumerate(people)]
    for one, mesh in zip(people, document.meshes, strict=True):
        mesh.weights = one.surface.morphs.weights[0].tolist()
    document.skins = [skin_of(one.moving.target, file, one.first_joint) for one in people]
    document.animations = [_animation(people, name, file)]
    return file


def _nodes(people: list[_Person]) -> list[gltf.Node]:
    nodes: list[gltf.Node] = []
    for k, one in enumerate(people):
        name = "body" if len(people) == 1 else f"{one.motion.name} body"
        nodes.append(gltf.Node(name=one.motion.name, children=[one.first_joint]))
        nodes.append(gltf.Node(name=name, mesh=k, skin=k))
        nodes += [_camera_node(people)] if k == 0 else []
        nodes += joint_nodes(one.moving, one.first_joint, posed=True)
    return nodes


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
    return frames, np.array([places[frame] for frame in frames]), same_hemisphere(quaternions)


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


def _animation(people: list[_Person], name: str, file: GltfFile) -> gltf.Animation:
    channels, rate = Channels(name, file), people[0].motion.frame_rate
    begins = min(one.motion.first_frame for one in people)
    ends = max(one.motion.first_frame + len(one.motion) for one in people)

    def seconds(frames: Sequence[int] | range) -> Float[np.ndarray, "n"]:
        return (np.array(frames) - begins) / rate

    if people[0].motion.camera.path is not None:
        frames, places, turns = _camera_poses(people)
        channels.add(seconds(frames), _CAMERA, "translation", places)
        channels.add(seconds(frames), _CAMERA, "rotation", turns)
    for one in people:
        first, last = one.motion.first_frame, one.motion.first_frame + len(one.motion)
        own = seconds(range(first, last))
        channels.add_joints(own, one.moving, one.first_joint)
        if one.surface.morphs.names:
            channels.add(own, one.root + _MESH, "weights", one.surface.morphs.weights)
        if (first, last) != (begins, ends):
            turning = sorted({begins, first, min(last, ends - 1)})
            there = np.array([[float(first <= frame < last)] * 3 for frame in turning])
            channels.add(seconds(turning), one.root, "scale", there, "STEP")
    return channels.animation
