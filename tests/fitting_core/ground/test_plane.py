"""The floor under feet of known places, and the feet of a body."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.body.model import BodyModel
from fitting_core.ground.contacts import FOOT_POINTS, Contacts
from fitting_core.ground.feet import sole_heights
from fitting_core.ground.gravity import Gravity, angles_to
from fitting_core.ground.grounding import Grounding, grounding_of
from fitting_core.ground.plane import Ground, ground_under
from tests.samples.before_fit import USUAL_SOLES, grounding_before_fit
from tests.samples.walkers import CAMERA, HEIGHT, RATE, SOLES, Walker, walker


def true_contacts(made: Walker) -> Contacts:
    return Contacts(
        probability=np.where(made.standing, 0.9, 0.1), standing=made.standing, let_go=np.zeros_like(made.standing)
    )


def ground_of(made: Walker, *, up: np.ndarray | None = None) -> Ground | str:
    gravity = Gravity(up=made.up if up is None else up, deviation=3.0)
    return ground_under(made.feet, SOLES, true_contacts(made), gravity, RATE)


def test_the_camera_is_as_high_above_the_floor_as_it_stands():
    made = walker()
    ground = ground_of(made)
    assert isinstance(ground, Ground) and ground.offset == pytest.approx(HEIGHT, abs=1e-6)
    soles = made.feet[..., 1, :] - SOLES[0, 1] * made.up
    assert abs(ground.height(soles)[made.standing]).max() < 1e-6 < 0.05 < ground.height(soles)[~made.standing].max()
    assert 0 < ground.deviation < 0.05


def test_a_raised_heel_does_not_lower_or_raise_the_floor():
    made = walker()
    points = made.points.copy()
    for foot in FOOT_POINTS:
        points[:, foot[:2]] += 0.08 * made.up  # ankle and heel
    ground = ground_of(replace(made, points=points))
    assert isinstance(ground, Ground) and ground.offset == pytest.approx(HEIGHT, abs=1e-6)


def test_who_climbs_leaves_the_floor_where_the_climb_begins():
    ground = ground_of(walker(climbs=0.25))
    assert isinstance(ground, Ground) and abs(ground.offset - HEIGHT) < 0.15


def test_no_floor_without_feet_and_the_reason_is_told():
    made = walker()
    gravity, none = Gravity(up=made.up, deviation=3.0), np.zeros(made.standing.shape)
    unseen = Contacts(probability=none, standing=none.astype(bool), let_go=none.astype(bool))
    moving = Contacts(probability=none + 0.1, standing=none.astype(bool), let_go=none.astype(bool))
    assert ground_under(made.feet, SOLES, unseen, gravity, RATE) == "the feet are not in the image"
    assert ground_under(made.feet, SOLES, moving, gravity, RATE) == "no foot stands still in the image"


def grounding(made: Walker) -> Grounding:
    return grounding_before_fit(made.xy, made.confidence, made.lifted(), CAMERA, RATE)


def test_a_photograph_has_a_floor_if_a_foot_stands():
    made, frame = walker(), slice(10, 11)
    gravity, contacts = Gravity(up=made.up, deviation=3.0), true_contacts(made)[frame]
    found = ground_under(made.feet[frame], SOLES, contacts, gravity, RATE)
    assert contacts.standing.any() and isinstance(found, Ground) and found.offset == pytest.approx(HEIGHT, abs=1e-6)
    jumping = replace(contacts, standing=np.zeros((1, 2), bool))
    assert ground_under(made.feet[frame], SOLES, jumping, gravity, RATE) == "no foot stands still in the image"


def test_a_part_has_its_own_contacts_and_the_same_floor():
    whole = grounding(walker())
    part = whole[10:25]
    assert np.array_equal(part.contacts.standing, whole.contacts.standing[10:25])
    assert part.ground is whole.ground and part.gravity is whole.gravity


def test_soles_are_below_the_feet(free_body: BodyModel):
    for betas in (np.zeros(10), np.linspace(-2, 2, 10)):
        soles = sole_heights(free_body, betas)
        assert ((soles > 0) & (soles < 0.13)).all() and (soles[:, 0] > soles[:, 1:].max(1)).all()
    assert abs(sole_heights(free_body, np.zeros(10)) - USUAL_SOLES).max() < 0.01


def test_the_trunk_has_a_say_only_where_there_is_no_ground():
    whole, half = walker(), walker().without_feet()
    leaning = Rotation.from_euler("x", 10, degrees=True).apply(np.tile(whole.up, (len(whole.xy), 1)))

    def up_of(made: Walker) -> np.ndarray:
        found = grounding_of(
            made.xy, made.confidence, made.lifted(), CAMERA, RATE, feet=made.feet, soles=SOLES, trunk=leaning
        )
        return found.gravity.up

    assert angles_to(up_of(whole), whole.up) < 1e-5 and 0.5 < angles_to(up_of(half), whole.up) < 10
