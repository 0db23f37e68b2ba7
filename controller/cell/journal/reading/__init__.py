"""Read journals: whole, as reports do, or bit by bit, as the history does. Nothing here writes."""

from ._following import (
    NO_ROW,
    NewRows,
    journal_mark,
    last_head,
    new_rows,
    parts_of,
    row_at,
    rows_behind,
    rows_of_parts,
    whole_up_to,
)
from ._reader import (
    BrokenRow,
    broken_rows,
    first_broken_row,
    newest_run,
    read_rows,
    read_rows_after,
    read_rows_counted,
    read_rows_named,
    read_rows_of_kinds,
    records_elsewhere,
)

__all__ = [
    "NO_ROW",
    "BrokenRow",
    "NewRows",
    "broken_rows",
    "first_broken_row",
    "journal_mark",
    "last_head",
    "new_rows",
    "newest_run",
    "parts_of",
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
]
