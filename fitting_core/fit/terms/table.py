"""The TERMS table: which terms a stage's objective has beside the data term, and how each is made."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fitting_core.body.joint_ranges import joint_ranges
from fitting_core.body.model import JOINT, POSE_JOINTS, BodyModel
from fitting_core.camera import CameraPath
from fitting_core.config.schema import FitConfig
from fitting_core.fit.terms.collision.term import CollidingBody, Collision
from fitting_core.fit.terms.limits import Limits
from fitting_core.fit.terms.locks import Locks
from fitting_core.fit.terms.priors import Bending, Height, Quadratic, Rest, Upright
from fitting_core.fit.terms.temporal import Evenness, JointPositions
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.state import Parametrisation
from fitting_core.keypoints import LOCKABLE

LOCK_WEIGHT = 6.0 / np.radians(2.0)
"""Per radian: what a person says, as of depths, and within two degrees."""
HEIGHT_DEVIATION = 0.015
"""Metres: what people say of their height, and how they stand."""
DEPTH_WEIGHT = 100.0
"""Of the camera step: (1e2)^2 (tz - tz_0)^2."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Setting:
    """What is constant over a fit, as far as terms look at it."""

    config: FitConfig
    """Weights and all other settings."""
    body: BodyModel
    """What is fitted."""
    parametrisation: Parametrisation
    """How a solver's numbers become the body's pose."""
    xy: Float[Tensor, "T 137 2"]
    """Pixels of the detections."""
    leg_seen: Bool[Tensor, "T"]
    """Frames that show a hip and its knee, or of which a given start tells them."""
    hands_shown: bool
    """Whether the clip shows any keypoint of the hands."""
    turned: Bool[np.ndarray, "T 55"]
    """Joints that the image turns, or what is known of relative positions."""
    temporal_weight: float
    """w_T for this clip."""
    turn: Float[Tensor, "T 137 3"]
    """How joints are turned, as far as a person says it (see `Keypoints.turn`)."""
    path: CameraPath | None
    """How the camera moves."""
    colliding: Callable[[], CollidingBody]
    """Makes the whole mesh the first time."""


def _quadratic(setting: Setting, name: str, where: slice, weight: float, target: Tensor | None = None) -> Quadratic:
    return Quadratic(name, where, setting.xy.new_full((where.stop - where.start,), weight), target)


def _body_pose(setting: Setting, s: int) -> Term:
    p = setting.parametrisation
    weight = setting.config.weights.body_pose[s]
    return _quadratic(setting, "body_pose", p.columns.body, weight, p.prior.neutral.to(setting.xy))


def _hand_pose(setting: Setting, s: int) -> Term:
    return _quadratic(setting, "hand_pose", setting.parametrisation.columns.hands, setting.config.weights.hand_pose[s])


def _jaw(setting: Setting, s: int) -> Term:
    w = setting.config.weights
    weights = setting.xy.new_tensor([w.jaw_open[s], w.jaw_sideways[s], w.jaw_sideways[s]])
    return Quadratic("jaw", setting.parametrisation.columns.jaw, weights)


def _expression(setting: Setting, s: int) -> Term:
    columns = setting.parametrisation.columns
    return _quadratic(setting, "expression", columns.expression, setting.config.weights.expression[s])


def _shape(setting: Setting, s: int) -> Quadratic:
    p = setting.parametrisation
    return _quadratic(setting, "shape", p.columns.betas, setting.config.weights.shape[s], p.betas)


def _shared_shape(setting: Setting, s: int) -> Term:
    """E_beta'."""
    return replace(_shape(setting, s), name="shared_shape", once=True)


def _height(setting: Setting, s: int) -> Term | None:
    """Counts as a beta does, in its standard deviations."""
    told, (mean, by_betas) = setting.config.height, setting.body.height
    if told is None:
        return None
    weight = setting.config.weights.shape[s] / HEIGHT_DEVIATION
    return Height(weight, told / 100 - mean, setting.xy.new_tensor(by_betas), setting.parametrisation.columns.betas)


def _bending(setting: Setting, s: int) -> Term | None:
    weight = setting.config.weights.bending[s]
    return Bending(weight) if weight else None


def _held_upright(setting: Setting, lean: float, turn: float) -> Term | None:
    """Lean and turn of the root on the frames that show no leg, if there are any."""
    if not (lean or turn) or bool(setting.leg_seen.all()):
        return None
    unheld = (~setting.leg_seen).to(setting.xy)
    return Upright(lean * unheld, turn * unheld)


def _upright(setting: Setting, s: int) -> Term | None:
    return _held_upright(setting, setting.config.weights.lean[s], setting.config.weights.turn[s])


def _limits(setting: Setting, s: int) -> Term | None:
    weight = setting.config.weights.limits[s]
    if not weight:
        return None
    limits = _limits_of(setting.body, setting.hands_shown, setting.xy.dtype, setting.xy.device)
    return replace(limits, weight=weight)


@lru_cache(maxsize=4)
def _limits_of(body: BodyModel, fingers: bool, dtype: torch.dtype, device: torch.device) -> Limits:
    """With weight 1. Remembered, as each stage and each drag of a keypoint would wait for it."""
    return Limits.of(1.0, joint_ranges(body), fingers=fingers, like=torch.zeros(0, dtype=dtype, device=device))


def _rest(setting: Setting, s: int) -> Term | None:
    weight, prior = setting.config.weights.rest[s], setting.parametrisation.prior
    if not weight:
        return None
    turned = torch.as_tensor(setting.turned[:, POSE_JOINTS["body_pose"]], device=setting.xy.device)
    unknown = ~turned.repeat_interleave(3, 1)
    return Rest(weight * unknown.to(setting.xy), prior.decode(prior.neutral.to(setting.xy)[None])[0])


def _collision(setting: Setting, s: int) -> Term | None:
    weight = setting.config.weights.collision[s]
    return Collision(weight, setting.colliding()) if weight else None


def _temporal(setting: Setting, s: int) -> Term | None:
    if not setting.temporal_weight:
        return None
    in_camera = setting.config.temporal.space == "camera"
    joints = JointPositions(setting.body, setting.parametrisation, in_camera=in_camera, path=setting.path)
    return Evenness(setting.temporal_weight, joints)


def _locks(setting: Setting, s: int) -> Term | None:
    """In every stage and configuration: whoever locks a joint means it."""
    names = LOCKABLE.values()
    turn = setting.turn[:, list(LOCKABLE)]
    locked = turn.isfinite().all(-1)
    used = locked.any(0)
    if not bool(used.any()):
        return None
    joint = torch.tensor([JOINT[name] for name in names], device=used.device)[used]
    return Locks(joint, turn[:, used].nan_to_num(), LOCK_WEIGHT * locked[:, used].to(turn))


@dataclass(frozen=True)
class Entry:
    """A line of the table."""

    kind: type[Term]
    make: Callable[[Setting, int], Term | None]
    """From what is constant over a fit and the index (0 to 4) of a stage; None: not in this stage."""


TERMS: dict[str, Entry] = {
    "body_pose": Entry(Quadratic, _body_pose),
    "hand_pose": Entry(Quadratic, _hand_pose),
    "jaw": Entry(Quadratic, _jaw),
    "expression": Entry(Quadratic, _expression),
    "shape": Entry(Quadratic, _shape),
    "shared_shape": Entry(Quadratic, _shared_shape),
    "height": Entry(Height, _height),
    "bending": Entry(Bending, _bending),
    "upright": Entry(Upright, _upright),
    "limits": Entry(Limits, _limits),
    "rest": Entry(Rest, _rest),
    "locks": Entry(Locks, _locks),
    "collision": Entry(Collision, _collision),
    "temporal": Entry(Evenness, _temporal),
}
"""By name."""
REACH = max(entry.kind.reach for entry in TERMS.values())
"""Frames to either side that any term looks at. Frames up to twice as far apart are coupled."""


def stage_terms(setting: Setting, stage: int) -> list[Term]:
    """The terms of a stage (1 to 5) beside the data term."""
    made = (entry.make(setting, stage - 1) for entry in TERMS.values())
    return [term for term in made if term is not None]


def camera_terms(setting: Setting, depth: Float[Tensor, "T"]) -> list[Term]:
    """The terms of the camera step beside the data term: the depth stays near its guess, the root upright."""
    where, weights = setting.parametrisation.columns.translation, setting.config.weights
    weight = setting.xy.new_full((1,), DEPTH_WEIGHT)
    hold = Quadratic("depth", slice(where.stop - 1, where.stop), weight, depth[:, None])
    upright = _held_upright(setting, max(weights.lean), max(weights.turn))
    return [hold] if upright is None else [hold, upright]
