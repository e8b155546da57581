"""Phase 2, after its keypoints: refines the shape by silhouettes.

Keypoints determine the length of bones, but hardly a body's girth. The border of a silhouette does, apart from clothes,
whose thickness is estimated with the shape: one number with a prior. Poses are fixed, and so is the height: a
silhouette does not determine size, and the prior alone made stout people shorter (by 5 cm and more). The sampled
frames' translation is free together with the shape, with keypoints counting as before.

A vertex on the outline of the posed body should be inside the border of the mask by the thickness of clothes, along the
normal of the outline (point-to-line ICP; Y. Chen, G. Medioni, Image and Vision Computing 10, 1992), with the
Geman-McClure function.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from fitting_core import keypoints as kp
from fitting_core.body.geometry import unit, vertex_normals
from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import JOINTS, N_BETAS, BodyModel
from fitting_core.fit.solvers.problem import Sample, SharedShape
from fitting_core.fit.stages import IMAGE_SCALE, N_STAGES, Stages
from fitting_core.fit.variables.state import Free, State
from fitting_core.lens import filmed

CLOTHES, CLOTHES_DEVIATION = 0.010, 0.007
"""Metres: the prior mean of the thickness of clothes."""
WEIGHT = 2.0
"""Standard deviation for a piece of outline of length PIECE, in keypoint units."""
PIECE = 0.05
"""Metres of outline whose errors are correlated."""
FAR = 0.06
"""rho of the Geman-McClure function, metres."""
_HEIGHT_DEVIATION = 0.015
"""Metres, of the height from keypoints, which is held."""
FEWEST, MOST = 3, 8
"""Minimum number of frames with a good silhouette, of the sampled ones."""
ROUNDS, STEPS = 2, 3
"""How often the outline is recomputed, and Gauss-Newton steps for each."""
_ALIKE = 0.6
"""Minimum intersection over union of body and silhouette in a good frame: otherwise it is someone else's."""
_SEEN = [kp.INDEX[f"{side}_{part}"] for side in ("left", "right") for part in ("shoulder", "hip", "knee")]
_BARE = ("head", "jaw", "eye", "elbow", "wrist", "index", "middle", "pinky", "ring", "thumb", "ankle", "foot")
"""Parts whose outline does not show the body: hair, shoes, hands, which are too fine, and forearms. Sleeves may end
above these: bare ones halved the thickness of clothes of 1 and 2 cm, and made people stouter and their distance
worse."""
_FACING = 0.5
"""Minimum cosine between the normals of corresponding points of the outline and of the mask's border."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OutlinedShape:
    """The result."""

    state: State
    """Of the sampled frames, which share their betas."""
    clothes: float
    """Thickness in metres."""
    frames: int
    """Number of frames whose outline counted."""

    def note(self) -> str:
        """For users."""
        return f"shape with the silhouettes of {self.frames} frames, clothes {100 * self.clothes:.1f} cm thick"


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sight:
    """A frame with a silhouette, and its posed body, which is linear in the betas."""

    stages: Stages
    distance: Float[np.ndarray, "h w"]
    """Distance in image pixels from the border of the mask, positive inside."""
    at_rest: Float[np.ndarray, "V 3"]
    """Vertices of the mean shape without the translation, metres in camera axes."""
    by_betas: Float[np.ndarray, "V 3 10"]

    @property
    def scale(self) -> Float[np.ndarray, "2"]:
        """Image pixels per mask pixel."""
        return np.array(self.stages.camera.size) / self.distance.shape[::-1]

    def in_mask(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Image positions as mask positions."""
        lens = self.stages.camera.lens
        return ((xy if lens is None else filmed(lens, xy)) + 0.5) / self.scale - 0.5

    def sampled(self, values: np.ndarray, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        """Bilinear interpolation of mask values at image positions; 0 outside it."""
        x, y = self.in_mask(xy).astype(np.float32).T[:, None]
        return cv2.remap(values.astype(np.float32), x, y, cv2.INTER_LINEAR)[0].astype(float)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Outline:
    """Vertices of a frame on the outline of the body."""

    sight: _Sight
    vertices: Int[np.ndarray, "n"]
    normals: Float[np.ndarray, "n 2"]
    """In the image, outward."""
    length: Float[np.ndarray, "n"]
    """Length of outline in pixels that each represents."""

    def rows(
        self, betas: Float[np.ndarray, "10"], translation: Float[np.ndarray, "3"], clothes: float
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 14"]]:
        """Weighted residuals, and their derivatives by translation, betas and the thickness of clothes."""
        sight, chosen = self.sight, self.vertices
        camera = sight.stages.camera
        by_betas = sight.by_betas[chosen]
        points = sight.at_rest[chosen] + by_betas @ betas + translation
        focal, depth = np.array(camera.focal), points[:, 2:]
        xy = points[:, :2] / depth * focal + camera.center
        metre = focal.mean() / depth[:, 0]
        within = sight.sampled(sight.distance, xy)
        residual = within - clothes * metre
        step = sight.scale.mean()
        slope = [sight.sampled(sight.distance, xy + step * axis) - within for axis in np.eye(2)]
        facing = (unit(np.stack(slope, 1) + 1e-9) * -self.normals).sum(1) > _FACING
        outward = np.concatenate(
            [self.normals * focal / depth, -(self.normals * focal * points[:, :2]).sum(1, keepdims=True) / depth**2], 1
        )
        rho2 = (FAR * metre) ** 2
        weight = WEIGHT * np.sqrt(self.length / (PIECE * metre)) * rho2 / (residual**2 + rho2)
        weight *= facing * IMAGE_SCALE / camera.size[1]
        by_shape = np.einsum("nd,ndk->nk", outward, by_betas)
        rows = np.concatenate([-outward, -by_shape, -metre[:, None]], 1)
        return weight * residual, weight[:, None] * rows


def outlined_shape(stages: Stages, frames: Int[torch.Tensor, "n"], sampled: State) -> OutlinedShape | None:
    """The shape of the sampled frames, refined by their silhouettes; None if fewer than FEWEST are good.

    Args:
        stages: Those of the clip.
        frames: The sampled ones.
        sampled: Their state, with shared betas.
    """
    sights = _sights(stages, frames, sampled)
    columns = stages.parametrisation.columns
    clothes, outlines = CLOTHES, {}
    height, free = _HeldHeight.of(stages, sampled), Free(body=False, hands=False, face=False)
    for _ in range(ROUNDS):
        outlines = {row: found for row, sight in sights.items() if (found := _outline(sight, sampled, row))}
        if len(outlines) < FEWEST:
            return None
        for _ in range(STEPS):
            problem = SharedShape(sample_of(stages, frames, sampled, N_STAGES, free))
            _, gradient, matrix, held, holding = (
                a[0].double().cpu().numpy() for a in problem.normal(sampled, torch.zeros(1, dtype=torch.long))
            )
            # The root's orientation, the first three columns, stays as the rest of the pose does.
            moves, betas, more = _solved(
                (gradient[:, 3:], matrix[:, 3:, 3:], held + height.gradient(sampled), holding + height.matrix),
                {row: _rows(outline, sampled, row, clothes) for row, outline in outlines.items()},
                clothes,
                stages.config.weights.shape[N_STAGES - 1],
            )
            vector = sampled.vector.clone()
            vector[:, columns.translation] += torch.as_tensor(moves).to(vector)
            vector[:, columns.betas] += torch.as_tensor(betas).to(vector)
            sampled, clothes = replace(sampled, vector=vector), clothes + more
    return OutlinedShape(state=sampled, clothes=clothes, frames=len(outlines))


@dataclass(frozen=True, kw_only=True, eq=False)
class _HeldHeight:
    """Holds the height determined by keypoints."""

    by_betas: Float[np.ndarray, "10"]
    """Weighted: how a beta changes it."""
    before: Float[np.ndarray, "10"]
    columns: slice

    @staticmethod
    def of(stages: Stages, sampled: State) -> "_HeldHeight":
        columns, weight = stages.parametrisation.columns.betas, stages.config.weights.shape[N_STAGES - 1]
        by_betas = weight / _HEIGHT_DEVIATION * stages.body.height[1]
        return _HeldHeight(by_betas=by_betas, before=_betas(sampled, columns), columns=columns)

    @property
    def matrix(self) -> Float[np.ndarray, "10 10"]:
        return np.outer(self.by_betas, self.by_betas)

    def gradient(self, sampled: State) -> Float[np.ndarray, "10"]:
        return self.matrix @ (_betas(sampled, self.columns) - self.before)


def _betas(sampled: State, columns: slice) -> Float[np.ndarray, "10"]:
    return sampled.vector[0, columns].double().cpu().numpy()


def sample_of(stages: Stages, frames: Int[torch.Tensor, "n"], sampled: State, stage: int, free: Free) -> Sample:
    """A stage's objective of some frames alone; `sampled` is their state."""
    part = stages.picked(frames.cpu().numpy())
    return Sample(part.objective(stage, sampled, free), part.all_frames)


def _rows(outline: _Outline, sampled: State, row: int, clothes: float) -> tuple[np.ndarray, np.ndarray]:
    columns = outline.sight.stages.parametrisation.columns
    vector = sampled.vector[row].double().cpu().numpy()
    return outline.rows(vector[columns.betas], vector[columns.translation], clothes)


def _solved(
    keypoints: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    outlines: dict[int, tuple[np.ndarray, np.ndarray]],
    clothes: float,
    prior: float,
) -> tuple[Float[np.ndarray, "B 3"], Float[np.ndarray, "10"], float]:
    """A Gauss-Newton step of translations, betas and clothes, whose thickness stays non-negative.

    Args:
        keypoints: The normal equations of `SharedShape.normal` in translations and betas.
        outlines: Residuals and rows by sampled frame.
        clothes: Their current thickness, metres.
        prior: Weight of a standard deviation.
    """
    of_frames, blocks, held, holding = keypoints
    count, own = len(of_frames), 3
    gradient, matrix = np.zeros((count, own + N_BETAS + 1)), np.zeros((count, own + N_BETAS + 1, own + N_BETAS + 1))
    gradient[:, :-1], matrix[:, :-1, :-1] = of_frames, blocks
    for row, (residual, rows) in outlines.items():
        gradient[row] += rows.T @ residual / len(outlines)
        matrix[row] += rows.T @ rows / len(outlines)
    right, schur = gradient[:, own:].sum(0), matrix[:, own:, own:].sum(0)
    right[:-1] += held
    schur[:-1, :-1] += holding
    precision = (prior / CLOTHES_DEVIATION) ** 2
    right[-1] += precision * (clothes - CLOTHES)
    schur[-1, -1] += precision
    eliminated = np.linalg.solve(
        matrix[:, :own, :own], np.concatenate([matrix[:, :own, own:], gradient[:, :own, None]], 2)
    )
    schur -= np.einsum("fab,fac->bc", matrix[:, :own, own:], eliminated[..., :-1])
    right -= np.einsum("fab,fa->b", matrix[:, :own, own:], eliminated[..., -1])
    shared = -np.linalg.solve(schur, right)
    if shared[-1] < -clothes:
        shared[-1] = -clothes
        shared[:-1] = -np.linalg.solve(schur[:-1, :-1], right[:-1] - clothes * schur[:-1, -1])
    return -eliminated[..., -1] - eliminated[..., :-1] @ shared, shared[:-1], float(shared[-1])


def _sights(stages: Stages, frames: Int[torch.Tensor, "n"], sampled: State) -> dict[int, _Sight]:
    """Sampled frames that have a silhouette and show the limbs, by row."""
    if stages.silhouettes is None:
        return {}
    found = ((row, stages.silhouettes.mask(frame)) for row, frame in enumerate(frames.tolist()))
    masks = {row: mask for row, mask in found if mask is not None}
    limbs = stages.observations.seen[frames][:, _SEEN].all(1).tolist()
    good = [row for row in masks if limbs[row]]
    spread = np.unique(np.linspace(0, len(good) - 1, min(MOST, len(good))).round().astype(int))
    return {row: _sight(stages, masks[row], sampled[row : row + 1]) for row in np.array(good, int)[spread].tolist()}


def _sight(stages: Stages, mask: Bool[np.ndarray, "h w"], state: State) -> _Sight:
    shapes = torch.cat([torch.zeros(1, N_BETAS), torch.eye(N_BETAS)]).double()
    posed = stages.parametrisation.to_params(state)[[0] * len(shapes)]
    posed = replace(posed, betas=shapes, camera_translation=torch.zeros(len(shapes), 3).double())
    vertices = shared_mesh(stages.body)(posed).double().numpy()
    return _Sight(
        stages=stages,
        distance=border_distance(mask) * np.mean(stages.camera.size) / np.mean(mask.shape),
        at_rest=vertices[0],
        by_betas=np.moveaxis(vertices[1:] - vertices[0], 0, -1),
    )


def border_distance(mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Pixels from the border, which is half a pixel from the centre of the last pixel inside."""
    inside, outside = (cv2.distanceTransform(m.astype(np.uint8), cv2.DIST_L2, 5) for m in (mask, ~mask))
    return np.where(mask, inside - 0.5, 0.5 - outside).astype(np.float64)


def _outline(sight: _Sight, sampled: State, row: int) -> _Outline | None:
    """The outline of the posed body; None if it does not match the silhouette."""
    columns, camera = sight.stages.parametrisation.columns, sight.stages.camera
    vector = sampled.vector[row].double().cpu().numpy()
    vertices = sight.at_rest + sight.by_betas @ vector[columns.betas] + vector[columns.translation]
    if vertices[:, 2].min() < 0.1:
        return None
    topology = _topology(sight.stages.body)
    xy = vertices[:, :2] / vertices[:, 2:] * camera.focal + camera.center
    a, b, c = np.moveaxis(xy[topology.faces], 1, 0)
    front = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] < 0
    covered = _covered(sight.in_mask(xy), topology, front, sight.distance.shape)
    mask = sight.distance > 0
    if (covered & mask).sum() < _ALIKE * (covered | mask).sum():
        return None
    edges = topology.edges[front[topology.edge_faces].sum(1) == 1]
    length = np.linalg.norm(np.diff(xy[edges], axis=1)[:, 0], axis=1)
    share = np.bincount(edges.ravel(), np.repeat(length / 2, 2), minlength=len(xy))
    chosen = np.flatnonzero((share > 0) & topology.informative)
    # The tangent plane of the body there contains the camera: its line in the image has the plane's x and y.
    normals = unit(vertex_normals(vertices, topology.faces)[chosen, :2] + 1e-12)
    beyond = xy[chosen] + 1.5 * sight.scale * normals
    inside = (beyond > 0).all(1) & (beyond < np.array(camera.size) - 1).all(1)
    outer = inside & (sight.sampled(covered, beyond) < 0.5)
    return _Outline(sight=sight, vertices=chosen[outer], normals=normals[outer], length=share[chosen[outer]])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Topology:
    """Constants of a body's outline."""

    faces: Int[np.ndarray, "F 3"]
    edges: Int[np.ndarray, "E 2"]
    edge_faces: Int[np.ndarray, "E 2"]
    """The two faces of each edge."""
    parts: tuple[Int[np.ndarray, "n"], ...]
    """Faces by the joint with the greatest skinning weight."""
    informative: Bool[np.ndarray, "V"]
    """Vertices whose outline shows the body."""


@lru_cache(maxsize=2)
def _topology(body: BodyModel) -> _Topology:
    faces = body.faces.astype(np.int64)
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, which, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(which.ravel(), kind="stable")
    first, twice = np.searchsorted(which.ravel()[order], np.arange(len(edges))), count == 2
    face = order % len(faces)
    edge_faces = np.stack([face[first[twice]], face[first[twice] + 1]], 1)
    carried = body.skinning_weights.argmax(1)
    bare = np.array([any(part in name for part in _BARE) for name in JOINTS])
    of_face = carried[faces[:, 0]]
    return _Topology(
        faces=faces,
        edges=edges[twice],
        edge_faces=edge_faces,
        parts=tuple(np.flatnonzero(of_face == joint) for joint in np.unique(of_face)),
        informative=~bare[carried],
    )


def _covered(
    xy: Float[np.ndarray, "V 2"], topology: _Topology, front: Bool[np.ndarray, "F"], shape: tuple[int, int]
) -> Bool[np.ndarray, "h w"]:
    """The mask covered by the body. Part by part, because `fillPoly` omits areas covered twice in one call."""
    covered = np.zeros(shape, np.uint8)
    corners = np.round(np.clip(xy, -1000, 5000) * 16).astype(np.int32)
    for part in topology.parts:
        seen = np.zeros(shape, np.uint8)
        cv2.fillPoly(seen, list(corners[topology.faces[part[front[part]]]]), 1, shift=4)
        covered |= seen
    return covered.astype(bool)
