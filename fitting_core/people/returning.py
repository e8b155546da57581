"""People who come back after a longer absence: rejoined if it is clear who they are, and always reported."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fitting_core.people.following import Sighting, Track

_ENDS_SECONDS = 2.0
"""Sightings at either end of an absence from which size is taken: at the image's edge alone, people are half seen."""
_SCALE = 0.15
"""Standard deviation of a person's log size over an absence, as poses change it."""
_OTHER = 0.7
"""With a larger change it is another person."""
_PLACE, _SPEED = 1.0, 8.0
"""In sizes: how far from where they were last seen people can come back, at once and more per second."""
_TELLS = 4.0
"""Margin to the second likeliest needed for rejoining, in squares of standard deviations."""


@dataclass(eq=False)
class FollowedPerson:
    """One person of a clip, followed through all absences."""

    parts: list[Track] = field(default_factory=list)
    """One after the other."""

    @cached_property
    def sightings(self) -> dict[int, Sighting]:
        """By frame, in order; complete once all parts are joined."""
        return {frame: seen for part in self.parts for frame, seen in part.sightings.items()}

    @property
    def last(self) -> int:
        """Frame in which the person was seen last."""
        return self.parts[-1].last

    @property
    def prominence(self) -> float:
        """Sum of size times confidence over all sightings."""
        return sum(seen.prominence for part in self.parts for seen in part.sightings.values())


def rejoined(followed: Sequence[Track], frame_rate: float) -> list[FollowedPerson]:
    """People, with those who come back joined to those who left.

    If exactly one person is away who could be there by then and has that size, the newcomer is that person. If several
    are away, it is the one whose size clearly fits best; if none does, it is a new person rather than a guess. The side
    on which a person left means nothing: people walk round a camera.

    Args:
        followed: In the order in which they appear.
        frame_rate: Frames per second.
    """
    people: list[FollowedPerson] = []
    for one in followed:
        away = [person for person in people if person.last < one.first]
        costs = np.array([_unlike(person.parts[-1], one, frame_rate) for person in away])
        best = np.argsort(costs)
        fits = int((costs < np.inf).sum())
        if fits == 1 or (fits > 1 and costs[best[1]] - costs[best[0]] > _TELLS):
            away[best[0]].parts.append(one)
        else:
            people.append(FollowedPerson(parts=[one]))
    return people


def _unlike(before: Track, after: Track, frame_rate: float) -> float:
    """How unlikely it is that one left and came back as the other; infinite: impossible."""
    near = round(_ENDS_SECONDS * frame_rate)
    ended = [seen for t, seen in before.sightings.items() if t > before.last - near]
    begun = [seen for t, seen in after.sightings.items() if t < after.first + near]
    sizes = [float(np.median([seen.size for seen in end])) for end in (ended, begun)]
    scale = abs(np.log(max(sizes[1], 1e-9) / max(sizes[0], 1e-9)))
    far = float(np.linalg.norm(begun[0].centre - ended[-1].centre)) / max(*sizes, 1e-9)
    seconds = (after.first - before.last) / frame_rate
    return float("inf") if scale > _OTHER or far > _PLACE + _SPEED * seconds else float((scale / _SCALE) ** 2)
