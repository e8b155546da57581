"""project.sqlite: its tables, their versions, and durable transactions."""

import os
import re
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import chain, repeat
from pathlib import Path
from typing import Any, Literal

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from tcfit_app.project.storage.columns import Damage

NAME = "project.sqlite"
_APPLICATION = int.from_bytes(b"tcft")
"""In the file's header: distinguishes a project from other SQLite databases."""


def _first_tables(connection: sqlite3.Connection) -> None:
    connection.execute("""
        CREATE TABLE clip (
            id INTEGER PRIMARY KEY CHECK (id = 1), name TEXT NOT NULL, created TEXT NOT NULL,
            frame_rate REAL NOT NULL, first_frame INTEGER NOT NULL, camera TEXT NOT NULL, notes TEXT NOT NULL,
            media TEXT, detections_sha256 TEXT NOT NULL
        )""")
    connection.execute("""
        CREATE TABLE edits (
            id INTEGER PRIMARY KEY AUTOINCREMENT, time TEXT NOT NULL, author TEXT NOT NULL, action TEXT NOT NULL
        )""")
    for change in ("UPDATE", "DELETE"):
        connection.execute(f"""
            CREATE TRIGGER edits_no_{change.lower()} BEFORE {change} ON edits
            BEGIN SELECT RAISE(ABORT, 'the log of edits is only ever added to'); END""")
    connection.execute("""
        CREATE TABLE runs (
            id INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, state TEXT NOT NULL, config TEXT NOT NULL,
            body TEXT NOT NULL, parent INTEGER, first_frame INTEGER, last_frame INTEGER, edits_seen INTEGER NOT NULL,
            started TEXT NOT NULL, ended TEXT, summary TEXT, message TEXT NOT NULL DEFAULT '', deleted TEXT
        )""")


def _review_marks(connection: sqlite3.Connection) -> None:
    connection.execute("""
        CREATE TABLE marks (
            frame INTEGER PRIMARY KEY, state TEXT NOT NULL, reason TEXT NOT NULL, time TEXT NOT NULL,
            author TEXT NOT NULL
        )""")


def _kinds_of_runs(connection: sqlite3.Connection) -> None:
    connection.execute("ALTER TABLE runs ADD COLUMN kind TEXT NOT NULL DEFAULT 'fit'")


def _order_of_marks(connection: sqlite3.Connection) -> None:
    """What precedes a mark, as numbers, because clocks can be set back. Older projects have only times."""
    connection.execute("ALTER TABLE runs ADD COLUMN moment INTEGER NOT NULL DEFAULT 0")
    for column in ("last_edit", "last_moment"):
        connection.execute(f"ALTER TABLE marks ADD COLUMN {column} INTEGER NOT NULL DEFAULT 0")
    connection.execute("""
        UPDATE runs SET moment = (
            SELECT count(*) FROM runs AS r WHERE coalesce(r.ended, r.started) <= coalesce(runs.ended, runs.started)
        )""")
    connection.execute("""
        UPDATE marks SET
            last_edit = (SELECT coalesce(max(id), 0) FROM edits WHERE edits.time <= marks.time),
            last_moment = (SELECT count(*) FROM runs WHERE coalesce(ended, started) <= marks.time)""")


def _given_starts(connection: sqlite3.Connection) -> None:
    """The start and shape that a run was given; NULL: none, as in all older projects."""
    connection.execute("ALTER TABLE runs ADD COLUMN given TEXT")


def _height(connection: sqlite3.Connection) -> None:
    """The person's height in centimetres; NULL: unknown."""
    connection.execute("ALTER TABLE clip ADD COLUMN height REAL")


def _review_of_the_clip(connection: sqlite3.Connection) -> None:
    connection.execute("""
        CREATE TABLE review (
            id INTEGER PRIMARY KEY CHECK (id = 1), approved TEXT, approved_by TEXT NOT NULL DEFAULT '',
            last_edit INTEGER NOT NULL DEFAULT 0, last_moment INTEGER NOT NULL DEFAULT 0, note TEXT NOT NULL DEFAULT '',
            worst TEXT
        )""")
    connection.execute("INSERT INTO review (id) VALUES (1)")


def _other_views(connection: sqlite3.Connection) -> None:
    """Where the videos of other views are, by the id of the edit that added the view."""
    connection.execute("CREATE TABLE views (edit INTEGER PRIMARY KEY, media TEXT NOT NULL)")


MIGRATIONS: tuple[Callable[[sqlite3.Connection], None], ...] = (
    _first_tables,
    _review_marks,
    _kinds_of_runs,
    _order_of_marks,
    _given_starts,
    _height,
    _review_of_the_clip,
    _other_views,
)
"""MIGRATIONS[n] upgrades version n to n + 1. Append only: projects of all versions exist."""
WITH_KINDS = MIGRATIONS.index(_kinds_of_runs) + 1
"""The version from which on runs have kinds."""
WITH_REVIEW = MIGRATIONS.index(_review_of_the_clip) + 1
"""That from which on there is a review of the clip."""
WITH_VIEWS = MIGRATIONS.index(_other_views) + 1
"""That from which on there are other views."""


def read_only_refusal(folder: Path) -> str:
    """The message for any change to a project that is open read-only."""
    return (
        f"{folder}: is open read-only, because another tcfit has it open or --read-only was given. "
        "Close the other one and open it again without the option."
    )


def is_project(path: Path) -> bool:
    """Whether a path is a project folder."""
    return (path / NAME).is_file()


_OF_A_VALUE = re.compile(r"(NULL|NUMERIC|TEXT|BLOB) value in |CHECK constraint failed in ")
"""How quick_check reports values that do not mean damage to the file."""
_DAMAGED = "is damaged ({}). Restore it from a backup; the fits in runs and detections.npz can be read without it"
_UNWRITABLE = "cannot be written ({}). Free space or allow writing there; what was stored before is still there"
_REASONS = {
    "SQLITE_CORRUPT": _DAMAGED,
    "SQLITE_ERROR": _DAMAGED,
    "SQLITE_NOTADB": _DAMAGED,
    "SQLITE_TOOBIG": _DAMAGED,
    "SQLITE_INTERRUPT": _DAMAGED,
    "SQLITE_FULL": _UNWRITABLE,
    "SQLITE_IOERR": _UNWRITABLE,
    "SQLITE_READONLY": _UNWRITABLE,
    "SQLITE_PERM": _UNWRITABLE,
    "SQLITE_CANTOPEN": "cannot be opened ({}). Allow reading it, and writing in its folder; or copy that folder to "
    "a writable place, and open the copy",
    "SQLITE_BUSY": "is in use by another program ({}). Close it and try again",
}
"""By SQLite's primary result code: what is wrong, and what to do. ERROR is a missing table or column."""


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Turns SQLite's errors caused by files, not by our code, into InputErrors."""
    try:
        yield
    except sqlite3.Error as error:
        code = "_".join((getattr(error, "sqlite_errorname", None) or "").split("_")[:2])
        # Without a code: sqlite3's own errors. OperationalError is text that is not UTF-8; others are bugs.
        reason = _REASONS.get(code) or (_DAMAGED if not code and isinstance(error, sqlite3.OperationalError) else "")
        if not reason:
            raise
        raise InputError(f"{path}: {reason.format(error)}.") from error


class Database:
    """A connection shared by several threads.

    A transaction that has ended without an error survives even a power failure (WAL, synchronous = FULL).
    """

    def __init__(self, path: Path, *, read_only: bool) -> None:
        """Open a project's database, and upgrade it to the current version. Raises InputError if it cannot be opened,
        is damaged, not a project of tcfit, or from a newer tcfit.

        Args:
            path: Of the file.
            read_only: Leave it unchanged; an older version is read as a snapshot of its opening.
        """
        self.path, self.read_only = path, read_only
        self.damage = Damage(path)
        with _explained(path):
            self._connection = _connect(path, "ro" if read_only else "rw")
        try:
            with _explained(path):
                version = _check(path, self._connection)
                if not read_only:
                    _make_durable(self._connection)
                elif version < len(MIGRATIONS):
                    self._read_a_copy()
                _upgrade(self._connection, version)
        except BaseException:
            self._connection.close()
            raise
        self._lock = threading.RLock()

    @staticmethod
    def create(path: Path) -> None:
        """Create a database with empty tables. Raises InputError if it cannot be written."""
        with _explained(path):
            connection = _connect(path, "rwc")
            try:
                connection.execute(f"PRAGMA application_id = {_APPLICATION}")
                _make_durable(connection)
                _upgrade(connection, 0)
            finally:
                connection.close()

    def _read_a_copy(self) -> None:
        """Continue with an upgradable copy in memory."""
        copy = _prepared(sqlite3.connect(":memory:", isolation_level=None, check_same_thread=False))
        self._connection.backup(copy)
        self._connection.close()
        self._connection = copy

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """All changes of the block or none; they are on disk when it ends. Raises InputError if the project is open
        read-only, or its file cannot be written."""
        if self.read_only:
            raise InputError(read_only_refusal(self.path.parent))
        with self._lock, _explained(self.path), _transaction(self._connection):
            yield self._connection

    def rows(self, query: str, *values: Any) -> list[sqlite3.Row]:
        """The rows of a query. Raises InputError if the file is damaged."""
        with self._lock, _explained(self.path):
            return self._connection.execute(query, values).fetchall()

    def close(self) -> None:
        """Merge everything into the one file and close it."""
        with self._lock:
            self._connection.close()


@contextmanager
def glimpse(path: Path) -> Iterator[tuple[sqlite3.Connection, int]]:
    """A connection for a few values of a project that is not opened, and the version of its tables.

    Leaves nothing beside the file, and takes half a millisecond. Raises InputError as `Database`.
    """
    with _explained(path):
        connection = _connect(path, "ro", alone=True)
        connection.set_progress_handler(chain(repeat(0, _MOST_STEPS // _STEPS), repeat(1)).__next__, _STEPS)
        try:
            yield connection, _check(path, connection)
        finally:
            connection.close()


_STEPS, _MOST_STEPS = 10_000, 20_000_000
"""Steps of SQLite's machine between two calls of the progress handler, and in all; 100,000 edits take 10^6."""
_LONGEST = 2**28
"""Bytes of a value. The longest are the paths of moving cameras, 300 bytes a frame."""
_TABLE = re.compile(r"CREATE TABLE (?!.*\b(CHECK|GENERATED|AS)\b)", re.IGNORECASE | re.DOTALL)
_TRIGGER = re.compile(
    r"CREATE TRIGGER edits_no_(\w+) BEFORE (?i:\1) ON edits\s+BEGIN SELECT RAISE\(ABORT, '[^']*'\); END"
)
"""The log's own triggers; earlier versions had another text in them."""


def _check(path: Path, connection: sqlite3.Connection) -> int:
    """The version of the tables. Raises InputError for a database that is damaged, hostile or not known to tcfit."""
    version = _version(path, connection)
    for kind, name, source in connection.execute("SELECT type, name, sql FROM sqlite_master").fetchall():
        # Views, triggers, generated columns and CHECKs may compute for ever, or take any amount of memory.
        own = (
            source is None or _TABLE.match(str(source).replace("CHECK (id = 1)", "")) or _TRIGGER.fullmatch(str(source))
        )
        if not own:
            what = f"contains a {kind} {name!r} that tcfit did not create"
            raise InputError(f"{path}: {_DAMAGED.format(what)}.")
    found = (row[0] for row in connection.execute("PRAGMA quick_check(1000000)"))
    # damaged values are reported when they are read
    if problem := next((text for text in found if text != "ok" and not _OF_A_VALUE.match(text)), ""):
        raise InputError(f"{path}: {_DAMAGED.format(problem)}.")
    return version


def _version(path: Path, connection: sqlite3.Connection) -> int:
    application, version = (
        connection.execute(f"PRAGMA {name}").fetchone()[0] for name in ("application_id", "user_version")
    )
    if application != _APPLICATION:
        raise InputError(f"{path}: is another program's database; expected one made by `tcfit new`.")
    if version > len(MIGRATIONS):
        raise InputError(
            f"{path}: has version {version}, but this tcfit supports versions up to {len(MIGRATIONS)}. A newer tcfit "
            "wrote it: update tcfit."
        )
    return version


def _connect(path: Path, mode: Literal["ro", "rw", "rwc"], *, alone: bool = False) -> sqlite3.Connection:
    """`alone`: no other process is writing, if nothing lies beside the file."""
    for file in (path.with_name(path.name + ending) for ending in ("", "-wal", "-shm", "-journal")):
        with suppress(OSError):  # SQLite reports these
            regular_file(file, most=None)
    options = f"mode={mode}"
    alone = alone or not os.access(path.parent, os.W_OK)
    if mode == "ro" and alone and not path.with_name(f"{path.name}-wal").exists():
        options = "immutable=1"  # otherwise SQLite needs a second file even for reading
    uri = f"{path.resolve().as_uri()}?{options}"
    connection = sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False)
    try:
        _prepared(connection)
        connection.execute("PRAGMA user_version").fetchone()
    except BaseException:
        connection.close()
        raise
    return connection


def _prepared(connection: sqlite3.Connection) -> sqlite3.Connection:
    connection.row_factory = sqlite3.Row
    connection.text_factory = _text
    # the project may be untrusted
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST)
    return connection


def _text(content: bytes) -> str | bytes:
    """Text that is not UTF-8 stays bytes, and is reported as damaged when read."""
    try:
        return content.decode()
    except UnicodeDecodeError:
        return content


def _make_durable(connection: sqlite3.Connection) -> None:
    """For a database known to be ours, because this writes into its header."""
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("PRAGMA fullfsync = ON")  # on macOS, plain fsync leaves data in the drive's cache


def _upgrade(connection: sqlite3.Connection, version: int) -> None:
    for number, migration in enumerate(MIGRATIONS[version:], version + 1):
        with _transaction(connection):
            migration(connection)
            connection.execute(f"PRAGMA user_version = {number}")


@contextmanager
def _transaction(connection: sqlite3.Connection) -> Iterator[None]:
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        # After some errors, such as a full disk, SQLite has already rolled back.
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise
