"""Plays a script: from its keyframes to the parameters of a body, by inverse kinematics; the face by what it does.

World: x to the person's left, y up, z forward, metres, seconds; the origin lies on the floor between the feet.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation

from evaluation.synthetic.acting.floor_contact import FootShape, hand_points, lowest, seat_gap, within_reach
from evaluation.synthetic.acting.limbs import LIMBS, Figure, hand_rotation
from evaluation.synthetic.acting.script import SIDES, FootKey, Key, Script, directions_through, through, wander
from fitting_core.body.handshapes import FINGERS, HANDSHAPES, finger_angles
from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import JOINT, N_JOINTS, POSE_JOINTS, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.keypoints import Side

# Among the 51 inner landmarks, right ones of the person first.
_BROWS = range(10)
_UPPER_LIDS, _LOWER_LIDS = (20, 21, 26, 27), (23, 24, 29, 30)
_RIGHT_CORNER, _LEFT_CORNER = 31, 37

GESTURES: dict[str, dict[int, tuple[float, float, float]]] = {
    "blink": {k: (0.0, -8.0, 0.0) for k in _UPPER_LIDS} | {k: (0.0, 1.0, 0.0) for k in _LOWER_LIDS},
    "smile": {_RIGHT_CORNER: (-6.0, 5.0, -2.0), _LEFT_CORNER: (6.0, 5.0, -2.0)},
    "raised_brows": {k: (0.0, 4.0, 0.0) for k in _BROWS},
    "lowered_brows": {k: (0.0, -3.0, 0.0) for k in _BROWS},
}
"""Millimetres by which landmarks move (x to the person's left, y up, z forward); the others should stay."""
_RIDGE_MM = 1.0
"""Weight of one unit of a component against one millimetre at one landmark; holds components near 0."""


def expression_of(body: BodyModel, gesture: str) -> Float[np.ndarray, "10"]:
    """Expression coefficients that come closest to a gesture of GESTURES at full strength, by least squares.

    Bodies order and mix their expression components as they like, so coefficients mean nothing across bodies.
    """
    wanted = np.zeros((len(body.landmark_vertices), 3))
    for landmark, move in GESTURES[gesture].items():
        wanted[landmark] = move
    moves = body.expression_directions[body.landmark_vertices] * body.landmark_weights[..., None, None]
    by_component = 1000 * moves.sum(1).reshape(-1, moves.shape[-1])
    ridge = _RIDGE_MM**2 * np.eye(moves.shape[-1])
    return np.linalg.solve(by_component.T @ by_component + ridge, by_component.T @ wanted.reshape(-1))


def expressions(body: BodyModel, strengths: Mapping[str, Float[np.ndarray, "T"]]) -> Float[np.ndarray, "T 10"]:
    """Sum of gestures, each with its strength over time (0 to 1)."""
    return sum((strength[:, None] * expression_of(body, name) for name, strength in strengths.items()), np.zeros(10))


_AROUND = 0.32
"""Seconds before and after sitting on the floor in which the hips must not be below it either."""
_STRETCHED = 0.985
"""Share of an arm's length at which its hand can support: hardly anybody locks the elbow."""
_COLLAR_DEGREES = 6.0
"""How far a shoulder sinks when the arm hangs."""


def standing_root(body: BodyModel, betas: Sequence[float]) -> tuple[Float[np.ndarray, "55 3"], float]:
    """Joints of the rest pose of a shape, and the height of its soles there (metres)."""
    shaped = body.with_shape(betas)
    return shaped.rest_joints, float(shaped.template[:, 1].min())


@dataclass(frozen=True, kw_only=True, eq=False)
class _Unrest:
    """Body sway, which the script lacks. Unit variance, smooth in time."""

    hips: Float[np.ndarray, "T 3"]
    spine: Float[np.ndarray, "T 3"]
    head: Float[np.ndarray, "T 3"]
    wrists: Mapping[str, Float[np.ndarray, "T 3"]]
    fingers: Mapping[str, Float[np.ndarray, "T 45"]]

    @staticmethod
    def draw(rng: np.random.Generator, times: Float[np.ndarray, "T"]) -> "_Unrest":
        return _Unrest(
            hips=wander(rng, times, 3, seconds=0.5),
            spine=wander(rng, times, 3, seconds=0.4),
            head=wander(rng, times, 3, seconds=0.3),
            wrists={side: wander(rng, times, 3, seconds=0.15) for side in SIDES},
            fingers={side: wander(rng, times, 45, seconds=0.25) for side in SIDES},
        )


def perform(
    body: BodyModel,
    script: Script,
    times: Float[np.ndarray, "T"],
    rng: np.random.Generator,
    *,
    betas: Sequence[float],
) -> BodyParams:
    """The performance at some times (seconds, evenly spaced) in the WORLD; `in_camera` takes it into a camera's."""
    actor = _Actor(body, script, times, _Unrest.draw(rng, times), betas)
    on_floor = through(script.on_floor, times)[:, 0]
    root = actor.scripted_root()
    step = times[1] - times[0] if len(times) > 1 else 1.0
    near = np.flatnonzero(maximum_filter1d(on_floor, 1 + 2 * round(_AROUND / step)))
    mesh = shared_mesh(body)
    for _ in range(2 if len(near) else 0):
        # Sinking hips turn the thighs, on whose flesh people sit: the second round takes the rest off.
        params = actor.params(actor.pose(root))
        gap = seat_gap(body, mesh(params[near.tolist()]).numpy())
        root[near, 1] -= gaussian_filter1d(np.minimum(on_floor[near] * gap, gap), 0.04 / step, mode="nearest")
    return actor.params(actor.pose(root))


class _Actor:
    """A body of one shape that plays a script at some times."""

    def __init__(
        self, body: BodyModel, script: Script, times: Float[np.ndarray, "T"], unrest: _Unrest, betas: Sequence[float]
    ) -> None:
        self.body, self.script, self.times, self.unrest, self.betas = body, script, times, unrest, betas
        self.rest, self.floor = standing_root(body, betas)
        shaped = body.with_shape(betas).template
        self.feet = {side: FootShape.of(body, shaped, self.rest, side) for side in SIDES}
        self.hands = {side: hand_points(body, shaped, self.rest, side) for side in SIDES}

    def scripted_root(self) -> Float[np.ndarray, "T 3"]:
        """Where the script wants the pelvis joint."""
        upright = self.rest[0] - [0, self.floor, 0]
        return upright + through(self.script.hips_path, self.times) + self.unrest.hips * [0.003, 0.0, 0.003]

    def pose(self, root: Float[np.ndarray, "T 3"]) -> Figure:
        """All joints, for a path of the pelvis joint."""
        figure = Figure(self.rest, self.body.parents, root)
        self._pose_trunk(figure)
        for side, sign in SIDES.items():
            self._pose_leg(figure, side, sign)
            self._pose_arm(figure, side, sign)
        return figure

    def _pose_trunk(self, figure: Figure) -> None:
        def turn(joint: str, degrees: np.ndarray) -> None:
            yaw_pitch_roll = degrees[:, [1, 0, 2]]
            figure.turn(joint, Rotation.from_euler("YXZ", yaw_pitch_roll, degrees=True).as_matrix())

        times, script = self.times, self.script
        breath = np.stack([-0.8 * np.sin(2 * np.pi * times / 3.4), 0 * times, 0 * times], 1)
        turn("pelvis", through(script.hips_turn, times))
        spine = through(script.spine_turn, times, smoothing=0.06) + 0.6 * self.unrest.spine + breath
        for joint, share in (("spine1", 0.3), ("spine2", 0.35), ("spine3", 0.35)):
            turn(joint, share * spine)
        head = through(script.head_turn, times) + 0.8 * self.unrest.head
        turn("neck", 0.4 * head)
        turn("head", 0.6 * head)

    def _pose_leg(self, figure: Figure, side: str, sign: float) -> None:
        """Feet stand where the script says: the knees follow from the hips."""
        keys, shape = self.script.feet[side], self.feet[side]

        def channel(value: Callable[[FootKey], Sequence[float]]) -> Float[np.ndarray, "T D"]:
            return through([(key.time, value(key)) for key in keys], self.times)

        place = channel(lambda key: key.place) * [sign, 1.0]
        degrees = channel(lambda key: (sign * key.yaw, key.heel, -sign * key.roll))
        foot = Rotation.from_euler("YZX", degrees[:, [0, 2, 1]], degrees=True).as_matrix()
        toes = Rotation.from_euler("X", -degrees[:, 1:2], degrees=True).as_matrix()
        ankle = shape.ankle(place, foot, toes, channel(lambda key: (key.lift,))[:, 0])
        knees = [(key.time, np.multiply(key.knee, [sign, 1.0, 1.0])) for key in keys]
        figure.reach(LIMBS[f"{side}_leg"], ankle, directions_through(knees, self.times), foot)
        figure.turn(f"{side}_foot", toes)

    def _pose_arm(self, figure: Figure, side: Side, sign: float) -> None:
        keys, times = self.script.arms[side], self.times
        mirror = np.array([sign, 1.0, 1.0])

        def channel(name: str) -> list[Key]:
            return [(key.time, np.multiply(getattr(key, name), mirror)) for key in keys]

        hand = hand_rotation(
            directions_through(channel("fingers"), times), directions_through(channel("palm"), times), side
        )
        elbow = directions_through(channel("elbow"), times, smoothing=0.08)
        lift = through([(key.time, (key.wrist[1],)) for key in keys if key.anchor != "floor"], times)[:, 0]
        collar = sign * np.where(lift > -0.3, 0.6 * _COLLAR_DEGREES * (lift + 0.3) / 0.3, 0.0) - sign * _COLLAR_DEGREES
        figure.turn(f"{side}_collar", Rotation.from_euler("z", collar[:, None], degrees=True).as_matrix())
        wrist = self._wrist_path(figure, side, mirror, hand) + 0.002 * self.unrest.wrists[side]
        figure.reach(LIMBS[f"{side}_arm"], wrist, elbow, hand)
        shapes = [(key.time, finger_angles(HANDSHAPES[key.shape], side).reshape(45)) for key in keys]
        angles = through(shapes, times) + np.radians(1.5) * self.unrest.fingers[side]
        for k, joint in enumerate(f"{side}_{finger}{n}" for finger in FINGERS for n in (1, 2, 3)):
            figure.turn(joint, Rotation.from_rotvec(angles[:, 3 * k : 3 * k + 3]).as_matrix())

    def _wrist_path(self, figure: Figure, side: str, mirror: np.ndarray, hand: np.ndarray) -> Float[np.ndarray, "T 3"]:
        """Where the wrist should be: counted from one anchor, or on the way from one to the next."""
        keys = self.script.arms[side]
        path, total = np.zeros((len(self.times), 3)), np.zeros((len(self.times), 1))
        for anchor in sorted({key.anchor for key in keys}):
            offset = through(
                [(key.time, np.multiply(key.wrist, mirror)) for key in keys if key.anchor == anchor], self.times
            )
            weight = through([(key.time, (float(key.anchor == anchor),)) for key in keys], self.times)
            path += weight * _ANCHORS[anchor](self, figure, side, offset, hand)
            total += weight
        return path / total

    def params(self, figure: Figure) -> BodyParams:
        """Parameters of the posed figure in the world, with the script's face."""
        body, script, times = self.body, self.script, self.times
        pose = Rotation.from_matrix(figure.local.reshape(-1, 3, 3)).as_rotvec().reshape(len(times), N_JOINTS, 3)
        left, right = (pose[:, first : first + 15].reshape(len(times), 45) for first in (25, 40))
        face = {name: through(keys, times, smoothing=0.02)[:, 0] for name, keys in script.face.items()}
        arrays = dict(
            betas=np.tile(self.betas, (len(times), 1)),
            global_orient=pose[:, 0],
            body_pose=pose[:, POSE_JOINTS["body_pose"]].reshape(len(times), 63),
            left_hand_pose=left - body.hand_mean[0],
            right_hand_pose=right - body.hand_mean[1],
            jaw_pose=np.radians(through(script.jaw_degrees, times)) * [1.0, 0.0, 0.0],
            leye_pose=np.zeros((len(times), 3)),
            reye_pose=np.zeros((len(times), 3)),
            expression=np.zeros((len(times), 10)) + expressions(body, face),
            camera_translation=figure.root - figure.rest[0],
        )
        return BodyParams(**{name: torch.as_tensor(array) for name, array in arrays.items()})


def _from_chest(actor: _Actor, figure: Figure, side: str, offset: np.ndarray, hand: np.ndarray) -> np.ndarray:
    chest, _ = figure.world("spine3")
    shoulders = (figure.world("left_shoulder")[1] + figure.world("right_shoulder")[1]) / 2
    return shoulders + (chest @ offset[..., None])[..., 0]


def _from_knee(actor: _Actor, figure: Figure, side: str, offset: np.ndarray, hand: np.ndarray) -> np.ndarray:
    return figure.world(f"{side}_knee")[1] + offset


def _from_floor(actor: _Actor, figure: Figure, side: str, offset: np.ndarray, hand: np.ndarray) -> np.ndarray:
    touching = -lowest(actor.hands[side], hand)  # the wrist's height
    wrist = offset + np.stack([0 * actor.times, touching, 0 * actor.times], 1)
    shoulder, elbow, end = (actor.rest[JOINT[f"{side}_{name}"]] for name in ("shoulder", "elbow", "wrist"))
    length = float(np.linalg.norm(elbow - shoulder) + np.linalg.norm(end - elbow))
    _, origin = figure.world(f"{side}_shoulder")
    return wrist + within_reach(actor.script.arms[side], actor.times, wrist, origin, _STRETCHED * length)


_ANCHORS = {"chest": _from_chest, "knee": _from_knee, "floor": _from_floor}
"""World position of the wrist (T, 3) from its offset: see ArmKey.anchor."""
