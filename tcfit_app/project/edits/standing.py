"""Which edits and remarks stood after each entry of a log: a tree, so that queries need not replay the log.

Doing something leads to a new state, Undo to the previous one, and Redo to the one left. A state links to its
predecessor and to a distant ancestor, so that the common ancestor of two states is found in the logarithm of their
distance (Myers, "An applicative random-access stack", 1983).
"""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

SaidEntry = TypeVar("SaidEntry")


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class _State(Generic[SaidEntry]):
    said: SaidEntry | None
    """The last statement that stands; None: nothing stands."""
    before: "_State[SaidEntry] | None"
    far: "_State[SaidEntry] | None"
    depth: int
    """Number of statements that stand."""
    counted: int
    """How many of them count."""


class Standing(Generic[SaidEntry]):
    """The states of a log. Adding an entry takes constant time. One thread adds at a time, and any may ask."""

    def __init__(self) -> None:
        self._now: _State[SaidEntry] = _State(said=None, before=None, far=None, depth=0, counted=0)
        self._numbers, self._states = [0], [self._now]
        """Each entry's statement, and the state after it."""
        self._of: dict[int, _State[SaidEntry]] = {}
        """The state after each entry, by its number."""

    def say(self, number: int, said: SaidEntry, *, counts: bool) -> None:
        """Add an edit or a remark; `counts`: whether it counts for `differing`."""
        before = self._now
        far = before.far
        skips = far is not None and far.far is not None and before.depth - far.depth == far.depth - far.far.depth
        state = _State(
            said=said,
            before=before,
            far=far.far if skips and far is not None else before,
            depth=before.depth + 1,
            counted=before.counted + counts,
        )
        self._of[number] = state
        self._add(number, state)

    def undo(self, number: int) -> None:
        """Undo the last statement that stands."""
        assert self._now.before is not None, "there is something to undo"
        self._add(number, self._now.before)

    def redo(self, number: int, again: int) -> None:
        """Redo the entry `again`."""
        self._add(number, self._of[again])

    def _add(self, number: int, state: _State[SaidEntry]) -> None:
        self._now = state
        self._states.append(state)  # first: another thread looks the number up
        self._numbers.append(number)

    def differing(self, seen: int) -> int:
        """How many counting statements stand now but did not after the entry `seen`, or vice versa."""
        then, now = self._after(seen), self._now
        return then.counted + now.counted - 2 * _parted(then, now).counted

    def changes(self, seen: int) -> Iterator[SaidEntry]:
        """All statements that differ in this way, newest first."""
        then, now = self._after(seen), self._now
        root = _parted(then, now)
        for state in (now, then):
            while state is not root:
                assert state.said is not None and state.before is not None
                yield state.said
                state = state.before

    def stood_by(self, seen: int, later: int | None = None) -> bool:
        """Whether every counting statement that stood after the entry `seen` stood after a later one too; None: stands
        now."""
        then = self._after(seen)
        return _parted(then, self._now if later is None else self._after(later)).counted == then.counted

    def counted(self, seen: int) -> int:
        """How many counting statements stood after the entry `seen`."""
        return self._after(seen).counted

    def stood(self, number: int, seen: int | None = None) -> bool | None:
        """Whether an entry's statement stood after the entry `seen`, by default the last one; None for an entry that is
        missing, because it is damaged or was removed."""
        state, then = self._of.get(number), self._now if seen is None else self._after(seen)
        return None if state is None else _parted(state, then) is state

    def said(self, number: int) -> SaidEntry:
        """The statement of an entry."""
        said = self._of[number].said
        assert said is not None
        return said

    def _after(self, seen: int) -> _State[SaidEntry]:
        return self._states[bisect_right(self._numbers, seen) - 1]


def _parted(one: _State[SaidEntry], other: _State[SaidEntry]) -> _State[SaidEntry]:
    """The last common ancestor."""
    one, other = _up(one, other.depth), _up(other, one.depth)
    while one is not other:
        far = one.far is not other.far  # states of equal depth have their distant ancestors at equal depth
        one, other = (state.far if far else state.before for state in (one, other))  # pyright: ignore
    return one


def _up(state: _State[SaidEntry], depth: int) -> _State[SaidEntry]:
    while state.depth > depth:
        assert state.far is not None and state.before is not None
        state = state.far if state.far.depth >= depth else state.before
    return state
