"""What a body's points are made of: constant tables of (point, bone) pairs (see body_points.py)."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, N_JOINTS, BodyModel


@dataclass(frozen=True)
class Joint:
    """A kinematic joint."""

    joint: int


@dataclass(frozen=True)
class Surface:
    """A weighted sum of vertices: one vertex, or a barycentric point of a triangle."""

    vertices: tuple[int, ...]
    weights: tuple[float, ...]


@dataclass(frozen=True)
class Offset:
    """A point at a joint's rest position plus an offset, moving with a bone."""

    joint: int
    bone: int
    offset: tuple[float, float, float]


@dataclass(frozen=True)
class Carried:
    """A weighted sum of vertices at rest that one bone carries rigidly, without pose correctives."""

    vertices: tuple[int, ...]
    weights: tuple[float, ...]
    bone: int


@dataclass(frozen=True)
class Contour:
    """One of the 17 face contour landmarks, whose place on the mesh depends on the head's yaw."""

    landmark: int


Point = Joint | Surface | Offset | Carried | Contour


def vertex(index: int) -> Surface:
    """A single vertex."""
    return Surface((index,), (1.0,))


@dataclass(frozen=True)
class PairTable:
    """Constants of the pairs of some points. With several variants (contour tables), the first axis counts them."""

    point: Int[Tensor, "P"]
    """Which of the points each pair belongs to."""
    bone: Int[Tensor, "P"]
    weight: Float[Tensor, "K P"]
    template: Float[Tensor, "K P 3"]
    directions: Float[Tensor, "K P 3 20"]
    driving: Int[Tensor, "n"]
    """Joints whose rotation drives a corrective of one of the pairs."""
    correctives: Float[Tensor, "K P*3 n*9"]

    def to(self, dtype: torch.dtype, device: torch.device) -> "PairTable":
        """The same table in another type and on another device."""
        floats = {
            n: getattr(self, n).to(dtype=dtype, device=device)
            for n in ("weight", "template", "directions", "correctives")
        }
        return replace(self, **floats, **{n: getattr(self, n).to(device) for n in ("point", "bone", "driving")})

    def _variant(self, table: Tensor, variant: Tensor | None) -> Tensor:
        if len(table) == 1:
            return table
        assert variant is not None, "contour landmarks need the head's yaw table of each frame"
        return table[variant]

    def weights(self, variant: Tensor | None) -> Float[Tensor, "B P"]:
        """Sum of skinning weights of each pair; one row if all frames share it."""
        return self._variant(self.weight, variant)

    def direction(self, variant: Tensor | None) -> Float[Tensor, "B P 3 20"]:
        """Derivative of the pair vectors by betas and expression; one row if all frames share it."""
        return self._variant(self.directions, variant)

    def vectors(
        self, coefficients: Tensor, local: Float[Tensor, "B 55 3 3"], variant: Tensor | None
    ) -> Float[Tensor, "B P 3"]:
        """The pair vectors in the rest pose: template, shape, expression and pose correctives."""
        frames, pairs = len(coefficients), len(self.bone)
        identity = torch.eye(3, dtype=local.dtype, device=local.device)
        features = (local[:, self.driving] - identity).flatten(1)
        if len(self.template) == 1:
            moved = coefficients @ self.directions[0].flatten(0, 1).T + features @ self.correctives[0].T
        else:
            directions = self._variant(self.directions, variant).flatten(1, 2)
            correctives = self._variant(self.correctives, variant)
            moved = (directions @ coefficients[..., None] + correctives @ features[..., None])[..., 0]
        return self._variant(self.template, variant) + moved.view(frames, pairs, 3)


def pairs_of(
    body: BodyModel, points: list[Point], rest: np.ndarray, directions: np.ndarray, moves: np.ndarray
) -> PairTable:
    """The pairs of points that do not depend on the head's yaw."""
    rows: list[tuple] = []
    for i, p in enumerate(points):
        if isinstance(p, Offset | Carried):
            if isinstance(p, Offset):
                place, move = rest[p.joint] + p.offset, moves[p.joint]
            else:
                place, move = (np.tensordot(p.weights, a[list(p.vertices)], 1) for a in (body.template, directions))
            rows.append((i, p.bone, 1.0, place, move, np.zeros((3, 9 * (N_JOINTS - 1)))))
            continue
        assert isinstance(p, Surface)
        vertices, weights = np.array(p.vertices), np.array(p.weights)
        for bone in np.flatnonzero(body.skinning_weights[vertices].max(0) > 0):
            rows.append((i, bone, *_weighted(body, vertices, weights, np.asarray(bone), directions)))
    if not rows:
        empty = np.zeros((0, 3))
        return _table(
            [], [], np.zeros((1, 0)), empty[None], np.zeros((1, 0, 3, 20)), np.zeros((1, 0, 3, 9 * (N_JOINTS - 1)))
        )
    point, bone, weight, template, direction, corrective = zip(*rows, strict=True)
    return _table(
        point,
        bone,
        np.array(weight)[None],
        np.array(template)[None],
        np.array(direction)[None],
        np.array(corrective)[None],
    )


def contour_pairs(body: BodyModel, landmarks: list[int], directions: np.ndarray) -> PairTable:
    """The pairs of contour landmarks, one variant for each yaw table; its bones are those of all tables."""
    point, bone = [], []
    for i, landmark in enumerate(landmarks):
        used = body.skinning_weights[body.contour_vertices[:, landmark]].max((0, 1)) > 0
        point += [i] * int(used.sum())
        bone += list(np.flatnonzero(used))
    owner = np.array(landmarks)[point]
    parts = [
        _weighted(body, vertices[owner], weights[owner], np.array(bone), directions)
        for vertices, weights in zip(body.contour_vertices, body.contour_weights, strict=True)
    ]
    return _table(point, bone, *(np.array(a) for a in zip(*parts, strict=True)))


def _weighted(
    body: BodyModel,
    vertices: Int[np.ndarray, "*n k"],
    weights: Float[np.ndarray, "*n k"],
    bone: Int[np.ndarray, "*n"],
    directions: np.ndarray,
) -> tuple:
    """Weight, template, directions and correctives of the part of surface points that one bone of each carries."""
    c = weights * body.skinning_weights[vertices, bone[..., None]]
    sums = [
        (c[..., None, :] @ a.reshape(*vertices.shape, -1)).reshape(*bone.shape, *a.shape[vertices.ndim :])
        for a in (body.template[vertices], directions[vertices], body.correctives_of(vertices))
    ]
    return c.sum(-1), *sums


def _table(
    point, bone, weight: np.ndarray, template: np.ndarray, directions: np.ndarray, correctives: np.ndarray
) -> PairTable:
    by_joint = correctives.reshape(*correctives.shape[:3], N_JOINTS - 1, 9)
    used = np.flatnonzero(abs(by_joint).max((0, 1, 2, 4)) > 0) if correctives.size else np.zeros(0, int)
    kept = by_joint[:, :, :, used].reshape(len(correctives), 3 * correctives.shape[1], 9 * len(used))
    index = [torch.as_tensor(np.array(a, dtype=np.int64)) for a in (point, bone, used + 1)]
    floats = [torch.as_tensor(np.ascontiguousarray(a)) for a in (weight, template, directions, kept)]
    points, bones, driving = index
    weights, templates, moves, bends = floats
    return PairTable(points, bones, weights, templates, moves, driving, bends)


_JOINT_KEYPOINTS = {
    "neck": "neck", "mid_hip": "pelvis",
    **{f"{side}_{part}": f"{side}_{part}" for side in ("left", "right")
       for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")},
}  # fmt: skip


def keypoint_points(body: BodyModel) -> list[Point | None]:
    """Where each of the 137 keypoints lies on the body, in their order; None where the model has no such point."""
    named: dict[str, Point] = {n: Joint(JOINT[j]) for n, j in _JOINT_KEYPOINTS.items()}
    named |= {n: vertex(v) for n, v in body.surface_keypoints.items() if n in kp.BODY_25}
    named |= {n: Offset(JOINT[o.joint], JOINT[o.bone], o.offset) for n, o in body.keypoint_offsets.items()}
    points: list[Point | None] = [named.get(n) for n in kp.BODY_25]
    for side in ("left", "right"):
        points.append(Joint(JOINT[f"{side}_wrist"]))
        for finger in ("thumb", "index", "middle", "ring", "pinky"):
            points += [Joint(JOINT[f"{side}_{finger}{k}"]) for k in (1, 2, 3)]
            tip = body.surface_keypoints.get(f"{side}_{finger}")
            points.append(None if tip is None else vertex(tip))
    if len(body.contour_vertices):
        points += [Contour(i) for i in range(17)]
    else:
        points += [None] * 17
    faces = zip(body.landmark_vertices, body.landmark_weights, strict=True)
    inner = [Surface(tuple(map(int, v)), tuple(map(float, w))) for v, w in faces]
    points += inner or [None] * 51
    return [*points, None, None]  # the pupils: no model has them
