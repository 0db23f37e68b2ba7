"""The changes of the store's tables from version to version, and the migrations.

A step may have the journals read once more, to fill new tables with data that was not kept. The
content of the store stays meanwhile: journals that are gone cannot be read again.
"""

from collections.abc import Callable
from typing import Any, Final

from sqlalchemy import Column, Connection, MetaData, inspect, text, update
from sqlalchemy.schema import CreateColumn

from controller.cell.journal import GENESIS

from .tables import (
    ALARMS,
    FINDINGS,
    JOURNALS,
    PARTS,
    PICTURES,
    RECOVERIES,
    REJUDGED,
    REVIEWS,
    RUNS,
    SENTENCES,
    STEPS,
    VERSION,
)


def _with_steps(db: Connection) -> None:
    """Add steps, recoveries and alarms; earlier parts get theirs as the journals are read again."""
    for table in (STEPS, RECOVERIES, ALARMS):
        table.create(db, checkfirst=True)
    db.execute(update(JOURNALS).values(last_seq=0, last_hash=GENESIS))


def _with_reviews(db: Connection) -> None:
    """Add nests and persons' verdicts; parts whose journal is gone have none."""
    REVIEWS.create(db, checkfirst=True)
    _add(db, PARTS.c.nest, PARTS.c.awaits_review, PARTS.c.review, FINDINGS.c.review)


def _with_followed(db: Connection) -> None:
    """Mark parts whose record is in another run; those whose journal is gone all count."""
    _add(db, PARTS.c.is_counted, PARTS.c.followed_by)


def _with_orders(db: Connection) -> None:
    """Add the number of each part's order; parts whose journal is gone have none."""
    _add(db, PARTS.c.order_number)


def _with_cells(db: Connection) -> None:
    """Make runs unique by cell and id: two cells may start one recipe in one millisecond."""
    known = inspect(db).get_unique_constraints(RUNS.name)
    if not any(one["column_names"] == ["run_id"] for one in known):
        return
    if db.dialect.name != "sqlite":
        for one in known:
            db.execute(text(f"ALTER TABLE {RUNS.name} DROP CONSTRAINT {one['name']}"))
        db.execute(
            text(f"ALTER TABLE {RUNS.name} ADD CONSTRAINT runs_of_cell UNIQUE (run_id, cell)")
        )
        return
    # SQLite drops no constraint: the rows go into a table without it, which takes the name
    there = [one["name"] for one in inspect(db).get_columns(RUNS.name)]
    apart = MetaData()
    JOURNALS.to_metadata(apart)  # which it names
    new = RUNS.to_metadata(apart, name=f"{RUNS.name}_new")
    new.create(db)
    names = ", ".join(f'"{name}"' for name in there)
    # names of our own tables and columns alone
    copied = f"INSERT INTO {new.name} ({names}) SELECT {names} FROM {RUNS.name}"  # nosec B608
    db.execute(text(copied))
    db.execute(text(f"DROP TABLE {RUNS.name}"))
    db.execute(text(f"ALTER TABLE {new.name} RENAME TO {RUNS.name}"))


def _with_rejudged(db: Connection) -> None:
    """Add what was judged anew; there is none yet."""
    REJUDGED.create(db, checkfirst=True)


def _with_pictures(db: Connection) -> None:
    """Add what pictures there are, and where copies of them; none where a journal is gone."""
    PICTURES.create(db, checkfirst=True)
    _add(db, RUNS.c.copied_to)


def _with_sentences(db: Connection) -> None:
    """Add keys and values of sentences; those whose journal has none stay English."""
    SENTENCES.create(db, checkfirst=True)
    _add(db)


def _add(db: Connection, *columns: Column[Any]) -> None:
    """Add columns, the indexes that have all theirs, and have the journals read once more."""
    for column in columns:
        if column.name in {one["name"] for one in inspect(db).get_columns(column.table.name)}:
            continue
        words = CreateColumn(column).compile(dialect=db.dialect)
        db.execute(text(f"ALTER TABLE {column.table.name} ADD COLUMN {words}"))
    known = {one["name"] for one in inspect(db).get_columns(PARTS.name)}
    for index in PARTS.indexes:
        if {column.name for column in index.columns} <= known:  # a later step has the others
            index.create(db, checkfirst=True)
    db.execute(update(JOURNALS).values(last_seq=0, last_hash=GENESIS))


# steps from each version to the next, from version 1 on
MIGRATIONS: Final[tuple[Callable[[Connection], None], ...]] = (
    _with_steps,
    _with_reviews,
    _with_followed,
    _with_orders,
    _with_cells,
    _with_rejudged,
    _with_pictures,
    _with_sentences,
)
SCHEMA_VERSION: Final = 1 + len(MIGRATIONS)


def migrate(db: Connection, version: int) -> None:
    """Bring a store to `SCHEMA_VERSION`; the caller's transaction keeps all or nothing.

    Parameters
    ----------
    db : open for writing
    version : version of the store now
    """
    for step in MIGRATIONS[version - 1 :]:
        step(db)
    db.execute(update(VERSION).values(version=SCHEMA_VERSION))
