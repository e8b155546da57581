"""The space of body shapes: mean and principal components of sampled bodies."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fitting_core.body.geometry import MIRROR
from fitting_core.body.model import N_BETAS
from fitting_core.build_assets.free_body.skin.skinning import joint_mirror


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
