"""The writing of rows: the file's table, by version, and the thread that writes in order."""

from ._migrations import MIGRATIONS, SCHEMA_VERSION, migrate
from .thread import BUSY_WALL_S, PATIENCE_WALL_S, PendingRow, WriterThread

__all__ = [
    "BUSY_WALL_S",
    "MIGRATIONS",
    "PATIENCE_WALL_S",
    "SCHEMA_VERSION",
    "PendingRow",
    "WriterThread",
    "migrate",
]
