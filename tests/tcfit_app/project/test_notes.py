"""Notes on frames, in the log of edits."""

import pytest

from fitting_core.errors import InputError
from tcfit_app.project.edits.edit_log import NOTE_CHARACTERS, WriteNote
from tcfit_app.project.project import Project


def texts(project: Project) -> list[tuple[range, str]]:
    return [(note.frames, note.text) for note in project.notes]


def test_notes_are_kept_in_the_order_of_their_frames(project: Project):
    late = project.append(WriteNote(frames=(3, 4), text="late"), author="me")
    project.append(WriteNote(frames=(1,), text="early"), author="me")
    assert texts(project) == [(range(1, 2), "early"), (range(3, 5), "late")]
    project.append(WriteNote(frames=(3, 4), text="later", replaces=late.id), author="you")
    assert texts(project) == [(range(1, 2), "early"), (range(3, 5), "later")]
    assert (project.notes[1].author, project.notes[0].author) == ("you", "me")
    assert project.notes[1].id == late.id
    project.append(WriteNote(frames=(3, 4), text="last", replaces=late.id), author="me")
    project.append(WriteNote(frames=(3, 4), text="", replaces=late.id), author="me")
    assert texts(project) == [(range(1, 2), "early")]
    with pytest.raises(InputError, match="no longer exists"):
        project.append(WriteNote(frames=(3, 4), text="again", replaces=late.id), author="me")


def test_undo_and_redo_go_through_them(project: Project):
    first = project.append(WriteNote(frames=(1,), text="one"), author="me")
    project.append(WriteNote(frames=(1,), text="", replaces=first.id), author="me")
    assert not project.notes
    project.undo(author="me")
    assert texts(project) == [(range(1, 2), "one")]
    project.redo(author="me")
    project.undo(author="me")
    project.undo(author="me")
    assert not project.notes


def test_they_are_there_when_it_is_opened_again(project: Project):
    folder = project.folder
    project.append(WriteNote(frames=(2,), text="a  text <b>of</b>\ntwo lines"), author="me")
    project.close()
    with Project.open(folder) as again:
        assert texts(again) == [(range(2, 3), "a  text <b>of</b>\ntwo lines")]


@pytest.mark.parametrize(
    ("note", "message"),
    [
        (WriteNote(frames=(1,), text=""), "is empty"),
        (WriteNote(frames=(), text="x"), "must be on one frame"),
        (WriteNote(frames=(1, 3), text="x"), "consecutive frames"),
        (WriteNote(frames=(999,), text="x"), "no frame 1006; the clip has frames 7 to 12"),
        (WriteNote(frames=(1,), text="x" * (NOTE_CHARACTERS + 1)), "2,001 characters; expected 2,000 at most"),
        (WriteNote(frames=(1,), text="x", replaces=77), "no longer exists"),
    ],
)
def test_senseless_notes_are_refused(project: Project, note: WriteNote, message: str):
    with pytest.raises(InputError, match=message):
        project.append(note, author="me")
    assert not project.notes and project.last_edit == 0
