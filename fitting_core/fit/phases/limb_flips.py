"""Limbs mirrored in depth: other poses with the same image.

A bone of known length that starts at a known point and ends on a known ray has two solutions, nearer or farther. So a
limb of two bones has four poses with the same keypoints (H.-J. Lee, Z. Chen, Determination of 3D human body postures
from a single view, CVGIP 30, 1985), and a descent seldom finds the way from one to another.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.model import JOINT
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.terms.temporal import JointPositions
from fitting_core.fit.variables.state import State
from fitting_core.results.provenance import Start

_STRAIGHT = 0.1
"""Sine of the bend below which a limb keeps its hinge axis: two collinear bones do not determine it."""
_APART = 0.05
"""Metres along the viewing direction by which a bone differs from the lifter's where its limb may be mirrored: a third
of the limbs. Among 55 key frames of four clips mirroring helped by more than 2 % in four, in which a limb differed by
0.1 to 0.4; at 0.08 a balancing man's cost is 0.3 % higher."""
_PALM = (1.0, -1.0, 1.0)
"""Mirrors a hand at rest in the plane of its palm."""


@dataclass(frozen=True, kw_only=True)
class Limb:
    """Two bones with a hinge between them."""

    joints: tuple[str, str, str]
    hinge: tuple[float, float, float]
    """Axis about which the lower bone bends, in the rest pose."""
    start: Start
    """The start recorded for a fit from the mirrored limb."""
    mirrored_hand: Start | None = None
    """The same for its hand, which is flat enough to look the same when mirrored in depth; None for a foot."""


LIMBS = {
    "left_arm": Limb(
        joints=("left_shoulder", "left_elbow", "left_wrist"),
        hinge=(0.0, -1.0, 0.0),
        start=Start.LEFT_ARM,
        mirrored_hand=Start.LEFT_HAND,
    ),
    "right_arm": Limb(
        joints=("right_shoulder", "right_elbow", "right_wrist"),
        hinge=(0.0, 1.0, 0.0),
        start=Start.RIGHT_ARM,
        mirrored_hand=Start.RIGHT_HAND,
    ),
    "left_leg": Limb(joints=("left_hip", "left_knee", "left_ankle"), hinge=(1.0, 0.0, 0.0), start=Start.LEFT_LEG),
    "right_leg": Limb(joints=("right_hip", "right_knee", "right_ankle"), hinge=(1.0, 0.0, 0.0), start=Start.RIGHT_LEG),
}
FLIPS = ((True, False), (False, True), (True, True))
"""Which bones are mirrored: upper, lower."""


class LimbFlips:
    """Makes mirrored states of one body.

    Args:
        stages: the body, its parametrisation, and the evidence of a clip's depths.
    """

    def __init__(self, stages: Stages) -> None:
        self.parametrisation = stages.parametrisation
        self.positions = JointPositions(stages.body, stages.parametrisation, in_camera=True)
        self.parents, self.observations = stages.body.parents, stages.observations

    def flipped(self, state: State, limb: Limb, *, upper: bool, lower: bool) -> Float[Tensor, "B 63"]:
        """The body's pose (axis-angle) with a limb's upper bone, lower bone or both mirrored, at the same pixels.

        The middle joint stays a hinge: the limb is rotated about its upper bone until it bends naturally.
        """
        estimate = self.positions.estimate(state)
        joints, world = estimate.in_camera, estimate.posed.world
        first, middle, last = (JOINT[name] for name in limb.joints)
        bones = joints[:, middle] - joints[:, first], joints[:, last] - joints[:, middle]
        at_middle = _other_end(joints[:, first], joints[:, middle]) if upper else joints[:, middle]
        ray = _unit(joints[:, last])
        near, far = _ends_on_ray(at_middle, ray, bones[1].norm(dim=1))
        was_near = (bones[1] * ray).sum(1, keepdim=True) < 0
        at_last = torch.where(was_near ^ lower, near, far)
        turned = _hinged(limb, world, bones, (_unit(at_middle - joints[:, first]), _unit(at_last - at_middle)))
        end = world[:, last]
        if limb.mirrored_hand is not None and lower:
            end = _mirrored_hand(end, ray)
        elif limb.mirrored_hand is None:
            end = turned[1] @ world[:, middle].transpose(1, 2) @ end
        return self._turned(state, (first, middle, last), world, (*turned, end))

    def mirrored_hand(self, state: State, limb: Limb) -> Float[Tensor, "B 63"]:
        """The body's pose with a limb's hand mirrored in depth about its wrist; the rest of the limb is unchanged."""
        estimate = self.positions.estimate(state)
        joints, world = estimate.in_camera, estimate.posed.world
        first, middle, last = (JOINT[name] for name in limb.joints)
        hand = _mirrored_hand(world[:, last], _unit(joints[:, last]))
        return self._turned(state, (first, middle, last), world, (world[:, first], world[:, middle], hand))

    def _turned(
        self, state: State, chain: tuple[int, int, int], world: Tensor, turned: tuple[Tensor, Tensor, Tensor]
    ) -> Tensor:
        """The body's pose with the world rotations of three joints in a row replaced."""
        pose = self.parametrisation.body_pose(state).clone()
        parent = world[:, int(self.parents[chain[0]])]
        for joint, own in zip(chain, turned, strict=True):
            pose[:, 3 * (joint - 1) : 3 * joint] = rotations.log(parent.transpose(1, 2) @ own)
            parent = own
        return pose

    def every(self, state: State, frames: Int[Tensor, "B"]) -> Iterator[tuple[Start, Int[Tensor, "n"], State]]:
        """All flips of limbs in doubt and their hands, one at a time: the start recorded for each, which of these
        frames it is of, and their states."""
        found: list[tuple[Start, Tensor, Tensor]] = []
        for limb in LIMBS.values():
            rows = self._in_doubt(state, frames, limb).nonzero()[:, 0]
            if not len(rows):
                continue
            own = state[rows]
            found += [(limb.start, rows, self.flipped(own, limb, upper=upper, lower=lower)) for upper, lower in FLIPS]
            if limb.mirrored_hand is not None:
                found.append((limb.mirrored_hand, rows, self.mirrored_hand(own, limb)))
        if not found:
            return
        body = self.parametrisation.prior.encode(torch.cat([pose for *_, pose in found]), rough=True)
        for (start, rows, _), own in zip(found, body.split([len(rows) for _, rows, _ in found]), strict=True):
            yield start, rows, state[rows].with_columns(self.parametrisation.columns.body, own)

    def _in_doubt(self, state: State, frames: Int[Tensor, "B"], limb: Limb) -> Bool[Tensor, "B"]:
        """Where the evidence of depth disagrees with a bone of the limb, or a seen bone has none."""
        o, joints, points = self.observations, [JOINT[n] for n in limb.joints], [kp.INDEX[n] for n in limb.joints]
        own = self.positions.estimate(state).in_camera[:, joints, 2].diff(dim=1)
        lifted = o.relative_position[frames][:, points, 2].diff(dim=1)
        known = o.relative_position_deviation[frames][:, points, 2].isfinite()
        doubt = torch.where(known[:, 1:] & known[:, :-1], (own - lifted).abs() > _APART, o.seen[frames][:, points[1:]])
        return doubt.any(1)


def mirrored_as_told(stages: Stages, state: State, frames: Int[Tensor, "n"]) -> State:
    """The state with limbs mirrored in frames where a person set their depth, if that lowers the cost.

    Knees and elbows bend in one direction, so a descent from a limb's other side gets stuck, or does not start.

    Args:
        stages: of a clip, or a part of it.
        state: all of its frames.
        frames: which of them may change.
    """
    objective = stages.objective(N_STAGES, state, stages.free(N_STAGES, betas=False))
    flips, columns, vector = LimbFlips(stages), stages.parametrisation.columns, state.vector.clone()
    for limb in LIMBS.values():
        ends = [kp.INDEX[name] for name in limb.joints[1:]]
        by_hand = frames[stages.observations.depth_by_hand[frames][:, ends].any(1)]
        if not len(by_hand):
            continue
        here = State(state.orient, vector)[by_hand]
        poses = [flips.flipped(here, limb, upper=upper, lower=lower) for upper, lower in FLIPS]
        encoded = stages.parametrisation.prior.encode(torch.cat(poses), rough=True).split(len(by_hand))
        tried = [here, *(here.with_columns(columns.body, own) for own in encoded)]
        best = torch.stack([objective.cost(one, by_hand) for one in tried]).argmin(0)
        vector[by_hand] = torch.stack([one.vector for one in tried])[
            best, torch.arange(len(by_hand), device=best.device)
        ]
    return State(state.orient, vector)


def _hinged(
    limb: Limb, world: Float[Tensor, "B 55 3 3"], bones: tuple[Tensor, Tensor], wanted: tuple[Tensor, Tensor]
) -> tuple[Float[Tensor, "B 3 3"], Float[Tensor, "B 3 3"]]:
    """World rotations of a limb's first two joints that turn its bones into the directions `wanted`."""
    first, middle, _ = (JOINT[name] for name in limb.joints)
    rest = [
        _unit((world[:, j].transpose(1, 2) @ b[..., None])[..., 0]) for j, b in zip((first, middle), bones, strict=True)
    ]
    hinge = bones[0].new_tensor(limb.hinge).expand_as(bones[0])
    normal, kept = torch.linalg.cross(*wanted), (world[:, first] @ hinge[..., None])[..., 0]
    normal = torch.where(normal.norm(dim=1, keepdim=True) > _STRAIGHT, normal, kept)
    turned = [_frame(w, normal) @ _frame(r, hinge).transpose(1, 2) for w, r in zip(wanted, rest, strict=True)]
    # A forearm keeps its twist, which is determined by the hand, not by keypoints of the arm.
    local = world[:, first].transpose(1, 2) @ world[:, middle]
    return turned[0], turned[1] @ _twist(local, rest[1])


def _other_end(start: Float[Tensor, "B 3"], end: Float[Tensor, "B 3"]) -> Float[Tensor, "B 3"]:
    """The other point on the ray of `end` at the same distance from `start`."""
    ray = _unit(end)
    return end - 2 * ((end - start) * ray).sum(1, keepdim=True) * ray


def _ends_on_ray(
    start: Float[Tensor, "B 3"], ray: Float[Tensor, "B 3"], length: Float[Tensor, "B"]
) -> tuple[Float[Tensor, "B 3"], Float[Tensor, "B 3"]]:
    """The nearer and the farther end of a bone on a ray; the ray's closest point where it is out of reach."""
    foot = (start * ray).sum(1, keepdim=True)
    off = (foot * ray - start).square().sum(1)
    reach = (length.square() - off).clamp_min(0).sqrt()[:, None]
    return (foot - reach) * ray, (foot + reach) * ray


def _mirrored_hand(hand: Float[Tensor, "B 3 3"], ray: Float[Tensor, "B 3"]) -> Float[Tensor, "B 3 3"]:
    """World rotation of a flat hand that looks the same to the camera, with its fingers mirrored in depth."""
    mirror = torch.eye(3, dtype=hand.dtype, device=hand.device) - 2 * ray[:, :, None] * ray[:, None]
    return mirror @ hand @ torch.diag(hand.new_tensor(_PALM))


def _frame(along: Float[Tensor, "*b 3"], normal: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3 3"]:
    """Rotation with columns: `along`, `normal` made perpendicular to it, and their cross product."""
    normal = _unit(normal - (normal * along).sum(-1, keepdim=True) * along)
    return torch.stack([along, normal, torch.linalg.cross(along, normal)], -1)


def _twist(rotation: Float[Tensor, "B 3 3"], axis: Float[Tensor, "B 3"]) -> Float[Tensor, "B 3 3"]:
    """The part of rotations about an axis: swing-twist decomposition of quaternions."""
    turn = rotations.log(rotation)
    half = 0.5 * turn.norm(dim=1)
    along = (turn * axis).sum(1) / (2 * half).clamp_min(1e-12) * half.sin()
    return rotations.exp(2 * torch.atan2(along, half.cos())[:, None] * axis)


def _unit(v: Tensor) -> Tensor:
    return v / v.norm(dim=-1, keepdim=True).clamp_min(1e-12)
