"""The open projects of one clip's people, with their sessions."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import msgspec

from fitting_core.errors import InputError
from fitting_core.io.people_file import Person, Span, read_people_file, write_people_file
from tcfit_app.project.edits.edit_log import LogEntry
from tcfit_app.project.edits.kinds import TakeOver
from tcfit_app.project.people import OpenPeople
from tcfit_app.review.session.session import RETRY, Session


@dataclass(kw_only=True, eq=False)
class Member:
    """One of the people."""

    person: Person
    """As in people.json."""
    number: int
    """From 1, in the order of people.json, as for --person."""
    session: Session

    @property
    def exchanges(self) -> dict[str, LogEntry]:
        """What this person has taken over from others, by the key shared by both edits."""
        return {_taken(entry).exchange: entry for entry in self.session.project.exchanges}

    def span(self, entry: LogEntry) -> Span:
        """The video frame numbers of an edit."""
        first, frames = self.session.project.footage.first_frame, _taken(entry).frames
        return first + frames[0], first + frames[-1]


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """Frames, as video frame numbers, in which a person may be someone else."""

    span: Span
    listed: Span
    """As in people.json, which does not record exchanges."""
    owner: int
    """The member whose entry there contains it."""


class Group:
    """Several people under review. For the drawing thread only.

    Args:
        people: Their open projects.
        sessions: Theirs, in the same order.
    """

    def __init__(self, people: OpenPeople, sessions: Sequence[Session]) -> None:
        self.folder = people.folder
        self.name = people.file.name
        """The clip's."""
        self.members = tuple(
            Member(person=person, number=people.file.people.index(person) + 1, session=session)
            for (person, _), session in zip(people.projects, sessions, strict=True)
        )
        self._doubts: tuple[object, list[list[Doubt]]] = (), []
        """What they were found from, and they."""
        self._next_try: float | None = None
        """When to retry undoing half an exchange, if one is pending."""
        self.undo_halves()

    def doubts(self, number: int) -> list[Doubt]:
        """What is uncertain about a member, in order; for two who were exchanged, later doubts are exchanged too."""
        state = [(member.person, member.session.project.keypoints_version) for member in self.members]
        if self._doubts[0] != state:
            found = [
                [Doubt(span=span, listed=span, owner=k) for span in member.person.uncertain]
                for k, member in enumerate(self.members)
            ]
            for one, other, span in self._exchanges():
                mine, theirs = found[one], found[other]
                found[one], found[other] = _after(mine, theirs, span), _after(theirs, mine, span)
            self._doubts = state, found
        return self._doubts[1][number]

    def _exchanges(self) -> list[tuple[int, int, Span]]:
        """Which members were exchanged, and in which frames; oldest first."""
        found = []
        for (i, one), (j, other) in combinations(enumerate(self.members), 2):
            taken = one.exchanges
            found += [(taken[name].time, i, j, one.span(taken[name])) for name in taken.keys() & other.exchanges]
        return [(i, j, span) for _, i, j, span in sorted(found)]

    def half_exchanged(self, number: int) -> list[tuple[Member, LogEntry]]:
        """From whom a member has taken frames over without an exchange in return, and by which edits."""
        return [
            (other, entry)
            for name, entry in self.members[number].exchanges.items()
            for other in self.members
            if other.person.name == _taken(entry).source and name not in other.exchanges
        ]

    def undo_halves(self) -> None:
        """Undo half exchanges, unless something was done after them. A full disk or a killed process leaves them: two
        projects cannot be written at once. What cannot be written now is tried again by `take_up`."""
        self._next_try = None
        for number, member in enumerate(self.members):
            project, halves = member.session.project, {entry.id for _, entry in self.half_exchanged(number)}
            try:
                while not project.read_only and (last := project.undoable) is not None and last.id in halves:
                    member.session.undo(author=last.author)
            except InputError:
                self._next_try = time.monotonic() + RETRY

    def take_up(self) -> None:
        """Undo what could not be undone before, if possible now."""
        if self._next_try is not None and time.monotonic() >= self._next_try:
            self.undo_halves()

    def settle(self, doubt: Doubt) -> None:
        """Mark these frames as certain, removing them from people.json. Raises InputError if people.json can no longer
        be read or written; nothing has changed then."""
        file = read_people_file(self.folder)  # again: another process may have settled others
        folder = self.members[doubt.owner].person.folder
        people = tuple(
            msgspec.structs.replace(one, uncertain=tuple(span for span in one.uncertain if span != doubt.listed))
            if one.folder == folder
            else one
            for one in file.people
        )
        write_people_file(self.folder, msgspec.structs.replace(file, people=people))
        by_folder = {one.folder: one for one in people}
        for member in self.members:
            member.person = by_folder.get(member.person.folder, member.person)


def _after(own: list[Doubt], others: list[Doubt], exchanged: Span) -> list[Doubt]:
    """The doubts about one of two people after an exchange, which settles those it begins in."""
    first, last = exchanged
    stay = [doubt for doubt in own if doubt.span[1] + 1 < first or doubt.span[0] > last]
    come = [
        replace(doubt, span=(doubt.span[0], min(doubt.span[1], last)))
        for doubt in others
        if first < doubt.span[0] <= last
    ]
    return sorted([*stay, *come], key=lambda doubt: doubt.span)


def _taken(entry: LogEntry) -> TakeOver:
    assert isinstance(entry.action, TakeOver)
    return entry.action
