"""people.json: the people of one clip. Each has a folder beside it: a project, or the result of a fit."""

from codecs import BOM_UTF8
from pathlib import Path
from typing import Annotated

import msgspec

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import regular_file

PEOPLE_NAME = "people.json"
VERSION = 1
MOST_PEOPLE = 100
_MOST_BYTES = 16 * 2**20
LONGEST_NAME = 200
"""Characters of a name."""
_NOT_IN_FOLDERS = '/\\:*?"<>|'
"""Some systems do not allow some of these, and others would lead out of the folder."""

Number = Annotated[int, msgspec.Meta(ge=0, lt=2**31)]
Span = tuple[Number, Number]
"""First and last frame, both included, by number in the video."""


class Person(msgspec.Struct, frozen=True, kw_only=True):
    """One of the people of a clip."""

    name: str
    """As users read it, such as "person 1"."""
    folder: str
    """Beside people.json, such as "person-1"; a plain name."""
    frames: Span
    """Where the person is in the video."""
    uncertain: tuple[Span, ...] = ()
    """Parts of `frames`, in order, in which this may be another of the people."""


class _Version(msgspec.Struct, frozen=True):
    tcfit_people: int


class People(msgspec.Struct, frozen=True, kw_only=True, tag_field="tcfit_people", tag=VERSION):
    """The people of a clip. The file has its version as well."""

    name: str
    """Of the clip."""
    people: tuple[Person, ...]
    """One at least; no two have one name or folder."""


def holds_people(folder: Path) -> bool:
    """Whether a folder is one of several people."""
    return (folder / PEOPLE_NAME).is_file()


def refuse_several(folder: Path) -> None:
    """Raise InputError for a folder of several people, where that of one is wanted."""
    if holds_people(folder):
        one = folder / read_people_file(folder).people[0].folder
        raise InputError(f"{folder}: holds several people. Give the folder of one of them, such as {one}.")


def read_people_file(folder: Path) -> People:
    """The people of a folder. Their own folders may be missing; a link is refused. Raises InputError if it has no
    people.json, or an unusable one."""
    path = folder / PEOPLE_NAME
    try:
        content = regular_file(path, most=_MOST_BYTES).read_bytes().removeprefix(BOM_UTF8)  # of Windows' editors
        version = msgspec.json.decode(content, type=_Version).tcfit_people
        if version > VERSION:
            raise InputError(f"{path}: has version {version}; this tcfit reads {VERSION}. Update tcfit.")
        found = msgspec.json.decode(content, type=People)
    except FileNotFoundError as error:
        raise InputError(f"{folder}: has no {PEOPLE_NAME}; expected a folder of several people.") from error
    except (OSError, UnicodeDecodeError, msgspec.DecodeError, RecursionError) as error:
        raise InputError(f"{path}: does not list the people of a clip ({error}); {_EXPECTED}.") from error
    if why := refused(found):
        raise InputError(f"{path}: {why}; {_EXPECTED}.")
    for person in found.people:
        if (folder / person.folder).is_symlink():
            raise InputError(f"{folder / person.folder}: is a link; expected the folder of {person.name} itself.")
    return found


def write_people_file(folder: Path, people: People) -> None:
    """Write people.json into an existing folder, atomically. Raises InputError if it cannot be written, or could not be
    read back."""
    path = folder / PEOPLE_NAME
    if why := refused(people):
        raise InputError(f"{path}: cannot be written: {why}; {_EXPECTED}.")
    try:
        with replacing(path) as draft:
            draft.write_bytes(msgspec.json.format(msgspec.json.encode(people), indent=2) + b"\n")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}).") from error


_EXPECTED = "expected what tcfit writes there: the name of a clip, and for each person a name, a folder and frames"


def refused(people: People) -> str:
    """Why this cannot be the content of people.json; empty if it can."""
    if not _is_line(people.name):
        return f"{people.name[:50]!r} cannot be the name of a clip"
    if not 1 <= len(people.people) <= MOST_PEOPLE:
        return f"it has {len(people.people)} people, and 1 to {MOST_PEOPLE} are possible"
    for person in people.people:
        if why := _refused_person(person):
            return why
    for what, names in (
        ("name", [person.name for person in people.people]),
        ("folder", [person.folder.casefold() for person in people.people]),  # as macOS and Windows compare them
    ):
        if twice := next((name for name in names if names.count(name) > 1), None):
            return f"two people have the {what} {twice!r}"
    return ""


def _refused_person(person: Person) -> str:
    name, folder = person.name, person.folder
    if not _is_line(name):
        return f"{name[:50]!r} cannot be the name of a person"
    if not _is_line(folder) or folder.startswith(".") or folder.endswith(".") or set(folder) & set(_NOT_IN_FOLDERS):
        return f"the folder of {name}, {folder[:50]!r}, is not the plain name of one beside it"
    first, last = person.frames
    if first > last:
        return f"{name} is there from frame {first} to {last}"
    end = first - 1
    for one, other in person.uncertain:
        if not end < one <= other <= last:
            return f"the uncertain frames {one} to {other} of {name} are not in order, or not among {first} to {last}"
        end = other
    return ""


def _is_line(text: str) -> bool:
    return 0 < len(text) <= LONGEST_NAME and text.isprintable() and text == text.strip()
