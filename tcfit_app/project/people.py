"""The people of one clip: a folder with people.json, and in it a project for each of them."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from fitting_core.errors import InputError
from fitting_core.io.people_file import People, Person, read_people
from tcfit_app.project.project import Project
from tcfit_app.project.storage.database import is_project


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenPeople:
    """Open projects of a clip's people."""

    folder: Path
    file: People
    """As people.json has them."""
    projects: tuple[tuple[Person, Project], ...]
    """Those that could be opened, in its order; one at least."""

    def chosen(self, number: int | None) -> Project:
        """One of them.

        Args:
            number: From 1, in the order of people.json; None: the first that is there.

        Raises:
            InputError: There is no such one, or the project could not be opened.
        """
        if number is None:
            return self.projects[0][1]
        people = self.file.people
        if not 1 <= number <= len(people):
            raise InputError(f"--person is {number}; {self.folder} has the people 1 to {len(people)}.")
        wanted = people[number - 1]
        found = next((project for person, project in self.projects if person is wanted), None)
        if found is None:
            raise InputError(f"--person {number}: the project of {wanted.name} could not be opened, as was told.")
        return found


@contextmanager
def opened_people(folder: Path, opened: Callable[[Path], Project], tell: Callable[[str], None]) -> Iterator[OpenPeople]:
    """Open all projects of a folder, until the end of the `with` block; who cannot be opened is told, and left out.

    Args:
        folder: With people.json.
        opened: Opens a project.
        tell: Gets what is left out.

    Raises:
        InputError: There is no people.json, or one that is of no use, or none of its people can be opened.
    """
    file = read_people(folder)
    problems: list[str] = []
    with ExitStack() as stack:
        projects: list[tuple[Person, Project]] = []
        for person in file.people:
            try:
                projects.append((person, stack.enter_context(opened(_project_of(folder, person)))))
            except InputError as error:
                problems.append(f"{person.name} is left out: {error}")
        if not projects:
            raise InputError(f"{folder}: none of its people can be opened. {problems[0]}")
        for problem in problems:
            tell(problem)
        yield OpenPeople(folder=folder, file=file, projects=tuple(projects))


def _project_of(folder: Path, person: Person) -> Path:
    own = folder / person.folder
    if not own.is_dir():
        raise InputError(f"{own}: is not there. Put it back, or take {person.name} out of people.json.")
    if not is_project(own):
        raise InputError(f"{own}: is no project. `tcfit new --people all` makes one for each person.")
    return own
