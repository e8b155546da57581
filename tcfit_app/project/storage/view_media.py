"""Where the videos of other views are: a table of links by the id of the edit that added the view."""

import sqlite3

import msgspec

from tcfit_app.project.storage.clip_review import Rows
from tcfit_app.project.storage.columns import Columns, Count, Damage, json_of, of
from tcfit_app.project.storage.database import WITH_VIEWS
from tcfit_app.project.storage.media import MediaLink


def view_links(rows: Rows, damage: Damage) -> dict[int, MediaLink]:
    """The links in a database of any version; those of damaged rows are left out."""
    if rows("PRAGMA user_version")[0][0] < WITH_VIEWS:
        return {}
    found = (damage.read(row, f"the video of view {row['edit']}", _link) for row in rows("SELECT * FROM views"))
    return dict(one for one in found if one is not None)


def _link(row: Columns) -> tuple[int, MediaLink]:
    return row.read("edit", of(Count)), row.read("media", json_of(MediaLink))


def store_view_link(connection: sqlite3.Connection, view: int, link: MediaLink) -> None:
    """Store where a view's video is, in a transaction."""
    values = view, msgspec.json.encode(link).decode()
    connection.execute("INSERT OR REPLACE INTO views VALUES (?, ?)", values)
