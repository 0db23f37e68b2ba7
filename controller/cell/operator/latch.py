"""Emergency stop and door are latched: the next start is barred until a person acknowledges them.

The latch is not stored in a process. It follows from the journal, so that it outlives a kill.
"""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from messages import key, say

from ..journal import Journal, is_of, read_rows_of_kinds
from ..journal.rows import Acknowledged, RunBegan
from .question import ACK, Choice, Operator, Question

# Codes of the faults that a person has to acknowledge.
LATCHING: Final = frozenset({"estop", "guard_closed"})
# The events, as the journal names them.
FAULT: Final = "fault"
OPENED: Final = "guard_opened"


@dataclass(frozen=True, slots=True)
class Latch:
    """A fault that nobody has acknowledged.

    Attributes
    ----------
    run : run in which it happened
    code, message : alarm code and text
    since : time, UTC
    """

    run: str
    code: str
    message: str
    since: str

    @property
    def words(self) -> str:
        """A sentence for the operator: the cause, and what to do."""
        return say(
            "run {run} was stopped at {since} and nobody has acknowledged it: "
            "{message}. Look at the cell, then state why it may start again: "
            'cellctl ack --why "..."',
            run=self.run,
            since=self.since,
            message=self.message,
        )


def fold_latch(path: Path, cell_name: str) -> Latch | None:
    """Return the last latching fault of a cell that nobody has acknowledged; None without one.

    A cell emulated by its run ended with it, and so did its emergency stop.

    Parameters
    ----------
    path : the cell's journal; it need not exist
    cell_name : as the cell file has it

    Raises
    ------
    JournalError : it cannot be read
    """
    if not path.exists():
        return None
    latch: Latch | None = None
    others: set[str] = set()
    for row in read_rows_of_kinds(
        path, (), (RunBegan.row_name, FAULT, OPENED, Acknowledged.row_name)
    ):
        if is_of(row, RunBegan):
            is_gone = "io" in row.body.get("emulated_devices", ()) and "pid" in row.body.get(
                "emulator", {}
            )
            if is_gone or row.body.get("cell", {}).get("name") != cell_name:
                others.add(row.run)
        elif is_of(row, Acknowledged):
            latch = None if latch is not None and row.body.get("run") == latch.run else latch
        elif row.run not in others and _is_latching(row.body):
            message = str(row.body.get("message", ""))
            latch = Latch(row.run, str(row.body["code"]), message, row.t_utc)
    return latch


def _is_latching(body: Mapping[str, Any]) -> bool:
    """Return whether a row is of a fault, or of an open door that held the run."""
    return body.get("code") in LATCHING and body.get("answer") != "ignored"


async def require_acknowledged(
    journal: Journal, cell_name: str, operator: Operator
) -> Latch | None:
    """Return the latch that bars a start; None if there is none or it was acknowledged.

    Parameters
    ----------
    journal : journal of the cell; gets the acknowledgement
    cell_name : as the cell file has it
    operator : operator who may acknowledge it now

    Raises
    ------
    JournalError : the journal cannot be read or written
    """
    latch = await asyncio.to_thread(fold_latch, journal.path, cell_name)
    if latch is None:
        return None
    choices = (
        Choice(ACK, key("I have looked at the cell, and it may start")),
        Choice("stop", key("end here; nothing has moved")),
    )
    answer = await operator.decide(Question("not_acknowledged", latch.words, choices))
    if answer is None or answer.key != ACK:
        return latch
    journal.write(acknowledge(latch, answer.who, answer.why))
    return None


def acknowledge(latch: Latch, who: str, why: str) -> Acknowledged:
    """Return the row that clears a latch.

    Parameters
    ----------
    latch : acknowledgement latch
    who, why : the person, and the reason given
    """
    return Acknowledged(run=latch.run, code=latch.code, who=who, why=why)
