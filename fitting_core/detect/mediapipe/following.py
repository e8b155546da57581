"""Everybody in a clip, followed from frame to frame by where their own body was, forwards and backwards."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field

import numpy as np

from fitting_core.detect.mediapipe import body as blaze
from fitting_core.detect.mediapipe.body import Body
from fitting_core.detect.mediapipe.squares import Image, Square

LOOK_EVERY = 10
"""Frames between two searches for new people; without tracked people, every frame is searched."""
MOST_PEOPLE = 8
"""Who are followed at once."""
_MOST_MISSED = 15
"""Frames after which a person found where another was lost is a new person."""
_SAME_PLACE, _SAME_SIZE = 0.25, 3.0
"""Distance of centres in sides of the smaller square, and ratio of sides, up to which two squares are of one person."""
_SAME_BODY = 0.06
"""Median distance of their points, in sides of the smaller square, up to which two bodies are one."""


@dataclass(eq=False)
class Followed:
    """One person, as seen in each frame."""

    number: int
    """In the order in which people were found."""
    bodies: dict[int, Body] = field(default_factory=dict)
    """By frame."""

    @property
    def last(self) -> int:
        """The frame in which they were seen last."""
        return max(self.bodies)


@dataclass(eq=False)
class Stretch:
    """Consecutive frames, and who is in them."""

    frames: range
    """Their numbers."""
    images: Sequence[Image]
    """RGB."""
    people: list[Followed] = field(default_factory=list)

    def bodies(self) -> dict[int, dict[int, Body]]:
        """By the people's numbers and by frame."""
        return {one.number: {t: one.bodies[t] for t in self.frames if t in one.bodies} for one in self.people}


class Followers:
    """Who is followed.

    Args:
        find_body: The body in a square of an image.
        find_people: Squares of an image that may show a person; the flag asks for a thorough search.
    """

    def __init__(
        self, find_body: Callable[[Image, Square], Body], find_people: Callable[[Image, bool], Sequence[Square]]
    ) -> None:
        self._find_body, self._find_people = find_body, find_people
        self.people: list[Followed] = []
        """Who may still be seen in the frame that comes next."""
        self.found = 0
        """How many people there have been."""

    def start_from(self, people: list[Followed], found: int) -> None:
        """Continue with the followed people and the number of people found."""
        self.people, self.found = people, found

    def forwards(self, stretch: "Stretch") -> Generator[int, None, None]:
        """Follow all people through a stretch and look for new ones; yields the number of finished frames."""
        stretch.people = list(self.people)
        for done, (t, image) in enumerate(zip(stretch.frames, stretch.images, strict=True), 1):
            self.people = [person for person in self.people if t - person.last <= _MOST_MISSED]
            for person in [person for person in self.people if t - 1 in person.bodies]:
                self._follow(person, image, t, t - 1, self.people)
            if t % LOOK_EVERY == 0 or t == stretch.frames[-1] or not any(t in one.bodies for one in self.people):
                stretch.people += self._look(image, t)
            yield done

    def backwards(self, stretches: Sequence["Stretch"]) -> None:
        """Follow those who came in between backwards through stretches that follow each other."""
        everybody = list({person: None for stretch in stretches for person in stretch.people})
        for stretch in reversed(stretches):
            for t, image in zip(reversed(stretch.frames), reversed(stretch.images), strict=True):
                for person in everybody:
                    if t not in person.bodies and t + 1 in person.bodies:
                        self._follow(person, image, t, t + 1, everybody)
            stretch.people = [person for person in everybody if any(t in person.bodies for t in stretch.frames)]

    def going_on(self) -> list[Followed]:
        """Who may be seen in the next frame, with nothing but where they were seen last."""
        return [Followed(number=one.number, bodies={one.last: one.bodies[one.last]}) for one in self.people]

    def forget(self, before: int) -> None:
        """Forget the frames before this one, except each person's last position."""
        for one in self.people:
            one.bodies = {t: body for t, body in one.bodies.items() if t >= before or t == one.last}

    def _follow(self, person: Followed, image: Image, t: int, known: int, everybody: Sequence[Followed]) -> None:
        body = self._find_body(image, person.bodies[known].next_square)
        around = [other.bodies[t] for other in everybody if other is not person and t in other.bodies]
        if body.score > blaze.SURE and not any(_is_same_body(body, other) for other in around):
            person.bodies[t] = body

    def _look(self, image: Image, t: int) -> list[Followed]:
        """Look for people who are not followed; those who are new."""
        new = []
        nobody = not any(t in person.bodies for person in self.people)
        for square in self._find_people(image, nobody and t % LOOK_EVERY == 0):
            here = [person.bodies[t] for person in self.people if t in person.bodies]
            if len(here) >= MOST_PEOPLE:
                break
            if any(_is_same_square(square, body.square) for body in here):
                continue
            body = self._find_body(image, square)
            if body.score > blaze.SURE:
                body = self._find_body(image, body.next_square)
            same = any(_is_same_square(body.square, other.square) or _is_same_body(body, other) for other in here)
            if body.score <= blaze.SURE or same:
                continue
            person = self._lost_at(body.square, t)
            if person is None:
                person = Followed(self.found)
                self.found += 1
                self.people.append(person)
                new.append(person)
            person.bodies[t] = body
        return new

    def _lost_at(self, square: Square, t: int) -> Followed | None:
        """The person lost there recently."""
        lost = [person for person in self.people if t not in person.bodies]
        at = [person for person in lost if _is_same_square(square, person.bodies[person.last].square)]
        return max(at, key=lambda person: person.last, default=None)


def _is_same_square(a: Square, b: Square) -> bool:
    apart, sides = np.hypot(a.x - b.x, a.y - b.y), sorted((a.side, b.side))
    return bool(apart <= _SAME_PLACE * sides[0] and sides[1] <= _SAME_SIZE * sides[0])


def _is_same_body(a: Body, b: Body) -> bool:
    apart = np.median(np.linalg.norm(a.xy - b.xy, axis=1))
    return bool(apart <= _SAME_BODY * min(a.square.side, b.square.side))
