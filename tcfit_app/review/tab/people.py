"""The people under review: one, or all those of a clip, each with a project of their own."""

from collections.abc import Callable
from dataclasses import dataclass, field

from fitting_core.errors import InputError
from fitting_core.io.people_file import Span
from tcfit_app.fitting.fits import Shown
from tcfit_app.project.edits.edit_log import LogEntry
from tcfit_app.project.edits.kinds import TakeOver
from tcfit_app.project.project import Project
from tcfit_app.review.session.group import Group
from tcfit_app.review.session.session import Session
from tcfit_app.review.shared.drawing_data import DrawingData
from tcfit_app.review.tab.state import TabState


@dataclass(kw_only=True, eq=False)
class Someone:
    """One of the people, with the data to draw them."""

    data: DrawingData
    name: str = ""
    """Empty if there is only one."""
    others: tuple["Someone", ...] = ()
    """The clip's other people, in order."""
    number: int = 0
    """The position in that order."""
    group: Group | None = None
    """The folder of all people, if there are several."""
    remembered: dict[str, TabState] = field(default_factory=dict)
    """States of tabs that were closed or reloaded, or that now show someone else, by the tab's own name."""

    @property
    def session(self) -> Session:
        """The open project."""
        return self.data.session

    @property
    def everybody(self) -> tuple["Someone", ...]:
        """This person and the others, in order."""
        return (*self.others[: self.number], self, *self.others[self.number :])

    @property
    def listed(self) -> int | None:
        """The number from 1 in people.json, used in links; None if there is only one."""
        return None if self.group is None else self.group.members[self.number].number

    def numbered(self, listed: int) -> "Someone":
        """The person a link refers to. Raises InputError if there is no such person here.

        Args:
            listed: As in `listed`.
        """
        found = next((someone for someone in self.everybody if someone.listed == listed), None)
        if found is None:
            there = ", ".join(f"{one.listed} ({one.name})" for one in self.everybody if one.listed is not None)
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


def alone(data: DrawingData) -> Someone:
    """The only person."""
    return Someone(data=data)


def together(group: Group, data: list[DrawingData]) -> tuple[Someone, ...]:
    """The people of a group, in order, linked to each other."""
    people = [
        Someone(data=one, name=member.person.name, number=number, group=group)
        for number, (member, one) in enumerate(zip(group.members, data, strict=True))
    ]
    for someone in people:
        someone.others = tuple(other for other in people if other is not someone)
    return tuple(people)
