"""The file forms of the SMPL family, and how each maps onto SMPL-X's 55 joints."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array

from fitting_core.body.model import JOINT, JOINTS, N_JOINTS, POSE_JOINTS, SURFACE_KEYPOINTS, sparse_if_mostly_zero

# fmt: off
PARENTS: tuple[int, ...] = (
    -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19,
    15, 15, 15,
    20, 25, 26, 20, 28, 29, 20, 31, 32, 20, 34, 35, 20, 37, 38,
    21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53,
)
"""Parent of each of the 55 joints, -1 for the root."""

# Vertex of each of SURFACE_KEYPOINTS, in its order, on the meshes of SMPL-X (10475 vertices) and SMPL (6890).
_SMPLX_VERTICES = (
    9120, 9929, 9448, 616, 6, 5770, 5780, 8846, 8463, 8474, 8635,
    5361, 4933, 5058, 5169, 5286, 8079, 7669, 7794, 7905, 8022,
)
_SMPL_VERTICES = (
    332, 6260, 2800, 4071, 583, 3216, 3226, 3387, 6617, 6624, 6787,
    2746, 2319, 2445, 2556, 2673, 6191, 5782, 5905, 6016, 6133,
)
# fmt: on
_BODY = tuple(range(POSE_JOINTS["body_pose"].stop))
_FINGERS = tuple(range(POSE_JOINTS["left_hand_pose"].start, N_JOINTS))


@dataclass(frozen=True, kw_only=True)
class Form:
    """One kind of body model file."""

    kind: str
    title: str
    """How the model is called in messages."""
    joints: tuple[int, ...]
    """For each of the file's joints the one of the 55 that takes over its skin."""
    kept: int
    """Number of leading joints of the file that are joints of the 55; the others merge into theirs."""
    vertices: int
    """Vertices of the official mesh; keypoint vertices need at least these."""
    keypoint_vertices: tuple[int, ...]
    """Vertex of each of SURFACE_KEYPOINTS."""
    expression_starts: dict[int, int] | None
    """For each allowed number of shape directions the column at which expressions start; None: 10 or more, none."""

    @property
    def parents(self) -> tuple[int, ...]:
        """Parent of each of the file's joints, in the file's numbering: a joint that merges hangs on what takes it."""
        own = {joint: i for i, joint in enumerate(self.joints[: self.kept])}
        inner = tuple(own.get(PARENTS[joint], -1) for joint in self.joints[: self.kept])
        return inner + tuple(own[joint] for joint in self.joints[self.kept :])

    @property
    def regressor_rows(self) -> tuple[int, ...]:
        """For each of the 55 joints the file's joint at which it sits: itself, or its nearest ancestor in the file."""
        own = {joint: i for i, joint in enumerate(self.joints[: self.kept])}
        rows: list[int] = []
        for joint in range(N_JOINTS):
            rows.append(own[joint] if joint in own else rows[PARENTS[joint]])
        return tuple(rows)

    def surface_keypoints(self) -> dict[str, int]:
        """Vertex of each of SURFACE_KEYPOINTS on this kind's mesh."""
        return dict(zip(SURFACE_KEYPOINTS, self.keypoint_vertices, strict=True))


_SMPLX = Form(
    kind="smplx",
    title="SMPL-X",
    joints=tuple(range(N_JOINTS)),
    kept=55,
    vertices=10475,
    keypoint_vertices=_SMPLX_VERTICES,
    expression_starts={20: 10, 400: 300},
)
_SMPLH = Form(
    kind="smplh",
    title="SMPL-H",
    joints=_BODY + _FINGERS,
    kept=52,
    vertices=6890,
    keypoint_vertices=_SMPL_VERTICES,
    expression_starts=None,
)
_SMPL = Form(
    kind="smpl",
    title="SMPL",
    joints=(*_BODY, JOINT["left_wrist"], JOINT["right_wrist"]),
    kept=22,
    vertices=6890,
    keypoint_vertices=_SMPL_VERTICES,
    expression_starts=None,
)
FORMS: dict[int, Form] = {len(form.joints): form for form in (_SMPLX, _SMPLH, _SMPL)}
"""By the file's number of joints."""
KINDS: dict[str, Form] = {form.kind: form for form in FORMS.values()}
"""By the kind's name: smplx, smplh, smpl."""

assert len(PARENTS) == len(JOINTS)


def weights_in_55(form: Form, weights: Float[np.ndarray, "V J"]) -> Float[np.ndarray, "V 55"]:
    """Skinning weights of the 55 joints; SMPL's two hand joints give theirs to the wrists."""
    merged = np.zeros((len(weights), N_JOINTS))
    for column, joint in enumerate(form.joints):
        merged[:, joint] += weights[:, column]
    return merged


def pose_directions_in_55(
    form: Form, directions: Float[np.ndarray, "V 3 P"]
) -> csr_array | Float[np.ndarray, "V*3 486"]:
    """Pose correctives of the 55 joints, zero for those that the file lacks; sparse where most are zero.

    Those of SMPL's hand joints are left out. That is exact, not an approximation: a merged joint moves rigidly with its
    wrist, so its own rotation minus the identity is always zero.
    """
    rows = directions.reshape(3 * len(directions), -1)
    if form.kept < N_JOINTS:
        given, rows = rows, np.zeros((len(rows), 9 * (N_JOINTS - 1)), directions.dtype)
        for place, joint in enumerate(form.joints[1 : form.kept]):
            rows[:, 9 * (joint - 1) : 9 * joint] = given[:, 9 * place : 9 * (place + 1)]
    return sparse_if_mostly_zero(rows)


def plain_hand_components() -> Float[np.ndarray, "45 45"]:
    """Hand components for a file that brings none: a permutation of the identity, bending first.

    Rows 0-14 turn the 15 finger joints (index, middle, little, ring, thumb) about z, which curls a finger of a hand in
    T-pose, rows 15-29 about y, rows 30-44 about x. So the 12 components in use bend the four fingers freely.
    """
    order = [3 * joint + axis for axis in (2, 1, 0) for joint in range(15)]
    return np.eye(45)[order]
