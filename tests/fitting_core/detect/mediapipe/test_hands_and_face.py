"""Whose hand is whose, and where hands are looked for."""

from collections.abc import Callable

import numpy as np
import pytest

from fitting_core.detect.mediapipe import body as blaze
from fitting_core.detect.mediapipe.detector import recalled, remembered
from fitting_core.detect.mediapipe.face import Face
from fitting_core.detect.mediapipe.following import Followed
from fitting_core.detect.mediapipe.hands import Hand, square_at_wrist
from fitting_core.detect.mediapipe.hands_and_face import PartsFinder, SeenParts, assigned
from fitting_core.detect.mediapipe.squares import Square
from tests.fitting_core.detect.mediapipe.seen import body_at, hand_at

BODY = body_at(320, 240, 400)
LEFT, RIGHT = BODY.xy[blaze.LEFT_WRIST], BODY.xy[blaze.RIGHT_WRIST]


def test_each_hand_goes_to_its_wrist():
    left, right = hand_at(*LEFT, right=0.1), hand_at(*RIGHT, right=0.9)
    for order in ([left, right], [right, left]):
        assert assigned(order, BODY) == {"left": left, "right": right}


def test_a_hand_that_looks_like_the_other_side_still_belongs_to_the_wrist_at_which_it_is():
    hand = hand_at(*LEFT, right=0.95)
    assert assigned([hand], BODY) == {"left": hand, "right": None}


def test_crossed_wrists_are_told_by_how_the_hands_look():
    xy = BODY.xy.copy()
    xy[blaze.LEFT_WRIST], xy[blaze.RIGHT_WRIST] = (322, 240), (318, 240)
    body = body_at(320, 240, 400, xy=xy)
    left, right = hand_at(312, 240, right=0.05), hand_at(328, 240, right=0.95)
    assert assigned([left, right], body) == {"left": left, "right": right}


def test_one_hand_is_not_both():
    hand, xy = hand_at(320, 240), BODY.xy.copy()
    xy[[blaze.LEFT_WRIST, blaze.RIGHT_WRIST]] = (320, 240)
    found = assigned([hand, hand], body_at(320, 240, 400, xy=xy))
    assert sum(one is not None for one in found.values()) == 1


def test_a_hand_that_points_at_the_camera_gets_no_tiny_square():
    xy = BODY.xy.copy()
    xy[[blaze.LEFT_PINKY, blaze.LEFT_INDEX]] = xy[blaze.LEFT_WRIST] + 1
    square = square_at_wrist(body_at(320, 240, 400, xy=xy), "left")
    assert square.side == pytest.approx(0.14 * 400)


class FakeNetworks:
    """In place of all networks: finds a left hand where `there` says so, and keeps the frames that were searched."""

    def __init__(self, there: Callable[[int], bool]) -> None:
        self.there, self.frame, self.searched = there, 0, []

    def follow(self, image: np.ndarray, squares: list, *, least: float) -> list[Hand]:
        return [hand_at(*LEFT, right=0.1) for _ in squares[:1] if self.there(self.frame)]

    def find(self, image: np.ndarray, squares: list | Square, *, least: float = 0.0) -> list:
        if not isinstance(squares, list) or not squares:  # palms, and faces
            return []
        self.searched.append(self.frame)
        return self.follow(image, squares, least=least)

    def nearer(self, image: np.ndarray, square: Square) -> Square:
        return square


@pytest.mark.parametrize(
    ("there", "searched"),
    [
        (lambda t: False, [1, 3, 6]),  # at first, and then in every third frame
        (lambda t: t >= 2, [1, 3, 6]),  # the right hand is still looked for
        (lambda t: t < 4, [1, 3, 4, 6]),  # at once where it is lost
    ],
)
def test_a_hand_that_is_not_seen_is_searched_for_now_and_then(
    monkeypatch: pytest.MonkeyPatch, there: Callable[[int], bool], searched: list[int]
):
    fake = FakeNetworks(there)
    for name in ("HandNetwork", "FaceNetwork", "SingleShot"):
        monkeypatch.setattr(f"fitting_core.detect.mediapipe.hands_and_face.{name}", lambda *args, **options: fake)
    monkeypatch.setattr(PartsFinder, "_find_face", lambda *args: None)
    finder, seen, found = PartsFinder(mirrored=False), None, []
    for fake.frame in range(1, 8):
        seen = finder.find(np.zeros((480, 640, 3), np.uint8), BODY, seen, fake.frame)
        found += [fake.frame] * (seen.hands["left"] is not None)
    assert fake.searched == searched
    assert found == [t for t in range(1, 8) if there(t) and (t != 2 or there(1))]


def test_memory_comes_back_as_it_was():
    people = [Followed(3, {8: body_at(100, 200, 300), 9: body_at(110, 200, 300)}), Followed(5, {4: BODY})]
    face = Face(xy=np.random.default_rng(0).normal(size=(468, 2)), score=0.7)
    seen = {3: SeenParts(hands={"left": hand_at(10, 20), "right": None}, face=face), 7: SeenParts()}
    back, shown, found = recalled(remembered(people, seen, 8))
    assert found == 8 and [(one.number, one.last) for one in back] == [(3, 9), (5, 4)]
    assert back[0].bodies[9].square == people[0].bodies[9].square
    assert np.array_equal(back[1].bodies[4].next_square.box, BODY.next_square.box)
    assert list(shown) == [3, 7] and shown[7] == SeenParts() and shown[3].hands["right"] is None
    assert np.array_equal(shown[3].face.xy, face.xy) and shown[3].hands["left"].score == 0.9
    assert recalled(remembered([], {}, 0)) == ([], {}, 0)
