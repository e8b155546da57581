"""The kernels against torch: costs, gradients, matrices and whole descents of single frames."""

import gc
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from fitting_core.body.model import BodyModel
from fitting_core.config.schema import PRESETS, FitConfig, SolverSettings
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.fused import ready
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.phases.initialize import guess_depth
from fitting_core.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from fitting_core.fit.solvers.problem import IndependentFrames
from fitting_core.fit.solvers.sequence import Sequence
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.bending import Bending
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.state import Free, State
from fitting_core.priors.files.network import write_prior_network
from tests.fitting_core.priors.networks import random_network
from tests.samples.scenes import finished, keypoints_of, noisy, random_params, random_state, stages_of
from tests.samples.sessions import QUICK, small_clip

pytest.importorskip("numba", reason="numba is not installed: pip install numba")
FRAMES = torch.arange(5)
NO_COLLISION = (0.0,) * 5


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    ready.prepare(print)


@contextmanager
def without_kernels() -> Iterator[None]:
    ready.use(kernels=False)
    try:
        yield
    finally:
        ready.use(kernels=True)


def test_a_fit_whose_kernels_cannot_be_compiled_warns_once(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(ready, "_missing", lambda: "numba cannot be used (no such module); pip install numba")
    monkeypatch.setattr(ready._Use, "warned", False)
    with pytest.warns(UserWarning, match=r"many times as long as they could: numba .*; pip install numba") as warned:
        ready.prepare_for(PRESETS["tcfit"])
        ready.prepare_for(PRESETS["tcfit"])
    assert len(warned) == 1


def test_a_fit_compiles_the_kernels_that_it_uses(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    compiled: list[object] = []
    monkeypatch.setattr("fitting_core.fit.compiled.jit.kept_in", lambda: tmp_path)
    monkeypatch.setattr(ready, "_compiled", lambda: bool(compiled))
    monkeypatch.setattr(ready, "_compile", compiled.append)
    single = replace(PRESETS["tcfit"], precision="float32")
    for config in (single, replace(PRESETS["tcfit"], solver="lbfgs"), replace(PRESETS["tcfit"], device="cuda")):
        ready.prepare_for(config)
    assert not compiled
    with pytest.warns(UserWarning, match="happens once"):
        ready.prepare_for(PRESETS["tcfit"])
    assert len(compiled) == 1


def test_a_fit_whose_kernels_are_turned_off_or_ready_does_not_warn(
    monkeypatch: pytest.MonkeyPatch, recwarn: pytest.WarningsRecorder
):
    monkeypatch.setattr(ready._Use, "warned", False)
    ready.prepare_for(PRESETS["tcfit"])
    with without_kernels():
        ready.prepare_for(PRESETS["tcfit"])
    assert not recwarn.list


def config_of(preset: str, prior: str | None = None) -> FitConfig:
    config = PRESETS[preset]
    config = replace(config, weights=replace(config.weights, collision=NO_COLLISION))
    return replace(config, pose_prior=prior) if prior else config


def stages(body: BodyModel, config: FitConfig) -> Stages:
    detections = noisy(keypoints_of(body, random_params(len(FRAMES))), 3.0)
    detections.confidence[1, ::7] = 0.0
    detections.confidence[3, 8:16] = 0.0
    return stages_of(body, detections, config)


def objective(made: Stages, stage: int, state: State, *, betas: bool = True) -> FrameObjective:
    if stage == 0:
        return made.camera_objective(guess_depth(made).depth)
    return made.objective(stage, state, made.free(stage, betas=betas))


def both(made: Stages, stage: int, state: State, *, betas: bool = True) -> tuple[FrameObjective, FrameObjective]:
    """With kernels and without."""
    fused = objective(made, stage, state, betas=betas)
    with without_kernels():
        plain = objective(made, stage, state, betas=betas)
    assert fused.fused is not None and plain.fused is None, ready.problem()
    return fused, plain


def apart(a: Tensor, b: Tensor) -> float:
    return float((a - b).abs().max() / b.abs().max())


def assert_same(fused: FrameObjective, plain: FrameObjective, state: State) -> None:
    got, expected = fused.normal(state, FRAMES), plain.normal(state, FRAMES)
    assert apart(got.cost, expected.cost) < 1e-12
    assert apart(fused.cost(state, FRAMES), expected.cost) < 1e-12
    assert apart(got.gradient, expected.gradient) < 1e-11
    # The prior's derivative is in float32 there.
    assert apart(got.matrix, expected.matrix) < 1e-6


@pytest.mark.parametrize(
    ("preset", "stage", "prior"),
    [
        *(("tcfit", stage, None) for stage in range(6)),
        ("tcfit", 5, "axis_angle"),
        ("paper", 3, None),
        ("paper", 5, None),
    ],
)
def test_every_stage_is_the_same(free_body: BodyModel, preset: str, stage: int, prior: str | None):
    made = stages(free_body, config_of(preset, prior))
    state = random_state(made.parametrisation, len(FRAMES))
    assert_same(*both(made, stage, state), state)


@pytest.mark.parametrize("activation", ["leaky_relu_0.2", "elu", "softplus", "tanh"])
def test_priors_of_other_networks(tiny_body: BodyModel, activation: str, tmp_path: Path):
    write_prior_network(tmp_path / "prior.npz", random_network(activation, size=9, hidden=30, spread=1.0))
    made = stages(tiny_body, config_of("smplifyx", str(tmp_path / "prior.npz")))
    state = random_state(made.parametrisation, len(FRAMES))
    assert_same(*both(made, 5, state), state)


def test_a_prior_of_one_layer_stays_in_torch(tiny_body: BodyModel, tmp_path: Path):
    network = random_network("silu", size=9, hidden=30, spread=1.0)
    layer = replace(network.decoder[-1], weight=network.decoder[-1].weight[:, :9])
    write_prior_network(tmp_path / "prior.npz", replace(network, decoder=(layer,)))
    made = stages(tiny_body, config_of("tcfit", str(tmp_path / "prior.npz")))
    assert objective(made, 5, made.parametrisation.neutral(len(FRAMES))).fused is None


def test_nothing_of_a_fit_is_kept(tiny_body: BodyModel):
    made = stages(tiny_body, config_of("tcfit"))
    prior = weakref.ref(made.parametrisation.prior)
    assert objective(made, 5, made.parametrisation.neutral(len(FRAMES))).fused is not None
    del made
    gc.collect()
    assert prior() is None


def test_a_fit_does_not_load_the_compiler_of_torch(tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch):
    """Forward differentiation does: a second of a first fit, and 70 MB."""
    monkeypatch.setattr(torch.func, "jacfwd", lambda function: pytest.fail("forward differentiation"))
    assert fit_clip(small_clip(tiny_body), tiny_body, QUICK).last.phase == 3


@pytest.mark.parametrize("moving", [Free(betas=False), Free(betas=False, hands=False, face=False)], ids=["all", "body"])
@pytest.mark.parametrize("prior", [None, "axis_angle"])
@pytest.mark.parametrize("preset", ["tcfit", "paper"])
def test_frames_that_are_fitted_together(free_body: BodyModel, preset: str, prior: str | None, moving: Free):
    """E_T in camera space and in the body's own, with frames before and behind that are held."""
    made = stages(free_body, config_of(preset, prior))
    clip, everything = random_state(made.parametrisation, len(FRAMES)), torch.tensor([0])
    fused = Sequence(made.objective(5, clip, moving), clip, range(1, 4))
    with without_kernels():
        plain = Sequence(made.objective(5, clip, moving), clip, range(1, 4))
    state = random_state(made.parametrisation, len(FRAMES), 1)[1:4]
    (cost, gradient, *bands), (expected, slope, *blocks) = (s.normal(state, everything) for s in (fused, plain))
    assert apart(cost, expected) < 1e-12 and apart(fused.cost(state, everything), expected) < 1e-12
    assert apart(gradient, slope) < 1e-6
    for one, other in zip(bands, blocks, strict=True):
        assert apart(one, other) < 1e-6


@dataclass(frozen=True)
class Strange(Term):
    """One that the kernels do not know."""

    name: str = "strange"

    def residual(self, e: Estimate) -> Tensor:
        return 3.0 * e.body_pose[:, 3:9].sin() + e.state.orient[:, 0, :1]


class LikeBending(Bending):
    """Known by its own kind only: what is built on it may differ."""


@pytest.mark.parametrize(
    "term", [Strange(), LikeBending(2.0), Bending(2.0)], ids=["strange", "derived", "a second one"]
)
def test_unknown_terms_are_added(tiny_body: BodyModel, term: Term):
    made = stages(tiny_body, config_of("paper"))
    state = random_state(made.parametrisation, len(FRAMES))
    fused, plain = both(made, 5, state)
    kernels = FrameObjective([*fused.terms, term], fused.view, fused.free)
    assert kernels.fused is not None and kernels.fused.others == [term]
    with without_kernels():
        torch_only = FrameObjective([*plain.terms, term], plain.view, plain.free)
    assert_same(kernels, torch_only, state)
    assert IndependentFrames(kernels, FRAMES).descents(state, iterations=1, tolerance=0) is None


@pytest.mark.parametrize(
    ("stage", "prior", "close"),
    [(0, None, 1e-9), (3, "axis_angle", 1e-9), (5, "axis_angle", 1e-9), (5, None, 1e-4)],
    # The prior's derivative is in float32 in the kernels: where next to nothing holds a number, a step differs.
)
def test_a_descent_takes_the_same_steps(free_body: BodyModel, stage: int, prior: str | None, close: float):
    made = stages(free_body, config_of("tcfit", prior))
    state = made.parametrisation.neutral(len(FRAMES))
    state.orient[:] = random_state(made.parametrisation, len(FRAMES)).orient
    state.vector[:, made.parametrisation.columns.translation] = torch.tensor([0.0, 0.0, 3.0], dtype=torch.float64)
    solver, found = LevenbergMarquardt(SolverSettings(iterations=3)), []  # more, and rounding decides where they go
    for built in both(made, stage, state):
        found.append(finished(solver.minimise(IndependentFrames(built, FRAMES), state, final=True)))
    kernels, plain = found
    assert kernels.reason == plain.reason and kernels.evaluations == plain.evaluations
    assert apart(kernels.cost, plain.cost) < close


def test_threads_change_no_bit_and_progress_is_told(tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch):
    made = stages(tiny_body, config_of("tcfit"))
    state = random_state(made.parametrisation, len(FRAMES))
    monkeypatch.setattr("fitting_core.fit.fused.frames._PIECE", 2)
    ends = []
    for threads in (1, 3):
        ready.use(threads=threads)
        problem = IndependentFrames(objective(made, 5, state), FRAMES)
        steps = list(LevenbergMarquardt(SolverSettings(iterations=5))._descend(problem, state, 1e-9))
        assert [step.running for step in steps] == [3, 1, 0] if threads == 1 else steps[-1].running == 0
        assert steps[-1].iteration == 5 and set(steps[0].terms()) >= {"data", "limits"}
        ends.append(steps[-1].cost)
    ready.use(threads=1)
    assert torch.equal(*ends)
