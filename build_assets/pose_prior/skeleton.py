"""The free body's skeleton while a prior is trained: points by which poses are compared, and spheres along its bones
that tell which poses put one part of the body into another."""

from copy import copy
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.body.model import JOINT, BodyModel

N_POSED = 22
"""The root and the 21 joints of the body pose."""
_ENDS = ("jaw", "left_eye", "right_eye", "left_index1", "left_pinky1", "right_index1", "right_pinky1")
_TOES = {"left_big_toe": "left_foot", "right_big_toe": "right_foot"}


class Skeleton:
    """Poses 22 joints, and points beyond head, hands and feet that show how the last joints are turned."""

    def __init__(self, body: BodyModel) -> None:
        joints = body.rest_joints
        ends = np.concatenate(
            [joints[[JOINT[n] for n in _ENDS]], body.template[[body.surface_keypoints[n] for n in _TOES]]]
        )
        carriers = [int(body.parents[JOINT[n]]) for n in _ENDS] + [JOINT[n] for n in _TOES.values()]
        self.carriers = torch.tensor(carriers)
        self.joints = torch.as_tensor(joints[:N_POSED], dtype=torch.float32)
        self.ends = torch.as_tensor(ends, dtype=torch.float32) - self.joints[self.carriers]
        self._parents = body.parents[:N_POSED]
        self.tree = Tree.of(self._parents)

    def to(self, device: str) -> "Skeleton":
        """The same on a device."""
        moved = copy(self)
        moved.carriers, moved.joints, moved.ends = (t.to(device) for t in (self.carriers, self.joints, self.ends))
        moved.tree = Tree.of(self._parents, device)
        return moved

    def points(self, rotations: Float[Tensor, "B 21 3 3"]) -> Float[Tensor, "B 31 3"]:
        """Joints and end points in metres, the pelvis at its rest position and unturned."""
        return self.posed(rotations)[1]

    def posed(self, rotations: Float[Tensor, "B 21 3 3"]) -> tuple[Float[Tensor, "B 22 3 3"], Float[Tensor, "B 31 3"]]:
        """World rotations of the joints, and the points."""
        root = torch.eye(3, dtype=rotations.dtype, device=rotations.device).expand(len(rotations), 1, 3, 3)
        local = torch.cat([root, rotations], 1)
        rest = self.joints.to(rotations).expand(len(rotations), -1, 3)
        world, position = pose_joints(self.tree, local, rest)
        ends = position[:, self.carriers] + (world[:, self.carriers] @ self.ends.to(rotations)[..., None])[..., 0]
        return world, torch.cat([position, ends], 1)


DEPTH = 0.03
"""Metres that spheres may overlap: flesh gives way, and spheres are rounder than people."""


@dataclass(frozen=True)
class _Ball:
    """A sphere that moves with a joint."""

    part: str
    joint: str
    towards: str
    share: float
    """Where between the joint (0) and `towards` (1), a joint or end point of the rest pose."""
    radius: float
    aside: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Metres beside the bone, in the rest pose's frame."""


def _limb(part: str, joint: str, towards: str, shares: tuple[float, ...], radius: float) -> list[_Ball]:
    return [_Ball(part, joint, towards, share, radius) for share in shares]


def _side(side: str) -> list[_Ball]:
    s = side
    return [
        *_limb(f"{s}_upper_arm", f"{s}_shoulder", f"{s}_elbow", (0.6, 0.9), 0.042),
        *_limb(f"{s}_forearm", f"{s}_elbow", f"{s}_wrist", (0.2, 0.5, 0.8), 0.037),
        *_limb(f"{s}_hand", f"{s}_wrist", f"{s}_index1", (0.5, 1.0), 0.033),
        *_limb(f"{s}_thigh", f"{s}_hip", f"{s}_knee", (0.35, 0.65, 0.95), 0.062),
        *_limb(f"{s}_shank", f"{s}_knee", f"{s}_ankle", (0.25, 0.5, 0.75, 1.0), 0.045),
        *_limb(f"{s}_foot", f"{s}_ankle", f"{s}_foot", (0.6, 1.1), 0.038),
    ]


_TORSO = [
    *(_Ball("torso", "pelvis", "pelvis", 0.0, 0.10, (x, 0.0, 0.0)) for x in (-0.06, 0.06)),
    *(_Ball("torso", "spine2", "spine2", 0.0, 0.10, (x, 0.0, 0.01)) for x in (-0.05, 0.05)),
    *(_Ball("torso", "spine3", "spine3", 0.0, 0.105, (x, 0.06, 0.02)) for x in (-0.06, 0.06)),
    _Ball("head", "neck", "neck", 0.0, 0.055, (0.0, 0.02, 0.01)),
    _Ball("head", "head", "head", 0.0, 0.085, (0.0, 0.10, 0.03)),
    _Ball("head", "head", "head", 0.0, 0.075, (0.0, 0.02, 0.05)),
]
_TOUCHING = [
    *((f"{s}_{arm}", other) for s in ("left", "right") for arm in ("forearm", "hand") for other in ("torso", "head")),
    *((f"{s}_{arm}", f"{o}_{leg}") for s in ("left", "right") for o in ("left", "right")
      for arm in ("forearm", "hand") for leg in ("thigh", "shank", "foot")),
    *((f"left_{a}", f"right_{b}") for a in ("upper_arm", "forearm", "hand") for b in ("upper_arm", "forearm", "hand")),
    *((f"left_{a}", f"right_{b}") for a in ("thigh", "shank", "foot") for b in ("thigh", "shank", "foot")),
    *((f"{s}_foot", "torso") for s in ("left", "right")),
    *((f"{s}_shank", "head") for s in ("left", "right")),
]  # fmt: skip
"""Pairs of parts that must not overlap; neighbours on the body always do."""


class Contact:
    """Tells colliding poses from others."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton = skeleton
        balls = [*_TORSO, *_side("left"), *_side("right")]
        rest, place = skeleton.joints, _places(skeleton)
        self.joint = torch.tensor([JOINT[b.joint] for b in balls])
        towards = torch.stack([place[b.towards] for b in balls])
        share = torch.tensor([b.share for b in balls])[:, None]
        self.offset = share * (towards - rest[self.joint]) + torch.tensor([b.aside for b in balls])
        radius = torch.tensor([b.radius for b in balls])
        parts = [b.part for b in balls]
        pairs = [(i, j) for i, a in enumerate(parts) for j, b in enumerate(parts) if (a, b) in set(_TOUCHING)]
        self.first, self.second = torch.tensor(pairs).T
        self.nearest = radius[self.first] + radius[self.second] - DEPTH

    def to(self, device: str) -> "Contact":
        """The same on a device."""
        moved = copy(self)
        moved.skeleton = self.skeleton.to(device)
        for name in ("joint", "offset", "first", "second", "nearest"):
            setattr(moved, name, getattr(self, name).to(device))
        return moved

    def depths(self, rotations: Float[Tensor, "B 21 3 3"]) -> Float[Tensor, "B pairs"]:
        """Metres by which spheres of two parts overlap beyond DEPTH, 0 where they do not."""
        world, points = self.skeleton.posed(rotations)
        centre = points[:, self.joint] + (world[:, self.joint] @ self.offset.to(points)[..., None])[..., 0]
        return (self.nearest - (centre[:, self.first] - centre[:, self.second]).norm(dim=-1)).clamp(min=0)

    def overlaps(self, rotations: Float[Tensor, "B 21 3 3"]) -> Bool[Tensor, "B"]:
        """Whether any two parts overlap by more than DEPTH."""
        return (self.depths(rotations) > 0).any(1)


def _places(skeleton: Skeleton) -> dict[str, Tensor]:
    names = {name: skeleton.joints[i] for name, i in JOINT.items() if i < len(skeleton.joints)}
    ends = skeleton.ends + skeleton.joints[skeleton.carriers]
    return names | {"left_index1": ends[3], "right_index1": ends[5]}
