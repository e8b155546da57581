"""Chosen points of a body (joints, vertices, landmarks, keypoints) with closed-form Jacobians, without the mesh.

A surface point is a sum over (point, bone) PAIRS, p = sum_pairs G_k x + w (t_k - G_k J_k), where the pair's vector
x = template + shape + expression + correctives already holds the skinning and barycentric weights. So one list of
constants covers vertices, landmarks and offset joints, and skins some hundred vectors instead of the whole mesh.

Turning joint a about a world axis e moves point p by e x m with m = q_a - W_a t_a, where q_a and W_a are the sums of
posed pair vectors and weights over the subtree of a. For all (point, joint) entries at once, m is one product of a
constant incidence matrix with [posed joints; posed pairs].
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body import rotations
from fitting_core.body.kinematics import Tree, pose_joints, turn_axes
from fitting_core.body.model import N_JOINTS, BodyModel
from fitting_core.body.points.pairs import Contour, Joint, Point, contour_pairs, pairs_of

N_COEFFICIENTS = 20
"""Betas, then expression."""


@dataclass(frozen=True)
class Posed:
    """One forward pass over B frames: the points, and what their Jacobian needs."""

    points: Float[Tensor, "B N 3"]
    """Metres, relative to the camera's axes; the camera translation is not added."""
    pose: Float[Tensor, "B 54 3"]
    """Axis-angle of all joints but the root."""
    world: Float[Tensor, "B 55 3 3"]
    local: Float[Tensor, "B 55 3 3"]
    joints: Float[Tensor, "B 55 3"]
    pairs: Float[Tensor, "B P 3"]
    weight: Float[Tensor, "B P"] | Float[Tensor, "1 P"]
    contour_bin: Int[Tensor, "B"] | None


class BodyPoints:
    """Evaluates a fixed list of points of one body.

    Args:
        body: the model.
        points: what to evaluate, in the order of the output; the same point may stand in it twice.
        dtype: float64 is the safe default; float32 reaches the same objectives on single frames.
        device: where to compute.
    """

    def __init__(
        self,
        body: BodyModel,
        points: Sequence[Point],
        *,
        dtype: torch.dtype = torch.float64,
        device: torch.device | str = "cpu",
    ) -> None:
        self.dtype, self.device = dtype, torch.device(device)
        self.tree = Tree.of(body.parents, device)
        directions = np.concatenate([body.shape_directions, body.expression_directions], 2)
        rest = body.rest_joints
        moves = np.einsum("jv,vdk->jdk", body.joint_regressor, directions)
        self.rest, self.rest_directions = self._tensor(rest), self._tensor(moves)
        relative = moves.copy()
        relative[1:] -= moves[body.parents[1:]]
        self.bone_directions = self._tensor(relative)
        self.ancestors = self._tensor(self.tree.ancestors)
        self._compile(body, points, rest, directions, moves)

    def _tensor(self, a) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(a), dtype=self.dtype, device=self.device)

    def _index(self, a) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(a), dtype=torch.long, device=self.device)

    def _compile(
        self, body: BodyModel, points: Sequence[Point], rest: np.ndarray, directions: np.ndarray, moves
    ) -> None:
        """Turns the list of points into constant tables: pairs, incidence and Jacobian entries."""
        surface = [i for i, p in enumerate(points) if not isinstance(p, Joint | Contour)]
        contour = [i for i, p in enumerate(points) if isinstance(p, Contour)]
        self.tables = [pairs_of(body, [points[i] for i in surface], rest, directions, moves)]
        if contour:
            self.tables.append(contour_pairs(body, [p.landmark for p in points if isinstance(p, Contour)], directions))
        self.tables = [t.to(self.dtype, self.device) for t in self.tables]
        self.has_contour = bool(contour)
        owner = np.concatenate([self.tables[0].point.cpu(), *[t.point.cpu() + len(surface) for t in self.tables[1:]]])
        bone = np.concatenate([t.bone.cpu() for t in self.tables])
        self.bone = self._index(bone)
        rows = surface + contour
        self.sum_pairs = self._tensor(np.equal.outer(np.arange(len(rows)), owner))
        place = {row: N_JOINTS + k for k, row in enumerate(rows)}
        self.pick = self._index([place.get(i, getattr(p, "joint", 0)) for i, p in enumerate(points)])
        self.surface_rows = self._index(rows)
        self._compile_entries(points, place, owner, bone)

    def _compile_entries(
        self, points: Sequence[Point], place: dict[int, int], owner: np.ndarray, bone: np.ndarray
    ) -> None:
        """Lists the (point, joint) pairs with a derivative, and how the lever arm of each comes about."""
        ancestors = self.tree.ancestors
        entries: list[tuple[int, int, np.ndarray]] = []
        for i, p in enumerate(points):
            if isinstance(p, Joint):
                for a in np.flatnonzero(ancestors[p.joint]).tolist():
                    if a != p.joint:
                        row = np.zeros(N_JOINTS + len(bone))
                        row[p.joint], row[a] = 1, -1
                        entries.append((i, a, row))
                continue
            mine = owner == place[i] - N_JOINTS
            for a in range(N_JOINTS):
                below = mine & ancestors[bone, a]
                if below.any():
                    row = np.zeros(N_JOINTS + len(bone))
                    row[N_JOINTS:][below] = 1
                    entries.append((i, a, row))
        self.entry_point, self.entry_joint = (self._index([entry[k] for entry in entries]) for k in (0, 1))
        incidence = np.array([row for *_, row in entries])
        self.incidence = self._tensor(incidence.reshape(len(entries), N_JOINTS + len(bone)))
        # weights of surface points in the subtree, to take their share of the turning joint's own position off
        self.subtree_weight = self.incidence[:, N_JOINTS:].contiguous()

    def world_rotations(
        self, orient: Float[Tensor, "B 3 3"], pose: Float[Tensor, "B 54 3"]
    ) -> Float[Tensor, "B 55 3 3"]:
        """World rotations of the joints alone."""
        local = torch.cat([orient[:, None], rotations.exp(pose)], 1)
        return pose_joints(self.tree, local, self.rest.expand(len(pose), -1, -1))[0]

    def forward(
        self,
        orient: Float[Tensor, "B 3 3"],
        pose: Float[Tensor, "B 54 3"],
        coefficients: Float[Tensor, "B 20"],
        contour_bin: Int[Tensor, "B"] | None = None,
        *,
        correctives_held: bool = False,
    ) -> Posed:
        """Poses the points.

        Args:
            orient: world rotation of the root.
            pose: axis-angle of the other joints, radians.
            coefficients: betas and expression.
            contour_bin: head yaw table of each frame; needed when contour landmarks are among the points.
            correctives_held: leave the pose correctives out of automatic derivatives. They take most of the time there,
                and their share is small: it shapes the steps of a solver, and not where these end.
        """
        local = torch.cat([orient[:, None], rotations.exp(pose)], 1)
        driving = local.detach() if correctives_held else local
        rest = self.rest + (coefficients @ self.rest_directions.flatten(0, 1).T).view(-1, N_JOINTS, 3)
        world, joints = pose_joints(self.tree, local, rest)
        vectors = torch.cat([t.vectors(coefficients, driving, contour_bin) for t in self.tables], 1)
        weight = torch.cat([t.weights(contour_bin).expand(len(pose), -1) for t in self.tables], 1)
        offset = joints - (world @ rest[..., None])[..., 0]
        pairs = (world[:, self.bone] @ vectors[..., None])[..., 0] + weight[..., None] * offset[:, self.bone]
        points = torch.cat([joints, self.sum_pairs @ pairs], 1)[:, self.pick]
        return Posed(points, pose, world, local, joints, pairs, weight, contour_bin)

    def rotation_entries(self, posed: Posed, by_point: Float[Tensor, "B N R 3"]) -> Float[Tensor, "B E R 3"]:
        """by_point[p] @ d point / d (axis-angle of joint) for every (point, joint) entry that is not zero.

        `by_point` is the derivative of the caller's values by each point: of its projection, or the identity.
        """
        axes = turn_axes(self.tree, posed.world, posed.pose)
        arm = self.incidence @ torch.cat([posed.joints, posed.pairs], 1)
        share = posed.weight @ self.subtree_weight.T
        arm = arm - share[..., None] * posed.joints[:, self.entry_joint]
        # A turn w moves a point by w x arm, so by_point . (w x arm) = (arm x by_point) . w.
        turned = torch.linalg.cross(
            arm[:, :, None].expand(-1, -1, by_point.shape[2], -1), by_point[:, self.entry_point]
        )
        return turned @ axes[:, self.entry_joint]

    def coefficient_jacobian(self, posed: Posed, columns: slice) -> Float[Tensor, "B N 3 C"]:
        """d points / d (betas, expression)[columns]."""
        frames, up = len(posed.joints), posed.world[:, self.tree.parents[1:]]
        identity = torch.eye(3, dtype=self.dtype, device=self.device).expand(frames, 1, 3, 3)
        bones = torch.cat([identity, up], 1) @ self.bone_directions[..., columns]
        count = bones.shape[-1]
        joints = (self.ancestors @ bones.flatten(2)).view(frames, N_JOINTS, 3, count)
        offset = joints - posed.world @ self.rest_directions[..., columns]
        table = [t.direction(posed.contour_bin)[..., columns].expand(frames, -1, -1, -1) for t in self.tables]
        pairs = posed.world[:, self.bone] @ torch.cat(table, 1) + posed.weight[..., None, None] * offset[:, self.bone]
        surface = (self.sum_pairs @ pairs.flatten(2)).view(frames, -1, 3, count)
        return torch.cat([joints, surface], 1)[:, self.pick]

    def corrective_jacobian(self, posed: Posed) -> Float[Tensor, "B N 3 55 3"]:
        """d points / d pose through the pose correctives alone, for lists without contour landmarks.

        It takes many times as long as the rest of the Jacobian; solvers that go on to the very optimum need it.
        """
        assert not self.has_contour
        (table,) = self.tables
        frames, pairs, joints = len(posed.joints), len(table.bone), len(table.driving)
        found = posed.joints.new_zeros(frames, len(self.surface_rows), 3, N_JOINTS, 3)
        turned = rotations.by_axis_angle(posed.local[:, table.driving], posed.pose[:, table.driving - 1])
        at_rest = torch.einsum("pxjf,bjkf->bpxjk", table.correctives[0].view(pairs, 3, joints, 9), turned)
        in_space = (posed.world[:, self.bone] @ at_rest.flatten(3)).unflatten(3, (joints, 3))
        by_point = torch.zeros_like(found[:, :, :, :joints]).index_add_(1, table.point, in_space)
        found[..., table.driving, :] = by_point
        whole = posed.joints.new_zeros(frames, len(self.pick), 3, N_JOINTS, 3)
        whole[:, self.surface_rows] = found
        return whole


def whole_pose(body_pose: Tensor, jaw_pose: Tensor, hands: Float[Tensor, "B 90"]) -> Float[Tensor, "B 54 3"]:
    """Axis-angle of all joints but the root, eyes at rest."""
    eyes = body_pose.new_zeros(len(body_pose), 6)
    return torch.cat([body_pose, jaw_pose, eyes, hands], 1).view(len(body_pose), N_JOINTS - 1, 3)
