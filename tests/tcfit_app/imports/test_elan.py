"""ELAN and back: what is exported, notes that come back, undo, another annotator's file, and what is refused."""

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import MagicMock

import pytest
import viser
from pympi.Elan import Eaf

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.io.eaf import Annotation, Tier, read_eaf, write_eaf
from tcfit_app.cli.main import main
from tcfit_app.imports.elan import OWN, import_notes
from tcfit_app.project.edits.edit_log import NOTE_CHARACTERS, WriteNote
from tcfit_app.project.project import Project
from tests.drivers.lone_page import lone_page
from tests.samples.project_samples import sample_clip
from tests.samples.waving import waving_project

FIRST, RATE = 7, 29.97  # of the samples' clip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, free_body: BodyModel) -> Path:
    folder = waving_project(tmp_path_factory.mktemp("elan") / "walk.tcfit", free_body)
    with Project.open(folder) as project:
        project.append(WriteNote(frames=(1, 2), text="a <note>\nof two lines"))
        project.append(WriteNote(frames=(2, 3), text="overlaps"))
        project.marks.set((0, 1), "flag")
        project.marks.set((3,), "checked")
    return folder


@pytest.fixture(scope="module")
def exported(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out")
    assert main(["export", str(folder), "--out", str(out), "--formats", "elan"]) == 0
    return out / "walk.eaf"


@pytest.fixture
def project(tmp_path: Path) -> Iterator[Project]:
    with Project.create(tmp_path / "empty.tcfit", sample_clip(10)) as project:
        yield project


def notes(project: Project) -> list[tuple[range, str]]:
    return [(note.frames, note.text) for note in project.notes]


def annotated(path: Path, *tiers: tuple[str, list[tuple[int, int, str]]]) -> Path:
    """A file with annotations from one frame to another."""
    made = []
    for name, texts in tiers:
        times = [(round(1000 * (FIRST + a) / RATE), round(1000 * (FIRST + b + 1) / RATE), text) for a, b, text in texts]
        found = tuple(Annotation(start=max(a, 0), end=b, text=text) for a, b, text in times)
        made.append(Tier(name=name, kind="any", annotations=found))
    write_eaf(path, made)
    return path


def test_what_was_said_is_in_tiers_that_do_not_overlap(exported: Path):
    tiers = {tier.name: tier for tier in read_eaf(exported)}
    assert set(tiers) > OWN and set(tiers) - OWN == {"Notes", "Notes 2"}
    frame = [round(1000 * f / RATE) for f in range(20)]
    assert tiers["Notes"].annotations == (Annotation(start=frame[8], end=frame[10], text="a <note>\nof two lines"),)
    assert tiers["Notes 2"].annotations[0].start == frame[9]
    assert tiers["Flags"].annotations == (Annotation(start=frame[7], end=frame[9], text="flagged"),)
    words = ["flagged", "not reviewed", "looks fine", "not reviewed"]
    assert [a.text for a in tiers["Review"].annotations] == words
    for tier in tiers.values():
        assert all(a.end <= b.start for a, b in zip(tier.annotations, tier.annotations[1:], strict=False)), tier.name


def test_hands_fill_the_clip_and_shapes_have_distances(exported: Path):
    eaf = Eaf(str(exported))
    for hand in ("Left", "Right"):
        phases = eaf.get_annotation_data_for_tier(f"{hand} hand phase")
        assert phases[0][0] == round(1000 * FIRST / RATE) and {p[2] for p in phases} <= {"movement", "hold", "rest"}
        shapes = eaf.get_annotation_data_for_tier(f"{hand} handshape")
        told = eaf.get_ref_annotation_data_for_tier(f"{hand} handshape distance")
        assert shapes and [s[:2] for s in shapes] == [t[:2] for t in told]
        assert all(re.fullmatch(r"\d+°( from .+)?", t[2]) for t in told)


def test_a_project_s_own_handshapes(folder: Path, tmp_path: Path):
    own = folder / "handshapes.toml"
    own.write_text('[mine]\nlike = "relaxed"\n')
    try:
        assert main(["export", str(folder), "--out", str(tmp_path), "--formats", "elan"]) == 0
    finally:
        own.unlink()
    names = {
        a.text for tier in read_eaf(tmp_path / "walk.eaf") if tier.name.endswith("handshape") for a in tier.annotations
    }
    assert names <= {"mine", "unclear"}


def test_some_frames_have_their_own_time(folder: Path, tmp_path: Path):
    assert main(["export", str(folder), "--out", str(tmp_path), "--formats", "elan", "--frames", "9:9"]) == 0
    tiers = {tier.name: tier for tier in read_eaf(tmp_path / "walk.eaf")}
    (note,) = tiers["Notes"].annotations
    assert (note.start, note.end) == (round(9000 / RATE), round(10000 / RATE))
    assert [a.text for a in tiers["Review"].annotations] == ["not reviewed"]


def test_what_was_exported_is_here_already(folder: Path, exported: Path):
    with Project.open(folder) as project:
        before, last = notes(project), project.last_edit
        found = import_notes(project, exported)
        assert (found.new, found.changed, found.known) == (0, 0, 2)
        assert notes(project) == before and project.last_edit == last


def test_another_text_takes_its_place_and_undo_brings_it_back(folder: Path, exported: Path, tmp_path: Path):
    content = exported.read_text(encoding="utf-8").replace("overlaps", "overlaps more")
    (tmp_path / "changed.eaf").write_text(content, encoding="utf-8")
    with Project.open(folder) as project:
        before = notes(project)
        found = import_notes(project, tmp_path / "changed.eaf", author="me")
        assert (found.new, found.changed, found.known) == (0, 1, 1)
        assert notes(project)[1] == (range(2, 4), "overlaps more") and len(project.notes) == 2
        project.undo()
        assert notes(project) == before


def test_spans_become_notes_and_one_undo_takes_all_back(project: Project, tmp_path: Path):
    path = annotated(tmp_path / "x.eaf", ("gloss", [(0, 2, "HOUSE"), (3, 9, "TREE")]), ("eyes", [(1, 1, "blink")]))
    found = import_notes(project, path, author="me")
    there = [(range(3), "HOUSE"), (range(1, 2), "blink"), (range(3, 10), "TREE")]
    assert notes(project) == there and (found.new, found.tiers) == (3, ("gloss", "eyes"))
    assert len({note.id for note in project.notes}) == 3
    again = import_notes(project, path, author="me")
    assert (again.new, again.known) == (0, 3) and notes(project) == there
    blink = project.notes[1]
    project.append(WriteNote(frames=(1,), text="a blink", replaces=blink.id))
    assert notes(project)[1] == (range(1, 2), "a blink")
    for _ in range(2):
        project.undo()
    assert not project.notes
    project.redo()
    assert notes(project) == there
    project.close()
    with Project.open(project.folder) as reopened:
        assert notes(reopened) == there


def test_chosen_tiers_and_what_lies_outside(project: Project, tmp_path: Path):
    path = annotated(
        tmp_path / "x.eaf", ("gloss", [(-7, 0, "A"), (9, 30, "B"), (40, 41, "C")]), ("eyes", [(1, 1, "x")])
    )
    found = import_notes(project, path, ("gloss",))
    assert notes(project) == [(range(1), "A"), (range(9, 10), "B")] and found.outside == 1
    assert "2 new notes, 1 outside of the clip ignored" in found.in_words()


def test_notes_lie_where_elan_shows_them_in_the_project_s_video(tmp_path: Path):
    """ELAN skips TIME_ORIGIN of a medium; of two that are linked, the project's counts."""
    path = annotated(tmp_path / "x.eaf", ("gloss", [(0, 2, "HOUSE")]))
    skipped = round(1000 * 4 / RATE)
    media = f'<MEDIA_DESCRIPTOR MEDIA_URL="file:///a/walk.mp4" MIME_TYPE="video/mp4" TIME_ORIGIN="{skipped}"/>'
    media += '<MEDIA_DESCRIPTOR MEDIA_URL="file:///a/other.mp4" MIME_TYPE="video/mp4"/>'
    path.write_text(path.read_text(encoding="utf-8").replace("<PROPERTY", f"{media}<PROPERTY"), encoding="utf-8")
    (tmp_path / "walk.mp4").write_bytes(b"a video")
    clip = replace(sample_clip(10), source=tmp_path / "walk.mp4")
    with Project.create(tmp_path / "walk.tcfit", clip) as project:
        import_notes(project, path)
        assert notes(project) == [(range(4, 7), "HOUSE")]


def test_a_strange_file_s_notes_take_nobody_s_place(project: Project, tmp_path: Path):
    project.append(WriteNote(frames=(1,), text="mine"))
    import_notes(project, annotated(tmp_path / "x.eaf", ("Notes", [(1, 1, "theirs")])))
    assert notes(project) == [(range(1, 2), "mine"), (range(1, 2), "theirs")]


REFUSED = {
    "no such tier": (("eyes", [(1, 1, "x")]), ("gaze",), "has no tier 'gaze'; expected some of eyes"),
    "nothing": (("eyes", []), (), "has no annotations in this clip's frames"),
    "far away": (("eyes", [(100, 120, "x")]), (), "has no annotations in this clip's frames"),
    "too long": (("eyes", [(1, 1, "x" * (NOTE_CHARACTERS + 1))]), (), "2,001 characters; expected 2,000 at most"),
    "too many": (("eyes", [(1, 1, "x")] * 20_001), (), "has 20,001 annotations; expected 20,000 at most at a time"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(project: Project, tmp_path: Path, name: str):
    tier, wished, says = REFUSED[name]
    with pytest.raises(InputError, match=says):
        import_notes(project, annotated(tmp_path / "x.eaf", tier), wished)
    assert not project.log


def test_the_command(folder: Path, exported: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["import", str(folder), str(exported)]) == 0
    assert "0 new notes, 2 already present" in capsys.readouterr().out
    assert main(["import", str(folder), str(exported), "--person", "1"]) == 2
    assert "--person: has no meaning for" in capsys.readouterr().err
    assert main(["import", str(folder), str(tmp_path / "fit.npz"), "--tiers", "x"]) == 2
    assert "has no tiers" in capsys.readouterr().err


def test_the_panel_takes_a_file_of_the_browser(panel_server: viser.ViserServer, project: Project, tmp_path: Path):
    waiting: list[Callable[[], None]] = []
    path = annotated(tmp_path / "x.eaf", ("gloss", [(0, 2, "HOUSE")]), ("eyes", [(1, 1, "blink")]))
    with lone_page(panel_server, project, waiting.append) as tested:
        tested.field("Tiers").value = " gloss, "
        upload = tested.field("Upload an .eaf file")
        upload._impl.value = viser.UploadedFile(name="x.eaf", content=path.read_bytes())
        tested.call_back(upload, MagicMock())
        for command in waiting:
            command()
        deadline = time.monotonic() + 20
        while not project.notes and time.monotonic() < deadline:
            tested.page.tab.session.take_news()
            time.sleep(0.02)
    assert notes(project) == [(range(3), "HOUSE")]
