"""Who was out of sight for longer and comes back: joined again where it can be told who it is, and said always."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fitting_core.people.following import Followed

_ENDS_SECONDS = 2.0
"""At either end of an absence, from which the size is taken: at the image's edge alone it would be half a person's."""
_SCALE = 0.15
"""Standard deviation of the logarithm of a person's size over an absence; poses change it."""
_OTHER = 0.7
"""Beyond such a change somebody else has come."""
_PLACE, _SPEED = 1.0, 8.0
"""In sizes: how far from where one was seen last one can come back, at once and more for each second."""
_TELLS = 4.0
"""How much likelier one must be than the next to be joined, in squares of standard deviations."""


@dataclass(eq=False)
class FollowedPerson:
    """One person of a clip, followed through all absences."""

    parts: list[Followed] = field(default_factory=list)
    """One after the other."""

    @property
    def last(self) -> int:
        """Frame in which the person was seen last."""
        return self.parts[-1].last

    @property
    def prominence(self) -> float:
        """Sum of size times confidence over all sightings."""
        return sum(seen.prominence for part in self.parts for seen in part.sightings.values())


def joined(followed: Sequence[Followed], frame_rate: float) -> list[FollowedPerson]:
    """People, of whom those who come back are one with those who went.

    Who comes while exactly one person is away who can be there by then, and is of that size, is that person. While
    several are away, it is the one whose size fits clearly best; where none does, it is a new person rather than a
    guess. On which side somebody left says nothing: people walk round a camera.

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


def _unlike(before: Followed, after: Followed, frame_rate: float) -> float:
    """How unlikely it is that one went and came back as the other; infinite: it is not so."""
    near = round(_ENDS_SECONDS * frame_rate)
    ended = [seen for t, seen in before.sightings.items() if t > before.last - near]
    begun = [seen for t, seen in after.sightings.items() if t < after.first + near]
    sizes = [float(np.median([seen.size for seen in end])) for end in (ended, begun)]
    scale = abs(np.log(max(sizes[1], 1e-9) / max(sizes[0], 1e-9)))
    far = float(np.linalg.norm(begun[0].centre - ended[-1].centre)) / max(*sizes, 1e-9)
    seconds = (after.first - before.last) / frame_rate
    return float("inf") if scale > _OTHER or far > _PLACE + _SPEED * seconds else float((scale / _SCALE) ** 2)
