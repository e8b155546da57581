"""The nodes of a glTF file as a skeleton. Their transforms without animation are the rest pose."""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.animation.rigs.skeleton import Skeleton
from fitting_core.errors import InputError
from fitting_core.io.motion.rigs.gltf_file import WRONG, GltfFile, said_of

_NODES = 4096


def gltf_skeleton(file: GltfFile) -> tuple[Skeleton, list[int]]:
    """The skeleton, and each joint's node. Raises InputError if the nodes are not a tree, or a transform is invalid."""
    nodes = file.document.get("nodes")
    try:
        if not isinstance(nodes, list) or not nodes:
            raise ValueError("it has no nodes")
        order, parents = _order(nodes)
        local = np.stack([_local(nodes[n]) for n in order])
        bones = _human_bones(file.document.get("extensions", {}), order)
        jointed = {n for skin in file.document.get("skins", []) for n in skin["joints"]}
    except WRONG as error:
        raise InputError(
            f"{file.path}: its skeleton cannot be read: {said_of(error)}. Export the rig again as GLB."
        ) from error
    jointed = _with_those_between(nodes, order, jointed)
    names = {n: str(nodes[n].get("name") or f"node {n}") for n in order}
    offered = tuple(names[n] for n in order if n in jointed)
    for n in order:  # a mesh named Head is not the bone Head
        if n not in jointed and names[n] in offered:
            names[n] += f" (node {n})"
    place = {n: j for j, n in enumerate(order)}
    skeleton = Skeleton(
        names=tuple(names.values()),
        parents=np.array([place.get(parents[n], -1) for n in order]),
        local=local,
        offered=offered or tuple(names.values()),
        stated={bone: names[n] for bone, n in bones.items()},
        source=str(file.path),
    )
    return skeleton, order


def _order(nodes: list[dict[str, Any]]) -> tuple[list[int], list[int]]:
    """Nodes, parents first, and the parent of each."""
    if len(nodes) > _NODES:
        raise ValueError(f"it has {len(nodes)} nodes, expected at most {_NODES}: the character alone")
    parents = [-1] * len(nodes)
    for n, node in enumerate(nodes):
        for child in node.get("children", []):
            if not 0 <= child < len(nodes) or parents[child] >= 0 or child == n:
                raise ValueError(f"node {child!r} is the child of two nodes or of itself, or does not exist")
            parents[child] = n
    order = [n for n, parent in enumerate(parents) if parent < 0]
    for n in order:
        order += nodes[n].get("children", [])
    if len(order) < len(nodes):
        raise ValueError("its nodes form a cycle")
    return order, parents


def _human_bones(extensions: dict[str, Any], order: list[int]) -> dict[str, int]:
    """Nodes by VRM bone name, parents first; empty if it is neither VRM 1.0 nor 0."""
    if "VRMC_vrm" in extensions:
        found = {name: bone["node"] for name, bone in extensions["VRMC_vrm"]["humanoid"]["humanBones"].items()}
    elif "VRM" in extensions:
        found = {bone["bone"]: bone["node"] for bone in extensions["VRM"]["humanoid"]["humanBones"]}
    else:
        return {}
    return dict(sorted(found.items(), key=lambda item: order.index(item[1])))


def _with_those_between(nodes: list[dict[str, Any]], order: list[int], jointed: set[int]) -> set[int]:
    """Joints of the skins, and the nodes between and above them up to their common root, as hips without vertices."""
    below = {n: int(n in jointed) for n in order}
    for n in reversed(order):
        below[n] += sum(below[child] for child in nodes[n].get("children", []))
    most = max(below.values())
    return {
        n
        for n in order
        if n in jointed or (below[n] and all(below[child] < most for child in nodes[n].get("children", [])))
    }


def _local(node: dict[str, Any]) -> Float[np.ndarray, "4 4"]:
    if "matrix" in node:
        matrix = np.array(node["matrix"], float).reshape(4, 4).T
    else:
        turn = np.array(node.get("rotation", (0, 0, 0, 1)), float)
        if turn.shape != (4,) or not np.linalg.norm(turn) > 0:
            raise ValueError(f"the rotation {turn.tolist()} is not a quaternion")
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(turn).as_matrix() * np.broadcast_to(node.get("scale", (1, 1, 1)), 3)
        matrix[:3, 3] = node.get("translation", (0, 0, 0))
    if not np.isfinite(matrix).all():
        raise ValueError("a transform is not finite")
    return matrix
