"""Metrics against values computed by hand, or another way."""

import numpy as np
import pytest
import scipy.spatial
from scipy.spatial.transform import Rotation

from fitting_core import metrics

RATE = 25.0
RNG = np.random.default_rng(0)
CLOUD = RNG.normal(size=(3, 8, 3))


def moved(points: np.ndarray, *, scale: float = 1.0) -> np.ndarray:
    turn = Rotation.from_rotvec([0.3, 2.0, -1.0]).as_matrix()
    return scale * points @ turn.T + [1.0, -2.0, 5.0]


def polynomial(order: int, frames: int = 9) -> np.ndarray:
    """Two points that move along x so that their derivative of this order is 6 m/s^order."""
    t = np.arange(frames) / RATE
    points = np.zeros((frames, 2, 3))
    points[..., 0] = (6 * t**order / np.prod(np.arange(1, order + 1)))[:, None]
    return points + CLOUD[:1, :2]


def test_a_mirrored_cloud_is_not_mirrored_back():
    mirrored = CLOUD * [-1, 1, 1]
    assert (np.linalg.det(metrics.similarity(mirrored, CLOUD).rotation) > 0).all()
    assert metrics.pa_mpjpe(mirrored, CLOUD).min() > 100


def test_procrustes_as_scipy_has_it():
    """scipy's disparity is of clouds of size 1, and it mirrors: so noise is small and the sizes are taken out."""
    other = moved(CLOUD, scale=0.6) + 0.02 * RNG.normal(size=CLOUD.shape)
    aligned = metrics.procrustes(other, CLOUD)
    for ours, truth, source in zip(aligned, CLOUD, other, strict=True):
        _, _, disparity = scipy.spatial.procrustes(truth, source)
        size = np.square(truth - truth.mean(0)).sum()
        assert np.square(ours - truth).sum() / size == pytest.approx(disparity, rel=1e-6)


def test_joint_errors_by_hand():
    estimate = CLOUD + np.array([0.003, 0, 0.004])
    np.testing.assert_allclose(metrics.point_error(estimate, CLOUD), 5)
    np.testing.assert_allclose(metrics.depth_error(estimate, CLOUD), 4)
    assert metrics.mpjpe(estimate, CLOUD, [0]).max() < 1e-9 and metrics.pa_mpjpe(moved(CLOUD), CLOUD).max() < 1e-9
    estimate[:, 3] += [0, 0.08, 0]
    np.testing.assert_allclose(metrics.mpjpe(estimate, CLOUD, [0, 1]), 80 / 8)


def test_derivatives_of_polynomials():
    assert metrics.jerk(polynomial(3), RATE) == pytest.approx(6)
    assert metrics.jerk(polynomial(2), RATE) == pytest.approx(0, abs=1e-6)
    assert metrics.jitter(polynomial(2)) == pytest.approx(1e3 * 6 / RATE**2)
    assert metrics.jerk(CLOUD[:2], RATE) == metrics.depth_jitter(CLOUD[:2], RATE) == 0, "of too few frames"


def test_acceleration_error_counts_the_difference_alone():
    errors = metrics.acceleration_error(polynomial(2), 0.5 * polynomial(2), RATE)
    assert np.isnan(errors[[0, -1]]).all()
    np.testing.assert_allclose(errors[1:-1], 3)
    assert np.isnan(metrics.acceleration_error(CLOUD[:2], CLOUD[:2], RATE)).all()


def test_reprojection_by_hand():
    seen = np.array([[[0.0, 0], [10, 0], [0, 40]], [[0, 0], [0, 0], [0, 0]]])
    counted = np.array([[True, True, True], [False, True, False]])
    off = seen + np.array([3.0, 4.0])
    np.testing.assert_allclose(metrics.reprojection_errors(off, seen, counted), 5)
    off[0, 2] = np.nan
    counted[0, 2] = False
    np.testing.assert_allclose(metrics.frame_means(off, seen, counted), [5, 5])
    np.testing.assert_array_equal(metrics.heights_in_image(seen, counted), [10, np.nan])
    assert np.isnan(metrics.frame_means(off, seen, np.zeros((2, 3), bool))).all()


def test_variations_by_hand():
    points = np.zeros((2, 3, 3))
    points[0, 1, 0], points[1, 1, 0] = 0.9, 1.1
    assert metrics.bone_length_variation(points, [(0, 1), (0, 2)]) == pytest.approx(0.1)
    assert metrics.bone_length_variation(np.zeros((2, 2, 3)), [(0, 1)]) == 0
    assert metrics.shape_variation(np.array([[1.0, 0], [3, 0]])) == pytest.approx(0.5)
