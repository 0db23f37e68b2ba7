"""The lines of `cellctl commission --status` on each calibration: age, runs, and those left."""

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from controller.bring_up.procedure import CommissioningFolder
from controller.cell.journal import JOURNAL_NAME, read_rows_counted, rows
from controller.cell.journal.usage import usage_of
from controller.config.calibrations import Usage, read_calibrations, standing_of


@dataclass(frozen=True, slots=True)
class CalibrationLine:
    """One calibration.

    Attributes
    ----------
    name : name of the kind
    measured : date
    why_stale : empty while it counts
    run_count : runs that have used it
    valid_runs : after which it is stale; None for never
    """

    name: str
    measured: datetime
    why_stale: str
    run_count: int
    valid_runs: int | None

    @property
    def runs_left(self) -> int | None:
        """The number of runs that may still use it; None for any number."""
        return None if self.valid_runs is None else max(0, self.valid_runs - self.run_count)

    @property
    def words(self) -> str:
        """The whole line, for people."""
        used = f"measured {self.measured:%Y-%m-%d}, {self.run_count} runs have used it"
        left = "" if self.runs_left is None else f", {self.runs_left} of {self.valid_runs} are left"
        return used + left + (f"; stale: {self.why_stale}" if self.why_stale else "")


def calibration_lines(
    folder: CommissioningFolder, runs: Path, now: datetime
) -> tuple[CalibrationLine, ...]:
    """Return the state of each calibration of a commissioned cell.

    Parameters
    ----------
    folder : folder of the commissioning
    runs : folder of the runs on the cell, whose journal has what each used; it need not exist
    now : with its offset from UTC

    Raises
    ------
    ConfigError : a calibration is damaged
    JournalError : the journal cannot be read
    """
    references = folder.references()
    if not references:
        return ()
    found = read_calibrations(folder.cell_file, references)
    journal = runs / JOURNAL_NAME
    names = (rows.RunBegan.row_name, rows.ViewsPosed.row_name)
    usage = usage_of(read_rows_counted(journal, names)) if journal.exists() else {}
    standing = standing_of(references, found, now, usage)
    return tuple(
        CalibrationLine(
            one.name,
            one.measured,
            one.why_stale,
            usage.get(references[one.name].sha256, Usage()).run_count,
            found[one.name].valid_runs,
        )
        for one in standing.each
    )
