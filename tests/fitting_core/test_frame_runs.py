"""Runs of frames: nothing is lost or doubled, and neighbours do not touch."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fitting_core.frame_runs import runs_where


@given(st.lists(st.booleans(), max_size=40))
def test_runs_are_where_it_is_true(true: list[bool]):
    found = runs_where(np.array(true, bool))
    assert [t for run in found for t in run] == [t for t, value in enumerate(true) if value]
    assert all(one.stop < other.start for one, other in pairwise(found))
