"""Up from balance: people who stand before a tilted camera, and what tells nothing."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.ground.feet import stance_of
from fitting_core.ground.gravity import Gravity, angles_to
from fitting_core.ground.grounding import with_balance

RATE, FRAMES = 30.0, 120
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
    found = with_balance(KNOWN, *stander(), BOTH, RATE)
    assert angles_to(KNOWN.up, UP) > 12 and angles_to(found.up, UP) < 6
    assert 2.5 <= found.deviation < KNOWN.deviation


def test_a_sure_direction_hardly_moves():
    sure = Gravity(up=KNOWN.up, deviation=1.0)
    assert angles_to(with_balance(sure, *stander(), BOTH, RATE).up, KNOWN.up) < 1.5


def test_the_weight_may_be_on_one_of_two_feet():
    """0.28 m to the left of the middle is above the left foot of two that are 0.6 m apart."""
    exact, leaning = Gravity(up=UP, deviation=9.0), stander(aside=0.28, apart=0.3)
    on_both = with_balance(exact, *leaning, BOTH, RATE)
    on_right = with_balance(exact, *leaning, BOTH & np.array([False, True]), RATE)
    assert angles_to(on_both.up, UP) < 3 and angles_to(on_right.up, UP) > 6


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_a_person_who_hardly_stands_changes_nothing(share: float):
    standing = BOTH & (np.arange(FRAMES) < share * FRAMES)[:, None]
    assert with_balance(KNOWN, *stander(), standing, RATE) is KNOWN


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
