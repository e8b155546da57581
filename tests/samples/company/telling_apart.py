"""How well people of a scene are told apart, and whether exchanges are named."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import linear_sum_assignment

from fitting_core.people.everybody import FoundPerson, find_all_people
from tests.samples.company.filmed import Company


@dataclass(frozen=True, kw_only=True)
class Told:
    """How one scene went."""

    right: float
    """Share of all people in all frames who were found as the one they are."""
    found: int
    """People."""
    there: int
    exchanges: int
    named: int
    """Of the exchanges."""
    uncertain: float
    """Share of all found people in all frames that was named."""


def told_apart(company: Company) -> Told:
    """Follow everybody in a scene, and compare with who is who."""
    found = find_all_people(company.detections, frame_rate=company.frame_rate).people
    whose = [[None if k is None else company.owners[t][k] for t, k in enumerate(one.entries)] for one in found]
    count = len(company.points)
    table = np.array([[sum(owner == k for owner in one) for k in range(count)] for one in whose])
    total = sum(k in owners for owners in company.owners for k in range(count))
    rows, columns = linear_sum_assignment(-table)
    changes = [_exchanges(one, owners) for one, owners in zip(found, whose, strict=True)]
    there = sum(entry is not None for one in found for entry in one.entries)
    named = sum(one.entries[t] is not None for one in found for span in one.uncertain for t in span)
    return Told(
        right=float(table[rows, columns].sum() / total),
        found=len(found),
        there=count,
        exchanges=sum(len(these) for these in changes),
        named=sum(sum(these) for these in changes),
        uncertain=named / there,
    )


def _exchanges(one: FoundPerson, owners: list[int | None]) -> list[bool]:
    """Of each time that somebody goes on as somebody else: whether it was named."""
    known = [(t, owner) for t, owner in enumerate(owners) if owner is not None and owner >= 0]
    doubtful = {t for span in one.uncertain for t in span}
    return [
        not doubtful.isdisjoint(range(before, after + 1))
        for (before, was), (after, now) in pairwise(known)
        if was != now
    ]
