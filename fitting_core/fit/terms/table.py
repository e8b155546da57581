"""The TERMS table: which terms a stage's objective has beside the data term, and how each is made."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.joint_ranges import joint_ranges
from fitting_core.body.model import POSE_JOINTS, BodyModel
from fitting_core.config.schema import FitConfig
from fitting_core.fit.terms.collision.term import CollidingBody, Collision
from fitting_core.fit.terms.joint_limits import Limits
from fitting_core.fit.terms.terms import Bending, Quadratic, Rest, Term, Upright
from fitting_core.fit.variables.state import Parametrisation


class Setting(Protocol):
    """What is constant over a fit, as far as terms look at it; `stages.Stages` is one."""

    config: FitConfig
    body: BodyModel
    parametrisation: Parametrisation
    device: torch.device
    xy: Float[Tensor, "T 137 2"]
    leg_seen: Bool[Tensor, "T"]

    def has(self, group: slice) -> bool:
        """Whether the clip shows any keypoint of the group."""
        ...

    @property
    def observed(self) -> Bool[np.ndarray, "T 55"]:
        """Joints that the image turns."""
        ...

    @property
    def colliding_body(self) -> CollidingBody:
        """The whole mesh."""
        ...


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


def _shape(setting: Setting, s: int) -> Term:
    return _quadratic(setting, "shape", setting.parametrisation.columns.betas, setting.config.weights.shape[s])


def _bending(setting: Setting, s: int) -> Term:
    return Bending(setting.config.weights.bending[s])


def upright(setting: Setting, lean: float, turn: float) -> Term | None:
    """Lean and turn of the root on the frames that show no leg, if there are any."""
    if not (lean or turn) or bool(setting.leg_seen.all()):
        return None
    unheld = (~setting.leg_seen).to(setting.xy)
    return Upright(lean * unheld, turn * unheld)


def _upright(setting: Setting, s: int) -> Term | None:
    return upright(setting, setting.config.weights.lean[s], setting.config.weights.turn[s])


def _limits(setting: Setting, s: int) -> Term | None:
    weight = setting.config.weights.limits[s]
    if not weight:
        return None
    return Limits.of(weight, joint_ranges(setting.body), fingers=setting.has(kp.HANDS), like=setting.xy)


def _rest(setting: Setting, s: int) -> Term | None:
    weight, prior = setting.config.weights.rest[s], setting.parametrisation.prior
    if not weight:
        return None
    unseen = ~torch.as_tensor(setting.observed[:, POSE_JOINTS["body_pose"]], device=setting.device).repeat_interleave(
        3, 1
    )
    return Rest(weight * unseen.to(setting.xy), prior.decode(prior.neutral.to(setting.xy)[None])[0])


def _collision(setting: Setting, s: int) -> Term | None:
    weight = setting.config.weights.collision[s]
    return Collision(weight, setting.colliding_body) if weight else None


TERMS: dict[str, Callable[[Setting, int], Term | None]] = {
    "body_pose": _body_pose,
    "hand_pose": _hand_pose,
    "jaw": _jaw,
    "expression": _expression,
    "shape": _shape,
    "bending": _bending,
    "upright": _upright,
    "limits": _limits,
    "rest": _rest,
    "collision": _collision,
}
"""How each term is made from what is constant over a fit and the index (0 to 4) of a stage; None: not in this stage."""


def stage_terms(setting: Setting, stage: int) -> list[Term]:
    """The terms of a stage (1 to 5) beside the data term."""
    made = (make(setting, stage - 1) for make in TERMS.values())
    return [term for term in made if term is not None]
