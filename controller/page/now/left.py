"""A part that a run left in a gripper, by the journal: the evidence for *Unfinished part*."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from controller.cell.custody import CellIdentity, Held, custody_of, fold_custody, read_folded
from controller.cell.custody.start_check import known_words
from controller.cell.journal import read_rows_after, rows

from .fold import RunFold


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


def fold_of(journal: Path, run: str) -> RunFold:
    """Return a whole run, folded: the final places of arm and part.

    Raises
    ------
    JournalError : the journal cannot be read
    """
    fold = RunFold(run)
    for row in read_rows_after(journal, 0, run):
        fold.take(row)
    return fold


def unfinished(left: Sequence[Held]) -> dict[str, Any] | None:
    """Return the page's data on a part left in a gripper, as JSON; None for none."""
    if not left:
        return None
    evidence = dict.fromkeys(known_words(one) for one in left)
    return {"custody": custody_of(left).value, "evidence": list(evidence)}
