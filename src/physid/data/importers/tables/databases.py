"""Databases of SQLite from strangers: what a reader asks of them comes from tables that hold it, and runs nothing."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing
from pathlib import Path

HELD = re.compile(r"CREATE (TABLE|INDEX|UNIQUE INDEX) ")
"""How SQLite writes what holds rows; a view, a trigger or a virtual table is run when it is asked, perhaps for ever."""
PARTS_OF_ADDRESSES = "?#%"


class UnsoundDatabaseError(ValueError):
    """A database that computes what it should hold, or cannot be opened."""


def require_plain_tables(path: Path) -> None:
    """Refuse a database that has more than tables and indices.

    Its list of tables is read, and no row of any other.

    Raises:
        UnsoundDatabaseError: If it has, or is damaged, or its path would be read as another one.
    """
    strange = next((sign for sign in PARTS_OF_ADDRESSES if sign in str(path)), None)
    if strange:
        raise UnsoundDatabaseError(
            f"{path}: expected a path without {strange}, which has a meaning to SQLite; rename the file"
        )
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
            made = database.execute("SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL").fetchall()
            found = [name for name, sql in made if not HELD.match(str(sql))]
            for name, _ in made:
                columns = database.execute("SELECT name, hidden FROM pragma_table_xinfo(?)", (name,))
                found += [f"{name}.{column}" for column, hidden in columns if hidden]
    except sqlite3.Error as error:
        raise UnsoundDatabaseError(f"{path}: expected a bag of ROS, found what cannot be read ({error})") from None
    if found:
        raise UnsoundDatabaseError(
            f"{path}: expected tables that hold what was recorded, found {str(found[0])!r}, which computes it when it "
            "is read; convert the bag where you trust it (ros2 bag convert)"
        )
