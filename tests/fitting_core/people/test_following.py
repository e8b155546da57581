"""The best assignment, against all that there are."""

from itertools import product
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fitting_core.keypoints import COUNT
from fitting_core.people import following
from fitting_core.people.following import MOST_FOLLOWED, optimal, tracks_of
from fitting_core.people.sightings import Sighting


def total(prices: np.ndarray, place: tuple[int | None, ...]) -> float:
    taken = [j for j in place if j is not None]
    if len(set(taken)) < len(taken):
        return np.inf
    return sum(1.0 if j is None else float(prices[k, j]) for k, j in enumerate(place))


@given(st.integers(1, 4), st.integers(0, 4), st.integers(0, 2**32 - 1))
def test_nothing_is_cheaper(rows: int, columns: int, seed: int):
    rng = np.random.default_rng(seed)
    prices = np.where(rng.random((rows, columns)) < 0.3, np.inf, rng.uniform(0, 2.5, (rows, columns)))
    place = tuple(optimal(prices))
    everything = product([None, *range(columns)], repeat=rows)
    assert total(prices, place) == min(total(prices, one) for one in everything)


@pytest.mark.thorough
def test_false_detections_all_over_the_frames_are_not_all_followed():
    """Their number squared would be the time."""
    rng = np.random.default_rng(0)
    points = rng.normal(0, 10.0, (COUNT, 3))
    points[:, 2] = 0.5
    places = rng.uniform(0, 1e6, (20, 50, 2))
    frames = [[Sighting.of(k, points + np.array([*place, 0.0])) for k, place in enumerate(frame)] for frame in places]
    with patch.object(following, "_prices", wraps=following._prices) as prices:
        assert len(tracks_of(frames, 30.0)) == 20 * 50
    assert max(len(call.args[2]) for call in prices.call_args_list) == MOST_FOLLOWED
