"""The TERMS table: the terms of objectives."""

from jaxtyping import Float
from torch import Tensor

from fitting_core.fit.terms import (
    bending,
    collision,
    data,
    limits,
    locks,
    positions,
    quadratic,
    rest,
    temporal,
    upright,
)
from fitting_core.fit.terms.context import TermContext, UsedKeypoints
from fitting_core.fit.terms.entry import Entry
from fitting_core.fit.terms.term import Term

TERMS: dict[str, Entry] = {
    entry.name: entry
    for entry in (
        data.ENTRY,
        *positions.ENTRIES,
        *quadratic.ENTRIES,
        bending.ENTRY,
        upright.ENTRY,
        limits.ENTRY,
        rest.ENTRY,
        locks.ENTRY,
        collision.ENTRY,
        temporal.ENTRY,
    )
}
"""By name, in the order of summation."""


def stage_terms(context: TermContext, looked: UsedKeypoints, stage: int) -> list[Term]:
    """The terms of a stage (1 to 5)."""
    made = (entry.make(context, looked, stage - 1) for entry in TERMS.values())
    return [term for term in made if term is not None]


def camera_terms(context: TermContext, looked: UsedKeypoints, depth: Float[Tensor, "T"]) -> list[Term]:
    """The terms of the camera step: keypoints; the depth stays near its guess, the root upright."""
    weights = context.config.weights
    root = upright.Upright.of(context, max(weights.lean), max(weights.turn))
    terms = [data.Data.of(context, looked), quadratic.held_depth(context, depth), root]
    return [term for term in terms if term is not None]
