"""Phases of hands: against the script of the generated signing, and of motions that are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.body.model import JOINT
from fitting_core.measure.hands.phases import hand_phases, wrist_height, wrist_speed

RATE = 50.0


def standing(frames: int) -> np.ndarray:
    """Joints of somebody who stands, with the left wrist before the chest."""
    joints = np.zeros((frames, 55, 3))
    places = {
        "spine3": (0, 1.2, 0), "neck": (0, 1.45, 0), "left_collar": (0.06, 1.38, 0), "right_collar": (-0.06, 1.38, 0),
        "left_hip": (0.1, 0.95, 0), "right_hip": (-0.1, 0.95, 0), "left_wrist": (0.1, 1.25, 0.3),
        "right_wrist": (-0.25, 0.95, 0.05),
    }  # fmt: skip
    for name, place in places.items():
        joints[:, JOINT[name]] = place
    return joints


def told(joints: np.ndarray, side: str = "left") -> list[tuple[str, int, int]]:
    return [(s.label, s.frames.start, s.frames.stop) for s in hand_phases(joints, side, RATE)]  # pyright: ignore


def moved(joints: np.ndarray, start: int, stop: int, metres: float) -> np.ndarray:
    """The left wrist goes aside between two frames, evenly."""
    way = np.interp(np.arange(len(joints)), [start, stop], [0.0, metres])
    result = joints.copy()
    result[:, JOINT["left_wrist"], 0] += way
    return result


def test_a_hand_is_held_moves_and_is_held():
    (a, _, b), (m, first, last), (c, _, end) = told(moved(standing(100), 40, 60, 0.4))
    assert (a, m, c, end) == ("hold", "movement", "hold", 100)
    assert b == first and abs(first - 40) <= 1 and abs(last - 60) <= 2


def test_an_unmoved_hand_near_the_hips_rests():
    assert told(standing(50), "right") == [("rest", 0, 50)]
    assert wrist_height(standing(1), "right")[0] == pytest.approx(0.0)
    assert wrist_height(standing(1), "left")[0] == pytest.approx(0.6)


def test_who_walks_and_turns_moves_no_hand():
    """A whole body that goes and turns, 1.5 m/s and a turn in 2 s, is no movement of its hands."""
    joints = standing(100)
    turn = Rotation.from_euler("y", np.linspace(0, 2 * np.pi, 100)[:, None]).as_matrix()
    walked = np.einsum("tij,tkj->tki", turn, joints) + np.linspace(0, 3, 100)[:, None, None] * [1.0, 0, 0.2]
    assert wrist_speed(walked, "left", RATE).max() < 1e-9
    assert told(walked) == [("hold", 0, 100)]


def test_the_speed_is_that_of_the_wrist():
    assert wrist_speed(moved(standing(60), 0, 59, 0.59), "left", RATE)[30] == pytest.approx(0.5)
    assert wrist_speed(standing(1), "left", RATE).tolist() == [0.0]


def test_short_stops_and_flicks_do_not_count():
    back_and_forth = moved(moved(standing(100), 30, 40, 0.3), 41, 51, -0.3)
    assert [name for name, _, _ in told(back_and_forth)] == ["hold", "movement", "hold"]
    assert told(moved(standing(60), 30, 31, 0.008)) == [("hold", 0, 60)]
