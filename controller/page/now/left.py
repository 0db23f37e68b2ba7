"""A part that a run left in a gripper, by the journal: the evidence for *Unfinished part*."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from controller.cell.custody import Held, custody_of, known_words
from controller.cell.journal import read_rows_after

from .fold import RunFold


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
