"""A motion on a body: its file's pose, or one whose keypoints are at those in the file.

Levenberg-Marquardt on the closed-form derivatives of `BodyPoints`. A weak pull to the rest pose decides what the points
leave open, such as the twist of a straight finger.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.model import JOINT, N_BETAS, N_JOINTS, POSE_JOINTS, BodyModel
from fitting_core.body.params import BodyParams, full_pose
from fitting_core.body.points.body_points import N_COEFFICIENTS, BodyPoints, Posed
from fitting_core.body.points.pairs import Carried, Contour, Offset, Point, Surface, keypoint_points
from fitting_core.io.motion.imported_motion import ImportedMotion
from fitting_core.least_squares import Descent, Step, dense_step

_AT_ONCE = 32
"""Frames: the Jacobian of one has up to 2 MB."""
_FOR_SHAPE = 24
"""Frames that a shared shape is estimated from."""
_ITERATIONS = 60
_DAMPING = 1e-5
_TOLERANCE = 1e-3
"""Relative decrease of the cost below which steps end."""
_BODY, _FINGERS, _SHAPE = 0.02, 0.002, 0.005
"""Distances from the rest pose and the mean shape that count as much as a metre between points: metres per radian of
trunk and limbs, and of fingers, jaw and eyes, whose points are nearer to their joints; metres per standard deviation of
the betas. For keypoints of another body, whose joints are centimetres from ours."""
_TORSO = [JOINT[name] for name in ("pelvis", "spine1", "spine2", "spine3", "left_collar", "right_collar")]
_LITTLE = 1e-3
"""Weight of the previous rotation relative to all that the points say about one."""


def posed_on(motion: ImportedMotion, body: BodyModel) -> ImportedMotion:
    """The motion with a pose of this body: its own, or if it has only keypoints, one fitted to these."""
    if motion.points is None:
        return motion.for_body(body)
    params, note = _through_keypoints(body, motion.points)
    own = {"kind": body.kind, "gender": body.gender, "body_hash": body.hash}
    return replace(motion, params=params, points=None, whole_hands=False, notes=(*motion.notes, note), **own)


def _through_keypoints(body: BodyModel, keypoints: Float[np.ndarray, "T 137 3"]) -> tuple[BodyParams, str]:
    """Hands as 45 numbers over the mean hand; and what the user should know of it."""
    points = keypoint_points(body)[: kp.HANDS.stop]
    chosen = [i for i, point in enumerate(points) if point is not None]
    found = pose_through(body, [point for point in points if point is not None], keypoints[:, chosen])
    off = 1000 * float(np.median(found.off))
    return found.params, f"It is of another body: the pose is one whose keypoints lie {off:.0f} mm off its (median)."


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedThrough:
    """A body's pose in T frames."""

    params: BodyParams
    """Hands as 45 numbers over the mean hand."""
    off: Float[np.ndarray, "T"]
    """Root mean square over the points of each frame, metres."""


def pose_through(body: BodyModel, points: Sequence[Point], places: Float[np.ndarray, "T N 3"]) -> PosedThrough:
    """Pose a body through points; all frames share a shape, the median over some of them.

    Args:
        body: Which body.
        points: Of it; none of the face contour.
        places: Their positions, camera space, metres; NaN if not known, for the same points in all frames.
    """
    known = np.asarray(np.isfinite(places).all((0, 2)))
    solver = _Solver(body, [point for point, there in zip(points, known, strict=True) if there])
    there = torch.as_tensor(places[:, known])
    start = solver.begun(there)
    some = torch.linspace(0, len(there) - 1, min(len(there), _FOR_SHAPE)).long()
    shape = solver.solved(start[some], there[some]).coefficients.median(0).values
    start = replace(start, coefficients=shape.expand_as(start.coefficients).clone())
    found = solver.solved(start, there, shape=False)
    return PosedThrough(params=solver.params(found), off=solver.off(found, there).numpy())


@dataclass(frozen=True, eq=False)
class _State:
    orient: Float[Tensor, "B 3 3"]
    pose: Float[Tensor, "B 54 3"]
    coefficients: Float[Tensor, "B 20"]
    translation: Float[Tensor, "B 3"]

    def __getitem__(self, frames: Tensor | slice) -> "_State":
        return _State(*(getattr(self, f.name)[frames] for f in fields(self)))

    def moved(self, step: Float[Tensor, "B 188"]) -> "_State":
        turn, bend = step[:, :3], step[:, 3 : 3 * N_JOINTS]
        return _State(
            rotations.exp(turn) @ self.orient,
            self.pose + bend.view_as(self.pose),
            self.coefficients + step[:, 3 * N_JOINTS : -3],
            self.translation + step[:, -3:],
        )

    def put(self, frames: Tensor, other: "_State") -> "_State":
        """These frames replaced by the other one's."""
        return _State(*(getattr(self, f.name).index_copy(0, frames, getattr(other, f.name)) for f in fields(self)))


def _carrier(body: BodyModel, point: Point) -> int:
    """The joint that carries a point most."""
    if isinstance(point, Surface):
        shares = np.array(point.weights) @ body.skinning_weights[list(point.vertices)]
        return int(shares.argmax())
    assert not isinstance(point, Contour), "a contour's points on the mesh depend on the pose"
    return point.bone if isinstance(point, Offset | Carried) else int(max(body.parents[point.joint], 0))


def _turn(
    rest: Float[Tensor, "n 3"], place: Float[Tensor, "T n 3"], before: Float[Tensor, "*T 3 3"]
) -> Float[Tensor, "T 3 3"]:
    """Rotations that take vectors to others; where these are ambiguous, near the rotation before.

    The orthogonal Procrustes problem (Schönemann 1966), whose matrix has a little of the rotation before added.
    """
    matrix = place.mT @ rest
    size = (place.norm(dim=-1) * rest.norm(dim=-1)).sum(-1)[:, None, None]
    left, _, right = torch.linalg.svd(matrix + (_LITTLE * size + 1e-12) * before)
    mirrored = torch.linalg.det(left @ right).sign()
    return torch.cat([left[..., :2], left[..., 2:] * mirrored[:, None, None]], -1) @ right


class _Solver:
    """One body, with one list of points."""

    def __init__(self, body: BodyModel, points: Sequence[Point]) -> None:
        self.body, self.owner = body, np.array([_carrier(body, point) for point in points])
        self.points, self.count = BodyPoints(body, points), len(points)
        weight = torch.full((N_JOINTS, 3), _FINGERS, dtype=torch.float64)
        weight[POSE_JOINTS["body_pose"]], weight[0] = _BODY, 0.0
        shape = torch.full((N_COEFFICIENTS,), _SHAPE, dtype=torch.float64)
        self.precision = torch.cat([weight.flatten(), shape, torch.zeros(3, dtype=torch.float64)]) ** 2
        self.shaped = torch.ones(len(self.precision), dtype=torch.bool)
        self.shaped[3 * N_JOINTS + N_BETAS : -3] = False  # keypoints do not determine the expression
        self.mean = full_pose(body, BodyParams.neutral(1, hand_components=45))[0, 1:].clone()
        """The rest pose has the mean hands."""

    def begun(self, places: Float[Tensor, "T N 3"]) -> _State:
        """Every joint rotated, from the root on, so that what it carries points the right way.

        For joints that carry nothing, their next descendants count. Ambiguous rotations stay as at rest.
        """
        frames, parents = len(places), self.body.parents
        rest, at_rest = self.points.rest, self._posed(self._at_rest(1)).points[0]
        mean = rotations.exp(torch.cat([torch.zeros(1, 3, dtype=places.dtype), self.mean]))
        trunk = torch.as_tensor(np.flatnonzero(np.isin(self.owner, _TORSO)))
        middle, target = at_rest[trunk].mean(0), places[:, trunk].mean(1)
        root = _turn(at_rest[trunk] - middle, places[:, trunk] - target[:, None], torch.eye(3, dtype=places.dtype))
        world, joints = [root], [target + root @ (rest[0] - middle)]
        local = [root]
        for joint in range(1, N_JOINTS):
            up = int(parents[joint])
            before = world[up] @ mean[joint]
            at = joints[up] + world[up] @ (rest[joint] - rest[up])
            mine = self._carried(joint)
            turned = before
            if len(mine):
                turned = _turn(at_rest[mine] - rest[joint], places[:, mine] - at[:, None], before)
            world.append(turned)
            joints.append(at)
            local.append(world[up].mT @ turned)
        pose = rotations.log(torch.stack(local[1:], 1))
        shift = joints[0] - rest[0]
        return replace(self._at_rest(frames), orient=root, pose=pose, translation=shift)

    def _carried(self, joint: int) -> Int[Tensor, "n"]:
        """The points of a joint, or of the first joints below it that have any."""
        down = self.body.parents
        level = [joint]
        while level:
            mine = np.flatnonzero(np.isin(self.owner, level))
            if len(mine):
                return torch.as_tensor(mine)
            level = [j for j in range(N_JOINTS) if down[j] in level]
        return torch.zeros(0, dtype=torch.long)

    def _at_rest(self, frames: int) -> _State:
        return _State(
            torch.eye(3, dtype=torch.float64).repeat(frames, 1, 1),
            torch.zeros(frames, N_JOINTS - 1, 3, dtype=torch.float64),
            torch.zeros(frames, N_COEFFICIENTS, dtype=torch.float64),
            torch.zeros(frames, 3, dtype=torch.float64),
        )

    def _posed(self, state: _State) -> Posed:
        return self.points.forward(state.orient, state.pose, state.coefficients)

    def off(self, state: _State, places: Tensor) -> Float[Tensor, "T"]:
        """Root mean square of the distances."""
        error = self._posed(state).points + state.translation[:, None] - places
        return error.square().sum(-1).mean(-1).sqrt()

    def solved(self, start: _State, places: Tensor, *, shape: bool = True) -> _State:
        """All frames, in batches."""
        free = self.shaped.clone()
        if not shape:
            free[3 * N_JOINTS : -3] = False
        parts = []
        for i in torch.arange(len(places)).split(_AT_ONCE):
            descent = Descent(_Posing(self, places[i], free), start[i], torch.arange(len(i)), damping=_DAMPING)
            parts.append(descent.run(_ITERATIONS, _TOLERANCE))
        return _State(*(torch.cat([getattr(part, f.name) for part in parts]) for f in fields(_State)))

    def _bent(self, state: _State) -> Float[Tensor, "B 188"]:
        """Regularised parameters: all but the root's rotation and the translation."""
        root, place = state.translation.new_zeros(len(state.pose), 3), torch.zeros_like(state.translation)
        return torch.cat([root, (state.pose - self.mean).flatten(1), state.coefficients, place], 1)

    def cost(self, state: _State, places: Tensor) -> Float[Tensor, "B"]:
        error = self._posed(state).points + state.translation[:, None] - places
        return error.square().sum((1, 2)) + (self.precision * self._bent(state).square()).sum(1)

    def normal(
        self, state: _State, places: Tensor, free: Tensor
    ) -> tuple[Float[Tensor, "B"], Float[Tensor, "B f"], Float[Tensor, "B f f"]]:
        """Cost, gradient and matrix (both halved) in the free variables."""
        posed, frames = self._posed(state), len(places)
        error, bent = posed.points + state.translation[:, None] - places, self._bent(state)
        jacobian = error.new_zeros(frames, self.count, 3, len(free))
        eye = torch.eye(3, dtype=error.dtype).expand(frames, self.count, 3, 3)
        by_joint = jacobian[..., : 3 * N_JOINTS].unflatten(3, (N_JOINTS, 3))
        at, joint = self.points.entry_point, self.points.entry_joint
        by_joint[:, at, :, joint] = self.points.rotation_entries(posed, eye).transpose(0, 1)
        jacobian[..., : 3 * N_JOINTS] += self.points.corrective_jacobian(posed).flatten(3)
        jacobian[..., 3 * N_JOINTS : -3] = self.points.coefficient_jacobian(posed, slice(0, N_COEFFICIENTS))
        jacobian[..., -3:] = eye
        rows = jacobian.flatten(1, 2)[..., free]
        gradient = (self.precision * bent)[:, free] + (rows.mT @ error.flatten(1)[..., None])[..., 0]
        cost = error.square().sum((1, 2)) + (self.precision * bent.square()).sum(1)
        return cost, gradient, rows.mT @ rows + torch.diag(self.precision[free])

    def params(self, state: _State) -> BodyParams:
        pose, mean = state.pose, self.mean
        hands = (pose - mean).flatten(1)[:, 3 * (POSE_JOINTS["left_hand_pose"].start - 1) :]
        parts = {
            name: pose[:, part.start - 1 : part.stop - 1].flatten(1)
            for name, part in POSE_JOINTS.items()
            if name in ("body_pose", "jaw_pose", "leye_pose", "reye_pose")
        }
        return BodyParams(
            betas=state.coefficients[:, :N_BETAS],
            expression=state.coefficients[:, N_BETAS:],
            global_orient=rotations.log(state.orient),
            left_hand_pose=hands[:, :45],
            right_hand_pose=hands[:, 45:],
            camera_translation=state.translation,
            **parts,
        )


@dataclass(frozen=True, eq=False)
class _Posing:
    """Frames posed through positions, each a group."""

    solver: _Solver
    places: Float[Tensor, "B N 3"]
    free: Bool[Tensor, "188"]

    def rows(self, groups: Tensor) -> Tensor:
        return groups

    def cost(self, state: _State, groups: Tensor) -> Tensor:
        return self.solver.cost(state, self.places[groups])

    def normal(self, state: _State, groups: Tensor) -> tuple[Tensor, ...]:
        return self.solver.normal(state, self.places[groups], self.free)

    def solve(self, normal: tuple[Tensor, ...], damping: Tensor) -> Step:
        _, gradient, matrix = normal
        step = dense_step(gradient, matrix, damping)
        move = gradient.new_zeros(len(gradient), len(self.free))
        move[:, self.free] = step.move
        return replace(step, move=move)
