"""The journal of the cell's work: append-only in SQLite, from the first event on.

Rows are chained by hash, so that a changed row is noticed. A head beside the file (`_head.py`)
names the last row known to be on the disk, so that rows cut off the end are noticed.
`open_cell_journal` checks both before a run may write. ADR 16 lists the changes that this detects
and those that it cannot. `rows` defines each row.
"""

from ._beside import append_beside, put_on_disk
from ._care import CellJournal, first_flaw, is_set_aside, journals_in, open_cell_journal
from ._form import CELL_TIME, GENESIS, JOURNAL_NAME, JournalError, Row, RowKind
from ._head import Head, HeadError, read_head_file
from ._writer import Journal
from .place import why_not_there
from .reading import (
    NO_ROW,
    BrokenRow,
    NewRows,
    broken_rows,
    first_broken_row,
    journal_mark,
    last_head,
    new_rows,
    newest_run,
    parts_of,
    read_rows,
    read_rows_after,
    read_rows_counted,
    read_rows_named,
    read_rows_of_kinds,
    records_elsewhere,
    row_at,
    rows_behind,
    rows_of_parts,
    whole_up_to,
)
from .rows import Body, Once, is_of, is_once, read_row
from .stamps import HOST_STAMPS, Stamps
from .writing import SCHEMA_VERSION

__all__ = [
    "CELL_TIME",
    "GENESIS",
    "HOST_STAMPS",
    "JOURNAL_NAME",
    "NO_ROW",
    "SCHEMA_VERSION",
    "Body",
    "BrokenRow",
    "CellJournal",
    "Head",
    "HeadError",
    "Journal",
    "JournalError",
    "NewRows",
    "Once",
    "Row",
    "RowKind",
    "Stamps",
    "append_beside",
    "broken_rows",
    "first_broken_row",
    "first_flaw",
    "is_of",
    "is_once",
    "is_set_aside",
    "journal_mark",
    "journals_in",
    "last_head",
    "new_rows",
    "newest_run",
    "open_cell_journal",
    "parts_of",
    "put_on_disk",
    "read_head_file",
    "read_row",
    "read_rows",
    "read_rows_after",
    "read_rows_counted",
    "read_rows_named",
    "read_rows_of_kinds",
    "records_elsewhere",
    "row_at",
    "rows_behind",
    "rows_of_parts",
    "whole_up_to",
    "why_not_there",
]
