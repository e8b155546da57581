"""Figures in the poses of hard_poses.py, and in any pose, before a camera: parameters and noise-free keypoints."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from benchmarks.hard_poses import Arm, HardPose, Leg, Vector
from build_assets.motion_capture.retarget import collar_rotation
from evaluation.synthetic.acting.limbs import LIMBS, Figure, hand_rotation
from fitting_core.body.handshapes import HANDSHAPES, finger_angles
from fitting_core.body.model import N_HAND_COMPONENTS, N_JOINTS, POSE_JOINTS, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera
from fitting_core.keypoints import COUNT, Keypoints, Side

CAMERA = Camera(focal=(1150.0, 1150.0), center=(500.0, 500.0), size=(1000, 1000), source="given")
DISTANCE = 3.5
"""From the camera to the middle of the body's joints, metres."""
TILT_DEGREES = 10.0
"""By which the camera looks down."""
_COLLAR_ROUNDS = 4
"""The collar follows the upper arm, whose direction follows from where the collar holds it."""
_SIDES: tuple[tuple[Side, float], ...] = (("left", 1.0), ("right", -1.0))
_FACING = np.diag([1.0, -1.0, -1.0])
_BODY = POSE_JOINTS["body_pose"]


@dataclass(frozen=True, kw_only=True)
class View:
    """From where a pose is seen."""

    name: str
    yaw_degrees: float
    """Of the person, to their left, from facing the camera."""


FRONT, BACK = View(name="front", yaw_degrees=0.0), View(name="back", yaw_degrees=170.0)
VIEWS = (FRONT, View(name="oblique", yaw_degrees=40.0), View(name="side", yaw_degrees=-85.0))


def views_of(pose: HardPose) -> Sequence[View]:
    """From where a pose is seen."""
    return (*VIEWS, BACK) if pose.from_behind else VIEWS


def figure_of(body: BodyModel, pose: HardPose) -> BodyParams:
    """One frame of a person of mean shape in a pose, in level axes, with the pelvis joint where it rests."""
    rest = body.rest_joints
    figure = Figure(rest, body.parents, rest[:1])
    figure.turn("pelvis", _turn(pose.hips))
    for joint, share in (("spine1", 0.3), ("spine2", 0.35), ("spine3", 0.35)):
        figure.turn(joint, _turn(pose.spine, share))
    for joint, share in (("neck", 0.4), ("head", 0.6)):
        figure.turn(joint, _turn(pose.head, share))
    hands = []
    shoulders = (figure.world("left_shoulder")[1] + figure.world("right_shoulder")[1]) / 2
    for (side, sign), leg, arm in zip(_SIDES, pose.legs, pose.arms, strict=True):
        _place_leg(figure, side, sign, leg)
        _place_arm(figure, side, sign, arm, shoulders)
        hands.append(_hand(body, side, arm.shape))
    local = Rotation.from_matrix(figure.local[0]).as_rotvec()
    orient = Rotation.from_matrix(_turn(pose.whole)[0] @ figure.local[0, 0]).as_rotvec()
    still = BodyParams.neutral(1)
    return replace(
        still,
        global_orient=torch.as_tensor(orient)[None],
        body_pose=torch.as_tensor(local[_BODY].reshape(1, 63)),
        left_hand_pose=hands[0],
        right_hand_pose=hands[1],
    )


def _turn(degrees: Vector, share: float = 1.0) -> Float[np.ndarray, "1 3 3"]:
    pitch, yaw, roll = degrees
    return Rotation.from_euler("YXZ", [[share * yaw, share * pitch, share * roll]], degrees=True).as_matrix()


def _place_leg(figure: Figure, side: str, sign: float, leg: Leg) -> None:
    mirror = np.array([sign, 1.0, 1.0])
    limb = LIMBS[f"{side}_leg"]
    ankle, knee = figure.root + np.array(leg.ankle) * mirror, np.array([leg.knee]) * mirror
    if leg.toes is None:
        figure.reach(limb, ankle, knee, np.eye(3)[None])
        figure.turn(limb.joints[-1], np.eye(3)[None])
        return
    toes, sole = (np.array([v]) * mirror for v in (leg.toes, leg.sole))
    # A foot at rest has its toes forward and its sole down: a hand's fingers and palm, turned by 90 degrees.
    at_rest = hand_rotation(np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, -1.0, 0.0]]), side)
    foot = hand_rotation(toes, sole, side) @ np.swapaxes(at_rest, -1, -2)
    figure.reach(limb, ankle, knee, foot)


def _place_arm(figure: Figure, side: str, sign: float, arm: Arm, shoulders: Float[np.ndarray, "1 3"]) -> None:
    """Sets collar, shoulder, elbow and wrist; `shoulders` is the middle between them with collars at rest."""
    mirror = np.array([sign, 1.0, 1.0])
    chest, _ = figure.world("spine3")

    def in_chest(vector: Vector) -> Float[np.ndarray, "1 3"]:
        return (chest @ (np.array(vector) * mirror)[:, None])[..., 0]

    limb, end = LIMBS[f"{side}_arm"], chest
    wrist, elbow = shoulders + in_chest(arm.wrist), in_chest(arm.elbow)
    resting = arm.fingers is None or arm.palm is None
    if arm.fingers is None or arm.palm is None:
        limb = replace(limb, twist_share=0.0)
    else:
        end = hand_rotation(in_chest(arm.fingers), in_chest(arm.palm), side)
    for _ in range(_COLLAR_ROUNDS):
        figure.reach(limb, wrist, elbow, end)
        upper = figure.world(limb.joints[1])[1] - figure.world(limb.joints[0])[1]
        along = (upper / np.linalg.norm(upper))[:, None] @ chest
        figure.turn(f"{side}_collar", collar_rotation(along[:, 0], side))
    figure.reach(limb, wrist, elbow, end)
    if resting:
        figure.turn(limb.joints[-1], np.eye(3)[None])


def _hand(body: BodyModel, side: Side, shape: str) -> Float[torch.Tensor, "1 12"]:
    """The nearest hand that the principal components can form, so that a fit could return it exactly."""
    index = 0 if side == "left" else 1
    angles = finger_angles(HANDSHAPES[shape], side).reshape(45) - body.hand_mean[index]
    basis = np.asarray(body.hand_components[index, :N_HAND_COMPONENTS], float).T
    return torch.as_tensor(np.linalg.lstsq(basis, angles, rcond=None)[0])[None]


def before_camera(body: BodyModel, figures: BodyParams, yaw_degrees: Float[np.ndarray, "T"]) -> BodyParams:
    """Figures in level axes, each turned by its yaw about the vertical and set before the camera."""
    turn = Rotation.from_matrix(_FACING) * Rotation.from_euler("x", TILT_DEGREES, degrees=True)
    turn = turn * Rotation.from_euler("y", np.asarray(yaw_degrees)[:, None], degrees=True)
    orient = (turn * Rotation.from_rotvec(figures.global_orient.numpy())).as_rotvec()
    turned = replace(
        figures,
        global_orient=torch.as_tensor(orient),
        camera_translation=torch.zeros(len(figures), 3, dtype=torch.float64),
    )
    joints = joints_in_space(body, turned)
    assert joints.shape[1] == N_JOINTS
    place = np.array([0.0, 0.0, DISTANCE]) - joints[:, :22].mean(1)
    return replace(turned, camera_translation=torch.as_tensor(place))


def seen_by(camera: Camera, body: BodyModel, params: BodyParams) -> Keypoints:
    """All keypoints that the body has, without noise, at confidence 1, whatever hides them."""
    points, exists = keypoints_in_space(body, params)
    xy = np.zeros((len(params), COUNT, 2))
    xy[:, exists] = points[:, exists, :2] / points[:, exists, 2:] * camera.focal + camera.center
    return Keypoints(xy=xy, confidence=np.tile(exists.astype(float), (len(params), 1)))
