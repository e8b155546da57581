"""The people under review: one, or all those of a clip, each with a project of their own."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import msgspec

from fitting_core.errors import InputError
from fitting_core.io.people_file import Span, read_people_file, write_people_file
from tcfit_app.fitting.fits import Shown
from tcfit_app.project.edits.edit_log import LogEntry
from tcfit_app.project.edits.kinds import TakeOver
from tcfit_app.project.people import OpenPeople
from tcfit_app.project.project import Project
from tcfit_app.review.session.session import RETRY, Session
from tcfit_app.review.shared.drawing_data import DrawingData
from tcfit_app.review.tab.state import TabState


@dataclass(kw_only=True, eq=False)
class ReviewedPerson:
    """One of the people, with the data to draw them."""

    data: DrawingData
    name: str = ""
    """Empty if there is only one."""
    number: int = 0
    """The position among `all_people`."""
    listed: int | None = None
    """The number from 1 in people.json, used in links and for --person; None if there is only one."""
    group: "Group | None" = None
    """All people of the clip, if there are several."""
    remembered: dict[str, TabState] = field(default_factory=dict)
    """States of tabs that were closed or reloaded, or that now show someone else, by the tab's own name."""

    @property
    def session(self) -> Session:
        """The open project."""
        return self.data.session

    @property
    def all_people(self) -> tuple["ReviewedPerson", ...]:
        """This person and the others, in order."""
        return (self,) if self.group is None else self.group.members

    @property
    def others(self) -> tuple["ReviewedPerson", ...]:
        """The clip's other people, in order."""
        return tuple(one for one in self.all_people if one is not self)

    @property
    def exchanges(self) -> dict[str, LogEntry]:
        """What this person has taken over from others, by the key shared by both edits."""
        return {_taken(entry).exchange: entry for entry in self.session.project.exchanges}

    def span(self, entry: LogEntry) -> Span:
        """The video frame numbers of an exchange."""
        first, frames = self.session.project.footage.first_frame, _taken(entry).frames
        return first + frames[0], first + frames[-1]

    def person_with_number(self, listed: int) -> "ReviewedPerson":
        """The person a link refers to. Raises InputError if there is no such person here.

        Args:
            listed: As in `listed`.
        """
        found = next((someone for someone in self.all_people if someone.listed == listed), None)
        if found is None:
            there = ", ".join(f"{one.listed} ({one.name})" for one in self.all_people if one.listed is not None)
            raise InputError(
                f"The link leads to person {listed}; "
                + (
                    f"this clip has {there}."
                    if there
                    else "this is one person's project. Open the folder of all people."
                )
            )
        return found

    @property
    def uncertain(self) -> tuple[Span, ...]:
        """Frames in which this may be someone else, as video frame numbers."""
        return () if self.group is None else tuple(doubt.span for doubt in self.group.doubts(self.number))

    def undo(self, *, author: str, shown: Shown | None) -> LogEntry | None:
        """Undo the last edit or remark; an exchange of two people is undone for both. Raises InputError as
        `Session.undo` does, or if the other person was corrected after the exchange."""
        return self._step(Session.undo, lambda project: project.undoable, author=author, shown=shown)

    def redo(self, *, author: str, shown: Shown | None) -> LogEntry | None:
        """Redo what was undone last. Raises InputError as `undo`."""
        return self._step(Session.redo, lambda project: project.redoable, author=author, shown=shown)

    def _step(
        self,
        step: Callable[..., LogEntry | None],
        next_of: Callable[[Project], LogEntry | None],
        *,
        author: str,
        shown: Shown | None,
    ) -> LogEntry | None:
        entry = next_of(self.session.project)
        if entry is None or not isinstance(entry.action, TakeOver):
            return step(self.session, author=author, shown=shown)
        taken, both = entry.action, [self.session]
        for other in self.others:
            if _is(taken, next_of(other.session.project)):
                both.insert(0, other.session)
                break
            done = any(_is(taken, theirs) for theirs in other.session.project.exchanges)
            if other.name == taken.source and done == (step is Session.undo):
                raise InputError(
                    f"{other.name} and {self.name} were exchanged, and {other.name} has been corrected or marked "
                    f"since. Undo that first, or exchange them once more."
                )
        for session in both:
            session.project.refuse_read_only()
        try:
            for session in both:
                step(session, author=author)  # fits made before the exchange are valid again
        except InputError:
            if self.group is not None:
                self.group.undo_halves()
            if self.session.project.standing.stood(entry.id) != (step is Session.redo):
                raise
        return entry

    @property
    def stop(self) -> int:
        """The video frame number after the last frame."""
        return self.data.session.project.footage.first_frame + self.data.length

    def frames_from(self, number: int) -> range:
        """The video frame numbers from one on."""
        return range(max(number, self.data.session.project.footage.first_frame), self.stop)

    def frame_of(self, number: int) -> int | None:
        """The clip's frame with a video frame number; None if the clip does not have it."""
        frame = number - self.data.session.project.footage.first_frame
        return frame if 0 <= frame < self.data.length else None


def _is(taken: TakeOver, entry: LogEntry | None) -> bool:
    """Whether an edit is part of the same exchange."""
    return entry is not None and isinstance(entry.action, TakeOver) and entry.action.exchange == taken.exchange


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
        data: To draw them, in the same order.
    """

    def __init__(self, people: OpenPeople, data: Sequence[DrawingData]) -> None:
        self.folder = people.folder
        self.name = people.file.name
        """The clip's."""
        self._persons = [person for person, _ in people.projects]
        """The members' entries in people.json."""
        self.members = tuple(
            ReviewedPerson(
                data=one,
                name=person.name,
                number=number,
                listed=people.file.people.index(person) + 1,
                group=self,
            )
            for number, (person, one) in enumerate(zip(self._persons, data, strict=True))
        )
        self._doubts: tuple[object, list[list[Doubt]]] = (), []
        """What they were found from, and they."""
        self._next_try: float | None = None
        """When to retry undoing half an exchange, if one is pending."""
        self.undo_halves()

    def doubts(self, number: int) -> list[Doubt]:
        """What is uncertain about a member, in order; for two who were exchanged, later doubts are exchanged too."""
        versions = [member.session.project.keypoints_version for member in self.members]
        state = self._persons.copy(), versions
        if self._doubts[0] != state:
            found = [
                [Doubt(span=span, listed=span, owner=k) for span in person.uncertain]
                for k, person in enumerate(self._persons)
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

    def half_exchanged(self, number: int) -> list[tuple[ReviewedPerson, LogEntry]]:
        """From whom a member has taken frames over without an exchange in return, and by which edits."""
        return [
            (other, entry)
            for name, entry in self.members[number].exchanges.items()
            for other in self.members
            if other.name == _taken(entry).source and name not in other.exchanges
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
        folder = self._persons[doubt.owner].folder
        people = tuple(
            msgspec.structs.replace(one, uncertain=tuple(span for span in one.uncertain if span != doubt.listed))
            if one.folder == folder
            else one
            for one in file.people
        )
        write_people_file(self.folder, msgspec.structs.replace(file, people=people))
        by_folder = {one.folder: one for one in people}
        self._persons = [by_folder.get(person.folder, person) for person in self._persons]


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
