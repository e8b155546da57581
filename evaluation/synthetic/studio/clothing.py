"""Colours for a bare body: skin, hair, eyes, shirt and trousers, as functions of the place in the rest pose."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.body.model import JOINT, BodyModel

SKIN, HAIR, LIPS = (222, 170, 140), (58, 42, 36), (196, 112, 104)
EYE_WHITE, IRIS = (238, 234, 228), (62, 48, 40)
SHIRT, TROUSERS = (62, 118, 140), (66, 68, 84)
"""sRGB, 0 to 255."""
_OUTER_LIPS = slice(31, 43)
"""Among the 51 inner face landmarks."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Outfit:
    """Where clothes end, in the rest pose (metres)."""

    paint: Float[np.ndarray, "V 4"]
    """Of each vertex: its place in the rest pose, and how far it is eyeball."""
    joints: Float[np.ndarray, "55 3"]
    lips: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]
    """Middle and half extent."""

    @staticmethod
    def of(body: BodyModel) -> "Outfit":
        """The outfit cut to a body's rest pose."""
        corners = body.template[body.landmark_vertices[_OUTER_LIPS]]
        lips = (corners * body.landmark_weights[_OUTER_LIPS, :, None]).sum(1)
        low, high = lips.min(0), lips.max(0)
        eyeball = body.skinning_weights[:, [JOINT["left_eye"], JOINT["right_eye"]]].sum(1, keepdims=True)
        return Outfit(
            paint=np.concatenate([body.template, eyeball], 1),
            joints=body.rest_joints,
            lips=((low + high) / 2, (high - low) / 2),
        )

    def colors(self, paint: Float[np.ndarray, "P 4"]) -> Float[np.ndarray, "P 3"]:
        """Linear RGB (0 to 1) of points between vertices, from their interpolated paint."""
        rest = paint[:, :3]
        color = np.tile(_linear(SKIN), (len(rest), 1))
        for tone, amount in (*self._face(rest), *self._eyes(paint), *self.clothes(rest)):
            touched = np.flatnonzero(amount)
            color[touched] += (_linear(tone) - color[touched]) * amount[touched, None]
        return color

    def _at(self, joint: str) -> np.ndarray:
        return self.joints[JOINT[joint]]

    def _face(self, rest: np.ndarray) -> list[tuple[tuple[int, int, int], np.ndarray]]:
        middle, half = self.lips
        from_lips = np.linalg.norm((rest - middle)[:, :2] / half[:2], axis=1)
        layers = [(LIPS, _below(from_lips, 1.0, 0.25) * (rest[:, 2] > middle[2] - 0.04))]
        eyes, ears = self._at("left_eye"), self._at("head")
        # The hairline is highest over the eyes and falls towards the ears and the neck.
        behind = np.clip((eyes[2] - rest[:, 2]) / (eyes[2] - ears[2] + 0.02), 0, 1.25)
        line = eyes[1] + 0.058 - 0.075 * behind**2 + 0.02 * (behind > 1.2)
        hair = np.maximum(_above(rest[:, 1], line, 0.004), _below(rest[:, 2], ears[2] - 0.02, 0.004))
        head = _above(rest[:, 1], ears[1] - 0.01, 0.006) * (abs(rest[:, 0]) < 0.15)
        # Half the distance between the roots of the ears: what lies farther out at their height is an ear.
        ear = _below(abs(rest[:, 0]), float(2.35 * self._at("left_eye")[0]), 0.002)
        return [*layers, (HAIR, hair * head * ear)]

    def _eyes(self, paint: np.ndarray) -> list[tuple[tuple[int, int, int], np.ndarray]]:
        """Whites where the eyeballs are, and an iris around the line straight ahead."""
        ball = _above(paint[:, 3], 0.5, 0.2)
        away = abs(paint[:, :2]) - [self._at("left_eye")[0], 0]
        away[:, 1] = paint[:, 1] - self._at("left_eye")[1]
        return [(EYE_WHITE, ball), (IRIS, ball * _below(np.linalg.norm(away, axis=1), 0.0062, 0.001))]

    def clothes(self, rest: Float[np.ndarray, "P 3"]) -> list[tuple[tuple[int, int, int], Float[np.ndarray, "P"]]]:
        """Shirt and trousers: their colour, and how far they cover places in the rest pose, 0 to 1."""
        across, up = abs(rest[:, 0]), rest[:, 1]
        shoulder, elbow, neck = self._at("left_shoulder"), self._at("left_elbow"), self._at("neck")
        waist, ankle = self._at("spine1")[1] - 0.01, self._at("left_ankle")[1]
        sleeve = shoulder[0] + 0.62 * (elbow[0] - shoulder[0])
        collar = np.linalg.norm((rest - neck - [0, 0.035, 0]) / [1.0, 1.15, 1.0], axis=1)
        shirt = (
            _above(up, waist - 0.01, 0.003)
            * _below(across, sleeve, 0.004)
            * _above(collar, 0.105, 0.003)
            * _below(up, neck[1] + 0.02, 0.003)
        )
        return [(SHIRT, shirt), (TROUSERS, _below(up, waist, 0.003) * _above(up, ankle + 0.03, 0.003))]


def _linear(color: tuple[int, int, int]) -> np.ndarray:
    return (np.array(color) / 255) ** 2.2


def _above(value: np.ndarray, edge: np.ndarray | float, softness: float) -> np.ndarray:
    return np.clip((value - edge) / (2 * softness) + 0.5, 0.0, 1.0)


def _below(value: np.ndarray, edge: np.ndarray | float, softness: float) -> np.ndarray:
    return 1 - _above(value, edge, softness)
