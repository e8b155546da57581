"""Ten expression directions from MakeHuman's facial actions.

They are chosen, not the principal components of random actions: these share brow and nose in one direction, and have
directions whose negative is no expression. Here each action's opposite is another action wherever the face has one, so
that a coefficient of -2 is as natural as +2. Opening the jaw and turning the eyes are joints, not expressions.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from build_assets.free_body.makehuman import DataFolder
from build_assets.free_body.skin.surface import VertexOrder
from fitting_core.body.geometry import MIRROR


@dataclass(frozen=True, kw_only=True)
class Expression:
    """One direction: how much of each action a coefficient of 1 holds; 2 is a strong expression."""

    name: str
    opposite: str
    actions: dict[str, float]
    """Actions of both sides at once are named without "Left" and "Right"."""
    odd: bool = False
    """The left side does the opposite of the right one."""


EXPRESSIONS = (
    Expression(
        name="smile",
        opposite="frown",
        actions={"mouthSmile": 0.20, "cheekSquint": 0.10, "mouthFrown": -0.20},
    ),
    Expression(
        name="lips protruded",
        opposite="mouth wide",
        actions={"mouthPucker": 0.22, "mouthFunnel": 0.20, "mouthStretch": -0.25},
    ),
    Expression(
        name="lips apart",
        opposite="lips pressed",
        actions={"mouthUpperUp": 0.13, "mouthLowerDown": 0.15, "mouthRollUpper": -0.18, "mouthRollLower": -0.18},
    ),
    Expression(name="mouth to the left", opposite="mouth to the right", actions={"mouthLeft": 0.3, "mouthRight": -0.3}),
    Expression(
        name="brows raised",
        opposite="brows lowered",
        actions={"browInnerUp": 0.35, "browOuterUp": 0.35, "browDown": -0.30},
    ),
    Expression(name="eyes closed", opposite="eyes wide", actions={"eyeBlink": 0.30}),
    Expression(name="cheeks puffed", opposite="cheeks drawn in", actions={"cheekPuff": 0.35}),
    Expression(
        name="nose wrinkled, eyes squinted",
        opposite="middle of the face relaxed",
        actions={"noseSneer": 0.35, "cheekSquint": 0.30, "eyeSquint": 0.25},
    ),
    Expression(name="left eye closed", opposite="right eye closed", actions={"eyeBlink": 0.2}, odd=True),
    Expression(
        name="smile of the left side", opposite="smile of the right side", actions={"mouthSmile": 0.2}, odd=True
    ),
)
"""In the order of the file's expression columns."""


def expression_directions(folder: DataFolder, order: VertexOrder) -> Float[np.ndarray, "V 3 10"]:
    """How each expression moves the skin, in metres per unit of its coefficient; symmetric or antisymmetric."""
    return np.stack([_direction(folder, order, expression) for expression in EXPRESSIONS], axis=-1)


def _direction(folder: DataFolder, order: VertexOrder, expression: Expression) -> Float[np.ndarray, "V 3"]:
    moved = np.zeros((len(order.base), 3))
    for action, amount in expression.actions.items():
        if folder.has_face_action(action):
            moved += amount * folder.face_action(action)[order.base]
            continue
        left, right = (folder.face_action(action + side)[order.base] for side in ("Left", "Right"))
        moved += amount * (left - right if expression.odd else left + right)
    odd = expression.odd or "mouthLeft" in expression.actions
    return (moved + (-1 if odd else 1) * moved[order.mirror] * MIRROR) / 2
