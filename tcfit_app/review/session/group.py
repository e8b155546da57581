"""The open projects of one clip's people, with all that works on them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import msgspec

from fitting_core.io.people_file import Person, Span, read_people, write_people
from tcfit_app.project.people import OpenPeople
from tcfit_app.review.session.session import Session


@dataclass(kw_only=True, eq=False)
class Member:
    """One of the people."""

    person: Person
    """As people.json has it."""
    number: int
    """From 1, in the order of people.json, as --person has it."""
    session: Session


class Group:
    """Several people under review. For the one thread that draws.

    Args:
        people: Their open projects.
        sessions: On these, in their order.
    """

    def __init__(self, people: OpenPeople, sessions: Sequence[Session]) -> None:
        self.folder = people.folder
        self.name = people.file.name
        """The clip's."""
        self.members = tuple(
            Member(person=person, number=people.file.people.index(person) + 1, session=session)
            for (person, _), session in zip(people.projects, sessions, strict=True)
        )

    def settle(self, spans: Mapping[int, Sequence[Span]]) -> None:
        """Nothing of these spans is uncertain any more: they go out of people.json.

        Args:
            spans: By the number of a member.

        Raises:
            InputError: people.json cannot be read any more, or not be written; nothing has changed then.
        """
        file = read_people(self.folder)  # anew: another process may have settled others
        gone = {self.members[number].person.folder: set(those) for number, those in spans.items()}
        people = tuple(
            msgspec.structs.replace(
                one, uncertain=tuple(span for span in one.uncertain if span not in gone.get(one.folder, ()))
            )
            for one in file.people
        )
        write_people(self.folder, msgspec.structs.replace(file, people=people))
        by_folder = {one.folder: one for one in people}
        for member in self.members:
            member.person = by_folder.get(member.person.folder, member.person)
