"""Camera space turned upright, and groundings as arrays."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.camera import World
from fitting_core.config.choices import Up
from fitting_core.ground.arrays import grounding_arrays, grounding_from
from fitting_core.ground.contacts import Contacts
from fitting_core.ground.gravity import Gravity
from fitting_core.ground.grounding import Grounding
from fitting_core.ground.level import best_grounding, level_of, upright
from fitting_core.ground.plane import Ground
from fitting_core.motion import AXES

LEVEL = np.array([0.0, -1.0, 0.0])


def a_grounding(*, ground: bool = True, deviation: float = 4.0) -> Grounding:
    up = Rotation.from_euler("xz", [20, 5], degrees=True).apply(LEVEL)
    random = np.random.default_rng(3)
    return Grounding(
        gravity=Gravity(up=up, deviation=deviation),
        contacts=Contacts(
            probability=random.random((6, 2)), standing=random.random((6, 2)) < 0.5, let_go=random.random((6, 2)) < 0.2
        ),
        ground=Ground(normal=up, offset=1.4, deviation=0.03) if ground else None,
        missing="" if ground else "the feet are not in the image",
    )


@pytest.mark.parametrize("angles", [(0, 0), (20, 5), (-35, -10), (80, 0), (89.9, 3), (-89.9, 0), (170, 0)])
def test_up_becomes_minus_y(angles: tuple[float, float]):
    up = Rotation.from_euler("xz", angles, degrees=True).apply(LEVEL)
    turn = upright(up)
    assert np.allclose(turn @ up, LEVEL) and np.allclose(turn @ turn.T, np.eye(3)) and np.linalg.det(turn) > 0


def test_a_level_camera_is_not_turned_and_a_tilted_one_keeps_its_heading():
    assert np.allclose(upright(LEVEL), np.eye(3))
    ahead = upright(Rotation.from_euler("xz", [30, 8], degrees=True).apply(LEVEL)) @ (0.0, 0.0, 1.0)
    assert abs(ahead[0]) < 1e-9 and ahead[2] > 0


def test_a_camera_that_looks_straight_down_has_its_upper_edge_ahead():
    assert np.allclose(upright(np.array([0.0, 0.0, -1.0])) @ (0.0, -1.0, 0.0), (0, 0, 1))


def test_what_is_sure_enough_turns_a_world():
    known, unsure = level_of(a_grounding()), level_of(a_grounding(ground=False, deviation=12.0))
    assert known is not None and known.height == 1.4 and unsure is None and level_of(None) is None
    gravity_alone = level_of(a_grounding(ground=False))
    assert gravity_alone is not None and gravity_alone.height is None
    assert level_of(a_grounding(deviation=12.0)) is None, "a floor lies across gravity, and is no surer"


TURN = Rotation.from_rotvec([1.7, 1.0, -0.4]).as_matrix()


@pytest.mark.parametrize("up", get_args(Up))
def test_the_user_s_world_is_turned_by_quarters_alone(up: Up):
    one, two, three = ((x, y, z) for x, y, z in TURN.tolist())
    world = World(rotation=(one, two, three), translation=(0.3, 0.9, 2.9), up=up)
    level = level_of(a_grounding(), world)
    assert level is not None and level.place is not None and world.up_in_camera is not None
    np.testing.assert_allclose(level.turn @ world.up_in_camera, LEVEL, atol=1e-12)
    # From the user's axes to these: whole numbers, and the same for the camera's place.
    quarters = level.turn @ TURN
    np.testing.assert_allclose(quarters, np.round(quarters), atol=1e-12)
    np.testing.assert_allclose(level.place, quarters @ world.place, atol=1e-12)
    if up == "z":  # as AXES turn them back
        np.testing.assert_allclose(np.array(AXES["z-up"].from_camera) @ quarters, np.eye(3), atol=1e-12)
    if up == "y":
        np.testing.assert_allclose(np.array(AXES["y-up"].from_camera) @ quarters, np.eye(3), atol=1e-12)


def test_a_world_without_up_is_left_out():
    world = World(rotation=((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)), translation=(1.0, 2.0, 3.0))
    level = level_of(a_grounding(), world)
    assert level is not None and level.place is None and level.height == 1.4


@pytest.mark.parametrize("ground", [True, False])
def test_arrays_there_and_back(ground: bool):
    given = a_grounding(ground=ground)
    arrays = grounding_arrays(given)
    assert all(array.dtype.kind in "fbU" for array in arrays.values())
    found = grounding_from(arrays, 6)
    assert found is not None and found.text == given.text
    assert np.allclose(found.gravity.up, given.gravity.up) and found.gravity.deviation == given.gravity.deviation
    assert np.array_equal(found.contacts.standing, given.contacts.standing)
    assert np.array_equal(found.contacts.probability, given.contacts.probability)
    assert np.array_equal(found.contacts.let_go, given.contacts.let_go)
    before = {name: value for name, value in arrays.items() if name != "contacts_let_go"}
    earlier = grounding_from(before, 6)
    assert earlier is not None and not earlier.contacts.let_go.any()
    assert (found.ground is None) == (not ground)
    if found.ground is not None and given.ground is not None:
        assert (found.ground.offset, found.ground.deviation) == (given.ground.offset, given.ground.deviation)
        assert np.allclose(arrays["ground"][:3], -arrays["gravity"])


def test_files_without_it_have_none_and_damaged_ones_are_told():
    assert grounding_arrays(None) == {} and grounding_from({"poses": np.zeros(3)}, 6) is None
    arrays = grounding_arrays(a_grounding())
    with pytest.raises(ValueError, match=r"contacts has the shape \(6, 2\), expected \(5, 2\)"):
        grounding_from(arrays, 5)
    with pytest.raises(ValueError, match="expected a unit vector"):
        grounding_from(arrays | {"gravity": np.zeros(3)}, 6)
    with pytest.raises(KeyError, match="ground_text"):
        grounding_from({name: value for name, value in arrays.items() if name != "ground_text"}, 6)


def test_of_several_people_the_surest_floor_counts():
    """A floor before gravity alone, however sure that is; nobody who looked: none."""
    floor, surer = a_grounding(), a_grounding()
    assert surer.ground is not None
    surer = replace(surer, ground=replace(surer.ground, deviation=0.01))
    alone, certain = a_grounding(ground=False), a_grounding(ground=False, deviation=0.001)
    assert best_grounding([None, alone, floor, certain, surer]) == 4
    assert best_grounding([alone, None, certain]) == 2
    assert best_grounding([None, None]) is None and best_grounding([]) is None
