"""people.json: what is written is read again, and what is of no use is refused in plain words."""

import json
import sys
from pathlib import Path

import pytest

from fitting_core.errors import InputError
from fitting_core.io.people_file import PEOPLE_NAME, People, Person, holds_people, read_people_file, write_people_file

TWO = People(
    name="a talk",
    people=(
        Person(name="person 1", folder="person-1", frames=(0, 99)),
        Person(name="Zoë", folder="person-2", frames=(10, 80), uncertain=((10, 12), (40, 80))),
    ),
)


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    assert not holds_people(tmp_path)
    write_people_file(tmp_path, TWO)
    assert holds_people(tmp_path) and read_people_file(tmp_path) == TWO
    assert [path.name for path in tmp_path.iterdir()] == [PEOPLE_NAME]


def content(**changes: object) -> dict[str, object]:
    return {"tcfit_people": 1, "name": "a talk", "people": [one()]} | changes


def one(**changes: object) -> dict[str, object]:
    return {"name": "person 1", "folder": "person-1", "frames": [0, 9], "uncertain": []} | changes


MALFORMED: dict[str, tuple[object, str]] = {
    "no object": ([], "object"),
    "no people": (content(people=[]), "0 people"),
    "too many": (content(people=[one(name=f"{i}", folder=f"{i}") for i in range(101)]), "101 people"),
    "a newer version": (content(tcfit_people=2), "has version 2; this tcfit reads 1. Update"),
    "no such version": (content(tcfit_people=0), "tcfit_people"),
    "no version": ({"name": "a talk", "people": [one()]}, "tcfit_people"),
    "a text as version": (content(tcfit_people="1"), "tcfit_people"),
    "too large": (" " * (2**24 + 1), "has 16.0 MB, expected at most 16.0 MB"),
    "no clip": (content(name=""), "name of a clip"),
    "two lines": (content(people=[one(name="a\nb")]), "name of a person"),
    "a lone surrogate": (content(people=[one(name="\ud800")]), "people of a clip"),
    "parent": (content(people=[one(folder="..")]), "plain name"),
    "nested": (content(people=[one(folder="a/b")]), "plain name"),
    "absolute": (content(people=[one(folder="/tmp")]), "plain name"),
    "of windows": (content(people=[one(folder="C:\\x")]), "plain name"),
    "null byte": (content(people=[one(folder="a\0b")]), "plain name"),
    "hidden": (content(people=[one(folder=".git")]), "plain name"),
    "backwards": (content(people=[one(frames=[9, 0])]), "from frame 9 to 0"),
    "negative": (content(people=[one(frames=[-1, 0])]), "frames"),
    "huge": (content(people=[one(frames=[0, 2**40])]), "frames"),
    "three": (content(people=[one(frames=[0, 1, 2])]), "frames"),
    "elsewhere": (content(people=[one(uncertain=[[5, 12]])]), "uncertain frames 5 to 12"),
    "overlapping": (content(people=[one(uncertain=[[1, 5], [5, 7]])]), "uncertain frames 5 to 7"),
    "same name": (content(people=[one(), one(folder="b")]), "two people have the name"),
    "same folder": (content(people=[one(), one(name="b", folder="PERSON-1")]), "two people have the folder"),
    "deep": ("[" * 100_000, "people of a clip"),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_file_is_refused_with_its_reason(name: str, tmp_path: Path) -> None:
    made, told = MALFORMED[name]
    (tmp_path / PEOPLE_NAME).write_text(made if isinstance(made, str) else json.dumps(made))
    with pytest.raises(InputError, match=told):
        read_people_file(tmp_path)


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")
def test_a_link_in_the_place_of_a_folder_is_refused(tmp_path: Path) -> None:
    write_people_file(tmp_path, TWO)
    (tmp_path / "person-2").symlink_to(tmp_path.parent)
    with pytest.raises(InputError, match="is a link"):
        read_people_file(tmp_path)
