"""Starting values of phase 1: depth from similar triangles, and the orientations of the camera step."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.model import JOINT
from fitting_core.fit.stages import Stages
from fitting_core.fit.variables.state import State

SIDE_VIEW = 0.25
"""Ratio of shoulder width to torso length in the image below which a person is seen from the side."""
_LONGEST = 100.0
"""Metres: a larger depth is not plausible."""

_TORSO_EDGES = [("left_shoulder", "left_hip"), ("right_shoulder", "right_hip")]
_OTHER_EDGES = [
    ("left_shoulder", "right_shoulder"),
    *[(f"{side}_{a}", f"{side}_{b}") for side in ("left", "right")
      for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))],
]  # fmt: skip
_ANCHORS = ("neck", "right_shoulder", "left_shoulder", "mid_hip", "right_hip", "left_hip")
_JOINT_OF = {"mid_hip": "pelvis"}


@dataclass(frozen=True)
class DepthGuess:
    """Depth of each frame, and its source."""

    depth: Float[Tensor, "T"]
    from_torso: Bool[Tensor, "T"]
    from_limbs: Bool[Tensor, "T"]

    def note(self) -> str:
        """For users."""
        torso, limbs = int(self.from_torso.sum()), int(self.from_limbs.sum())
        rest = len(self.depth) - torso - limbs
        parts = [f"the torso in {torso} frames"] if torso else []
        parts += [f"shoulders and limbs in {limbs} (hips not seen)"] if limbs else []
        parts += [f"neighbouring frames in {rest}"] if rest else []
        return "depth was first guessed from " + ", ".join(parts)


def guess_depth(stages: Stages) -> DepthGuess:
    """Similar triangles: focal length x length in metres / length in pixels.

    From the mean of the shoulder-hip edges where both are visible. Otherwise from the shoulder width and the limbs: a
    foreshortened edge looks farther away than it is, so the nearest candidate counts. Otherwise from other frames.
    """
    rest = stages.fitted.rest_joints
    focal = sum(stages.camera.focal) / 2

    def edge(a: str, b: str) -> tuple[Tensor, Tensor, float]:
        i, j = kp.INDEX[a], kp.INDEX[b]
        seen = stages.observations.seen[:, i] & stages.observations.seen[:, j]
        return seen, (stages.xy[:, i] - stages.xy[:, j]).norm(dim=1), float((rest[JOINT[a]] - rest[JOINT[b]]).norm())

    torso = [edge(a, b) for a, b in _TORSO_EDGES]
    torso_seen = torso[0][0] & torso[1][0]
    torso_pixels = sum(t[1] for t in torso)
    by_torso = focal * sum(t[2] for t in torso) / torso_pixels.clamp_min(1e-6)  # pyright: ignore
    others = [edge(a, b) for a, b in _OTHER_EDGES]
    limbs = torch.stack(
        [torch.where(seen, focal * metres / pixels.clamp_min(1e-6), torch.inf) for seen, pixels, metres in others]
    )
    by_limbs = limbs.amin(0)
    from_torso = torso_seen & (by_torso < _LONGEST)
    from_limbs = ~from_torso & (by_limbs < _LONGEST)
    depth = torch.where(from_torso, by_torso, by_limbs)
    known = from_torso | from_limbs
    return DepthGuess(fill_gaps(depth, known, otherwise=4.0), from_torso, from_limbs)


def fill_gaps(values: Float[Tensor, "T"], known: Bool[Tensor, "T"], *, otherwise: float) -> Float[Tensor, "T"]:
    """Values where known, interpolated linearly in time and constant beyond; `otherwise` if none is known."""
    if not bool(known.any()):
        return torch.full_like(values, otherwise)
    at = np.flatnonzero(known.cpu().numpy())
    filled = np.interp(np.arange(len(values)), at, values[known].cpu().numpy())
    return torch.as_tensor(filled).to(values)


def starting_state(stages: Stages, depth: Float[Tensor, "T"], yaw_degrees: float) -> State:
    """The neutral pose at the guessed depth, upright, turned by `yaw_degrees` from facing the camera."""
    state = stages.parametrisation.neutral(len(depth))
    facing = torch.diag(depth.new_tensor([1.0, -1.0, -1.0]))
    orient = facing @ rotations.yaw(yaw_degrees, depth)
    where = [kp.INDEX[n] for n in _ANCHORS]
    rest = (orient @ stages.fitted.rest_joints[[JOINT[_JOINT_OF.get(n, n)] for n in _ANCHORS]].T).T
    share = stages.observations.confidence[:, where] * stages.observations.seen[:, where]
    total = share.sum(1, keepdim=True)
    share = torch.where(total > 0, share / total.clamp_min(1e-9), share)
    pixels = (stages.xy[:, where] * share[..., None]).sum(1)
    anchor = (share[..., None] * rest).sum(1)  # a product of matrices rounds differently for one frame than for several
    focal, center = depth.new_tensor(stages.camera.focal), depth.new_tensor(stages.camera.center)
    across = (pixels - center) / focal * depth[:, None] - anchor[:, :2]
    across = torch.where(total > 0, across, 0.0)
    state = state.with_columns(stages.parametrisation.columns.translation, torch.cat([across, depth[:, None]], 1))
    return State(orient.expand(len(depth), 3, 3).clone(), state.vector)


def half_turned(state: State) -> State:
    """The same bodies turned by 180 degrees about their own vertical axis."""
    return State(state.orient @ rotations.yaw(180.0, state.orient), state.vector)


def seen_from_side(stages: Stages) -> Bool[Tensor, "T"]:
    """Frames in which the shoulders look close together relative to the torso's length."""
    xy = stages.xy
    left, right = kp.INDEX["left_shoulder"], kp.INDEX["right_shoulder"]
    width = (xy[:, left] - xy[:, right]).norm(dim=1)
    hips = [kp.INDEX["left_hip"], kp.INDEX["right_hip"]]
    length = (xy[:, [left, right]].mean(1) - xy[:, hips].mean(1)).norm(dim=1)
    known = stages.observations.seen[:, [left, right]].all(1) & stages.observations.hips_seen
    return known & (width < SIDE_VIEW * length)
