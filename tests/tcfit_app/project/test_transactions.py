"""Transactions of a project: one at a time."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tcfit_app.project.storage.database import NAME, Database


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Database]:
    Database.create(tmp_path / NAME)
    made = Database(tmp_path / NAME, read_only=False)
    yield made
    made.close()


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
