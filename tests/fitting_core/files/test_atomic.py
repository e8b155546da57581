"""Files and folders that appear whole or not at all, and what is left of those whose process died."""

import errno
import os
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from fitting_core.files import locking
from fitting_core.files.atomic import LONGEST, drafting, put_folder, replacing, scratch_folder, sweep
from tests.drivers.processes import ended, killed_after, needs_fork, start
from tests.drivers.syncs import recorded_syncs

Report = Callable[[str], None]


def test_a_file_appears_when_it_is_whole(tmp_path: Path):
    path = tmp_path / "walk.smplx.npz"
    path.write_text("old")
    with replacing(path) as draft:
        draft.write_text("new")
        assert path.read_text() == "old" and draft.name == path.name
        assert [found.name[0] for found in tmp_path.iterdir() if found != path] == ["."], "the rest is hidden"
    assert path.read_text() == "new"
    with pytest.raises(KeyboardInterrupt), replacing(path) as draft:
        draft.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]


def test_a_name_may_be_as_long_as_the_system_takes(tmp_path: Path):
    """A draft lies in a folder of a longer name, and a format may write its file in a draft of its own."""
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
    assert not list(tmp_path.iterdir())


def test_two_who_write_to_the_same_place_do_not_meet(tmp_path: Path):
    path = tmp_path / "a.txt"
    with replacing(path) as one, replacing(path) as other:
        one.write_text("one")
        other.write_text("other")
        assert one != other and one.read_text() == "one"
    assert path.read_text() == "one", "who ends last"
    assert list(tmp_path.iterdir()) == [path]


def test_content_is_on_the_disk_before_its_name_and_the_name_when_it_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    file, folder = tmp_path / "a.txt", tmp_path / "walk"
    with recorded_syncs(monkeypatch) as syncs:
        with replacing(file) as draft:
            draft.write_text("a" * 1000)
        syncs.check(file)
        for _ in range(2):  # the second time it takes the place of the first
            with drafting(folder) as draft:
                (draft / "inner").mkdir(parents=True)
                (draft / "inner" / "b.txt").write_text("b")
                put_folder(draft, folder)
            syncs.check(folder)


# --- what dead processes leave ---


@contextmanager
def _file(path: Path) -> Iterator[None]:
    with replacing(path) as draft:
        draft.write_text("half")
        yield


@contextmanager
def _folder(path: Path) -> Iterator[None]:
    with drafting(path) as draft:
        (draft / "inner").mkdir(parents=True)
        (draft / "inner" / "a.txt").write_text("half")
        yield
        put_folder(draft, path)


@contextmanager
def _scratch(path: Path) -> Iterator[None]:
    with scratch_folder() as folder:
        (folder / "a.txt").write_text("half")
        yield


KINDS = {"file": _file, "folder": _folder, "temporary folder": _scratch}


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the system's temporary files lie."""
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@needs_fork
@pytest.mark.parametrize("kind", KINDS)
def test_what_a_dead_process_left_is_gone_after_the_next(kind: str, temporary: Path, tmp_path: Path):
    path = tmp_path / "walk"

    def work(report: Report) -> None:
        with KINDS[kind](path):
            report("writing")
            signal.pause()

    assert killed_after(0, work) == ["writing"]
    left = [entry for entry in (*tmp_path.iterdir(), *temporary.iterdir()) if entry != temporary]
    assert len(left) == 1 and not path.exists()
    with KINDS[kind](path):
        assert not list(left[0].rglob("a.txt")) or kind != "temporary folder"
    assert {*tmp_path.iterdir()} - {temporary} <= {path} and not list(temporary.iterdir())


@needs_fork
@pytest.mark.parametrize("kind", KINDS)
def test_what_a_running_process_writes_is_left_alone(kind: str, temporary: Path, tmp_path: Path):
    path, go_on = tmp_path / "walk", os.pipe()

    def work(report: Report) -> None:
        with KINDS[kind](path):
            report("writing")
            os.read(go_on[0], 1)

    child, source = start(work)
    os.read(source, 1)
    with KINDS[kind](path):
        pass
    sweep(tmp_path)
    os.write(go_on[1], b"\n")
    status, lines = ended(child, source)
    assert status == 0, lines
    assert {*tmp_path.iterdir()} - {temporary} <= {path} and not list(temporary.iterdir())


@needs_fork
def test_what_was_being_replaced_comes_back(tmp_path: Path):
    """Killed between the old folder's last moment in its place and the new one's first."""
    path = tmp_path / "walk"
    with _folder(path):
        pass

    def work(report: Report) -> None:
        Path.rename = _rename_once(report)
        with _folder(path):
            pass

    assert killed_after(10, work) == ["moved"] and not path.exists()
    sweep(tmp_path)
    with pytest.raises(KeyboardInterrupt), _folder(path):
        raise KeyboardInterrupt
    assert (path / "inner" / "a.txt").read_text() == "half" and list(tmp_path.iterdir()) == [path]


def _rename_once(report: Report) -> Callable[[Path, Path], None]:
    def rename(self: Path, target: Path) -> None:
        os.rename(self, target)
        report("moved")
        os.kill(os.getpid(), signal.SIGKILL)

    return rename


@pytest.mark.parametrize("way", ["link", "folder", "file"])
def test_what_others_have_called_so_stays(way: str, tmp_path: Path):
    """A link would lead to a folder that was never a draft; and another program may call its own folder so."""
    theirs, path = tmp_path / "theirs", tmp_path / "walk.npz"
    theirs.mkdir()
    (theirs / "precious.txt").write_text("precious")
    hidden = tmp_path / ".walk.npz.partial"
    if way == "link":
        (theirs / "tcfit-draft.lock").touch()
        hidden.symlink_to(theirs)
    elif way == "folder":
        theirs.rename(hidden)
    else:
        hidden.write_text("precious")
    sweep(tmp_path)
    with replacing(path) as draft:
        draft.write_text("new")
    assert path.read_text() == "new" and hidden.exists()
    kept = [file for file in (hidden / "precious.txt", hidden, theirs / "precious.txt") if file.is_file()]
    assert kept and kept[0].read_text() == "precious"


def test_without_locks_files_are_written_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refused(descriptor: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(locking, "_lock", refused)
    path = tmp_path / "a.txt"
    with replacing(path) as draft:
        draft.write_text("new")
        sweep(tmp_path)
    with scratch_folder() as folder:
        (folder / "a").touch()
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path] and not folder.parent.exists()


def test_a_temporary_folder_of_a_process_that_died_before_it_locked_it_is_gone_after_the_next(temporary: Path):
    (temporary / "tcfit-scratch-abc").mkdir()
    with scratch_folder():
        pass
    assert not list(temporary.iterdir())


def test_a_temporary_folder_that_another_process_sweeps_at_once_is_made_anew(
    temporary: Path, monkeypatch: pytest.MonkeyPatch
):
    """That process locks it before its own does: it has deleted it already, or is about to."""
    made, held = tempfile.mkdtemp, list[int]()

    def swept(prefix: str) -> str:
        folder = Path(made(prefix=prefix))
        if not held:
            (folder / "tcfit-draft.lock").touch()
            held.append(os.open(folder / "tcfit-draft.lock", os.O_RDWR))
            assert locking.try_lock(held[0])
        elif len(held) == 1:
            folder.rmdir()
            held.append(-1)
        return str(folder)

    monkeypatch.setattr(tempfile, "mkdtemp", swept)
    with scratch_folder() as folder:
        (folder / "a").touch()
    os.close(held[0])
    with scratch_folder():
        pass
    assert not list(temporary.iterdir())


def test_a_users_own_temporary_folder_stays(temporary: Path):
    mine = temporary / "tcfit-of-mine"
    mine.mkdir()
    for name in ("lock", "precious.txt"):
        (mine / name).write_text("precious")
    with scratch_folder():
        pass
    assert sorted(file.name for file in mine.iterdir()) == ["lock", "precious.txt"]
