"""Plays the script of the demo clip: from its keyframes to the parameters of a body, by inverse kinematics.

World: x to the person's left, y up, z forward, metres, seconds; the origin lies on the floor between the feet.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.body.model import JOINT, N_JOINTS, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.evaluation import demo_script as script
from fitting_core.evaluation.gestures import expressions
from fitting_core.evaluation.handshapes import FINGERS, HANDSHAPES, finger_angles
from fitting_core.evaluation.limbs import LIMBS, Figure, hand_rotation
from fitting_core.evaluation.motion import Key, directions_through, through, wander

_FOOT_OUTWARD_DEGREES = 9.0
_FOOT_SPREAD = 0.115
"""From the middle to each ankle, metres."""
_COLLAR_DEGREES = 6.0
"""How far a shoulder sinks when the arm hangs."""
_SIDES = (("left", 1.0), ("right", -1.0))


def standing_root(body: BodyModel, betas: Sequence[float]) -> tuple[Float[np.ndarray, "55 3"], float]:
    """Joints of the rest pose of a shape, and the height of its soles there (metres)."""
    shaped = body.template + body.shape_directions @ np.array(betas)
    return body.joint_regressor @ shaped, float(shaped[:, 1].min())


def perform(
    body: BodyModel,
    times: Float[np.ndarray, "T"],
    rng: np.random.Generator,
    *,
    betas: Sequence[float] = script.BETAS,
) -> BodyParams:
    """The performance at some times (seconds, evenly spaced) in the WORLD: `in_camera` turns it into a camera's."""
    rest, floor = standing_root(body, betas)
    sway = wander(rng, times, 3, seconds=0.5) * [0.003, 0.0, 0.003]
    figure = Figure(rest, body.parents, rest[0] - [0, floor, 0] + through(script.HIPS_PATH, times) + sway)
    _pose_trunk(figure, times, rng)
    for side, sign in _SIDES:
        _pose_leg(figure, side, sign, floor)
        _pose_arm(figure, side, sign, times, rng)
    return _params(body, figure, times, betas)


def in_camera(
    params: BodyParams,
    rest_root: Float[np.ndarray, "3"],
    rotation: Float[np.ndarray, "3 3"],
    translation: Float[np.ndarray, "3"],
) -> BodyParams:
    """The same bodies in camera space, where x_camera = rotation @ x_world + translation.

    A body turns about its root joint, which rests at `rest_root` and not at the origin.
    """
    orient = Rotation.from_matrix(rotation) * Rotation.from_rotvec(params.global_orient.numpy())
    root = (params.camera_translation.numpy() + rest_root) @ rotation.T + translation
    return replace(
        params,
        global_orient=torch.as_tensor(orient.as_rotvec()),
        camera_translation=torch.as_tensor(root - rest_root),
    )


def _pose_trunk(figure: Figure, times: np.ndarray, rng: np.random.Generator) -> None:
    def turn(joint: str, degrees: np.ndarray) -> None:
        yaw_pitch_roll = degrees[:, [1, 0, 2]]
        figure.turn(joint, Rotation.from_euler("YXZ", yaw_pitch_roll, degrees=True).as_matrix())

    breath = np.stack([-0.8 * np.sin(2 * np.pi * times / 3.4), 0 * times, 0 * times], 1)
    turn("pelvis", through(script.HIPS_TURN, times))
    spine = through(script.SPINE_TURN, times, smoothing=0.06) + 0.6 * wander(rng, times, 3, seconds=0.4) + breath
    for joint, share in (("spine1", 0.3), ("spine2", 0.35), ("spine3", 0.35)):
        turn(joint, share * spine)
    head = through(script.HEAD_TURN, times) + 0.8 * wander(rng, times, 3, seconds=0.3)
    turn("neck", 0.4 * head)
    turn("head", 0.6 * head)


def _pose_leg(figure: Figure, side: str, sign: float, floor: float) -> None:
    """Feet stand flat where they stand: the knees follow from the hips."""
    ankle = figure.rest[JOINT[f"{side}_ankle"]]
    frames = len(figure.root)
    target = np.tile([sign * _FOOT_SPREAD, ankle[1] - floor, ankle[2]], (frames, 1))
    foot = Rotation.from_euler("y", sign * _FOOT_OUTWARD_DEGREES, degrees=True).as_matrix()
    pole = np.tile([sign * 0.22, 0.0, 1.0], (frames, 1))
    figure.reach(LIMBS[f"{side}_leg"], target, pole, np.tile(foot, (frames, 1, 1)))


def _pose_arm(figure: Figure, side: str, sign: float, times: np.ndarray, rng: np.random.Generator) -> None:
    keys = script.ARMS[side]
    mirror = np.array([sign, 1.0, 1.0])

    def channel(name: str) -> list[Key]:
        return [(key.time, np.multiply(getattr(key, name), mirror)) for key in keys]

    fingers = directions_through(channel("fingers"), times)
    palm = directions_through(channel("palm"), times)
    elbow = directions_through(channel("elbow"), times, smoothing=0.08)
    lift = through([(key.time, (key.wrist[1],)) for key in keys], times)[:, 0]
    collar = sign * np.where(lift > -0.3, 0.6 * _COLLAR_DEGREES * (lift + 0.3) / 0.3, 0.0) - sign * _COLLAR_DEGREES
    figure.turn(f"{side}_collar", Rotation.from_euler("z", collar[:, None], degrees=True).as_matrix())
    wrist = _wrist_path(figure, side, keys, mirror, times) + 0.002 * wander(rng, times, 3, seconds=0.15)
    figure.reach(LIMBS[f"{side}_arm"], wrist, elbow, hand_rotation(fingers, palm, side))
    shapes = [(key.time, finger_angles(HANDSHAPES[key.shape], side).reshape(45)) for key in keys]
    angles = through(shapes, times) + np.radians(1.5) * wander(rng, times, 45, seconds=0.25)
    for k, joint in enumerate(f"{side}_{finger}{n}" for finger in FINGERS for n in (1, 2, 3)):
        figure.turn(joint, Rotation.from_rotvec(angles[:, 3 * k : 3 * k + 3]).as_matrix())


def _wrist_path(
    figure: Figure, side: str, keys: Sequence[script.ArmKey], mirror: np.ndarray, times: np.ndarray
) -> Float[np.ndarray, "T 3"]:
    """Where the wrist should be: counted from the chest, from the knee, or on the way from one to the other."""
    wrists = [(key.time, np.multiply(key.wrist, mirror), key.on_knee) for key in keys]
    chest, _ = figure.world("spine3")
    shoulders = (figure.world("left_shoulder")[1] + figure.world("right_shoulder")[1]) / 2
    from_chest = through([(time, offset) for time, offset, on_knee in wrists if on_knee == 0], times)
    from_knee = through([(time, offset) for time, offset, on_knee in wrists if on_knee == 1], times)
    weight = through([(key.time, (key.on_knee,)) for key in keys], times)
    by_chest = shoulders + (chest @ from_chest[..., None])[..., 0]
    by_knee = figure.world(f"{side}_knee")[1] + from_knee
    return (1 - weight) * by_chest + weight * by_knee


def _params(body: BodyModel, figure: Figure, times: np.ndarray, betas: Sequence[float]) -> BodyParams:
    pose = Rotation.from_matrix(figure.local.reshape(-1, 3, 3)).as_rotvec().reshape(len(times), N_JOINTS, 3)
    jaw = np.radians(through(script.JAW_DEGREES, times)) * [1.0, 0.0, 0.0]
    left, right = (pose[:, first : first + 15].reshape(len(times), 45) for first in (25, 40))
    arrays = dict(
        betas=np.tile(betas, (len(times), 1)),
        global_orient=pose[:, 0],
        body_pose=pose[:, 1:22].reshape(len(times), 63),
        left_hand_pose=left - body.hand_mean[0],
        right_hand_pose=right - body.hand_mean[1],
        jaw_pose=jaw,
        leye_pose=np.zeros((len(times), 3)),
        reye_pose=np.zeros((len(times), 3)),
        expression=expressions(
            body, {name: through(keys, times, smoothing=0.02)[:, 0] for name, keys in script.FACE.items()}
        ),
        camera_translation=figure.root - figure.rest[0],
    )
    return BodyParams(**{name: torch.as_tensor(array) for name, array in arrays.items()})
