"""The changes of a journal's file from version to version, and the migration of older ones.

A migration adds to the file and changes no row: the hashes that chain the rows stay true, and
`cellctl verify` gives the same answer before and after. The version is SQLite's ``user_version``.
"""

import sqlite3
from typing import Final

from .._form import SCHEMA

# From each version to the next. Version 0 is the table of version 1, before it was numbered.
MIGRATIONS: Final = (
    SCHEMA,
    # a start folds custody and intents of all runs, a small share of a long journal
    "CREATE INDEX IF NOT EXISTS journal_kind ON journal (kind, seq);",
)
SCHEMA_VERSION: Final = len(MIGRATIONS)


def migrate(db: sqlite3.Connection, version: int) -> None:
    """Bring a journal to `SCHEMA_VERSION`, all or nothing.

    Parameters
    ----------
    db : open for writing, in autocommit mode
    version : version of the file now
    """
    steps = "".join(MIGRATIONS[version:])
    try:
        db.executescript(f"BEGIN IMMEDIATE; {steps} PRAGMA user_version = {SCHEMA_VERSION};")
        db.execute("COMMIT")
    except BaseException:
        if db.in_transaction:
            db.execute("ROLLBACK")
        raise
