"""Rotations between directions."""

import numpy as np
from scipy.spatial.transform import Rotation

from fitting_core.body.geometry import shortest_rotation


def test_the_shortest_rotation_takes_one_direction_to_the_other_and_no_farther():
    source, target = np.random.default_rng(0).normal(size=(2, 20, 3))
    turn = shortest_rotation(source, target)
    turned = np.einsum("nij,nj->ni", turn, source)
    lengths = np.linalg.norm(source, axis=1) * np.linalg.norm(target, axis=1)
    np.testing.assert_allclose((turned * target).sum(1), lengths, rtol=1e-12)
    between = np.arccos((source * target).sum(1) / lengths)
    np.testing.assert_allclose(Rotation.from_matrix(turn).magnitude(), between, rtol=1e-9)


def test_to_the_opposite_direction_it_is_half_a_turn():
    source = np.vstack([np.eye(3), -np.eye(3), [(0.6, 0.8, 0.0)]])
    np.testing.assert_allclose(np.einsum("nij,nj->ni", shortest_rotation(source, -source), source), -source, atol=1e-12)


def test_what_has_no_length_turns_nothing():
    for source, target in (((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)), ((1.0, 2.0, 3.0), (0.0, 0.0, 0.0))):
        np.testing.assert_array_equal(shortest_rotation(np.array(source), np.array(target)), np.eye(3))
