"""How many people are followed."""

from unittest.mock import patch

import numpy as np
import pytest

from fitting_core.keypoints import COUNT
from fitting_core.people import following
from fitting_core.people.following import MOST_FOLLOWED, tracks_of
from fitting_core.people.sightings import Sighting


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
