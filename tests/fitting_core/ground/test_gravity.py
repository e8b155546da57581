"""The direction that a clip's frames agree on, and how sure it is said to be."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core import keypoints as kp
from fitting_core.camera import Camera, World, path_of
from fitting_core.ground.gravity import (
    Gravity,
    angles_to,
    gravity_before_fit,
    rolled_views,
    told_gravity,
    with_trunk,
)
from fitting_core.lifting.clip_lifting import lift
from tests.samples.walkers import CAMERA, RATE, TILT, walker


def test_the_tilt_of_the_camera_is_found():
    made = walker()
    gravity = gravity_before_fit(made.lifted(), made.confidence, CAMERA)
    assert angles_to(gravity.up, made.up) < 1e-5 and np.linalg.norm(gravity.up) == pytest.approx(1)
    assert gravity.tilt == pytest.approx(TILT)


def test_some_frames_that_see_the_world_lie_down_do_not_matter():
    made = walker()
    lifted = made.lifted()
    up = lifted.up.copy()
    up[::5] = Rotation.from_euler("z", 80, degrees=True).apply(up[::5])
    assert angles_to(up.mean(0), made.up) > 10
    assert angles_to(gravity_before_fit(replace(lifted, up=up), made.confidence, CAMERA).up, made.up) < 3


def test_without_legs_less_is_known():
    made = walker()
    confidence = made.confidence.copy()
    confidence[:, [kp.INDEX[f"{s}_{p}"] for s in ("left", "right") for p in ("knee", "ankle")]] = 0
    whole, cut = (gravity_before_fit(made.lifted(), c, CAMERA).deviation for c in (made.confidence, confidence))
    assert whole < 10 < cut + 1.5 and cut > whole + 2


@pytest.mark.parametrize("degrees", [0, 35, -30])
@pytest.mark.parametrize("moving", [False, True])
def test_how_a_camera_is_rolled_is_found(degrees: int, moving: bool):
    made, turn = walker(), Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    xy = (made.xy - CAMERA.center) @ turn[:2, :2].T + CAMERA.center
    still = np.tile(np.eye(3), (len(xy), 1, 1))
    camera = replace(CAMERA, path=path_of(still, np.zeros((len(xy), 3)))) if moving else CAMERA
    lifted = lift(xy, made.confidence, camera, RATE, calibrated=True)
    level = gravity_before_fit(lifted, made.confidence, camera)
    found = gravity_before_fit(lifted, made.confidence, camera, rolled_views(xy, made.confidence, camera, RATE))
    assert angles_to(found.up, turn @ made.up) < min(2 * found.deviation, 8)
    assert degrees == 0 or angles_to(level.up, turn @ made.up) > 2 * level.deviation


@pytest.mark.parametrize(("deviation", "pulled"), [(4.0, (0.0, 3.0)), (10.0, (3.0, 7.0))])
def test_an_upright_trunk_counts_as_far_as_the_lifter_is_unsure(deviation: float, pulled: tuple[float, float]):
    up, trunk = np.array([0.0, -1.0, 0.0]), Rotation.from_euler("x", 12, degrees=True).apply([[0.0, -0.5, 0.0]] * 9)
    found = with_trunk(Gravity(up=up, deviation=deviation), trunk)
    assert pulled[0] < angles_to(found.up, up) < pulled[1] and angles_to(found.up, trunk[0] / 0.5) < 12
    assert np.linalg.norm(found.up) == pytest.approx(1)


def test_who_lies_does_not_turn_the_world():
    up, trunk = np.array([0.0, -1.0, 0.0]), np.tile([0.5, 0.0, 0.0], (9, 1))
    assert angles_to(with_trunk(Gravity(up=up, deviation=9.0), trunk).up, up) < 2


def test_a_calibration_that_says_what_is_up_tells_gravity():
    # The camera looks along the world's y, with z up: -y in the camera.
    rotation = ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
    camera = Camera(focal=(900.0, 900.0), center=(320.0, 240.0), size=(640, 480))
    told = told_gravity(replace(camera, world=World(rotation=rotation, translation=(0, 0, 0), up="z")))
    assert told is not None and np.allclose(told.up, (0, -1, 0)) and told.deviation < 1
    assert told_gravity(camera) is None
    assert told_gravity(replace(camera, world=World(rotation=rotation, translation=(0, 0, 0)))) is None
