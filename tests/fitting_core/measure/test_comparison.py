"""A whole comparison on bodies whose errors are known."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core import keypoints as kp
from fitting_core.body.markers.joint_centres import CENTRES, joint_centres_in_space
from fitting_core.body.model import BodyModel, KeypointOffset
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera, path_of
from fitting_core.errors import InputError
from fitting_core.io.motion.imported_motion import from_still
from fitting_core.measure.comparison import compare, figure_titles
from fitting_core.measure.limbs import LIMB_FIGURES
from fitting_core.measure.pairing import PosedMotion
from fitting_core.measure.references.bodies import reference_of
from fitting_core.measure.references.files import read_reference
from fitting_core.measure.references.reference import Reference
from tests.samples.scenes import arms_in_motion, random_params

CAMERA = Camera(focal=(800.0, 800.0), center=(320.0, 240.0), size=(640, 480))


def estimate(body: BodyModel, params: BodyParams) -> PosedMotion:
    return PosedMotion(body=body, params=params, camera=CAMERA, frame_rate=25.0)


@pytest.fixture(scope="module")
def truth(free_body: BodyModel) -> Reference:
    params = random_params(4)
    params = replace(params, betas=params.betas[:1].expand(4, -1))
    return reference_of("truth", "", free_body, params, frame_rate=25.0, in_camera=True)


def moved(params: BodyParams, x: float, z: float) -> BodyParams:
    shift = torch.tensor([x, 0.0, z], dtype=torch.float64)
    return replace(params, camera_translation=params.camera_translation + shift)


def test_a_body_that_stands_elsewhere(free_body: BodyModel, truth: Reference):
    assert truth.params is not None
    found = compare(estimate(free_body, moved(truth.params, 0.03, 0.04)), truth, truth_body=free_body, every=3).figures
    assert found["joint_error_mean"] == pytest.approx(50, abs=1e-6)
    assert found["depth_error_mean"] == pytest.approx(40, abs=1e-6) and found["depth_error_std"] == pytest.approx(
        0, abs=1e-6
    )
    for name in ("mpjpe_mean", "pa_mpjpe_mean", "volume_error_mean", "shape_variation", "bone_length_variation"):
        assert found[name] == pytest.approx(0, abs=1e-3), name
    assert found["vertex_to_surface_mean"] == pytest.approx(0, abs=1e-3)
    assert found["per_vertex_mean"] == pytest.approx(0, abs=1e-2)
    assert found["jitter"] == pytest.approx(found["jitter_truth"])
    assert found["reprojection_mean"] is None and found["reprojection_truth_mean"] > 1
    assert set(found) == set(figure_titles())


def test_a_fit_beside_other_systems_is_compared_by_its_joint_centres(free_body: BodyModel):
    """Not by its keypoints, which lie elsewhere: the reference has joint centres of markers."""
    beyond = KeypointOffset(joint="left_wrist", bone="left_elbow", offset=(0.1, 0.0, 0.0))
    fit = estimate(replace(free_body, keypoint_offsets={"left_wrist": beyond}), random_params(4))
    points = np.full((4, kp.COUNT, 3), np.nan)
    points[:, kp.LIMBS] = joint_centres_in_space(fit.body, fit.params)
    about = dict(name="markers", kind="", frame_rate=25.0, in_camera=True)
    beside = Reference(**about, points=points, others={"wham": points})
    found = compare(fit, beside, meshes=False).figures
    for name in ("pa_mpjpe_mean", "mpjpe_mean", *LIMB_FIGURES):
        assert found[name] == pytest.approx(0, abs=1e-9), name
    alone = compare(fit, Reference(**about, points=points), meshes=False).figures
    assert alone["pa_mpjpe_mean"] > 5, "keypoints of a detector have no joints"


@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_joint_centres_by_a_laboratorys_names_are_compared_with_those_of_the_fit(
    free_body: BodyModel, tmp_path: Path, unit: float
):
    fit = estimate(free_body, random_params(4))
    names = np.array([f"{name[0]}_{name[1:]}" for name in CENTRES])
    np.savez(tmp_path / "c.npz", points=unit * joint_centres_in_space(fit.body, fit.params), names=names)
    if unit != 1:
        with pytest.raises(InputError, match="millimetres"):
            read_reference(tmp_path / "c.npz")
        return
    assert compare(fit, read_reference(tmp_path / "c.npz"), meshes=False).figures["pa_mpjpe_mean"] < 1e-6


def test_the_motion_of_a_camera_is_not_the_person_s(free_body: BodyModel):
    """Both fit and truth are even, and before a camera in the hand: the figures are those of the room."""
    frames, random = 8, np.random.default_rng(3)
    turns = Rotation.from_rotvec(0.05 * random.standard_normal((frames, 3))).as_matrix()
    path = path_of(turns, 0.1 * random.standard_normal((frames, 3)))
    moving, truth = replace(CAMERA, path=path), arms_in_motion(frames)
    fitted = replace(
        truth, body_pose=truth.body_pose + torch.linspace(0, 0.3, frames, dtype=torch.float64)[:, None] ** 2
    )

    def figures(camera: Camera, place: Callable[[BodyParams], BodyParams]) -> dict[str, float | None]:
        reference = reference_of("", "", free_body, place(truth), frame_rate=25.0, in_camera=True)
        given = replace(estimate(free_body, place(fitted)), camera=camera)
        return compare(given, reference, meshes=False).figures

    shaken = figures(moving, lambda params: from_still(free_body, params, moving))
    steady = figures(CAMERA, lambda params: params)
    blind = figures(CAMERA, lambda params: from_still(free_body, params, moving))
    for name in ("jitter", "jitter_truth", "jerk", "jerk_truth", "acceleration_error_mean"):
        assert shaken[name] == pytest.approx(steady[name], rel=1e-4) and blind[name] != pytest.approx(
            steady[name], rel=0.2
        )
    assert shaken["depth_jitter"] < 0.1 * blind["depth_jitter"]  # pyright: ignore[reportOptionalOperand]


def test_a_reference_of_other_frames_and_no_place(free_body: BodyModel, truth: Reference):
    assert truth.params is not None
    short = replace(truth, points=truth.points[:2], joints=truth.joints[:2], params=truth.params[:2], in_camera=False)
    found = compare(estimate(free_body, moved(truth.params, 1.0, 0.0)), short, truth_body=free_body, meshes=False)
    assert found.curves["pa_mpjpe"][2:] == [None, None] and found.figures["pa_mpjpe_mean"] == pytest.approx(0, abs=1e-3)
    assert found.figures["joint_error_mean"] is None and found.figures["mpjpe_mean"] is None
    assert found.curves["true_volume"][:2] == pytest.approx(found.curves["volume"][:2])


@pytest.mark.parametrize(("rate", "even"), [(50.0, True), (75.05, True), (40.0, False), (12.5, False)])
def test_accelerations_need_a_reference_that_lies_evenly(free_body: BodyModel, truth: Reference, rate: float, even):
    """Beside a fit of 25 per second; where they cannot be told, positions still are."""
    assert truth.params is not None
    other = reference_of("", "", free_body, truth.params[[0, 1, 2, 3] * 3], frame_rate=rate, in_camera=True)
    figures = compare(estimate(free_body, truth.params), other, meshes=False).figures
    for name in ("acceleration_error_mean", "jitter_truth", "jerk_truth"):
        assert (figures[name] is not None) == even, name
    assert figures["joint_error_mean"] is not None and figures["jitter"] is not None


def test_points_alone_with_some_missing(free_body: BodyModel, truth: Reference):
    points = truth.points.copy()
    points[1, 2:5] = np.nan
    points[2] = np.nan
    assert truth.params is not None
    alone = replace(truth, points=points, joints=None, params=None, body=None)
    found = compare(estimate(free_body, moved(truth.params, 0.0, 0.1)), alone)
    assert found.curves["joint_error"] == [pytest.approx(100), pytest.approx(100), None, pytest.approx(100)]
    assert found.figures["vertex_to_surface_mean"] is None and found.figures["volume_error_mean"] is None


def test_without_a_reference(free_body: BodyModel, truth: Reference):
    assert truth.params is not None
    found = compare(estimate(free_body, truth.params), None)
    assert found.figures["jitter"] and found.figures["volume_mean"] and found.figures["pa_mpjpe_mean"] is None
