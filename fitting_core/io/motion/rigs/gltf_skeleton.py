"""The nodes of a glTF file as a skeleton. The rest pose is that of its nodes when nothing is animated."""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.errors import InputError
from fitting_core.io.motion.rigs.gltf_file import GltfFile
from fitting_core.io.motion.rigs.skeleton import Skeleton


def gltf_skeleton(file: GltfFile) -> tuple[Skeleton, list[int]]:
    """The skeleton, and each joint's node.

    Raises:
        InputError: The nodes are no tree, or a transform is none.
    """
    nodes = file.document.get("nodes")
    try:
        if not isinstance(nodes, list) or not nodes:
            raise ValueError("it has no nodes")
        order, parents = _order(nodes)
        local = np.stack([_local(nodes[n]) for n in order])
        jointed = {n for skin in file.document.get("skins", []) for n in skin["joints"]}
    except (ValueError, KeyError, IndexError, TypeError, AttributeError) as error:
        said = f"it lacks {error}" if isinstance(error, KeyError) else error
        raise InputError(f"{file.path}: its skeleton cannot be read: {said}. Export the rig again as GLB.") from error
    place = {n: j for j, n in enumerate(order)}
    names = tuple(str(nodes[n].get("name") or f"node {n}") for n in order)
    skeleton = Skeleton(
        names=names,
        parents=np.array([place.get(parents[n], -1) for n in order]),
        local=local,
        offered=tuple(names[place[n]] for n in order if n in jointed) or names,
        source=str(file.path),
    )
    return skeleton, order


def _order(nodes: list[dict[str, Any]]) -> tuple[list[int], list[int]]:
    """Nodes so that parents stand first, and the parent of each."""
    parents = [-1] * len(nodes)
    for n, node in enumerate(nodes):
        for child in node.get("children", []):
            if not 0 <= child < len(nodes) or parents[child] >= 0 or child == n:
                raise ValueError(f"node {child!r} is the child of two nodes, of itself, or is not there")
            parents[child] = n
    order = [n for n, parent in enumerate(parents) if parent < 0]
    for n in order:
        order += nodes[n].get("children", [])
    if len(order) < len(nodes):
        raise ValueError("its nodes run in a circle")
    return order, parents


def _local(node: dict[str, Any]) -> Float[np.ndarray, "4 4"]:
    if "matrix" in node:
        matrix = np.array(node["matrix"], float).reshape(4, 4).T
    else:
        turn = np.array(node.get("rotation", (0, 0, 0, 1)), float)
        if turn.shape != (4,) or not np.linalg.norm(turn) > 0:
            raise ValueError(f"the rotation {turn.tolist()} is no quaternion")
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(turn).as_matrix() * np.broadcast_to(node.get("scale", (1, 1, 1)), 3)
        matrix[:3, 3] = node.get("translation", (0, 0, 0))
    if not np.isfinite(matrix).all():
        raise ValueError("a transform is not finite")
    return matrix
