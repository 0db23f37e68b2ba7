"""A person's verdict on a part: one more row in the journal, unnoticed by a running cell.

Nothing is changed or deleted. The machine's verdict stays; a person's later verdict replaces an
earlier one, and both are in the journal.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, cast

from sqlalchemy import select

from controller.cell.control import MAX_WHO, MAX_WHY
from controller.cell.journal import (
    JOURNAL_NAME,
    Head,
    JournalError,
    append_beside,
    rows,
    whole_up_to,
)

from ..errors import HistoryError
from ..filling import fill, journals_by_key
from ..queries import find_parts
from ..rows_of import NO_VERDICT
from ..store import Store
from ..tables import JOURNALS

VERDICTS: Final = ("accept", "reject")
WORDS: Final = ("real", "false_alarm")
NAMED_COUNT: Final = 8  # parts that an error names


@dataclass(frozen=True, slots=True)
class PartDecision:
    """A person's decision on a part.

    Attributes
    ----------
    verdict : ``accept`` or ``reject``
    who, why : the person's name and reason
    findings : by number of a finding, ``real`` or ``false_alarm``; those not named stay open
    """

    verdict: str
    who: str
    why: str
    findings: Mapping[int, str] = field(default_factory=dict)


def one_part(store: Store, word: str) -> Mapping[str, Any]:
    """Return the full record of one part.

    Parameters
    ----------
    store : filled
    word : ``RUN/NUMBER``, or a serial number that came once

    Raises
    ------
    NoSuchPartError : there is none
    HistoryError : several parts are meant, or the store cannot be read
    """
    found = find_parts(store, word)
    if len(found) > 1:
        names = ", ".join(str(one["part"]) for one in found[-NAMED_COUNT:])
        raise HistoryError(f"serial number {word} came {len(found)} times; name one: {names}")
    return found[0]


def decide(
    store: Store, runs_dir: Path, word: str, decision: PartDecision, *, seen: int | None = None
) -> Mapping[str, Any]:
    """Write a person's verdict into the journal and return the part's record with it.

    Parameters
    ----------
    store : filled; filled again afterwards
    runs_dir : folder of all runs
    word : the part, as `one_part` takes it
    decision : the verdict
    seen : number of persons' verdicts that the decider has seen; None for any

    Raises
    ------
    NoSuchPartError : there is no such part
    HistoryError : the verdict makes no sense, somebody else was faster, or the journal is not one
        that may be written to
    """
    part = one_part(store, word)
    run, number = str(part["run"]), int(part["number"])
    _check(part, decision)
    if seen is not None and seen != len(part["reviews"]):
        raise HistoryError(f"part {part['part']}: somebody decided meanwhile; look at it again")
    row = rows.PartReviewed(
        verdict=cast(Literal["accept", "reject"], decision.verdict),
        who=decision.who,
        why=decision.why.strip(),
        machine=str(part["verdict"]),
        findings=tuple(
            rows.FindingReviewed(number=n, word=cast(Literal["real", "false_alarm"], said))
            for n, said in sorted(decision.findings.items())
        ),
    )
    path = runs_dir / JOURNAL_NAME
    _require_writable(store, runs_dir, part)
    try:
        append_beside(path, run, row, number)
    except JournalError as error:
        raise HistoryError(str(error)) from error
    fill(store, runs_dir)
    return one_part(store, str(part["part"]))


def _check(part: Mapping[str, Any], decision: PartDecision) -> None:
    """Raise HistoryError if a verdict makes no sense for a part."""
    name = part["part"]
    if decision.verdict not in VERDICTS:
        raise HistoryError(f"verdict {decision.verdict}: one of {', '.join(VERDICTS)}")
    if not 0 < len(decision.why.strip()) <= MAX_WHY:
        raise HistoryError(f"the reason needs 1 to {MAX_WHY} characters")
    if not 0 < len(decision.who) <= MAX_WHO:
        raise HistoryError(f"the name needs 1 to {MAX_WHO} characters")
    if part["verdict"] == NO_VERDICT and not part["tray"]:
        raise HistoryError(f"part {name} was neither judged nor sorted: there is nothing to review")
    known = {int(one["number"]) for one in part["findings"]}
    for number, word in decision.findings.items():
        if number not in known:
            there = f"it has 1 to {max(known)}" if known else "it has none"
            raise HistoryError(f"part {name} has no finding {number}; {there}")
        if word not in WORDS:
            raise HistoryError(f"finding {number}={word}: one of {', '.join(WORDS)}")


def _require_writable(store: Store, runs_dir: Path, part: Mapping[str, Any]) -> None:
    """Raise HistoryError unless a part's journal is the one in use in a folder, and intact."""
    path, run = runs_dir / JOURNAL_NAME, part["run"]
    with store.reading() as db:
        journal = db.execute(select(JOURNALS).where(JOURNALS.c.key == part["journal"])).one()
    if journal.file != JOURNAL_NAME:
        raise HistoryError(
            f"run {run} is in {journal.file}, which was set aside: nothing is added to it"
        )
    try:
        if part["journal"] not in journals_by_key(runs_dir):
            raise HistoryError(
                f"part {part['part']} is of cell {part['cell']}, whose journal is not in "
                f"{runs_dir}: decide on it where that cell's runs are"
            )
        _, broken = whole_up_to(path, Head(int(journal.last_seq), str(journal.last_hash)))
    except JournalError as error:
        raise HistoryError(str(error)) from error
    if broken is not None:
        raise HistoryError(
            f"journal {path}: row {broken.seq} {broken.why}, so nothing is added to it "
            "(`cellctl verify`)"
        )
