"""The form of a journal: its table, its rows, the hash that chains them."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

RowKind = Literal[
    "event", "intent", "outcome", "observation", "decision", "custody", "lease", "config"
]
# Rows of these names were once written with another kind. They are read with today's kind; the file
# stays as it is, since the hashes cover it.
EARLIER_KINDS: Final[Mapping[str, tuple[RowKind, RowKind]]] = {
    "lease_taken": ("decision", "lease"),
    "lease_returned": ("decision", "lease"),
}

SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS journal (
    seq       INTEGER PRIMARY KEY,
    t_utc     TEXT NOT NULL,
    t_mono    REAL NOT NULL,
    run       TEXT NOT NULL,
    part      INTEGER,
    kind      TEXT NOT NULL,
    name      TEXT NOT NULL,
    body      TEXT NOT NULL,
    prev_hash TEXT NOT NULL,
    hash      TEXT NOT NULL
) STRICT;
CREATE INDEX IF NOT EXISTS journal_run ON journal (run, seq);
CREATE TRIGGER IF NOT EXISTS journal_keeps_rows BEFORE UPDATE ON journal
BEGIN SELECT RAISE(ABORT, 'the journal is append-only'); END;
CREATE TRIGGER IF NOT EXISTS journal_loses_none BEFORE DELETE ON journal
BEGIN SELECT RAISE(ABORT, 'the journal is append-only'); END;
-- REPLACE takes rows away without asking the trigger on DELETE
CREATE TRIGGER IF NOT EXISTS journal_only_grows BEFORE INSERT ON journal
WHEN NEW.seq <= (SELECT coalesce(max(seq), 0) FROM journal)
BEGIN SELECT RAISE(ABORT, 'the journal is append-only'); END;
"""
GENESIS: Final = "0" * 64
JOURNAL_NAME: Final = "journal.sqlite"
# The key under which the writer notes the instant on the cell's clock.
CELL_TIME: Final = "cell_s"


class JournalError(Exception):
    """The journal cannot be written or read; nothing may move without it."""


@dataclass(frozen=True, slots=True)
class Row:
    """One row of the journal; `t_mono_s` is a time of the machine's monotonic clock [wall s]."""

    seq: int
    t_utc: str
    t_mono_s: float
    run: str
    part: int | None
    kind: str
    name: str
    body: dict[str, Any]

    @property
    def cell_s(self) -> float | None:
        """The time of writing by the cell's clock [cell s]; good for differences within a run.

        None for rows from before the devices had a clock, and for those that only list texts.
        """
        found = self.body.get(CELL_TIME)
        return float(found) if isinstance(found, int | float) else None


def kind_of(kind: str, name: str) -> str:
    """Return today's kind of a row that was written with ``kind``."""
    was, now = EARLIER_KINDS.get(name, (kind, kind))
    return now if kind == was else kind


def digest_of(prev: str, *fields: object) -> str:
    """Return the hash of a row that follows the one with hash ``prev``."""
    text = json.dumps([prev, *fields], separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()
