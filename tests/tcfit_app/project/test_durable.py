"""Files and transactions of a project: on the disk when they should be, and one at a time."""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tcfit_app.project.storage.database import NAME, Database
from tcfit_app.project.storage.durable import durable


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Database]:
    Database.create(tmp_path / NAME)
    made = Database(tmp_path / NAME, read_only=False)
    yield made
    made.close()


def test_a_files_content_is_on_the_disk_before_its_name_and_its_name_when_it_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path, order = tmp_path / "detections.npz", []
    fsync, replace = os.fsync, os.replace

    def noted(descriptor: int) -> None:
        found = os.fstat(descriptor)
        order.append((found.st_ino, found.st_size) if found.st_size == 1000 else found.st_ino)
        fsync(descriptor)

    def renamed(draft: Path, target: Path) -> None:
        order.append("renamed")
        replace(draft, target)

    monkeypatch.setattr(os, "fsync", noted)
    monkeypatch.setattr(os, "replace", renamed)
    with durable(path) as draft:
        draft.write_bytes(bytes(1000))
    assert order == [(path.stat().st_ino, 1000), "renamed", tmp_path.stat().st_ino]


def test_threads_wait_for_the_end_of_a_transaction(store: Database):
    """Else one would begin inside another's, and read or roll back what that one has not finished."""
    insert = "INSERT INTO edits (time, author, action) VALUES ('', '', '')"

    def other() -> int:
        with store.transaction() as connection:
            connection.execute(insert)
        return len(store.rows("SELECT id FROM edits"))

    with ThreadPoolExecutor(2) as pool:
        with pytest.raises(KeyboardInterrupt), store.transaction() as connection:
            connection.execute(insert)
            began, seen = pool.submit(other), pool.submit(store.rows, "SELECT id FROM edits")
            for waiting in (began, seen):
                with pytest.raises(TimeoutError):
                    waiting.result(0.1)
            raise KeyboardInterrupt
        assert began.result(30) == 1 and len(seen.result(30)) <= 1
