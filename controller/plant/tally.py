"""What the journal tells of one run so far; each of its rows is read once. Reads only."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, get_args

from controller.cell.journal import Row, is_of, read_rows_after, rows

from .model import Disposition

TRAYS: Final[Mapping[object, Disposition]] = {one: one for one in get_args(Disposition)}


@dataclass(slots=True)
class RunTally:
    """A run, counted.

    Attributes
    ----------
    journal, run : where it is, and its name
    began : its first row; None before it
    part : number of its last part, 0 before the first
    trays : where each finished part went, by its number
    end : the row that ended it; None before
    """

    journal: Path
    run: str
    began: rows.RunBegan | None = None
    part: int = 0
    trays: dict[int, Disposition] = field(default_factory=dict)
    end: Row | None = None
    _seq: int = 0

    def look(self) -> None:
        """Take the rows that are new.

        Raises
        ------
        JournalError : the journal cannot be read
        ValueError : a row is not what this version of cellctl writes
        """
        for row in read_rows_after(self.journal, self._seq, self.run):
            self._seq = row.seq
            self.part = row.part or self.part
            if is_of(row, rows.RunBegan):
                self.began = rows.RunBegan.model_validate(row.body)
            elif is_of(row, rows.PartDone) and row.part:
                # one may be booked twice, before and after a person's word
                if (tray := TRAYS.get(row.body.get("tray"))) is not None:
                    self.trays.setdefault(row.part, tray)
            elif is_of(row, rows.RunEnded) or is_of(row, rows.RunBrokeOff):
                self.end = row

    @property
    def counts(self) -> dict[Disposition, int]:
        """Finished parts by where they went; none without any."""
        found: dict[Disposition, int] = {}
        for tray in self.trays.values():
            found[tray] = found.get(tray, 0) + 1
        return found
