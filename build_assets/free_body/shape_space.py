"""What sampled bodies tell: the space of their shapes, and the regressor that finds SMPL-X's joints from their skin."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.distance import cdist

from build_assets.free_body.skin.skinning import joint_mirror
from fitting_core.body.geometry import MIRROR
from fitting_core.body.model import JOINTS, N_BETAS


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledBodies:
    """Bodies in the rest pose, symmetric, in metres, vertices in the file's order."""

    vertices: Float[np.ndarray, "bodies V 3"]
    joints: Float[np.ndarray, "bodies 55 3"]

    @classmethod
    def symmetric(
        cls,
        vertices: Float[np.ndarray, "bodies V 3"],
        joints: Float[np.ndarray, "bodies 55 3"],
        mirror: Int[np.ndarray, "V"],
    ) -> "SampledBodies":
        """Averages each body with its mirror image."""
        return cls(
            vertices=(vertices + vertices[:, mirror] * MIRROR) / 2,
            joints=(joints + joints[:, joint_mirror()] * MIRROR) / 2,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapeSpace:
    """A body's vertices are mean + directions @ betas, in metres; betas of people have unit variance."""

    mean: Float[np.ndarray, "V 3"]
    directions: Float[np.ndarray, "V 3 10"]
    explained: float
    """Share of the samples' variance that the directions hold."""


def shape_space(bodies: SampledBodies) -> ShapeSpace:
    """Principal components. Positive means taller for the first, wider for the others."""
    mean = bodies.vertices.mean(0)
    deviations = (bodies.vertices - mean).reshape(len(bodies.vertices), -1)
    variances, modes = np.linalg.eigh(deviations @ deviations.T / len(deviations))
    largest = np.argsort(-variances)[:N_BETAS]
    directions = (deviations.T @ modes[:, largest] / np.sqrt(len(deviations))).reshape(-1, 3, N_BETAS)
    outward = np.einsum("vdk,vd->k", directions, mean - mean.mean(0))
    taller = np.ptp(mean[:, 1] + directions[:, 1, 0]) - np.ptp(mean[:, 1])
    signs = np.sign(np.concatenate([[taller], outward[1:]]))
    return ShapeSpace(
        mean=mean,
        directions=directions * np.where(signs == 0, 1, signs),
        explained=float(variances[largest].sum() / variances.sum()),
    )


_NEAREST = 60
_SPREAD = 140
_REACH = 0.20  # metres: how far from a joint its vertices may lie
_STILL = 1e-4  # metres per unit of an expression: vertices that move less tell nothing of the face
_STILL_HEAD = 2e-3
_FACE_WEIGHT = 2.0
_SUM_WEIGHT = 3.0
_PENALTY = 0.02  # metres per unit of weight. A quarter of it halves the error, but lets joints leave thin bodies.
_SMALLEST_WEIGHT = 1e-4


def joint_regressor(
    bodies: SampledBodies,
    expressions: Float[np.ndarray, "V 3 10"],
    weights: Float[np.ndarray, "V 55"],
    parents: Int[np.ndarray, "55"],
    mirror: Int[np.ndarray, "V"],
) -> Float[np.ndarray, "55 V"]:
    """Sparse weights of the skin's vertices, per joint summing to 1.

    They are found over the sampled bodies, and such that expressions do not move the joints. Weights may be negative:
    convex ones miss the spine by 20 mm, since it does not lie at a fixed share between back and belly; these by 8 mm.

    Args:
        bodies: sampled bodies with their joints.
        expressions: expression directions.
        weights: skinning weights.
        parents: parent of each joint, -1 for the root.
        mirror: the vertex on the body's other side.
    """
    mean, mean_joints = bodies.vertices.mean(0), bodies.joints.mean(0)
    face = np.linalg.norm(expressions, axis=1).max(-1)
    regressor = np.zeros((len(JOINTS), len(mean)))
    for joint, other in enumerate(joint_mirror()):
        if other < joint:  # the left side comes first
            regressor[joint] = regressor[other][mirror]
            continue
        own = weights[:, joint] + (weights[:, parents[joint]] if parents[joint] >= 0 else 0)
        chosen = _candidates(joint, mean, mean_joints[joint], weights[:, joint], own, face)
        if other == joint:
            chosen = np.union1d(chosen, mirror[chosen])
        regressor[joint, chosen] = _fit(bodies, joint, expressions, chosen)
        if other == joint:
            regressor[joint] = (regressor[joint] + regressor[joint][mirror]) / 2
    return regressor


def _candidates(
    joint: int,
    mean: Float[np.ndarray, "V 3"],
    at: Float[np.ndarray, "3"],
    moved: Float[np.ndarray, "V"],
    own: Float[np.ndarray, "V"],
    face: Float[np.ndarray, "V"],
) -> Int[np.ndarray, "n"]:
    """Vertices near the joint, and some spread over its neighbourhood so that it is surrounded."""
    distance = np.linalg.norm(mean - at, axis=1)
    if JOINTS[joint].endswith("eye"):
        return np.argsort(np.where(moved > 0.5, distance, np.inf))[:_NEAREST]
    near = np.argsort(distance + 0.05 * (own < 0.2) + 2 * face)[:_NEAREST]
    in_head = JOINTS[joint] in ("jaw", "head")
    reach = 0.16 if in_head else max(_REACH, 2.5 * distance.min())
    around = np.flatnonzero((own > 0.25) & (face < (_STILL_HEAD if in_head else _STILL)) & (distance < reach))
    return np.union1d(near, _farthest_points(mean, around, distance))


def _farthest_points(
    mean: Float[np.ndarray, "V 3"], among: Int[np.ndarray, "n"], distance: Float[np.ndarray, "V"]
) -> Int[np.ndarray, "m"]:
    """A spread of at most _SPREAD vertices: the nearest, then always the one farthest from those chosen."""
    if len(among) <= _SPREAD:
        return among
    between = cdist(mean[among], mean[among])
    chosen = [int(distance[among].argmin())]
    gap = between[chosen[0]]
    for _ in range(_SPREAD - 1):
        chosen.append(int(gap.argmax()))
        gap = np.minimum(gap, between[chosen[-1]])
    return among[chosen]


def _fit(
    bodies: SampledBodies, joint: int, expressions: Float[np.ndarray, "V 3 10"], chosen: Int[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """Ridge regression; the penalty keeps weights small, so that noise of single vertices averages out."""
    scale = np.sqrt(len(bodies.vertices))
    around = (bodies.vertices[:, chosen] - bodies.joints[:, None, joint]).transpose(0, 2, 1).reshape(-1, len(chosen))
    face = _FACE_WEIGHT * scale * expressions[chosen].transpose(1, 2, 0).reshape(-1, len(chosen))
    system = np.concatenate(
        [around, face, _SUM_WEIGHT * scale * np.ones((1, len(chosen))), _PENALTY * scale * np.eye(len(chosen))]
    )
    target = np.zeros(len(system))
    target[len(around) + len(face)] = _SUM_WEIGHT * scale
    weights = np.linalg.lstsq(system, target, rcond=None)[0]
    weights = np.where(np.abs(weights) < _SMALLEST_WEIGHT, 0, weights)
    return weights / weights.sum()
