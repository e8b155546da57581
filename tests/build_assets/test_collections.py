"""Which motion capture is trained on, and which is kept apart."""

from dataclasses import dataclass

from build_assets.motion_capture.collections import split

HELD = {"cmu05", "cmu13", "cmu14"}


@dataclass
class Clip:
    """What `split` looks at."""

    subject: str


def test_subjects_are_held_out():
    seen, held = split([Clip(subject) for subject in ("cmu01", "cmu05", "deepmimic", "cmu13", "cmu14")])
    assert [clip.subject for clip in seen] == ["cmu01", "deepmimic"]
    assert {clip.subject for clip in held} == HELD
