"""The direction that a clip's frames agree on, how sure it is said to be, and what balance tells of it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera, World, path_of
from fitting_core.ground.feet import stance_of
from fitting_core.ground.gravity import (
    Gravity,
    angles_to,
    gravity_before_fit,
    rolled_views,
    told_gravity,
    with_trunk,
)
from fitting_core.ground.grounding import with_balance
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


# --- balance ---


PER_SECOND, FRAMES = 30.0, 120
UP = Rotation.from_euler("xz", [20, -8], degrees=True).apply([0.0, -1.0, 0.0])
KNOWN = Gravity(up=Rotation.from_euler("xz", [13, 3], degrees=True).apply([0.0, -1.0, 0.0]), deviation=9.0)
"""13 degrees off."""
SIDE = np.cross(UP, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(UP, [0.0, 0.0, 1.0]))


def stander(*, aside: float = 0.0, apart: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """The centre of mass 0.95 m above the feet, metres to the left of their middle, and the feet."""
    middle = np.array([0.1, 0.4, 4.0])
    feet = np.stack([middle + way * apart * SIDE for way in (1, -1)])[:, None].repeat(4, 1)
    sway = 0.01 * np.sin(np.linspace(0, 9, FRAMES))[:, None] * SIDE
    return middle + 0.95 * UP + aside * SIDE + sway, np.broadcast_to(feet, (FRAMES, 2, 4, 3))


BOTH = np.ones((FRAMES, 2), bool)


def test_a_standing_person_determines_up():
    found = with_balance(KNOWN, *stander(), BOTH, PER_SECOND)
    assert angles_to(KNOWN.up, UP) > 12 and angles_to(found.up, UP) < 6
    assert 2.5 <= found.deviation < KNOWN.deviation


def test_a_sure_direction_hardly_moves():
    sure = Gravity(up=KNOWN.up, deviation=1.0)
    assert angles_to(with_balance(sure, *stander(), BOTH, PER_SECOND).up, KNOWN.up) < 1.5


def test_the_weight_may_be_on_one_of_two_feet():
    """0.28 m to the left of the middle is above the left foot of two that are 0.6 m apart."""
    exact, leaning = Gravity(up=UP, deviation=9.0), stander(aside=0.28, apart=0.3)
    on_both = with_balance(exact, *leaning, BOTH, PER_SECOND)
    on_right = with_balance(exact, *leaning, BOTH & np.array([False, True]), PER_SECOND)
    assert angles_to(on_both.up, UP) < 3 and angles_to(on_right.up, UP) > 6


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_a_person_who_hardly_stands_changes_nothing(share: float):
    standing = BOTH & (np.arange(FRAMES) < share * FRAMES)[:, None]
    assert with_balance(KNOWN, *stander(), standing, PER_SECOND) is KNOWN


def test_the_centre_of_mass_is_in_the_trunk_above_the_feet(free_body: BodyModel):
    """At 55 to 58 % of the height in adults (Palmer 1944); the free body rests in a T-pose."""
    stance = stance_of(free_body, BodyParams.neutral(1))
    feet = stance.feet[0].reshape(-1, 3)
    height = stance.centre[0, 1] - feet[:, 1].min()
    assert 0.53 < height / 1.71 < 0.6 and stance.upright.all()
    assert feet[:, 2].min() < stance.centre[0, 2] < feet[:, 2].max() and abs(stance.centre[0, 0]) < 0.01


def test_a_bent_knee_does_not_carry(free_body: BodyModel):
    params = BodyParams.neutral(1)
    params.body_pose[0, 9] = torch.pi / 2
    assert stance_of(free_body, params).upright.tolist() == [[False, True]]
