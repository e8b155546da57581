"""The people of a clip: a folder with people.json and a project for each."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from fitting_core.errors import InputError
from fitting_core.io.people_file import People, Person, read_people_file
from tcfit_app.project.project import Project
from tcfit_app.project.storage.database import is_project


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenPeople:
    """The open projects of a clip's people."""

    folder: Path
    file: People
    """As in people.json."""
    projects: tuple[tuple[Person, Project], ...]
    """Those that could be opened, in its order; at least one."""

    def chosen(self, number: int | None) -> Project:
        """The project of a person. Raises InputError if there is no such person, or the project could not be opened.

        Args:
            number: From 1, in the order of people.json; None: the first available.
        """
        if number is None:
            return self.projects[0][1]
        people = self.file.people
        if not 1 <= number <= len(people):
            raise InputError(f"--person is {number}; {self.folder} has people 1 to {len(people)}.")
        wanted = people[number - 1]
        found = next((project for person, project in self.projects if person is wanted), None)
        if found is None:
            raise InputError(f"--person {number}: the project of {wanted.name} could not be opened (see above).")
        return found


@contextmanager
def opened_people(folder: Path, opened: Callable[[Path], Project], tell: Callable[[str], None]) -> Iterator[OpenPeople]:
    """Open all projects of a folder for the `with` block; those that cannot be opened are reported and skipped. Raises
    InputError if there is no valid people.json, or none of the projects can be opened.

    Args:
        folder: The folder with people.json.
        opened: Opens a project.
        tell: Called with a message for each skipped person.
    """
    file = read_people_file(folder)
    problems: list[str] = []
    with ExitStack() as stack:
        projects: list[tuple[Person, Project]] = []
        for person in file.people:
            try:
                projects.append((person, stack.enter_context(opened(_project_of(folder, person)))))
            except InputError as error:
                problems.append(f"{person.name} was skipped: {error}")
        if not projects:
            raise InputError(f"{folder}: no person's project can be opened. {problems[0]}")
        for problem in problems:
            tell(problem)
        yield OpenPeople(folder=folder, file=file, projects=tuple(projects))


def _project_of(folder: Path, person: Person) -> Path:
    own = folder / person.folder
    if not own.is_dir():
        raise InputError(f"{own}: does not exist. Put it back, or remove {person.name} from people.json.")
    if not is_project(own):
        raise InputError(f"{own}: not a project. `tcfit new --people all` creates one for each person.")
    return own
