"""Everybody in a clip: who is who, how many are followed, what is named as uncertain, and what is no person."""

import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from fitting_core.detections import Detections
from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT
from fitting_core.people import following
from fitting_core.people.everybody import FoundPerson, find_all_people
from fitting_core.people.following import MOST_FOLLOWED, Sighting, tracks_of

Figure = Callable[..., np.ndarray]
RATE = 25.0


def found(frames: list[list[np.ndarray]], rate: float = RATE) -> tuple[list[FoundPerson], str]:
    people = tuple(np.array(frame).reshape(-1, 137, 3) for frame in frames)
    stems = tuple(f"a_{t}" for t in range(len(people)))
    return find_all_people(Detections(frames=people, stems=stems, source=Path("a")), frame_rate=rate, first_frame=100)


def noses(everybody: list[FoundPerson]) -> list[np.ndarray]:
    """Where the nose of each is, by frame; NaN where it is not seen."""
    return [np.where(one.keypoints.confidence[:, 0] > 0, one.keypoints.xy[:, 0, 0], np.nan) for one in everybody]


def uncertain(everybody: list[FoundPerson]) -> list[set[int]]:
    return [{t for span in one.uncertain for t in span} for one in everybody]


@pytest.mark.parametrize("seed", range(3))
def test_who_cross_in_plain_sight_are_told_apart_without_a_doubt(figure: Figure, seed: int):
    rng = np.random.default_rng(seed)
    frames = []
    for t in range(60):
        both = [figure(200 + 10 * t, 300), figure(800 - 10 * t, 270, height=180)]
        frames.append([both[k] for k in rng.permutation(2)])
    everybody, note = found(frames)
    one, other = noses(everybody)
    assert np.array_equal(one, 200 + 10 * np.arange(60.0)) and np.array_equal(other, 800 - 10 * np.arange(60.0))
    assert note == "" and [one.frames for one in everybody] == [range(60), range(60)]
    # Only the frames in which both are in one place can be doubtful.
    assert all(frames <= set(range(27, 34)) for frames in uncertain(everybody))


def test_who_is_hidden_in_a_crossing_goes_on_and_is_named(figure: Figure):
    """B, as large as A and at the same height, is not seen for 12 frames."""
    frames = []
    for t in range(80):
        a, b = figure(100 + 10 * t, 300), figure(900 - 10 * t, 300)
        frames.append([a] if 34 <= t < 46 else [b, a])
    everybody, _ = found(frames)
    one, other = noses(everybody)
    assert np.array_equal(one, 100 + 10 * np.arange(80.0))
    assert np.nanmin(other) == 110 and np.isnan(other[34:46]).all() and not np.isnan(other[46:]).any()
    assert all({38, 40, 42} <= named for named in uncertain(everybody))
    assert all(named <= set(range(30, 52)) for named in uncertain(everybody))


def test_an_exchange_that_nobody_could_see_is_named(figure: Figure):
    """Two walk up to each other, both vanish, and come out where they came from or on the other side: who knows."""
    frames = []
    for t in range(80):
        far = 20 + 10 * abs(t - 40)
        both = [figure(500 - far, 300), figure(500 + far, 300)]
        frames.append([] if 36 <= t <= 44 else both)
    assert all({40} <= named for named in uncertain(found(frames)[0]))


WAYS: dict[str, Callable[[np.ndarray], list[np.ndarray]]] = {
    "crossing": lambda t: [150 + 5 * t, 1100 - 5 * t],
    "behind": lambda t: [620 + 0 * t, 150 + 5 * t],
    "meeting": lambda t: [600 - 6 * abs(t - 95).clip(8), 610 + 6 * abs(t - 95).clip(8)],
    "overtaking": lambda t: [100 + 6 * t, 350 + 3 * t],
    "three": lambda t: [100 + 5 * t, 1000 - 4 * t, 250 + 3 * t],
}
"""Pixels from the left of each person, the nearest first, in frame t."""


@pytest.mark.parametrize(
    ("scene", "seed", "exchanged"),
    [
        ("crossing", 0, False),
        ("overtaking", 0, False),
        ("behind", 0, True),
        ("meeting", 3, True),
        ("three", 1, True),
        ("three", 7, True),
    ],
)
def test_every_exchange_is_named(figure: Figure, scene: str, seed: int, exchanged: bool):
    """Who is behind somebody of nearly the same size is not found most of the time."""
    rng, frames, owners = np.random.default_rng(seed), [], []
    ways = [x + rng.normal(0, 20) for x in WAYS[scene](np.arange(200.0))]
    heights, lost = 200 + rng.normal(0, 6, len(ways)), rng.random((len(ways), 20)) < 0.7
    for t in range(0, 200, 2):
        hidden = [any(abs(x[t] - way[t]) < 45 for x in ways[:k]) and lost[k, t // 10] for k, way in enumerate(ways)]
        order = [k for k in rng.permutation(len(ways)).tolist() if 0 < ways[k][t] < 1280 and not hidden[k]]
        noise = rng.normal(0, 4, (len(ways), 2))
        frames.append([figure(ways[k][t] + noise[k, 0], 300 + noise[k, 1], height=heights[k]) for k in order])
        owners.append(order)
    people, _ = found(frames, RATE / 2)
    whose = [[(t, owners[t][k]) for t, k in enumerate(one.entries) if k is not None] for one in people]
    exchanges = 0
    for one, known in zip(people, whose, strict=True):
        for (before, was), (after, now) in pairwise(known):
            exchanges += was != now
            assert was == now or any(span.start <= after and before < span.stop for span in one.uncertain)
    assert (exchanges > 0) == exchanged
    named = sum(len(span) for one in people for span in one.uncertain)
    assert named < 0.3 * sum(map(len, whose)), "who is near nobody is not named"


def test_one_of_two_who_leaves_and_comes_back_is_the_same_and_it_is_said(figure: Figure):
    frames = []
    for t in range(200):
        stays = figure(300, 300)
        x = 700 + 20 * t if t < 30 else 1280 - 20 * (t - 130)
        frames.append([stays, figure(x, 300)] if x < 1280 and not 30 <= t < 130 else [stays])
    everybody, _ = found(frames)
    assert len(everybody) == 2
    assert everybody[1].frames == range(0, 200)
    assert uncertain(everybody) == [set(), set(range(28, 132))] or uncertain(everybody)[1] >= set(range(35, 125))


def test_of_two_who_are_away_a_like_one_is_somebody_new(figure: Figure):
    """Nothing tells which of both it is that comes back: it is nobody's guess."""
    gone = [[figure(300, 300), figure(800, 300)]] * 30 + [[]] * 60
    everybody, _ = found([*gone, *[[figure(550, 300)]] * 30])
    assert [one.frames for one in everybody] == [range(30), range(30), range(90, 120)]


def test_a_person_detected_twice_is_one(figure: Figure):
    rng = np.random.default_rng(0)
    frames = []
    for t in range(40):
        again = figure(103 + 2 * t, 302, confidence=0.5)
        again[rng.permutation(25)[:8]] = 0
        frames.append([again, figure(100 + 2 * t, 300)])
    everybody, _ = found(frames)
    assert len(everybody) == 1 and everybody[0].entries == (1,) * 40


def test_a_flash_is_nobody_and_that_is_said(figure: Figure):
    frames = [[figure(100, 300)] for _ in range(40)]
    for t in (7, 8, 20):
        frames[t] = [figure(600, 200), *frames[t]]
    everybody, note = found(frames)
    assert len(everybody) == 1 and uncertain(everybody) == [set()]
    assert note == (
        "Anybody seen for fewer than 6 frames at a stretch was left out as a false detection, in frames 107-108, 120."
    )


def test_people_are_numbered_as_they_appear_from_left_to_right(figure: Figure):
    """Who appears within a quarter of a second appears together."""
    places = {500: 0, 100: 1, 900: 2, 300: 30}
    frames = [[figure(x, 300) for x, since in places.items() if t >= since] for t in range(60)]
    assert [one[~np.isnan(one)][0] for one in noses(found(frames)[0])] == [100, 500, 900, 300]


@pytest.mark.parametrize("frames", [[], [[]], [[np.zeros((137, 3))]] * 3])
def test_nobody_at_all(frames: list[list[np.ndarray]]):
    with pytest.raises(InputError, match="Nobody is found for 6 frames in a"):
        found(frames)


@pytest.mark.thorough
def test_crowds_take_a_bounded_time(figure: Figure):
    """A hundred people in each frame, and ten thousand in one; the hundred largest of these are followed."""
    rng = np.random.default_rng(0)
    crowd = rng.uniform(0, 4000, (100, 2))
    frames = [[figure(*place, height=150) for place in crowd + rng.normal(0, 2, (100, 2))] for _ in range(20)]
    many = np.repeat(figure(0, 0, height=20)[None], 10_000, axis=0)
    many[:, :25, :2] += rng.uniform(0, 4000, (10_000, 1, 2))
    frames[9] = [*many, *frames[9]]
    begun = time.process_time()
    everybody, note = found(frames)
    assert time.process_time() - begun < 20
    # Where two of them stand in one place they are one.
    assert 90 <= len(everybody) <= 100
    assert "In frames 109 more than 100 people are detected; the largest were followed." in note


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
