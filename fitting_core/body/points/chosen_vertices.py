"""A few vertices of a body, different in every frame, with closed-form derivatives.

For lists that stay the same over a fit, `BodyPoints` is faster; compiling one takes a second, though, and which
vertices collide changes with every step.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body import rotations
from fitting_core.body.kinematics import turn_axes
from fitting_core.body.mesh import Mesh, Skeleton
from fitting_core.body.model import N_JOINTS


@dataclass(frozen=True)
class PosedVertices:
    """K vertices of each of B frames, and what their derivatives need."""

    ids: Int[Tensor, "B K"]
    vertices: Float[Tensor, "B K 3"]
    """Metres, without camera translation."""
    rest: Float[Tensor, "B K 3"]
    """The same vertices before skinning, with shape, expression and correctives."""
    skeleton: Skeleton
    pose: Float[Tensor, "B 54 3"]
    """Axis-angle of all joints but the root."""


@dataclass(frozen=True)
class VertexRows:
    """R rows, each the derivative of a number by C of the chosen vertices: sum over c of by_vertex[r, c] . d vertex."""

    frame: Int[Tensor, "R"]
    chosen: Int[Tensor, "R C"]
    """Place of the vertex among its frame's chosen ones."""
    by_vertex: Float[Tensor, "R C 3"]


class ChosenVertices:
    """Evaluates chosen vertices of one mesh by gathering their rows of its tables."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        relative = mesh.rest_directions.clone()
        relative[1:] -= mesh.rest_directions[mesh.tree.parents[1:]]
        self._bone_directions = relative
        self._ancestors = torch.as_tensor(mesh.tree.ancestors, dtype=mesh.dtype, device=mesh.device)

    def forward(
        self,
        orient: Float[Tensor, "B 3 3"],
        pose: Float[Tensor, "B 54 3"],
        coefficients: Float[Tensor, "B 20"],
        ids: Int[Tensor, "B K"],
    ) -> PosedVertices:
        """Poses the vertices; differentiable in all but `ids`.

        Args:
            orient: world rotation of the root.
            pose: axis-angle of the other joints, radians.
            coefficients: betas, then expression.
            ids: vertex numbers, which may repeat.
        """
        mesh = self.mesh
        local = torch.cat([orient[:, None], rotations.exp(pose)], 1)
        identity = torch.eye(3, dtype=mesh.dtype, device=mesh.device)
        skeleton = mesh.skeleton(local, coefficients)
        shaped = (mesh.directions[ids] @ coefficients[:, None, :, None])[..., 0]
        features = (local[:, 1:] - identity).flatten(1)
        correctives = mesh.body.correctives_of(ids.cpu().numpy())
        corrected = (features.new_tensor(correctives) @ features[:, None, :, None])[..., 0]
        rest = mesh.template[ids] + shaped + corrected
        transforms = torch.cat([skeleton.world, skeleton.offset[..., None]], -1)
        blended = (mesh.weights[ids] @ transforms.flatten(2)).view(*ids.shape, 3, 4)
        vertices = (blended[..., :3] @ rest[..., None])[..., 0] + blended[..., 3]
        return PosedVertices(ids, vertices, rest, skeleton, pose)

    def by_joint(self, posed: PosedVertices, rows: VertexRows) -> Float[Tensor, "R 55 3"]:
        """The rows' derivatives by the joints' axis-angles, without those through the pose correctives.

        Turning joint a about a world axis e moves a vertex by e x m with m = q_a - W_a t_a (see body_points.py).
        """
        skeleton, weights = posed.skeleton, self.mesh.weights[posed.ids]
        carried = posed.rest @ skeleton.world.flatten(1, 2).transpose(1, 2)
        carried = weights[..., None] * (carried.unflatten(2, (N_JOINTS, 3)) + skeleton.offset[:, None])
        arms = torch.einsum("bkjx,ja->bkax", carried, self._ancestors)
        arms = arms - (weights @ self._ancestors)[..., None] * skeleton.joints[:, None]
        turned = arms.new_zeros(len(rows.frame), N_JOINTS, 3)
        for chosen, by_vertex in zip(rows.chosen.unbind(1), rows.by_vertex.unbind(1), strict=True):
            turned += torch.linalg.cross(arms[rows.frame, chosen], by_vertex[:, None].expand_as(turned))
        axes = turn_axes(self.mesh.tree, skeleton.world, posed.pose)
        return (turned[..., None, :] @ axes[rows.frame])[..., 0, :]

    def by_coefficient(self, posed: PosedVertices, rows: VertexRows) -> Float[Tensor, "R 20"]:
        """The rows' derivatives by betas and expression."""
        skeleton, frames = posed.skeleton, len(posed.ids)
        up = skeleton.world[:, self.mesh.tree.parents[1:]]
        bones = torch.cat(
            [self._bone_directions[None, :1].expand(frames, -1, -1, -1), up @ self._bone_directions[1:]], 1
        )
        joints = (self._ancestors @ bones.flatten(2)).view_as(bones)
        offset = joints - skeleton.world @ self.mesh.rest_directions
        weights = self.mesh.weights[posed.ids]
        blended = (weights @ skeleton.world.flatten(2)).unflatten(2, (3, 3))
        moved = blended @ self.mesh.directions[posed.ids]
        moved = moved + (weights @ offset.flatten(2)).view_as(moved)
        return torch.einsum("rcx,rcxk->rk", rows.by_vertex, moved[rows.frame[:, None], rows.chosen])
