"""The best assignment, against all that there are."""

from itertools import product

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fitting_core.io.keypoints.people.following import optimal


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
