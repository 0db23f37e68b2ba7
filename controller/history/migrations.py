"""What has changed in the store's tables from version to version, and how it is brought up.

A step may ask for the journals to be read once more, where new tables take what was not kept.
What is in the store stays meanwhile: journals that are gone cannot be read again.
"""

from collections.abc import Callable
from typing import Final

from sqlalchemy import Connection, update

from controller.cell.journal import GENESIS

from .tables import ALARMS, JOURNALS, RECOVERIES, STEPS, VERSION


def _with_steps(db: Connection) -> None:
    """Add steps, recoveries and alarms; earlier parts get theirs as the journals are read again."""
    for table in (STEPS, RECOVERIES, ALARMS):
        table.create(db, checkfirst=True)
    db.execute(update(JOURNALS).values(last_seq=0, last_hash=GENESIS))


# from each version to the next, from version 1 on
MIGRATIONS: Final[tuple[Callable[[Connection], None], ...]] = (_with_steps,)
SCHEMA_VERSION: Final = 1 + len(MIGRATIONS)


def migrate(db: Connection, version: int) -> None:
    """Bring a store to `SCHEMA_VERSION`; the caller's transaction keeps all or nothing.

    Parameters
    ----------
    db : open for writing
    version : of the store now
    """
    for step in MIGRATIONS[version - 1 :]:
        step(db)
    db.execute(update(VERSION).values(version=SCHEMA_VERSION))
