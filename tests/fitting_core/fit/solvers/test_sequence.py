"""E_T by plain loops, its derivatives by automatic differentiation, and which residuals count where."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.camera import CameraPath, path_of
from fitting_core.config.schema import FitConfig
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.solvers.sequence import Sequence, span_of
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.temporal import JointPositions, Smoothness, off_mean
from fitting_core.fit.variables.state import Free, State
from fitting_core.least_squares import DIAGONAL_FLOOR
from tests.fitting_core.fit.solvers.test_banded import dense
from tests.samples.scenes import differentiated, hidden, keypoints_of, random_params, random_state, stages_of

WEIGHT = 70.0


class Scene:
    """E_T over some frames of a clip of random poses; with `terms`, E_o of stage 5 beside it."""

    def __init__(
        self,
        body: BodyModel,
        frames: int,
        *,
        camera: bool = False,
        latent: bool = False,
        terms: bool = False,
        path: CameraPath | None = None,
    ) -> None:
        self.body, self.terms = body, terms
        detections = hidden(keypoints_of(body, random_params(frames, 3)), kp.FACE)
        self.stages: Stages = stages_of(body, detections, FitConfig(), latent=latent)
        self.whole = random_state(self.stages.parametrisation, frames, 4)
        self.joints = JointPositions(body, self.stages.parametrisation, in_camera=camera, path=path)

    def objective(self, groups: Free | None = None) -> FrameObjective:
        objective = self.stages.objective(5, self.whole, groups or Free(betas=False))
        terms = [*(objective.terms if self.terms else []), Smoothness(WEIGHT, self.joints)]
        return FrameObjective(terms, objective.view, objective.free)

    def sequence(self, free: range, groups: Free | None = None, *, windowed: bool = False) -> Sequence:
        return Sequence(self.objective(groups), self.whole, free, windowed=windowed)


def by_loops(scene: Scene, centres: range, *, camera: bool) -> float:
    """w^2 sum over frames, joints and axes of (J_i - mean of J over i - 1, i, i + 1)^2."""
    params = scene.stages.parametrisation.to_params(scene.whole)
    joints = Mesh(scene.body, dtype=torch.float64).joints(params).numpy()
    if not camera:
        joints = joints - params.camera_translation[:, None].numpy()
    if scene.joints.path is not None:  # x_camera = R x_still + t
        turns, moves = np.array(scene.joints.path.rotation), np.array(scene.joints.path.translation)
        joints = np.stack([(joint - camera * t) @ turn for joint, turn, t in zip(joints, turns, moves, strict=True)])
    cost = 0.0
    for i in centres:
        for j in range(55):
            for axis in range(3):
                mean = (joints[i - 1, j, axis] + joints[i, j, axis] + joints[i + 1, j, axis]) / 3
                cost += WEIGHT**2 * (joints[i, j, axis] - mean) ** 2
    return cost


def a_path(frames: int) -> CameraPath:
    """A camera that turns and goes about wildly."""
    random = np.random.default_rng(6)
    turns = Rotation.from_quat(random.normal(0, 1, (frames, 4))).as_matrix()
    return path_of(turns, random.normal(0, 1, (frames, 3)))


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("camera", [False, True])
@pytest.mark.parametrize("frames", [1, 2, 3, 6])
def test_value_by_loops(tiny_body: BodyModel, frames: int, camera: bool, moves: bool):
    scene = Scene(tiny_body, frames, camera=camera, path=a_path(frames) if moves else None)
    sequence = scene.sequence(range(frames))
    expected = by_loops(scene, range(1, frames - 1), camera=camera)
    assert float(sequence.cost(scene.whole, torch.tensor([0]))) == pytest.approx(expected, rel=1e-10)
    assert (expected > 0) == (frames >= 3)


CASES = {
    "all frames": (7, range(7), False),
    "three frames": (3, range(3), False),
    "two frames": (2, range(2), False),
    "one frame": (1, range(1), False),
    "first window": (9, range(0, 4), True),
    "inner window": (9, range(3, 7), True),
    "last window": (9, range(5, 9), True),
    "re-run inside": (9, range(4, 6), False),
    "re-run of one frame": (9, range(4, 5), False),
    "re-run at the start": (9, range(0, 2), False),
    "re-run at the end": (9, range(7, 9), False),
}
"""Frames of the clip, those that move, and whether residuals count as in the paper's windows."""


def step_of_all(scene: Scene, sequence: Sequence, free: range, *, windowed: bool) -> Tensor:
    """Half the Hessian's Gauss-Newton part, (n d, n d), from the Jacobian of all residuals of E_T by all frames."""
    moving, frames = scene.whole[free.start : free.stop], torch.arange(free.start, free.stop)
    jacobian = differentiated(
        lambda s: scene.joints.of(scene.joints.estimate(s, frames)).flatten(1), moving, sequence.objective.index
    )
    assert sequence.smoothness is not None
    span, local = span_of(free, len(scene.whole), windowed=windowed), sequence.smoothness.local
    matrix = written_out(span)[:, local]
    rows = WEIGHT * torch.einsum("rn,nkd->rknd", matrix, jacobian)
    rows = rows.flatten(2).flatten(0, 1)
    return rows.mT @ rows


VARIANTS = [
    *((case, False, False, False) for case in CASES),
    *((case, latent, True, False) for case in ("three frames", "inner window") for latent in (False, True)),
    ("re-run inside", True, False, False),
    *(("inner window", False, camera, True) for camera in (False, True)),
]


@pytest.mark.parametrize(("case", "latent", "camera", "moves"), VARIANTS)
def test_blocks_and_gradient(
    tiny_body: BodyModel, case: str, latent: bool, camera: bool, moves: bool, monkeypatch: pytest.MonkeyPatch
):
    """The bands against dense Gauss-Newton, the gradient against autograd of the cost; chunks of 3 frames."""
    monkeypatch.setattr("fitting_core.fit.objective.jacobians_at_once", lambda _: 3)
    frames, free, windowed = CASES[case]
    scene = Scene(tiny_body, frames, camera=camera, latent=latent, path=a_path(frames) if moves else None)
    sequence = scene.sequence(free, Free(betas=False, face=False, hands=not latent), windowed=windowed)
    local, group = scene.whole[free.start : free.stop], torch.tensor([0])
    cost, gradient, *blocks = sequence.normal(local, group)
    torch.testing.assert_close(cost, sequence.cost(local, group), rtol=1e-12, atol=1e-12)
    expected = step_of_all(scene, sequence, free, windowed=windowed)
    torch.testing.assert_close(dense([b[0] for b in blocks]), expected, rtol=1e-10, atol=1e-9)

    move = torch.zeros(1, sequence.unknowns, dtype=torch.float64, requires_grad=True)
    total = sequence.cost(local.moved(sequence.spread(move)), group).sum()
    (autograd,) = torch.autograd.grad(total, move)
    torch.testing.assert_close(gradient.flatten(), autograd.flatten() / 2, rtol=1e-9, atol=1e-9)
    assert (float(cost) > 0) == (frames >= 3)


@pytest.mark.parametrize("case", ["all frames", "inner window", "re-run inside", "one frame"])
def test_step_is_the_dense_one(tiny_body: BodyModel, case: str):
    """With E_o beside E_T: the banded solution of the damped system, and what it promises."""
    frames, free, windowed = CASES[case]
    scene = Scene(tiny_body, frames, terms=True)
    sequence = scene.sequence(free, windowed=windowed)
    normal = sequence.normal(scene.whole[free.start : free.stop], torch.tensor([0]))
    _, gradient, *blocks = normal
    matrix, g = dense([b[0] for b in blocks]), gradient.flatten()
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


@pytest.mark.parametrize("case", ["all frames", "inner window", "re-run inside"])
def test_a_change_of_cost_is_divided_among_frames(tiny_body: BodyModel, case: str):
    frames, free, windowed = CASES[case]
    sequence = Scene(tiny_body, frames).sequence(free, windowed=windowed)
    smoothness = sequence.smoothness
    assert smoothness is not None
    one, other = torch.randn(2, len(free), 165, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    expected = float(smoothness.cost(other) - smoothness.cost(one))
    assert float(smoothness.change(one, other).sum()) == pytest.approx(expected, rel=1e-9)


def test_one_bent_frame_does_not_hold_the_others(tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch):
    """While one frame's cost rises with every step, that frame is damped; the others then move as far as before."""
    scene = Scene(tiny_body, 5, terms=True)
    sequence = scene.sequence(range(5))
    lowest = sequence.descent(scene.whole).run(40, 1e-9)
    start = lowest.moved(1e-3 * torch.ones_like(scene.whole.vector))
    descent = sequence.descent(start)
    plain, bent, damping, cost = sequence.evaluated, 2, descent.damping.clone(), descent.cost.clone()

    def as_if_bent(state: State) -> tuple[Tensor, Tensor]:
        own, joints = plain(state)
        own[bent] += 1e3 * float(cost)
        return own, joints

    monkeypatch.setattr(sequence, "evaluated", as_if_bent)
    descent.iterate(1e-9)
    assert descent.cost == cost
    assert sequence.stiffness.tolist() == [1, 1, 10, 1, 1]
    assert descent.damping == damping
    monkeypatch.undo()
    descent.iterate(1e-9)
    assert descent.cost < cost
    moved = (descent.state.vector - start.vector).norm(dim=1)
    assert bool((moved > 0).all())
    assert sequence.stiffness.tolist() == [1, 1, 5, 1, 1]


def written_out(span: range) -> Tensor:
    """L, residuals x frames of the span."""
    return off_mean(torch.eye(len(span), dtype=torch.float64))


def counted(span: range) -> set[int]:
    """Frames on which a residual is centred."""
    matrix = written_out(span)
    centres = {int(row.argmax()) + span.start for row in matrix}
    assert len(centres) == len(matrix)
    for row in matrix:
        np.testing.assert_allclose(sorted(row[row != 0]), [-1 / 3, -1 / 3, 2 / 3])
        assert abs(float(row.sum())) < 1e-15
    return centres


@pytest.mark.parametrize(
    ("frames", "free", "windowed", "expected"),
    [
        (1, range(1), False, set()),
        (2, range(2), False, set()),
        (3, range(3), False, {1}),
        (8, range(8), False, set(range(1, 7))),
        # A window: all its frames but the last, the frame before it is a constant.
        (12, range(0, 7), True, {1, 2, 3, 4, 5}),
        (12, range(3, 10), True, set(range(3, 9))),
        (12, range(5, 12), True, set(range(5, 11))),
        # A re-run: every residual that looks at a free frame.
        (12, range(4, 6), False, {3, 4, 5, 6}),
        (12, range(0, 1), False, {1}),
        (12, range(11, 12), False, {10}),
        (12, range(1, 2), False, {1, 2}),
    ],
)
def test_which_residuals_count(frames: int, free: range, windowed: bool, expected: set[int]):
    span = span_of(free, frames, windowed=windowed)
    assert counted(span) == expected
    assert set(free) <= set(span) <= set(range(frames))
