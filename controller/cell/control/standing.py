"""What is known of a cell while no run can be asked: how the last run ended, and what it left.

Read from lock and journal alone: nothing here speaks to a device or writes.
"""

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from messages import joined, say

from ..custody import CellIdentity, Held, custody_of, fold_custody, known_words, read_folded
from ..journal import JOURNAL_NAME, newest_run, rows, rows_of_parts
from ..lock import LOCK_NAME, read_holder
from ..operator import fold_latch
from .words import HolderReply


class StandingReply(BaseModel):
    """A cell that no run can be asked about, as JSON.

    Attributes
    ----------
    cell : its name by the last run; empty before the first
    state : `free`; `left`: a gripper may hold a part, or nobody has acknowledged a stop; `taken`:
        another command has the cell, or a run that is starting or ending
    message : why it is not free, as a sentence
    run, end, end_message : the last run and its end; empty before the first
    custody : who has the part that was left; empty for none
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    cell: str = ""
    state: Literal["free", "left", "taken"]
    message: str = ""
    run: str = ""
    end: str = ""
    end_message: str = ""
    custody: str = ""
    holder: HolderReply | None = None


def left_in_grippers(journal: Path, began: rows.RunBegan) -> tuple[Held, ...]:
    """Return which grippers of a cell may hold a part; none of a cell that ended with its run.

    Parameters
    ----------
    journal : journal of the cell
    began : the first row of its last run

    Raises
    ------
    JournalError : the journal cannot be read
    """
    here = CellIdentity.of(began)
    return fold_custody(read_folded(journal), here) if here.outlives_the_run else ()


def standing_of(runs_dir: Path) -> StandingReply:
    """Return what is known of a cell without asking a run.

    Parameters
    ----------
    runs_dir : folder of all runs

    Raises
    ------
    JournalError : the journal cannot be read
    OSError : the folder cannot be read
    """
    holder = read_holder(runs_dir / LOCK_NAME)
    journal = runs_dir / JOURNAL_NAME
    run = newest_run(journal) if journal.is_file() else None
    found = StandingReply(state="free")
    if run is not None:
        found = _after(journal, run)
    if holder is not None:
        update = {
            "state": "taken",
            "message": say("{holder} has the cell", holder=holder),
            "holder": HolderReply.of(holder),
        }
        return found.model_copy(update=update)
    return found


def _after(journal: Path, run: str) -> StandingReply:
    """Return what is known after a run."""
    names = (rows.RunBegan.row_name, rows.RunEnded.row_name)
    found = {row.name: row.body for row in rows_of_parts(journal, run, (), names=names)}
    first, last = (found.get(name) for name in names)
    began = None if first is None else rows.RunBegan.model_validate(first)
    ended = None if last is None else rows.RunEnded.model_validate(last)
    cell = "" if began is None else str(began.cell.get("name", ""))
    left = () if began is None else left_in_grippers(journal, began)
    latch = fold_latch(journal, cell)
    message = joined(
        "; ", [*dict.fromkeys(known_words(one) for one in left), *([latch.words] if latch else [])]
    )
    return StandingReply(
        cell=cell,
        state="left" if message else "free",
        message=message,
        run=run,
        end="cut_off" if ended is None else ended.end,
        end_message="" if ended is None else ended.message,
        custody=custody_of(left).value if left else "",
    )
