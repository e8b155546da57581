"""Deviations of joints and angles according to the normal equations, which are too small.

The objective is a sum of squared residuals, so near its minimum it is (up to a factor) the negative logarithm of a
normal distribution whose inverse covariance is J^T J of all residuals: keypoints with their robust weights, the lifter,
the priors, E_T and held feet (Triggs et al., Bundle Adjustment - A Modern Synthesis, 2000, section 2.3). A covariance
of the unknowns becomes one of what depends on them, K C K^T with K its derivative.

Shape and camera are held; and every error counts as one of a single frame, although a detector's and the lifter's last.
`calibration` makes up for that.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body import rotations
from fitting_core.body.markers.joint_centres import with_joint_centres
from fitting_core.body.model import JOINT
from fitting_core.body.segment_axes import BONES, rest_axes
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.phases.consistency import overlapping_parts
from fitting_core.fit.solvers.banded import diagonal_of_inverse
from fitting_core.fit.solvers.sequence import Sequence
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.terms.temporal import JointPositions
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.state import State
from fitting_core.least_squares import damping_diagonal
from fitting_core.results.error_bars import ANGLES, JOINTS, ErrorBars

_PART, _SEAM = 200, 20
"""Frames whose normal equations are in memory together, and those that two neighbours share: the deviations differ from
the whole clip's by less than 0.2 % (a test has it)."""
_AT_ONCE = 32
"""Frames whose joints' derivatives are in memory together: 0.2 MB each."""
_SEGMENTS = {
    "hip": ("pelvis", "thigh"),
    "knee": ("thigh", "shank"),
    "elbow": ("humerus", "forearm"),
    "shoulder": ("thorax", "humerus"),
    "ankle": ("shank", "foot"),
    "lumbar": ("pelvis", "thorax"),
}
"""By the joint that bends: the segment before it, and the one that it turns."""
_HANGING = 1e-6
"""For an arm that hangs along the thorax, whose elevation has no slope."""


def _about_z(turn: Float[Tensor, "B 3 3"]) -> Float[Tensor, "B"]:
    """The first of the angles of R = Rz Rx Ry."""
    return torch.atan2(-turn[:, 0, 1], turn[:, 1, 1])


def _about_x(turn: Float[Tensor, "B 3 3"]) -> Float[Tensor, "B"]:
    """The second."""
    return turn[:, 2, 1].asin()


def _about_y(turn: Float[Tensor, "B 3 3"]) -> Float[Tensor, "B"]:
    """The third."""
    return torch.atan2(-turn[:, 2, 0], turn[:, 2, 2])


def _elevation(turn: Float[Tensor, "B 3 3"]) -> Float[Tensor, "B"]:
    """The second of R = Ry Rx Ry: between both y."""
    return torch.atan2((turn[:, 0, 1].square() + turn[:, 2, 1].square() + _HANGING).sqrt(), turn[:, 1, 1])


_TURNS = {"elevation": _elevation, "bending": _about_x, "rotation": _about_y}
"""By the last word of an angle's name: what it is of the turn of the second segment against the first; without its
sign. All others are about z."""


def deviations(stages: Stages, state: State) -> ErrorBars:
    """Standard deviations of a state at the minimum of E_o + E_T, according to the normal equations.

    Linear in the number of frames; NaN if the normal equations cannot be inverted.

    Args:
        stages: Of the clip, with feet held as in the fit.
        state: All of its frames.
    """
    frames = len(state)
    parts = overlapping_parts(frames, _PART, _SEAM)
    found = [_of_part(stages.within(part), state[part.start : part.stop]) for part in parts]
    whole = ErrorBars.unknown(frames)
    for part, bars in zip(parts, found, strict=True):  # the later half of shared frames is the later part's
        first = part.start and part.start + _SEAM // 2
        whole = whole.with_frames(range(first, part.stop), bars[slice(first - part.start, None)])
    return whole


def _of_part(stages: Stages, state: State) -> ErrorBars:
    objective = stages.objective(N_STAGES, state, stages.free(N_STAGES, betas=False))
    problem = Sequence(objective, state, range(len(state)))
    _, _, *bands = problem.normal(state, torch.zeros(1, dtype=torch.long, device=stages.device))
    diagonal, *below = (band[0].double() for band in bands)
    covariance = diagonal_of_inverse([diagonal, *below])
    if covariance is None:
        # Where one frame alone shows the person, E_T leaves free how the body drifts from there: the floor of the
        # solver's damping bounds that, and changes what the frame itself says by less than a millionth.
        floor = damping_diagonal(diagonal.diagonal(dim1=1, dim2=2), diagonal.new_zeros(len(diagonal)))
        covariance = diagonal_of_inverse([diagonal + torch.diag_embed(floor), *below])
    if covariance is None:
        return ErrorBars.unknown(len(state))
    joints = JointPositions(stages.body, stages.parametrisation, in_camera=False)
    covariance = covariance.to(state.vector)
    of_joints = [
        _of_joints(objective, joints, state[frames], frames, covariance[frames])
        for frames in stages.all_frames.split(_AT_ONCE)
    ]
    anatomical = JointPositions(with_joint_centres(stages.body), stages.parametrisation, in_camera=False)
    of_angles = _of_angles(objective, anatomical, state, covariance)
    return ErrorBars(joints=torch.cat(of_joints).float().cpu().numpy(), angles=of_angles.float().cpu().numpy())


def _of_joints(
    objective: FrameObjective,
    joints: JointPositions,
    state: State,
    frames: Int[Tensor, "B"],
    covariance: Float[Tensor, "B d d"],
) -> Float[Tensor, "B 22 2"]:
    """Metres along the camera's ray through each joint, and across it (root mean square over two directions)."""
    count = len(JOINTS)
    rows = objective.joint_jacobian(joints, state, frames)[:, : 3 * count]
    # K C K^T of each joint: 3 x 3, camera axes, square metres.
    spread = (rows @ covariance).unflatten(1, (count, 3)) @ rows.unflatten(1, (count, 3)).mT
    ray = torch.nn.functional.normalize(joints.estimate(state, frames).in_camera[:, :count], dim=-1)
    # Along the unit ray u: u^T S u. The rest of the trace is shared by two directions across it.
    along = (ray[..., None, :] @ spread @ ray[..., None])[..., 0, 0]
    across = (spread.diagonal(dim1=-2, dim2=-1).sum(-1) - along) / 2
    return torch.stack([along, across], -1).clamp_min(0).sqrt()


def _of_angles(
    objective: FrameObjective, joints: JointPositions, state: State, covariance: Float[Tensor, "B d d"]
) -> Float[Tensor, "B 13"]:
    with torch.enable_grad():
        move = state.vector.new_zeros(len(state), len(objective.index), requires_grad=True)
        angles = _angles(joints.estimate(state.moved(objective.step(move))))
        slopes = [torch.autograd.grad(angle.sum(), move, retain_graph=True)[0] for angle in angles]
    # The variance of an angle is k^T C k, with k its gradient by the unknowns.
    rows = torch.stack(slopes, 1)
    return ((rows @ covariance) * rows).sum(-1).clamp_min(0).sqrt().rad2deg()


def _angles(joints: Estimate) -> list[Float[Tensor, "B"]]:
    """ANGLES, radians."""
    points, coefficients = joints.view.points, joints.view.parametrisation.coefficients(joints.state[:1])
    pose = joints.body_pose
    rest = points.rest + (coefficients @ points.rest_directions.flatten(0, 1).T).view(-1, 3)
    axes = {name: pose.new_tensor(at[0]) for name, at in rest_axes(rest[None].detach().cpu().numpy()).items()}
    turns, parents, found = rotations.exp(pose.unflatten(1, (-1, 3))), joints.view.points.tree.parents, []
    for name in ANGLES:
        *side, joint, angle = name.split("_")
        before, turned = (one if one in axes else f"{side[0]}_{one}" for one in _SEGMENTS[joint])
        # The second segment's axes in those of the first: A1^T R_1 ... R_n A2, over the joints between both.
        turn, bone = axes[turned], JOINT[BONES[turned]]
        while bone != JOINT[BONES[before]]:
            turn, bone = turns[:, bone - 1] @ turn, int(parents[bone])
        found.append(_TURNS.get(angle, _about_z)(axes[before].T @ turn))
    return found
