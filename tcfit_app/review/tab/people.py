"""The people under review: one, or all those of a clip, each of whom is a project of its own."""

from dataclasses import dataclass, field

from fitting_core.errors import InputError
from fitting_core.io.people_file import Span
from tcfit_app.review.session.group import Group
from tcfit_app.review.session.session import Session
from tcfit_app.review.shared.drawing_data import DrawingData
from tcfit_app.review.tab.state import TabState


@dataclass(kw_only=True, eq=False)
class Someone:
    """One of the people, with what is drawn of them."""

    data: DrawingData
    name: str = ""
    """Empty where there is but one."""
    others: tuple["Someone", ...] = ()
    """The clip's other people, in their order."""
    number: int = 0
    """In that order."""
    group: Group | None = None
    """The people's common folder, if there are several."""
    remembered: dict[str, TabState] = field(default_factory=dict)
    """States of tabs that were closed or reloaded, or that show somebody else now, by the tab's own name."""

    @property
    def session(self) -> Session:
        """The open project."""
        return self.data.session

    @property
    def everybody(self) -> tuple["Someone", ...]:
        """This one and the others, in their order."""
        return (*self.others[: self.number], self, *self.others[self.number :])

    @property
    def listed(self) -> int | None:
        """The number from 1 in people.json, which links have; None where there is but one."""
        return None if self.group is None else self.group.members[self.number].number

    def numbered(self, listed: int) -> "Someone":
        """Whom a link means.

        Args:
            listed: See there.

        Raises:
            InputError: There is no such person here.
        """
        found = next((someone for someone in self.everybody if someone.listed == listed), None)
        if found is None:
            there = ", ".join(f"{one.listed} ({one.name})" for one in self.everybody if one.listed is not None)
            raise InputError(
                f"The link leads to person {listed}; "
                + (f"here are {there}." if there else "here is one person's project. Open the folder of all people.")
            )
        return found

    @property
    def uncertain(self) -> tuple[Span, ...]:
        """Frames in which this may be another of the people, by number in the video."""
        return () if self.group is None else self.group.members[self.number].person.uncertain

    @property
    def stop(self) -> int:
        """The number in the video behind the last frame."""
        return self.data.session.project.clip.first_frame + self.data.length

    def frames_from(self, number: int) -> range:
        """The numbers of the frames from one on."""
        return range(max(number, self.data.session.project.clip.first_frame), self.stop)

    def frame_of(self, number: int) -> int | None:
        """The own frame with a number in the video; None if the clip does not have it."""
        frame = number - self.data.session.project.clip.first_frame
        return frame if 0 <= frame < self.data.length else None


def alone(data: DrawingData) -> Someone:
    """The only one."""
    return Someone(data=data)


def together(group: Group, data: list[DrawingData]) -> tuple[Someone, ...]:
    """The people of a group, in its order, who know each other."""
    people = [
        Someone(data=one, name=member.person.name, number=number, group=group)
        for number, (member, one) in enumerate(zip(group.members, data, strict=True))
    ]
    for someone in people:
        someone.others = tuple(other for other in people if other is not someone)
    return tuple(people)
