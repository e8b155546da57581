"""Choosing one person over a clip."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from fitting_core.detections import Detections
from fitting_core.errors import InputError
from fitting_core.io import read_detections
from fitting_core.people.person import choose_person
from fitting_core.video.frame_names import spans

NOBODY = np.zeros((137, 3))


def clip(*frames: list[np.ndarray]) -> Detections:
    """Detections of frames given as lists of people."""
    people = tuple(np.array(frame).reshape(-1, 137, 3) for frame in frames)
    return Detections(frames=people, stems=tuple(f"a_{t}" for t in range(len(people))), source=Path("a"))


def shuffled(frames: list[list[np.ndarray]], seed: int) -> tuple[list[list[np.ndarray]], list[list[int]]]:
    """Every frame's people in random order, and where each one went."""
    rng = np.random.default_rng(seed)
    orders = [rng.permutation(len(frame)).tolist() for frame in frames]
    mixed = [[frame[k] for k in order] for frame, order in zip(frames, orders, strict=True)]
    return mixed, [[order.index(k) for k in range(len(order))] for order in orders]


@pytest.mark.parametrize("seed", range(5))
def test_the_larger_person_is_followed_whatever_the_order(figure, seed):
    frames = [[figure(100 + 5 * t, 300), figure(400 - 3 * t, 250, height=150)] for t in range(20)]
    mixed, places = shuffled(frames, seed)
    assert choose_person(clip(*mixed))[0].entries == tuple(place[0] for place in places)


def test_presence_outweighs_a_short_close_up(figure):
    frames = [[figure(100, 300)] for _ in range(20)]
    frames[7] = [figure(600, 300, height=500), figure(100, 300)]
    assert choose_person(clip(*frames))[0].entries == tuple(1 if t == 7 else 0 for t in range(20))


@pytest.mark.parametrize("occluded, speed", list(itertools.product([0, 3, 8], [6, 15])))
def test_people_who_cross_are_not_swapped(figure, occluded, speed):
    """B, behind A and nearly as large, is not seen around the crossing."""
    middle, frames = 30, []
    for t in range(2 * middle):
        a, b = figure(500 + speed * (t - middle), 300), figure(500 - speed * (t - middle), 290, height=180)
        frames.append([a] if abs(t - middle) <= occluded // 2 and occluded else [a, b])
    mixed, places = shuffled(frames, seed=occluded)
    found, _ = choose_person(clip(*mixed))
    assert found.entries == tuple(place[0] for place in places)


def test_gaps_stay_empty_and_are_reported(figure):
    frames = [[figure(100, 300)], [], [NOBODY], [figure(900, 300)], [figure(110, 300)]]
    found, note = choose_person(clip(*frames), first_frame=10)
    assert found.entries == (0, None, None, None, 0)
    assert (found.keypoints.confidence.max(1) > 0).tolist() == [True, False, False, False, True]
    assert note == (
        "Person: found in 2 of 5 frames, not in frames 11-13. The largest and surest of 2 people (or false "
        "detections) was taken; the others appear in frames 13."
    )


@pytest.mark.parametrize(
    "gap, distance, followed",
    [(0, 50, True), (0, 300, False), (20, 250, True), (20, 900, False), (50, 250, True), (50, 1500, False)],
)
def test_how_far_a_person_can_move_unseen(figure, gap, distance, followed):
    """Of 200 pixels, alone in the image."""
    frames = [[figure(100, 300)]] * 12 + [[]] * gap + [[figure(100 + distance, 300)]] * 10
    found = sum(entry is not None for entry in choose_person(clip(*frames))[0].entries)
    assert found == (22 if followed else 12)


def test_a_false_detection_beside_a_person_takes_nobody_over(figure):
    """One stood at the person's left before, and one comes up at the right: least total distance would take
    the person for the former, and the false detection for the person."""
    person, before, beside = figure(300, 300), figure(245, 300), figure(355, 300)
    frames = [[person, before], [person], [person], [beside, person], [person]]
    assert choose_person(clip(*frames))[0].entries == (0, 0, 0, 1, 0)


def test_a_nearly_equal_rival_is_named(figure):
    frames = [[figure(400, 300, height=195), figure(100, 300)]] * 4
    found, note = choose_person(clip(*frames))
    assert found.entries == (1, 1, 1, 1)
    assert "Another person is nearly as prominent, in frame 0 at place 0 of the list: use person=0" in note


@pytest.mark.parametrize("moved", [5, 90])
def test_who_comes_back_beside_others_within_a_second_is_the_same(figure, moved: int):
    """Of 200 pixels, not seen in frames 20 to 26, and then that many pixels off."""
    other = figure(900, 300, height=120)
    walked = [[figure(300, 300), other]] * 20, [[figure(300 + moved, 300), other]] * 20
    found, note = choose_person(clip(*walked[0], *[[other]] * 7, *walked[1]))
    assert found.entries == (0,) * 20 + (None,) * 7 + (0,) * 20
    assert "may be confused" not in note and "not in frames 20-26" in note


def test_a_possible_exchange_is_noted(figure):
    """Two people of one size who are both away for a second, and of whom one returns, may be either."""
    frames = [[figure(300, 300), figure(420, 300)]] * 20 + [[]] * 4 + [[figure(360, 300)]] * 20
    assert "the person may be confused with another" in choose_person(clip(*frames))[1]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("late", [0, 2])
def test_the_advice_gives_the_rival(figure, seed, late):
    """Whatever the order of each frame's list, and where a false detection had the rival's place before."""
    frames = [[figure(400, 300 + t, height=205), figure(100, 300 - t)] for t in range(12)]
    frames[:late] = [[figure(400, 300 + t, height=205), figure(900, 900, height=40)] for t in range(late)]
    mixed, places = shuffled(frames, seed)
    note = choose_person(clip(*mixed), first_frame=7)[1]
    advice = re.search(r"use (?:first_frame=(\d+) and )?person=(\d)", note)
    assert advice is not None, note
    cut = int(advice[1] or 7) - 7
    found, _ = choose_person(clip(*mixed[cut:]), person=int(advice[2]), first_frame=7 + cut)
    assert found.entries == tuple(None if t < late else place[1] for t, place in enumerate(places))[cut:]


def test_who_is_asked_for_is_followed_through_lists_of_any_order(figure):
    large, small = figure(100, 300), figure(500, 300, height=50)
    found, note = choose_person(clip([large], [large, small], [large], [small, large]), person=1, first_frame=5)
    assert found.entries == (None, 1, None, 0)
    assert found.keypoints.xy[3, 0].tolist() == small[0, :2].tolist()
    assert note == (
        "Person: the one at place 1 of the list of frame 6, as asked; found in 2 of 4 frames, not in frames 5, 7. "
        "In frames 8 the same person has another place."
    )


@pytest.mark.parametrize("person", [2, 100, -1])
def test_an_entry_that_no_frame_has(figure, person):
    with pytest.raises(InputError, match=f"person={person}, but no frame of a has more than 2 people; expected 0 to 1"):
        choose_person(clip([figure(1, 1)] * 2), person=person)
    with pytest.raises(InputError, match=r"more than one person; expected 0\. Leave"):
        choose_person(clip([figure(1, 1)]), person=person)


@pytest.mark.parametrize("frames", [[], [[]], [[], [NOBODY]]])
def test_no_detection_at_all(frames):
    with pytest.raises(InputError, match=f"No keypoint is detected in any of the {len(frames)} frames of a"):
        choose_person(clip(*frames))


@pytest.mark.parametrize(
    "frames, words",
    [
        ([3], "3"),
        ([3, 4], "3-4"),
        ([1, 2, 3, 7, 9, 10], "1-3, 7, 9-10"),
        (list(range(0, 20, 2)), "0, 2, 4, 6, 8 and 5 more"),
    ],
)
def test_spans_in_words(frames, words):
    assert spans(frames) == words


@pytest.mark.parametrize("camera", ["cam03", pytest.param("cam04", marks=pytest.mark.thorough)])
def test_the_man_on_the_treadmill_is_followed_through_his_jumps(shared_data, camera):
    detections = read_detections(shared_data / "balancing" / camera / "keypoints")
    assert choose_person(detections)[0].entries == (0,) * 100
