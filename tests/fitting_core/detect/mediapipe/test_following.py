"""People followed by their own bodies: coming in, crossing, getting lost, being found twice."""

from collections.abc import Callable

import numpy as np

from fitting_core.detect.mediapipe.body import Body, square_of
from fitting_core.detect.mediapipe.following import LOOK_EVERY, Followed, Followers, Stretch
from fitting_core.detect.mediapipe.squares import Square
from tests.fitting_core.detect.mediapipe.seen import body_at

Where = Callable[[int], dict[str, Body]]


class World:
    """Stands for the networks: images are frame numbers, and a body is found where somebody is."""

    def __init__(self, where: Where) -> None:
        self.where = where
        self.looks: list[int] = []
        self.hard_looks: list[int] = []

    def body(self, image: np.ndarray, square: Square) -> Body:
        here = self.where(int(image)).values()
        near = [b for b in here if np.hypot(b.square.x - square.x, b.square.y - square.y) < 0.5 * square.side]
        if not near:
            return body_at(square.x, square.y, square.side, score=0.0)
        return min(near, key=lambda b: np.hypot(b.square.x - square.x, b.square.y - square.y))

    def people(self, image: np.ndarray, harder: bool) -> list[Square]:
        self.looks.append(int(image))
        self.hard_looks += [int(image)] * harder
        return [square_of(body.circle) for body in self.where(int(image)).values()]


def followed(where: Where, lengths: list[int]) -> tuple[list[Followed], World]:
    """Everybody through stretches of some lengths, as the detector goes through them."""
    world = World(where)
    followers = Followers(world.body, world.people)
    everybody: dict[int, Followed] = {}
    waiting, start = None, 0
    for length in lengths:
        frames = range(start, start + length)
        stretch = Stretch(frames, [np.array(t) for t in frames])
        assert list(followers.forwards(stretch)) == list(range(1, length + 1))
        followers.backwards([stretch] if waiting is None else [waiting, stretch])
        for part in (waiting, stretch):
            for number, bodies in (part.bodies() if part else {}).items():
                everybody.setdefault(number, Followed(number)).bodies.update(bodies)
        followers.forget(before=start)
        waiting, start = stretch, start + length
    return [everybody[number] for number in sorted(everybody)], world


def test_somebody_who_comes_in_is_followed_back_to_where_they_came_in():
    """Between two looks, and across the border of two stretches."""
    coming = 2 * LOOK_EVERY - 7

    def where(t: int) -> dict[str, Body]:
        her = {"her": body_at(300 + 3 * t, 240, 300)}
        return her | ({"him": body_at(1000 - 4 * t, 240, 280)} if t >= coming else {})

    people, world = followed(where, [15, 15, 15])
    assert [sorted(person.bodies) for person in people] == [list(range(45)), list(range(coming, 45))]
    assert len(set(world.looks)) < 12


def test_people_who_cross_at_a_distance_stay_who_they_are():
    def where(t: int) -> dict[str, Body]:
        return {"a": body_at(200 + 12 * t, 240, 400), "b": body_at(800 - 12 * t, 260, 200)}

    people, _ = followed(where, [25, 25])
    assert len(people) == 2
    for person, x, side in zip(people, (200, 800), (400, 200), strict=True):
        own = [body.square for body in person.bodies.values()]
        assert len(own) >= 48 and own[0].x == x and {square.side for square in own} == {side}


def test_nobody_is_followed_twice():
    """A second square that leads to the same body is the same person."""

    def where(t: int) -> dict[str, Body]:
        return {"one": body_at(300, 240, 300), "again": body_at(303, 241, 301)}

    people, _ = followed(where, [25])
    assert len(people) == 1


def test_somebody_who_is_lost_for_a_moment_is_the_same_person():
    def where(t: int) -> dict[str, Body]:
        return {} if 12 <= t < 20 else {"one": body_at(300 + t, 240, 300)}

    people, world = followed(where, [20, 20])
    assert len(people) == 1 and sorted(people[0].bodies) == [*range(12), *range(20, 40)]
    assert set(range(12, 21)) <= set(world.looks)  # nobody is there: every frame is looked at


def test_somebody_who_is_lost_for_long_is_another_person():
    def where(t: int) -> dict[str, Body]:
        return {} if 12 <= t < 40 else {"one": body_at(300, 240, 300)}

    people, _ = followed(where, [20, 20, 20])
    assert [sorted(person.bodies)[0] for person in people] == [0, 40]
