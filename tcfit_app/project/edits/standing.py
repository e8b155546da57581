"""Which edits and remarks stood after each entry of a log: a tree, so that no question replays the log.

What is said leads to a new state, Undo back to the one before, and Redo to the one that was left. A state knows the one
before it and one far before it, by which two states find where they parted in the logarithm of their distance (Myers,
"An applicative random-access stack", 1983).
"""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

SaidEntry = TypeVar("SaidEntry")


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class _State(Generic[SaidEntry]):
    said: SaidEntry | None
    """What was said last of what stands; None: nothing stands."""
    before: "_State[SaidEntry] | None"
    far: "_State[SaidEntry] | None"
    depth: int
    """How much stands."""
    counted: int
    """How much of that counts."""


class Standing(Generic[SaidEntry]):
    """The states of a log. An entry is taken up in a time that does not depend on what came before."""

    def __init__(self) -> None:
        self._now: _State[SaidEntry] = _State(said=None, before=None, far=None, depth=0, counted=0)
        self._numbers, self._states = [0], [self._now]
        """Of each entry, and the state after it."""
        self._of: dict[int, _State[SaidEntry]] = {}
        """The state to which an entry has led, by its number."""

    def say(self, number: int, said: SaidEntry, *, counts: bool) -> None:
        """An edit or a remark; `counts`: whether `differing` does."""
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
        """What was said last of what stands does not any more."""
        assert self._now.before is not None, "there is something to undo"
        self._add(number, self._now.before)

    def redo(self, number: int, again: int) -> None:
        """The entry `again` stands again."""
        self._add(number, self._of[again])

    def _add(self, number: int, state: _State[SaidEntry]) -> None:
        self._now = state
        self._numbers.append(number)
        self._states.append(state)

    def differing(self, seen: int) -> int:
        """How many that count stand now and did not after the entry `seen`, or did and do not now."""
        then, now = self._after(seen), self._now
        return then.counted + now.counted - 2 * _parted(then, now).counted

    def changes(self, seen: int) -> Iterator[SaidEntry]:
        """Those of `differing` and whatever else differs so, the newest first."""
        then, now = self._after(seen), self._now
        root = _parted(then, now)
        for state in (now, then):
            while state is not root:
                assert state.said is not None and state.before is not None
                yield state.said
                state = state.before

    def stood_by(self, seen: int, later: int | None = None) -> bool:
        """Whether all that stood after the entry `seen` stood after a later one as well; None: stands now."""
        then = self._after(seen)
        return _parted(then, self._now if later is None else self._after(later)) is then

    def stood(self, number: int, seen: int | None = None) -> bool:
        """Whether what an entry has said stood after the entry `seen`; None: whether it stands now."""
        state, then = self._of.get(number), self._now if seen is None else self._after(seen)
        return state is not None and _parted(state, then) is state

    def said(self, number: int) -> SaidEntry:
        """What an entry has said."""
        said = self._of[number].said
        assert said is not None
        return said

    def _after(self, seen: int) -> _State[SaidEntry]:
        return self._states[bisect_right(self._numbers, seen) - 1]


def _parted(one: _State[SaidEntry], other: _State[SaidEntry]) -> _State[SaidEntry]:
    """The last state that both come from."""
    one, other = _up(one, other.depth), _up(other, one.depth)
    while one is not other:
        far = one.far is not other.far  # states of one depth have their far ones at one depth
        one, other = (state.far if far else state.before for state in (one, other))  # pyright: ignore
    return one


def _up(state: _State[SaidEntry], depth: int) -> _State[SaidEntry]:
    while state.depth > depth:
        assert state.far is not None and state.before is not None
        state = state.far if state.far.depth >= depth else state.before
    return state
