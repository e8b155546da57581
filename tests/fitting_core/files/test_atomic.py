"""Files that appear whole or not at all."""

from pathlib import Path

import pytest

from fitting_core.files.atomic import LONGEST, replacing


def test_a_file_appears_when_it_is_whole(tmp_path: Path):
    path = tmp_path / "walk.smplx.npz"
    path.write_text("old")
    with replacing(path) as draft:
        draft.write_text("new")
        assert path.read_text() == "old" and draft.suffix == ".npz" and draft.name.startswith(".")
    assert path.read_text() == "new"
    with pytest.raises(KeyboardInterrupt), replacing(path) as draft:
        draft.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]


def test_a_name_may_be_as_long_as_the_system_takes(tmp_path: Path):
    """A draft has a longer name than its file, and a format may write its file in a draft of its own."""
    stems = ["走" * 83 + "a", "走" * 83 + "b"]
    one, other = (tmp_path / f"{stem}.mp4" for stem in stems)
    assert len(one.name.encode()) == LONGEST - 1
    with replacing(one) as a, replacing(other) as b, replacing(a) as inner:
        assert len({a, b, inner}) == 3 and {path.suffix for path in (a, b, inner)} == {".mp4"}
        for path, text in ((inner, "one"), (b, "other")):
            path.write_text(text)
    assert one.read_text() == "one" and other.read_text() == "other" and len(list(tmp_path.iterdir())) == 2


def test_a_name_that_is_too_long_is_refused_at_once(tmp_path: Path):
    with pytest.raises(OSError, match="too long"), replacing(tmp_path / ("x" * 256)) as draft:
        draft.write_text("")
