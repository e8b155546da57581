"""Figures of runs, and two runs side by side."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.config.schema import PRESETS
from fitting_core.errors import InputError
from fitting_core.io.summary import summary
from fitting_core.results.fit_result import FitResult, PhaseResult
from tcfit_app.analysis.curves import between_runs, vertex_distances
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.run_metrics import METRICS, ComparedMetric, Metric, compare, run_metrics
from tests.samples.posed import displaced, fit_of, keypoints_of, still_params, with_keypoints
from tests.samples.scenes import noisy, random_params


def phase_of(params: BodyParams) -> PhaseResult:
    return PhaseResult(phase=3, params=params, objective={"data": 12.0}, frame_cost=np.ones(len(params)), seconds=2.0)


def measured(fit: PosedFit) -> dict[str, float | None]:
    return {metric.name: metric.value for metric in run_metrics(fit, 7.5)}


def in_motion(frames: int) -> BodyParams:
    """To the right with an acceleration of 10 mm/frame^2."""
    params = still_params(frames)
    shift = torch.zeros(frames, 3, dtype=torch.float64)
    shift[:, 0] = 0.005 * torch.arange(frames) ** 2
    return replace(params, camera_translation=params.camera_translation + shift)


def test_height_and_shape_are_those_of_the_mean_betas(free_body: BodyModel):
    params = still_params(2)
    betas = torch.zeros(2, 10, dtype=torch.float64)
    betas[:, :2] = torch.tensor([[3.0, 4.0], [1.0, 0.0]])
    found = measured(fit_of(free_body, replace(params, betas=betas)))
    vertices = free_body.with_shape([2.0, 2.0, *[0.0] * 8]).template
    assert found["height"] == pytest.approx(np.ptp(vertices[:, 1]), abs=2e-3)
    assert found["betas_size"] == pytest.approx(np.sqrt(8)) and found["betas_std"] == pytest.approx(0.3)


def test_known_figures(tiny_body: BodyModel):
    params = in_motion(6)
    found = measured(displaced(fit_of(tiny_body, params), slice(None), list(range(kp.COUNT)[kp.FACE]), (3.0, 4.0)))
    expected = {
        "reprojection_body_p95": 0,
        "reprojection_hands_median": 0,
        "reprojection_face_median": 5,
        "reprojection_face_p95": 5,
        "jitter": 10,
        "jitter_in_body": 0,
        "acceleration": 0.010 * 25**2,
        "betas_std": 0,
        "seconds": 7.5,
    }
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, abs=1e-3), name


def test_they_are_those_of_the_summary(tiny_body: BodyModel):
    params = random_params(5)
    fit = fit_of(tiny_body, params, noisy(keypoints_of(tiny_body, params), 5.0))
    result = FitResult(
        phases=(phase_of(params),), camera=fit.clip.camera, config=PRESETS["tcfit"], observed=np.ones((5, 55), bool)
    )
    told, found = summary(result, fit.clip, tiny_body, complete=True, command=""), measured(fit)
    assert found["reprojection_median"] == pytest.approx(told["reprojection_px"]["phase3"]["median"])
    assert found["reprojection_p95"] == pytest.approx(told["reprojection_px"]["phase3"]["p95"])
    assert found["jitter"] == pytest.approx(told["jitter"]["phase3"]["camera_space_mm_per_frame2"])
    assert found["jitter_in_body"] == pytest.approx(told["jitter"]["phase3"]["body_space_mm_per_frame2"])


def test_a_fit_of_a_project_takes_camera_space_and_costs_along(tiny_body: BodyModel):
    params = still_params(4)
    fit = fit_of(tiny_body, params)
    camera = replace(fit.clip.camera, focal=(500.0, 500.0))
    first, last = phase_of(params), replace(phase_of(in_motion(4)), frame_cost=np.arange(4.0))
    result = FitResult(
        phases=(replace(first, phase=1), last), camera=camera, config=PRESETS["paper"], observed=np.ones((4, 55), bool)
    )
    found = PosedFit.of(fit.clip, result, fit.meshes)
    assert found.clip.camera == camera and found.space == "body" and found.params is last.params
    assert found.frame_cost is last.frame_cost
    assert PosedFit.of(fit.clip, result, fit.meshes, phase=result.phases[0]).params is params


@pytest.mark.parametrize("frames", [1, 2])
def test_what_cannot_be_measured_is_none(tiny_body: BodyModel, frames: int):
    fit = fit_of(tiny_body, still_params(frames))
    fit = with_keypoints(fit, confidence=np.zeros_like(fit.clip.keypoints.confidence))
    found = measured(fit)
    names = ["reprojection_median", "reprojection_hands_p95", "jitter", "acceleration"]
    assert [found[name] for name in names] == [None] * 4 and {*METRICS, "seconds"} == set(found)


def metric(name: str, value: float | None, lower_is_better: bool = True) -> Metric:
    return Metric(name=name, title=name.title(), unit="px", value=value, lower_is_better=lower_is_better)


def test_two_runs_side_by_side():
    a = (metric("error", 2.0), metric("volume", 2.0, False), metric("one", None, False))
    b = (metric("error", 3.0), metric("volume", 3.0, False), metric("other", 1.0, False))
    rows = compare(a, b)
    assert rows[0] == ComparedMetric(of=a[0], a=2.0, b=3.0)
    assert [(r.of.name, r.a, r.b, r.difference, r.better) for r in rows] == [
        ("error", 2.0, 3.0, 1.0, "a"),
        ("volume", 2.0, 3.0, 1.0, ""),
        ("one", None, None, None, ""),
        ("other", None, 1.0, None, ""),
    ]


@pytest.mark.parametrize(("a", "b", "better"), [(2.0, 1.9, "b"), (2.0, 1.99, ""), (0.0, 0.0, ""), (1.0, None, "")])
def test_which_is_better(a: float, b: float | None, better: str):
    assert compare((metric("x", a),), (metric("x", b),))[0].better == better


def test_distances_are_those_of_the_meshes(tiny_body: BodyModel):
    one, other = fit_of(tiny_body, random_params(2, seed=1)), fit_of(tiny_body, random_params(2, seed=2))
    mesh = Mesh(tiny_body, dtype=torch.float64)
    expected = 1e3 * (mesh(one.params) - mesh(other.params)).norm(dim=-1)[1].numpy()
    a, b = (fit.meshes.vertices("v", fit.params, 1) for fit in (one, other))
    np.testing.assert_allclose(vertex_distances(a, b), expected, atol=1e-2)
    joints = 1e3 * (mesh.joints(one.params) - mesh.joints(other.params)).norm(dim=-1).mean(1).numpy()
    np.testing.assert_allclose(between_runs(one, other).values, joints, rtol=1e-6)


def test_other_meshes_cannot_be_compared(tiny_body: BodyModel):
    with pytest.raises(InputError, match="440 and 439 vertices"):
        vertex_distances(np.zeros((440, 3), np.float32), np.zeros((439, 3), np.float32))
