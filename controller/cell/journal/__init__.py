"""The journal: what the cell did, append-only in SQLite, from the first event on.

Rows are chained by hash, so that a changed row is noticed. A head beside the file (`_head.py`)
names the last row known to be on the disk, so that rows cut off the end are noticed.
`open_cell_journal` checks both before a run may write. ADR 16 lists what it can and cannot notice.
`rows` defines what each row says.
"""

from ._care import CellJournal, first_flaw, open_cell_journal
from ._form import JOURNAL_NAME, JournalError, Row, RowKind
from ._migrations import SCHEMA_VERSION
from ._reader import (
    BrokenRow,
    broken_rows,
    first_broken_row,
    read_rows,
    read_rows_named,
    read_rows_of_kinds,
)
from ._writer import Journal
from .rows import Body, Once, is_of, is_once, read_row
from .stamps import HOST_STAMPS, Stamps

__all__ = [
    "HOST_STAMPS",
    "JOURNAL_NAME",
    "SCHEMA_VERSION",
    "Body",
    "BrokenRow",
    "CellJournal",
    "Journal",
    "JournalError",
    "Once",
    "Row",
    "RowKind",
    "Stamps",
    "broken_rows",
    "first_broken_row",
    "first_flaw",
    "is_of",
    "is_once",
    "open_cell_journal",
    "read_row",
    "read_rows",
    "read_rows_named",
    "read_rows_of_kinds",
]
