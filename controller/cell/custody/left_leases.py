"""Leases that a run took and never gave back, since its controller died: folded from its rows."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from messages import joined, say

from ..journal import Row, is_of, read_rows_of_kinds, rows
from .fold import CellIdentity, GripperName


@dataclass(frozen=True, slots=True)
class LeftLease:
    """The resources of an action at the death of its controller.

    Attributes
    ----------
    resources : devices and spaces
    by : the action
    run, since : run, and start of its lease [UTC]
    """

    resources: tuple[str, ...]
    by: str
    run: str
    since: str

    @property
    def words(self) -> str:
        """A sentence for people."""
        what = joined(", ", self.resources)
        since = f"{datetime.fromisoformat(self.since):%Y-%m-%d %H:%M:%S}"
        return say(
            "held, owner dead: {what}; taken by {by} of run {run} at {since} UTC",
            what=what,
            by=self.by,
            run=self.run,
            since=since,
        )


def read_left_leases(path: Path, here: CellIdentity) -> tuple[LeftLease, ...]:
    """Return the leases that the last controller of a cell held when it died, by its journal.

    Parameters
    ----------
    path : the journal; it may have runs of other cells too, which may be going on
    here : the cell, which this process has to itself

    Raises
    ------
    JournalError : the journal cannot be read
    """
    elsewhere: set[str] = set()
    mine: list[Row] = []
    for row in read_rows_of_kinds(path, ("lease",), (rows.RunBegan.row_name,)):
        if is_of(row, rows.RunBegan):
            with suppress(ValueError):  # a run whose first row is unreadable may be of this cell
                cell = CellIdentity.of(rows.RunBegan.model_validate(row.body))
                if not any(here.shares(gripper, cell) for gripper in GripperName):
                    elsewhere.add(row.run)
        elif row.run not in elsewhere:
            mine.append(row)
    return left_leases(mine)


def left_leases(found: Iterable[Row]) -> tuple[LeftLease, ...]:
    """Return the leases not given back by the newest run that took any.

    Parameters
    ----------
    found : rows of all runs of a cell whose controllers are gone, in order
    """
    open_leases: dict[str, LeftLease] = {}
    run = ""
    for row in found:
        if is_of(row, rows.LeaseTaken):
            if row.run != run:
                run, open_leases = row.run, {}
            body = rows.LeaseTaken.model_validate(row.body)
            open_leases[body.by] = LeftLease(body.resources, body.by, row.run, row.t_utc)
        elif is_of(row, rows.LeaseReturned) and row.run == run:
            open_leases.pop(rows.LeaseReturned.model_validate(row.body).by, None)
    return tuple(open_leases.values())
