"""The data of a body model in SMPL-X form, and the names of its joints and keypoint vertices."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

_BODY_JOINTS = (
    "pelvis left_hip right_hip spine1 left_knee right_knee spine2 left_ankle right_ankle spine3 left_foot right_foot "
    "neck left_collar right_collar head left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist"
).split()
_FINGER_JOINTS = [f"{finger}{k}" for finger in ("index", "middle", "pinky", "ring", "thumb") for k in (1, 2, 3)]
JOINTS = (
    _BODY_JOINTS
    + ["jaw", "left_eye", "right_eye"]
    + [f"left_{n}" for n in _FINGER_JOINTS]
    + [f"right_{n}" for n in _FINGER_JOINTS]
)
"""SMPL-X's 55 kinematic joints, in its order."""
JOINT = {name: i for i, name in enumerate(JOINTS)}
N_JOINTS = len(JOINTS)


def other_side(name: str) -> str:
    """The name of the same part on the body's other side: right_hip for left_hip, neck for neck."""
    swapped = {"left": "right", "right": "left"}
    return "_".join(swapped.get(word, word) for word in name.split("_"))


POSE_JOINTS: dict[str, slice] = {
    "global_orient": slice(0, 1),
    "body_pose": slice(1, 22),
    "jaw_pose": slice(22, 23),
    "leye_pose": slice(23, 24),
    "reye_pose": slice(24, 25),
    "left_hand_pose": slice(25, 40),
    "right_hand_pose": slice(40, 55),
}
"""By the parameter that turns them (see `BodyParams`): its joints among JOINTS."""
POSE_COLUMNS: dict[str, slice] = {name: slice(3 * part.start, 3 * part.stop) for name, part in POSE_JOINTS.items()}
"""The same among the 165 axis-angle numbers of all joints."""
N_BETAS = 10
N_EXPRESSION = 10
N_HAND_COMPONENTS = 12

SURFACE_KEYPOINTS = (
    "nose right_eye left_eye right_ear left_ear left_big_toe left_small_toe left_heel right_big_toe right_small_toe "
    "right_heel left_thumb left_index left_middle left_ring left_pinky right_thumb right_index right_middle "
    "right_ring right_pinky"
).split()
"""Keypoints that are single vertices of the mesh; the fingers' names stand for their tips."""


@dataclass(frozen=True, kw_only=True)
class KeypointOffset:
    """Where a detector's keypoint lies: at a joint plus an offset that moves with a bone.

    Detectors' joints are not the model's: OpenPose's hip, for one, lies some 30 mm from SMPL-X's.
    """

    joint: str
    bone: str
    offset: tuple[float, float, float]
    """Metres, in the rest pose's frame (x to the body's left, y up, z forward)."""


_SPARSE = 0.3
"""Share of numbers that are not zero up to which a sparse product is the faster one."""


def sparse_if_mostly_zero(values: Float[np.ndarray, "m n"]) -> csr_array | Float[np.ndarray, "m n"]:
    """The same matrix, sparse where that makes products with it faster."""
    return csr_array(values) if np.count_nonzero(values) <= _SPARSE * values.size else values


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyModel:
    """A linear blend skinning body with SMPL-X's 55 joints and parameters.

    SMPL-H and SMPL files are read into the same form: joints that they lack carry no skin, sit on their parent, and
    parameters that they lack move nothing. Rest pose: T-pose, x to the body's left, y up, z forward, metres.
    """

    kind: str
    """Kind of the file: "smplx", "smplh" or "smpl"."""
    gender: str
    """"neutral", "male", "female" or "child"."""
    template: Float[np.ndarray, "V 3"]
    shape_directions: Float[np.ndarray, "V 3 10"]
    expression_directions: Float[np.ndarray, "V 3 10"]
    pose_directions: csr_array | Float[np.ndarray, "V*3 486"]
    """Pose correctives: per joint but the root, the 9 entries of its rotation matrix minus the identity, row-major.
    float32 or float64, as in the file; sparse where most are zero, for they are most of its numbers (78 MB of the free
    body, 2 % of them not zero)."""
    joint_regressor: Float[np.ndarray, "55 V"]
    skinning_weights: Float[np.ndarray, "V 55"]
    parents: Int[np.ndarray, "55"]
    """Parent of each joint; -1 for the root."""
    faces: Int[np.ndarray, "F 3"]
    hand_components: Float[np.ndarray, "2 45 45"]
    """Left, right: each row is one principal component of the 15 finger joints' axis-angle."""
    hand_mean: Float[np.ndarray, "2 45"]
    surface_keypoints: dict[str, int]
    """Vertex of each of SURFACE_KEYPOINTS that the model has."""
    landmark_vertices: Int[np.ndarray, "51 3"]
    landmark_weights: Float[np.ndarray, "51 3"]
    """Inner face landmarks as barycentric points on triangles; zero rows where the model has none."""
    contour_vertices: Int[np.ndarray, "79 17 3"]
    contour_weights: Float[np.ndarray, "79 17 3"]
    """Face contour by the head's turn to its right: tables 0..39 for 0..39 degrees, 40..78 for -1..-39 degrees."""
    keypoint_offsets: dict[str, KeypointOffset] = field(default_factory=dict)
    """By the name of the body keypoint; others lie on their joint or vertex. Bodies of today need none."""
    source: Path | None = None
    """The file that it was read from."""
    hash: str = ""
    """SHA-256 of that file, so that a result can say which body it used."""

    @property
    def rest_joints(self) -> Float[np.ndarray, "55 3"]:
        """Joints of the mean shape in the rest pose."""
        return self.joint_regressor @ self.template

    @property
    def height(self) -> tuple[float, Float[np.ndarray, "10"]]:
        """From the soles to the crown in the rest pose: metres of the mean shape, and what each beta adds."""
        up, low, high = self.template[:, 1], self.template[:, 1].argmin(), self.template[:, 1].argmax()
        return float(up[high] - up[low]), self.shape_directions[high, 1] - self.shape_directions[low, 1]

    def correctives_of(self, vertices: Int[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3 486"]:
        """Rows of `pose_directions`, never sparse."""
        rows = self.pose_directions[(3 * vertices[..., None] + np.arange(3)).ravel()]
        dense = rows.toarray() if isinstance(rows, csr_array) else rows
        return dense.reshape(*vertices.shape, 3, dense.shape[1])

    def with_shape(self, betas: Sequence[float] | Float[np.ndarray, "10"]) -> "BodyModel":
        """The body whose mean shape is the one that these betas give; further betas add to it."""
        return replace(self, template=self.template + self.shape_directions @ np.asarray(betas, dtype=float))

    def __post_init__(self) -> None:
        vertices = len(self.template)
        assert self.shape_directions.shape == (vertices, 3, N_BETAS)
        assert self.expression_directions.shape == (vertices, 3, N_EXPRESSION)
        assert self.pose_directions.shape == (vertices * 3, 9 * (N_JOINTS - 1))
        assert self.joint_regressor.shape == (N_JOINTS, vertices)
        assert self.skinning_weights.shape == (vertices, N_JOINTS)
        assert self.parents[0] == -1 and (self.parents[1:] < np.arange(1, N_JOINTS)).all()
