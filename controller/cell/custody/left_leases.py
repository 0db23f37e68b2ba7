"""Leases that a run took and never gave back, since its controller died: folded from its rows."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from ..journal import Row, is_of, rows


@dataclass(frozen=True, slots=True)
class LeftLease:
    """What an action had when its controller died.

    Attributes
    ----------
    resources : devices and spaces
    by : the action
    run, since : whose, and since when [UTC]
    """

    resources: tuple[str, ...]
    by: str
    run: str
    since: str

    @property
    def words(self) -> str:
        """A sentence for people."""
        what = ", ".join(self.resources)
        return (
            f"held, owner dead: {what}; taken by {self.by} of run {self.run} at "
            f"{datetime.fromisoformat(self.since):%Y-%m-%d %H:%M:%S} UTC"
        )


def left_leases(found: Sequence[Row]) -> tuple[LeftLease, ...]:
    """Return the leases that the newest run with any lease has not given back.

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
