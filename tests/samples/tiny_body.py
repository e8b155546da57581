"""A small synthetic body in SMPL-X's form: every kind of parameter moves something, and no licensed data is in it."""

import numpy as np

from fitting_core.body.files.forms import PARENTS
from fitting_core.body.model import JOINT, JOINTS, N_JOINTS, SURFACE_KEYPOINTS, BodyModel

PER_JOINT = 8
"""Vertices around each joint."""

_MIDDLE = {
    "pelvis": (0, 0, 0), "spine1": (0, 0.12, 0), "spine2": (0, 0.25, 0), "spine3": (0, 0.31, 0.02),
    "neck": (0, 0.52, 0), "head": (0, 0.6, 0.02), "jaw": (0, 0.6, 0.06),
}  # fmt: skip
_LEFT = {
    "hip": (0.06, -0.09, 0), "knee": (0.11, -0.47, 0.01), "ankle": (0.09, -0.87, -0.02), "foot": (0.12, -0.93, 0.1),
    "collar": (0.07, 0.45, 0), "shoulder": (0.17, 0.44, -0.01), "elbow": (0.43, 0.43, -0.02),
    "wrist": (0.68, 0.43, -0.02), "eye": (0.03, 0.65, 0.08),
}  # fmt: skip
_FINGERS = {"index": 0.03, "middle": 0.01, "ring": -0.01, "pinky": -0.03, "thumb": 0.05}
_HEAD = [JOINT[name] for name in ("neck", "head", "jaw")]
_CORRECTED = [j for j in range(1, N_JOINTS) if j % 7]
"""Joints that drive correctives; the others must be skipped without a change."""


def rest_joints() -> np.ndarray:
    """Roughly where the joints of a person of 1.7 m lie, (55, 3) metres."""
    left = {f"left_{name}": position for name, position in _LEFT.items()}
    for finger, z in _FINGERS.items():
        for k in (1, 2, 3):
            left[f"left_{finger}{k}"] = (0.74 + 0.025 * k, 0.42, z)
    right = {name.replace("left", "right"): (-x, y, z) for name, (x, y, z) in left.items()}
    places = {**_MIDDLE, **left, **right}
    return np.array([places[name] for name in JOINTS], float)


def make_tiny_body(seed: int = 0) -> BodyModel:
    """440 vertices: clouds around the joints, skinned to these and up to three above them; random directions."""
    rng = np.random.default_rng(seed)
    parents, joints = np.array(PARENTS), rest_joints()
    owner = np.repeat(np.arange(N_JOINTS), PER_JOINT)
    small = np.array([j >= JOINT["jaw"] for j in range(N_JOINTS)])
    template = joints[owner] + rng.normal(0, 1, (len(owner), 3)) * np.where(small, 0.008, 0.04)[owner, None]
    faces = np.stack([rng.permutation(np.flatnonzero(owner == j))[:3] for j in range(N_JOINTS) for _ in range(3)])
    on_head = np.isin(owner, _HEAD)
    components = np.stack([np.linalg.qr(rng.normal(size=(45, 45)))[0] for _ in range(2)])
    return BodyModel(
        kind="smplx",
        gender="neutral",
        template=template,
        shape_directions=rng.normal(0, 0.006, (len(owner), 3, 10)),
        expression_directions=rng.normal(0, 0.004, (len(owner), 3, 10)) * on_head[:, None, None],
        pose_directions=_correctives(rng, len(owner)),
        joint_regressor=_regressor(rng, owner),
        skinning_weights=_weights(rng, owner, parents),
        parents=parents,
        faces=faces,
        hand_components=components,
        hand_mean=rng.normal(0, 0.1, (2, 45)),
        surface_keypoints=_surface_keypoints(rng, owner),
        landmark_vertices=_triangles(rng, np.flatnonzero(on_head), (51,)),
        landmark_weights=rng.dirichlet((1, 1, 1), 51),
        contour_vertices=_triangles(rng, np.flatnonzero(on_head), (79, 17)),
        contour_weights=rng.dirichlet((1, 1, 1), (79, 17)),
    )


def _correctives(rng: np.random.Generator, vertices: int) -> np.ndarray:
    by_joint = np.zeros((vertices, 3, N_JOINTS - 1, 9))
    for j in _CORRECTED:
        by_joint[:, :, j - 1] = rng.normal(0, 0.002, (vertices, 3, 9)) * (rng.random(vertices) < 0.3)[:, None, None]
    return by_joint.reshape(3 * vertices, -1)


def _regressor(rng: np.random.Generator, owner: np.ndarray) -> np.ndarray:
    regressor = np.zeros((N_JOINTS, len(owner)))
    for j in range(N_JOINTS):
        regressor[j, owner == j] = rng.dirichlet(np.full(PER_JOINT, 5.0))
    return regressor


def _weights(rng: np.random.Generator, owner: np.ndarray, parents: np.ndarray) -> np.ndarray:
    weights = np.zeros((len(owner), N_JOINTS))
    for v, j in enumerate(owner):
        bones = [int(j)]
        while len(bones) < rng.integers(2, 5) and parents[bones[-1]] >= 0:
            bones.append(int(parents[bones[-1]]))
        # The owner carries most: a vertex that followed far bones would leave its limb.
        weights[v, bones] = rng.dirichlet([9.0] + [0.5] * (len(bones) - 1))
    return weights


def _surface_keypoints(rng: np.random.Generator, owner: np.ndarray) -> dict[str, int]:
    chosen = {}
    for name in SURFACE_KEYPOINTS:
        side, _, part = name.partition("_")
        joint = {"nose": "head", "ear": "head", "eye": f"{side}_eye"}.get(part or side, f"{side}_foot")
        joint = f"{side}_{part}3" if part in _FINGERS else joint
        chosen[name] = int(rng.choice(np.flatnonzero(owner == JOINT[joint])))
    return chosen


def _triangles(rng: np.random.Generator, among: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return rng.permuted(np.broadcast_to(among, (*shape, len(among))), axis=-1)[..., :3]
