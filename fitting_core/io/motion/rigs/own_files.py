"""Export of a motion on the user's own rig: the rig's file with an animation added, or a BVH of its skeleton."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fitting_core.animation.retargeting.retarget import RigMotion
from fitting_core.animation.rigs.own_rig import on_own
from fitting_core.animation.rigs.skeleton import Skeleton
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.io.motion.rigs.gltf_file import GltfFile, read_gltf
from fitting_core.io.motion.rigs.gltf_skeleton import gltf_skeleton
from fitting_core.io.motion.rigs.mapping_file import read_mapping, read_skeleton
from fitting_core.io.motion.rigs.rig_bvh import write_rig_bvh
from fitting_core.motion import Motion, Progress, stated

_FLOAT = 5126


def write_own_glb(path: Path, motion: Motion, mapping_path: Path, progress: Progress | None = None) -> None:
    """Write the rig's own GLB or glTF with all its content, and the motion as its first animation.

    Raises:
        InputError: The mapping or the rig cannot be used, or the rig is a BVH, which has no surface.
        OSError: The file cannot be written; nothing is left of it.
    """
    mapping = read_mapping(mapping_path)
    if mapping.skeleton.suffix.lower() == ".bvh":
        raise InputError(
            f"{mapping_path}: the rig {mapping.skeleton.name} is a BVH, which has no surface for a GLB. Export "
            "rig-bvh, or give the rig as GLB."
        )
    file = read_gltf(mapping.skeleton)
    skeleton, nodes = gltf_skeleton(file)
    moving = on_own(motion, skeleton, mapping.joints)
    animated = _animated(file, moving, nodes, skeleton.world, motion)
    with replacing(path) as draft:
        draft.write_bytes(animated.written())
    if progress:
        progress(1.0)


def write_own_bvh(path: Path, motion: Motion, mapping_path: Path, progress: Progress | None = None) -> None:
    """Write the rig's skeleton with the motion, in the rig's unit and up axis.

    Raises:
        InputError: The mapping or the rig cannot be used.
        OSError: The file cannot be written; nothing is left of it.
    """
    mapping = read_mapping(mapping_path)
    skeleton = read_skeleton(mapping.skeleton)
    moving = on_own(motion, skeleton, mapping.joints)
    kept = None if mapping.skeleton.suffix.lower() == ".bvh" else _jointed(skeleton, moving)
    write_rig_bvh(path, moving, motion.frame_rate, kept=kept, progress=progress)


def _jointed(skeleton: Skeleton, moving: RigMotion) -> list[int]:
    """The pelvis and the joints below it: glTF nodes also include meshes and cameras."""
    target, offered = moving.target, set(skeleton.offered)
    kept = set()
    for k in target.order_below_root:
        if target.names[k] in offered:
            while k not in kept:
                kept.add(k)
                k = k if k == target.root else int(target.parents[k])
    return sorted(kept)


def _animated(file: GltfFile, moving: RigMotion, nodes: list[int], rest: np.ndarray, motion: Motion) -> GltfFile:
    document: dict[str, Any] = file.document
    data = bytearray(file.data + bytes(-len(file.data) % 4))
    add = _adder(document, data)
    when = add((np.arange(len(motion)) / motion.frame_rate).astype("<f4"), "SCALAR", bounds=True)
    animation: dict[str, Any] = {"name": motion.name, "samplers": [], "channels": []}

    def animate(node: int, path: str, values: np.ndarray) -> None:
        output = add(values.astype("<f4"), "VEC3" if values.shape[1] == 3 else "VEC4")
        animation["samplers"].append({"input": when, "output": output, "interpolation": "LINEAR"})
        channel = {"sampler": len(animation["samplers"]) - 1, "target": {"node": node, "path": path}}
        animation["channels"].append(channel)

    target, local = moving.target, moving.local
    for k, source in enumerate(target.sources):
        if source is not None:
            _as_parts(document["nodes"][nodes[k]])
            animate(nodes[k], "rotation", local[:, k])
    above = int(target.parents[target.root])
    into = np.linalg.inv(rest[above]) if above >= 0 else np.eye(4)
    animate(nodes[target.root], "translation", moving.root @ into[:3, :3].T + into[:3, 3])
    document["animations"] = [animation, *document.get("animations", [])]
    extras = document["asset"].get("extras")
    said = stated(motion.in_axes("y-up")) | {"rig": file.path.name, "rig_lengths": "the rig's"}
    document["asset"]["extras"] = (extras if isinstance(extras, dict) else {}) | said
    return GltfFile(document=document, data=bytes(data), path=file.path)


def _adder(document: dict[str, Any], data: bytearray) -> Callable[..., int]:
    """A function that appends an array to a file's data and returns the number of its accessor."""
    views, accessors = (document.setdefault(name, []) for name in ("bufferViews", "accessors"))

    def add(values: np.ndarray, kind: str, *, bounds: bool = False) -> int:
        content = np.ascontiguousarray(values).tobytes()
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(content)})
        data.extend(content + bytes(-len(content) % 4))
        about = {"bufferView": len(views) - 1, "componentType": _FLOAT, "count": len(values), "type": kind}
        if bounds:
            about |= {"min": [float(values.min())], "max": [float(values.max())]}
        accessors.append(about)
        return len(accessors) - 1

    return add


def _as_parts(node: dict[str, Any]) -> None:
    """A node with a matrix cannot be animated: replace it by translation, rotation and scale."""
    if "matrix" in node:
        matrix = np.array(node.pop("matrix"), float).reshape(4, 4).T
        scale = np.linalg.norm(matrix[:3, :3], axis=0)
        node["translation"] = matrix[:3, 3].tolist()
        node["rotation"] = Rotation.from_matrix(matrix[:3, :3] / scale).as_quat().tolist()
        node["scale"] = scale.tolist()
