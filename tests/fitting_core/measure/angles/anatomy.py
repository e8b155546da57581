"""Bodies posed by clinical angles, with frames that are built here by themselves: by cross products from the joints."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from fitting_core.body.markers.joint_centres import with_joint_centres
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.motion import Motion, rest_joints
from tests.fitting_core.io.motion.motions import CAMERA

BONES = {
    "pelvis": "pelvis", "thorax": "spine3", "head": "head", "thigh": "hip", "shank": "knee", "foot": "ankle",
    "toes": "foot", "humerus": "shoulder", "forearm": "elbow", "hand": "wrist",
}  # fmt: skip
TURNED = {
    "lumbar": "spine2", "neck": "neck", "hip": "hip", "knee": "knee", "ankle": "ankle", "toes": "foot",
    "shoulder": "shoulder", "elbow": "elbow", "wrist": "wrist",
}  # fmt: skip
"""By the clinical joint, the model's joint that is turned for it."""


def bone(segment: str) -> int:
    """The joint of the model that carries it."""
    side, _, name = segment.rpartition("_")
    return JOINT[f"{side}_{BONES[name]}".removeprefix("_")]


def frames(rest: np.ndarray) -> dict[str, np.ndarray]:
    """Anatomical axes as columns (x forward, y up, z right) in the rest pose whose joints these are, (55, 3)."""
    found = {name: np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]) for name in ("pelvis", "thorax", "head")}
    for side in ("left", "right"):
        place = {name: rest[JOINT[f"{side}_{name}"]] for name in (
            "hip", "knee", "ankle", "shoulder", "elbow", "wrist", "middle1", "index1", "pinky1")}  # fmt: skip
        for segment, top, end in (("thigh", "hip", "knee"), ("shank", "knee", "ankle")):
            y = _unit(place[top] - place[end])
            x = _unit(np.cross(y, [-1.0, 0.0, 0.0]))
            found[f"{side}_{segment}"] = np.stack([x, y, np.cross(x, y)], -1)
        found[f"{side}_foot"] = found[f"{side}_toes"] = found["pelvis"]
        to_thumb = 1 if side == "right" else -1
        y = _unit(place["shoulder"] - place["elbow"])
        x = _unit(np.cross(y, [0.0, to_thumb, 0.0]))
        found[f"{side}_humerus"] = np.stack([x, y, np.cross(x, y)], -1)
        y = _unit(place["elbow"] - place["wrist"])
        x = _unit(np.cross(y, [0.0, 0.0, to_thumb]))
        found[f"{side}_forearm"] = np.stack([x, y, np.cross(x, y)], -1)
        y = _unit(place["wrist"] - place["middle1"])
        x = _unit(np.cross(y, to_thumb * (place["index1"] - place["pinky1"])))
        found[f"{side}_hand"] = np.stack([x, y, np.cross(x, y)], -1)
    return found


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


PARENTS = {
    "lumbar": ("pelvis", "thorax"), "neck": ("thorax", "head"), "hip": ("pelvis", "thigh"), "knee": ("thigh", "shank"),
    "ankle": ("shank", "foot"), "toes": ("foot", "toes"), "shoulder": ("thorax", "humerus"),
    "elbow": ("humerus", "forearm"), "wrist": ("forearm", "hand"),
}  # fmt: skip


def posed(
    body: BodyModel,
    turns: dict[str, Sequence[Rotation]],
    *,
    root: Sequence[Rotation] | None = None,
    betas: Sequence[float] = (0.0,) * 10,
    axes: str = "y-up",
) -> Motion:
    """A body that stands anatomically, arms hanging and palms forward, but for these rotations of anatomical frames.

    Args:
        body: The body.
        turns: By joint ("left_knee"), for each frame: the child's axes in the parent's, on either side those of ISB.
        root: The pelvis' axes in a world whose x, y, z are the person's when it faces +z of y-up.
        betas: The shape.
        axes: Of the motion.
    """
    count = len(root) if root else max(len(rotations) for rotations in turns.values())
    shape = torch.tensor([list(betas)], dtype=torch.float64)
    rest = Motion(body=body, params=replace(BodyParams.neutral(1), betas=shape), camera=CAMERA, frame_rate=50, name="")
    own = frames(rest_joints(with_joint_centres(body), rest.params)[0].numpy())
    pose = np.zeros((count, 55, 3))
    for side in ("left_", "right_", ""):
        for joint, (parent, child) in PARENTS.items():
            if (joint in ("lumbar", "neck")) != (side == ""):
                continue
            above, below = (own.get(name, own.get(side + name)) for name in (parent, child))
            turned = turns.get(side + joint, [Rotation.identity()] * count)
            local = [above @ rotation.as_matrix() @ below.T for rotation in turned]
            pose[:, JOINT[side + TURNED[joint]]] = Rotation.from_matrix(local).as_rotvec()
    if root:
        facing = own["pelvis"]  # the rest pose's frame is that of y-up: it faces +z
        pose[:, 0] = Rotation.from_matrix([facing @ one.as_matrix() @ facing.T for one in root]).as_rotvec()
    params = replace(
        BodyParams.neutral(count),
        betas=shape.expand(count, -1).clone(),
        global_orient=torch.as_tensor(pose[:, 0]),
        body_pose=torch.as_tensor(pose[:, 1:22].reshape(count, -1)),
    )
    return Motion(body=body, params=params, camera=CAMERA, frame_rate=50.0, name="posed", axes=axes)


def turned(sequence: str, *angles: float) -> Rotation:
    """Degrees about body-fixed axes: R = Rz(a) Rx(b) Ry(c) for "ZXY", each by Rodrigues' formula."""
    rotation = np.eye(3)
    for letter, angle in zip(sequence, angles, strict=True):
        x, y, z = np.eye(3)["XYZ".index(letter)]
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        step = np.eye(3) + np.sin(np.radians(angle)) * cross + (1 - np.cos(np.radians(angle))) * cross @ cross
        rotation = rotation @ step
    return Rotation.from_matrix(rotation)


def mirrored(rotation: Rotation) -> Rotation:
    """The same turn on the other side of the body: about x and y the other way."""
    return Rotation.from_rotvec(rotation.as_rotvec() * [-1.0, -1.0, 1.0])
