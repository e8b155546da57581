"""ELAN's files: written by the rules of its schema, read by another program, and back; files of ELAN's own kinds."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pympi.Elan import Eaf

from fitting_core.errors import InputError
from fitting_core.io.eaf import Annotation, Tier, frames_of, milliseconds_of, read_eaf, write_eaf

WORDS = {"hold": "It stays", "move": 'It <moves> & "turns"'}
TIERS = (
    Tier(name="Notes", kind="note", annotations=(Annotation(start=0, end=40, text="a <b> & ü\nこ"),)),
    Tier(
        name="Left phase",
        kind="phase",
        annotations=(Annotation(start=0, end=80, text="hold"), Annotation(start=80, end=120, text="move")),
        vocabulary=WORDS,
    ),
    Tier(name="Right phase", kind="phase", annotations=(), vocabulary=WORDS),
    Tier(
        name="Left distance",
        kind="distance",
        annotations=(Annotation(start=0, end=80, text="3°"), Annotation(start=80, end=120, text="4°")),
        parent="Left phase",
    ),
)


@pytest.fixture
def written(tmp_path: Path) -> Path:
    (tmp_path / "a film.mp4").touch()
    write_eaf(tmp_path / "signs.eaf", TIERS, media=tmp_path / "a film.mp4")
    return tmp_path / "signs.eaf"


def test_it_is_written_as_before(written: Path):
    """`signs.eaf` keeps the rules of EAFv3.0.xsd: elements in their order, required attributes, references and ids.
    Whoever changes it checks that ELAN opens it."""
    text = re.sub(r'(?<= DATE=")[^"]+', "", written.read_text(encoding="utf-8"))
    expected = Path(__file__).with_name("signs.eaf").read_text(encoding="utf-8")
    assert text.replace(written.parent.as_uri(), "file:///films") == expected


def test_another_program_reads_the_same(written: Path):
    eaf = Eaf(str(written))
    assert list(eaf.get_tier_names()) == [tier.name for tier in TIERS]
    assert eaf.get_annotation_data_for_tier("Left phase") == [(0, 80, "hold"), (80, 120, "move")]
    assert [a[:3] for a in eaf.get_ref_annotation_data_for_tier("Left distance")] == [(0, 80, "3°"), (80, 120, "4°")]
    assert [entry[0][0][0] for entry in eaf.get_cv_entries("phase").values()] == list(WORDS)
    (linked,) = eaf.get_linked_files()
    assert linked["RELATIVE_MEDIA_URL"] == "./a%20film.mp4" and linked["MIME_TYPE"] == "video/mp4"
    assert linked["MEDIA_URL"] == (written.parent / "a film.mp4").as_uri()


def test_it_comes_back(written: Path):
    back = read_eaf(written)
    assert [(t.name, t.annotations, t.parent) for t in back] == [(t.name, t.annotations, t.parent) for t in TIERS]


def test_what_xml_cannot_have_is_replaced(tmp_path: Path):
    text = "bell \x07 null \x00 half \ud800 end"
    write_eaf(tmp_path / "x.eaf", [Tier(name="N", kind="n", annotations=(Annotation(start=0, end=1, text=text),))])
    (tier,) = read_eaf(tmp_path / "x.eaf")
    assert tier.annotations[0].text == "bell � null � half � end"


def test_another_program_s_file(tmp_path: Path):
    eaf = Eaf(author="me")
    eaf.add_tier("gloss")
    eaf.add_linguistic_type("child", constraints="Symbolic_Association", timealignable=False)
    eaf.add_tier("meaning", ling="child", parent="gloss")
    eaf.add_annotation("gloss", 500, 900, "HOUSE")
    eaf.add_ref_annotation("meaning", "gloss", 600, "a house")
    eaf.to_file(str(tmp_path / "other.eaf"))
    by_name = {tier.name: tier for tier in read_eaf(tmp_path / "other.eaf")}
    assert by_name["gloss"].annotations == (Annotation(start=500, end=900, text="HOUSE"),)
    assert by_name["meaning"].annotations == (Annotation(start=500, end=900, text="a house"),)


def file_with(*tiers: str, slots: str = "", units: str = "milliseconds") -> str:
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><ANNOTATION_DOCUMENT><HEADER TIME_UNITS="{units}"/><TIME_ORDER>{slots}'
        f"</TIME_ORDER>{''.join(tiers)}</ANNOTATION_DOCUMENT>"
    )


def slot(name: str, time: int | None) -> str:
    return f'<TIME_SLOT TIME_SLOT_ID="{name}"' + (f' TIME_VALUE="{time}"/>' if time is not None else "/>")


def aligned(name: str, first: str, second: str) -> str:
    ends = f'TIME_SLOT_REF1="{first}" TIME_SLOT_REF2="{second}"'
    value = f"<ANNOTATION_VALUE>{name}</ANNOTATION_VALUE>"
    return (
        f'<ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="{name}" {ends}>{value}</ALIGNABLE_ANNOTATION></ANNOTATION>'
    )


def referring(name: str, parent: str, previous: str = "") -> str:
    before = f' PREVIOUS_ANNOTATION="{previous}"' if previous else ""
    value = f"<ANNOTATION_VALUE>{name}</ANNOTATION_VALUE>"
    held = f'<REF_ANNOTATION ANNOTATION_ID="{name}" ANNOTATION_REF="{parent}"{before}>{value}</REF_ANNOTATION>'
    return f"<ANNOTATION>{held}</ANNOTATION>"


def tier(name: str, *annotations: str) -> str:
    return f'<TIER TIER_ID="{name}" LINGUISTIC_TYPE_REF="x">{"".join(annotations)}</TIER>'


SLOTS = slot("t1", 100) + slot("t2", None) + slot("t3", None) + slot("t4", 700)


def test_times_that_only_follow_from_others(tmp_path: Path):
    """Slots without a time between two that have one; words of a sentence, in their order; their meanings."""
    parts = tier("parts", aligned("p1", "t1", "t2"), aligned("p2", "t2", "t3"), aligned("p3", "t3", "t4"))
    sentence = tier("sentence", aligned("s", "t1", "t4"))
    words = tier("words", referring("w2", "s", "w1"), referring("w1", "s"))
    meanings = tier("meanings", referring("m2", "w2"), referring("m1", "w1"))
    path = tmp_path / "x.eaf"
    path.write_text(file_with(meanings, words, parts, sentence, slots=SLOTS))
    found = {t.name: [(a.start, a.end, a.text) for a in t.annotations] for t in read_eaf(path)}
    assert found["parts"] == [(100, 300, "p1"), (300, 500, "p2"), (500, 700, "p3")]
    assert found["words"] == [(100, 400, "w1"), (400, 700, "w2")]
    assert found["meanings"] == [(100, 400, "m1"), (400, 700, "m2")]


BOMB = '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><ANNOTATION_DOCUMENT>&b;</ANNOTATION_DOCUMENT>'
BROKEN = {
    "no XML": ("walk", "syntax error"),
    "cut off": (file_with(tier("x"))[:-12], "no element found|unclosed"),
    "a document type": (BOMB, "has a document type"),
    "another document": ("<html/>", "outermost element is <html>"),
    "frames": (file_with(units="PAL-frames"), "times are in PAL-frames"),
    "no slot": (file_with(tier("x", aligned("a1", "t1", "t9")), slots=SLOTS), "time slot t9, which is not there"),
    "no time": (file_with(tier("x", aligned("a1", "t1", "t2")), slots=SLOTS), "a1 has no time"),
    "a negative time": (file_with(slots='<TIME_SLOT TIME_SLOT_ID="t" TIME_VALUE="-1"/>'), "'-1', expected whole"),
    "back in time": (file_with(tier("x", aligned("a1", "t4", "t1")), slots=SLOTS), "a1 ends before it starts"),
    "no parent": (file_with(tier("x", referring("a1", "a7"))), "belongs to a7, which has no time"),
    "a circle": (file_with(tier("x", referring("a1", "a2"), referring("a2", "a1"))), "has no time"),
    "no id": (file_with('<TIER LINGUISTIC_TYPE_REF="x"/>'), "<TIER> has no TIER_ID"),
    "no annotation": (file_with(tier("x", "<ANNOTATION/>")), "holds .*, expected one of"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files(tmp_path: Path, name: str):
    content, says = BROKEN[name]
    path = tmp_path / "broken.eaf"
    path.write_text(content)
    with pytest.raises(InputError, match=rf"broken\.eaf: is not a readable \.eaf file: .*({says})"):
        read_eaf(path)


@given(
    st.integers(0, 10**6), st.integers(1, 5000), st.sampled_from([12.5, 23.976, 24, 25, 29.97, 30, 50, 59.94, 120, 240])
)
def test_frames_come_back_from_their_time(first: int, count: int, rate: float):
    frames = range(first, first + count)
    assert frames_of(*milliseconds_of(frames, rate), rate) == frames


def linked(path: Path, *media: tuple[str, str, str]) -> Path:
    """A file with an annotation from 1000 to 1400 ms, and media: file, kind, and where ELAN lets it begin."""
    write_eaf(path, [Tier(name="gloss", kind="any", annotations=(Annotation(start=1000, end=1400, text="SIGN"),))])
    links = "".join(
        f'<MEDIA_DESCRIPTOR MEDIA_URL="file:///a/{name}" MIME_TYPE="{kind}" {origin}/>' for name, kind, origin in media
    )
    content = path.read_text(encoding="utf-8")
    path.write_text(content.replace("<PROPERTY", f"{links}<PROPERTY"), encoding="utf-8")
    return path


def starts(path: Path, video: str = "walk.mp4") -> int:
    return read_eaf(path, video)[0].annotations[0].start


LATER, SOONER = 'TIME_ORIGIN="2000"', 'TIME_ORIGIN="-500"'
ORIGINS = {
    "one": ([("walk.mp4", "video/mp4", LATER)], 3000),
    "none": ([("walk.mp4", "video/mp4", "")], 1000),
    "before the video": ([("walk.mp4", "video/mp4", SOONER)], 500),
    "of another name": ([("moved.mp4", "video/mp4", LATER)], 3000),
    "sound from elsewhere": ([("walk2.wav", "audio/x-wav", SOONER), ("moved.mp4", "video/mp4", LATER)], 3000),
    "two cameras": ([("front.mp4", "video/mp4", ""), ("my%20Walk.mpg", "video/mpeg", LATER)], 3000),
}


@pytest.mark.parametrize("name", ORIGINS)
def test_times_are_those_of_the_video(tmp_path: Path, name: str):
    media, start = ORIGINS[name]
    assert starts(linked(tmp_path / "x.eaf", *media), "my walk.mp4" if name == "two cameras" else "walk.mp4") == start
