"""Whether the suite's people move as people do: contact with the floor, limbs in each other, joints, speeds, volumes.

python -m benchmarks.suite_motions
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
import tyro
from jaxtyping import Float
from scipy.spatial import KDTree

from evaluation.synthetic.suite import SEQUENCES, SuiteSequence, subject_body, world_params
from fitting_core.body.geometry import vertex_normals
from fitting_core.body.joint_ranges import joint_ranges
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, POSE_JOINTS, BodyModel
from fitting_core.fit.terms.limits import AngleTable

_BODY_JOINTS = 22
_TOUCHING = 0.004
"""Height up to which a vertex counts as on the floor, above the lowest one of its part; metres."""
_GROUNDED = 0.004
"""Height of a foot's or hand's lowest vertex up to which it stands; metres."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A sequence in the world, evaluated once for all figures."""

    sequence: SuiteSequence
    body: BodyModel
    vertices: Float[np.ndarray, "T V 3"]
    joints: Float[np.ndarray, "T 55 3"]
    pose: Float[np.ndarray, "T 63"]

    @staticmethod
    def of(sequence: SuiteSequence) -> "Motion":
        """Poses the whole mesh in every frame."""
        body = subject_body(sequence.subject)
        params, mesh = world_params(sequence, body), Mesh(body)
        return Motion(
            sequence=sequence,
            body=body,
            vertices=mesh(params).numpy().astype(np.float64),
            joints=mesh.joints(params).numpy().astype(np.float64),
            pose=params.body_pose.numpy(),
        )

    def part(self, *joints: str) -> np.ndarray:
        """The vertices that mostly follow these joints."""
        return np.flatnonzero(self.body.skinning_weights[:, [JOINT[j] for j in joints]].sum(1) > 0.6)


Figures = dict[str, float]


def volume(vertices: Float[np.ndarray, "V 3"], faces: np.ndarray) -> float:
    """Of a closed mesh, dm^3 (vertices in metres): the sum of the tetrahedra from the origin to each face."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(1e3 * np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def size(motion: Motion) -> Figures:
    """Volume and height of the shape in the rest pose."""
    shaped = motion.body.with_shape(motion.sequence.subject.betas).template
    return {"dm^3": volume(shaped, motion.body.faces), "m tall": float(np.ptp(shaped[:, 1]))}


def floor(motion: Motion) -> Figures:
    """Lowest point of the body, and how far what stands on the floor slides from one frame to the next."""
    figures = {"lowest cm": float(100 * motion.vertices[..., 1].min())}
    for side in ("left", "right"):
        figures[f"{side[0]}foot slip mm"] = 1e3 * _slip(motion, motion.part(f"{side}_ankle", f"{side}_foot"))
        weights = motion.body.skinning_weights
        fingers = weights[:, POSE_JOINTS[f"{side}_hand_pose"]].sum(1)
        hand = weights[:, JOINT[f"{side}_wrist"]] + fingers > 0.6
        figures[f"{side[0]}hand lowest cm"] = float(100 * motion.vertices[:, hand, 1].min())
        figures[f"{side[0]}hand slip mm"] = 1e3 * _slip(motion, np.flatnonzero(hand))
    return figures


def _slip(motion: Motion, part: np.ndarray) -> float:
    """Largest median horizontal step, metres, of the vertices on the floor in one frame and in the next."""
    height = motion.vertices[:, part, 1]
    low = height < height.min(1, keepdims=True) + _TOUCHING
    steps = np.linalg.norm(np.diff(motion.vertices[:, part][..., [0, 2]], axis=0), axis=-1)
    slips = [
        float(np.median(steps[i][low[i] & low[i + 1]]))
        for i in range(len(steps))
        if max(height[i].min(), height[i + 1].min()) < _GROUNDED and (low[i] & low[i + 1]).any()
    ]
    return max(slips, default=0.0)


def overlap(motion: Motion) -> Figures:
    """How deep a limb is in another or in the trunk: vertices behind the surface of the other's nearest vertex."""
    parts = _parts(motion)
    deepest = np.zeros(len(motion.vertices))
    for i in range(0, len(motion.vertices), _EVERY):
        points, normals = motion.vertices[i], vertex_normals(motion.vertices[i], motion.body.faces)
        trees = {name: KDTree(points[part]) for name, part in parts.items()}
        for first, second in _PAIRS:
            distance, nearest = trees[second].query(points[parts[first]], distance_upper_bound=_DEEPEST)
            near = np.flatnonzero(np.isfinite(distance))
            other = parts[second][np.asarray(nearest)[near]]
            behind = ((points[parts[first][near]] - points[other]) * normals[other]).sum(1)
            deepest[i] = max(deepest[i], -behind.min(initial=0.0))
    return {"overlap cm": float(100 * deepest.max()), "at": float(deepest.argmax())}


_EVERY = 2
"""Overlaps are looked for in every second frame."""
_DEEPEST = 0.08
"""Metres from a surface beyond which a point is not taken to be inside."""
_LEGS, _ARMS = ("left_leg", "right_leg"), ("left_arm", "right_arm")
_PAIRS = (
    _LEGS,
    _ARMS,
    *((arm, leg) for arm in _ARMS for leg in _LEGS),
    *((arm, "trunk") for arm in _ARMS),
)


def _parts(motion: Motion) -> dict[str, np.ndarray]:
    """Vertices of the limbs without what touches the trunk in all poses, and of trunk and head."""
    body, parts = motion.body, {}
    rest = body.rest_joints
    for side in ("left", "right"):
        first = 25 if side == "left" else 40
        fingers = list(JOINT)[first : first + 15]
        parts[f"{side}_arm"] = motion.part(f"{side}_elbow", f"{side}_wrist", *fingers)
        hip, knee = rest[JOINT[f"{side}_hip"]], rest[JOINT[f"{side}_knee"]]
        thigh = motion.part(f"{side}_hip")
        lower = thigh[body.template[thigh, 1] < hip[1] + 0.4 * (knee[1] - hip[1])]
        parts[f"{side}_leg"] = np.concatenate([lower, motion.part(*(f"{side}_{n}" for n in ("knee", "ankle", "foot")))])
    parts["trunk"] = motion.part("pelvis", "spine1", "spine2", "spine3", "neck", "head")
    return parts


def anatomy(motion: Motion) -> Figures:
    """Degrees by which joints of trunk and limbs exceed their ranges."""
    ranges = {name: r for name, r in joint_ranges(motion.body).items() if JOINT[name] < _BODY_JOINTS}
    pose = torch.as_tensor(motion.pose)
    table = AngleTable.of(ranges, pose)
    angles = table.named(table.angles(pose.view(-1, 21, 3)[:, table.joint - 1])).rad2deg().numpy()
    low, high = np.moveaxis(np.array([r.bounds for r in ranges.values()]), -1, 0)
    return {"beyond °": float(abs(angles - angles.clip(low, high)).max())}


def speed(motion: Motion) -> Figures:
    """Highest speed and acceleration of a body joint."""
    rate, joints = motion.sequence.frame_rate, motion.joints[:, :_BODY_JOINTS]
    velocity, acceleration = np.diff(joints, axis=0) * rate, np.diff(joints, 2, axis=0) * rate**2
    return {
        "m/s": float(np.linalg.norm(velocity, axis=-1).max()),
        "m/s^2": float(np.linalg.norm(acceleration, axis=-1).max()),
    }


MEASURES: list[Callable[[Motion], Figures]] = [size, floor, overlap, anatomy, speed]


def main(names: tyro.conf.Positional[tuple[str, ...]] = ()) -> None:
    """Print a table of all sequences, or of some by name."""
    rows = {}
    for name in names or SEQUENCES:
        motion = Motion.of(SEQUENCES[name])
        rows[name] = {key: value for measure in MEASURES for key, value in measure(motion).items()}
    columns = list(next(iter(rows.values())))
    print(f"{'':12}" + "".join(f"{column:>{len(column) + 3}}" for column in columns))
    for name, row in rows.items():
        print(f"{name:12}" + "".join(f"{row[column]:>{len(column) + 3}.2f}" for column in columns))


if __name__ == "__main__":
    tyro.cli(main)
