"""E_T by plain loops, its derivatives by automatic differentiation, and which residuals count where."""

import numpy as np
import pytest
import torch
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.config.schema import FitConfig
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.solvers.problem import DIAGONAL_FLOOR
from fitting_core.fit.stages import Stages
from fitting_core.fit.temporal import Coupling, JointPositions, Sequence
from fitting_core.fit.variables.state import Free, State
from tests.samples.scenes import differentiated, hidden, keypoints_of, random_params, random_state, stages_of

WEIGHT = 70.0


class Scene:
    """E_T over some frames of a clip of random poses; with `terms`, E_o of stage 5 beside it."""

    def __init__(
        self, body: BodyModel, frames: int, *, camera: bool = False, latent: bool = False, terms: bool = False
    ) -> None:
        self.body, self.terms = body, terms
        detections = hidden(keypoints_of(body, random_params(frames, 3)), kp.FACE)
        self.stages: Stages = stages_of(body, detections, FitConfig(), latent=latent)
        self.whole = random_state(self.stages.parametrisation, frames, 4)
        self.joints = JointPositions(body, self.stages.parametrisation, in_camera=camera)

    def sequence(self, free: range, centres: range, groups: Free | None = None) -> Sequence:
        objective = self.stages.objective(5, self.whole, groups or Free(betas=False))
        if not self.terms:
            objective = FrameObjective([], objective.view, objective.free)
        coupling = Coupling.of(free, centres, len(self.whole))
        return Sequence(objective, self.joints, self.joints(self.whole), coupling, WEIGHT)


def by_loops(scene: Scene, centres: range, *, camera: bool) -> float:
    """w^2 sum over frames, joints and axes of (J_i - mean of J over i - 1, i, i + 1)^2."""
    params = scene.stages.parametrisation.to_params(scene.whole)
    joints = Mesh(scene.body, dtype=torch.float64).joints(params).numpy()
    if not camera:
        joints = joints - params.camera_translation[:, None].numpy()
    cost = 0.0
    for i in centres:
        for j in range(55):
            for axis in range(3):
                mean = (joints[i - 1, j, axis] + joints[i, j, axis] + joints[i + 1, j, axis]) / 3
                cost += WEIGHT**2 * (joints[i, j, axis] - mean) ** 2
    return cost


@pytest.mark.parametrize("camera", [False, True])
@pytest.mark.parametrize("frames", [1, 2, 3, 6])
def test_value_by_loops(tiny_body: BodyModel, frames: int, camera: bool):
    scene = Scene(tiny_body, frames, camera=camera)
    sequence = scene.sequence(range(frames), range(frames))
    expected = by_loops(scene, range(1, frames - 1), camera=camera)
    assert float(sequence.cost(scene.whole, torch.tensor([0]))) == pytest.approx(expected, rel=1e-10)
    assert (expected > 0) == (frames >= 3)


def test_depth_jitter_counts_in_camera_space_alone(tiny_body: BodyModel):
    costs = {}
    for camera in (False, True):
        scene = Scene(tiny_body, 3, camera=camera)
        sequence, where = scene.sequence(range(3), range(3)), scene.stages.parametrisation.columns.translation
        moved = scene.whole.vector[:, where].clone()
        moved[1, 2] += 0.3
        moved = scene.whole.with_columns(where, moved)
        costs[camera] = [float(sequence.cost(s, torch.tensor([0]))) for s in (scene.whole, moved)]
    assert costs[False][0] == costs[False][1]
    assert abs(costs[True][0] - costs[True][1]) > 1


CASES = {
    "all frames": (7, range(7), range(7)),
    "three frames": (3, range(3), range(3)),
    "two frames": (2, range(2), range(2)),
    "one frame": (1, range(1), range(1)),
    "first window": (9, range(0, 4), range(0, 3)),
    "inner window": (9, range(3, 7), range(3, 6)),
    "last window": (9, range(5, 9), range(5, 8)),
    "re-run inside": (9, range(4, 6), range(3, 7)),
    "re-run of one frame": (9, range(4, 5), range(3, 6)),
    "re-run at the start": (9, range(0, 2), range(-1, 3)),
    "re-run at the end": (9, range(7, 9), range(6, 10)),
}


def step_of_all(scene: Scene, sequence: Sequence, free: range) -> Tensor:
    """Half the Hessian's Gauss-Newton part, (n d, n d), from the Jacobian of all residuals of E_T by all frames."""
    local = scene.whole[free.start : free.stop]
    jacobian = differentiated(lambda s: scene.joints(s).flatten(1), local, sequence.objective.index)
    matrix = written_out(sequence.coupling)[:, sequence.local]
    rows = WEIGHT * torch.einsum("rn,nkd->rknd", matrix, jacobian)
    rows = rows.flatten(2).flatten(0, 1)
    return rows.mT @ rows


def dense(blocks: tuple[Tensor, ...]) -> Tensor:
    diagonal, *below = blocks
    n, d = diagonal.shape[:2]
    matrix = diagonal.new_zeros(n, d, n, d)
    for i in range(n):
        matrix[i, :, i] = diagonal[i]
    for k, off in enumerate(below, 1):
        assert len(off) == max(n - k, 0)
        for i in range(n - k):
            matrix[i + k, :, i], matrix[i, :, i + k] = off[i], off[i].mT
    return matrix.view(n * d, n * d)


VARIANTS = [
    *((case, False, False) for case in CASES),
    *((case, latent, True) for case in ("three frames", "inner window") for latent in (False, True)),
    ("re-run inside", True, False),
]


@pytest.mark.parametrize(("case", "latent", "camera"), VARIANTS)
def test_blocks_and_gradient(tiny_body: BodyModel, case: str, latent: bool, camera: bool, monkeypatch):
    """The bands against dense Gauss-Newton, the gradient against autograd of the cost; chunks of 3 frames."""
    monkeypatch.setattr("fitting_core.fit.temporal.CHUNK", 3)
    frames, free, centres = CASES[case]
    scene = Scene(tiny_body, frames, camera=camera, latent=latent)
    sequence = scene.sequence(free, centres, Free(betas=False, face=False, hands=not latent))
    local, group = scene.whole[free.start : free.stop], torch.tensor([0])
    cost, gradient, *blocks = sequence.normal(local, group)
    torch.testing.assert_close(cost, sequence.cost(local, group), rtol=1e-12, atol=1e-12)
    expected = step_of_all(scene, sequence, free)
    torch.testing.assert_close(dense(tuple(b[0] for b in blocks)), expected, rtol=1e-10, atol=1e-9)

    move = torch.zeros(1, sequence.unknowns, dtype=torch.float64, requires_grad=True)
    total = sequence.cost(local.moved(sequence.spread(move)), group).sum()
    (autograd,) = torch.autograd.grad(total, move)
    torch.testing.assert_close(gradient.flatten(), autograd.flatten() / 2, rtol=1e-9, atol=1e-9)
    assert (float(cost) > 0) == (frames >= 3)


@pytest.mark.parametrize("case", ["all frames", "inner window", "re-run inside", "one frame"])
def test_step_is_the_dense_one(tiny_body: BodyModel, case: str):
    """With E_o beside E_T: the banded solution of the damped system, and what it promises."""
    frames, free, centres = CASES[case]
    scene = Scene(tiny_body, frames, terms=True)
    sequence = scene.sequence(free, centres)
    normal = sequence.normal(scene.whole[free.start : free.stop], torch.tensor([0]))
    _, gradient, *blocks = normal
    matrix, g = dense(tuple(b[0] for b in blocks)), gradient.flatten()
    diagonal = matrix.diagonal().view(len(free), -1)
    extra = 0.1 * diagonal.mean(1, keepdim=True) + DIAGONAL_FLOOR * diagonal.amax(1, keepdim=True)
    extra = extra.expand_as(diagonal).flatten()
    expected = -torch.linalg.solve(matrix + extra.diag(), g)
    step = sequence.solve(normal, torch.tensor([0.1], dtype=torch.float64))
    assert step.solved.tolist() == [True]
    torch.testing.assert_close(step.move[:, sequence.objective.index].flatten(), expected, rtol=1e-6, atol=1e-9)
    # E(x) - E(x + m) of the quadratic model is -2 g m - m H m, and (H + D) m = -g
    promised = float(-2 * g @ expected - expected @ matrix @ expected)
    assert float(step.predicted) == pytest.approx(promised, rel=1e-6)


def test_not_positive_definite_is_reported(tiny_body: BodyModel):
    scene = Scene(tiny_body, 4, terms=True)
    sequence = scene.sequence(range(4), range(4))
    normal = list(sequence.normal(scene.whole, torch.tensor([0])))
    normal[2] = normal[2] - 1e9 * torch.eye(normal[2].shape[-1], dtype=torch.float64)
    step = sequence.solve(tuple(normal), torch.tensor([1e-3], dtype=torch.float64))
    assert step.solved.tolist() == [False] and float(step.move.abs().max()) == 0


def written_out(coupling: Coupling) -> Tensor:
    """L, residuals x frames from the first on."""
    return coupling.residuals(torch.eye(coupling.span, dtype=torch.float64))


def counted(coupling: Coupling) -> set[int]:
    """Frames on which a residual is centred."""
    matrix = written_out(coupling)
    centres = {int(row.argmax()) + coupling.first for row in matrix}
    assert len(centres) == len(matrix)
    for row in matrix:
        np.testing.assert_allclose(sorted(row[row != 0]), [-1 / 3, -1 / 3, 2 / 3])
        assert abs(float(row.sum())) < 1e-15
    return centres


@pytest.mark.parametrize(
    ("frames", "free", "centres", "expected"),
    [
        (1, range(1), range(1), set()),
        (2, range(2), range(2), set()),
        (3, range(3), range(3), {1}),
        (8, range(8), range(8), set(range(1, 7))),
        # A window: all its frames but the last, the frame before it is a constant.
        (12, range(0, 7), range(0, 6), {1, 2, 3, 4, 5}),
        (12, range(3, 10), range(3, 9), set(range(3, 9))),
        (12, range(5, 12), range(5, 11), set(range(5, 11))),
        # A re-run: every residual that looks at a free frame.
        (12, range(4, 6), range(3, 7), {3, 4, 5, 6}),
        (12, range(0, 1), range(-1, 2), {1}),
        (12, range(11, 12), range(10, 13), {10}),
        (12, range(1, 2), range(0, 3), {1, 2}),
    ],
)
def test_which_residuals_count(frames: int, free: range, centres: range, expected: set[int]):
    coupling = Coupling.of(free, centres, frames)
    assert counted(coupling) == expected
    assert coupling.free.tolist() == list(free)
    assert coupling.first + coupling.span <= frames
    matrix = written_out(coupling)
    assert torch.allclose(coupling.transposed(torch.eye(len(matrix), dtype=matrix.dtype)), matrix.T)
    square, local = matrix.T @ matrix, coupling.free - coupling.first
    for k, band in enumerate(coupling.bands(matrix)):
        assert torch.allclose(band, square[local[k:], local[: max(len(local) - k, 0)]])


def test_cost_of_a_rerun_looks_at_the_frames_around_it(tiny_body: BodyModel):
    """A change of a held neighbour within two frames changes the cost, one farther away does not."""
    scene = Scene(tiny_body, 12)
    local, group = scene.whole[5:7], torch.tensor([0])
    before = float(scene.sequence(range(5, 7), range(4, 8)).cost(local, group))
    where = scene.stages.parametrisation.columns.body
    for frame in range(12):
        pose = scene.whole.vector[:, where].clone()
        pose[frame] += 0.1
        moved: State = scene.whole.with_columns(where, pose)
        objective = scene.sequence(range(5, 7), range(4, 8)).objective
        coupling = Coupling.of(range(5, 7), range(4, 8), 12)
        after = Sequence(objective, scene.joints, scene.joints(moved), coupling, WEIGHT).cost(local, group)
        assert (float(after) != before) == (frame in (3, 4, 7, 8)), frame
