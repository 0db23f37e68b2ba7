"""Makes notices from the journal: the same row always makes the same notices. Reads only."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal, get_args

from controller.cell.alarms import BY_NUMBER
from controller.cell.journal import (
    Row,
    parts_of,
    read_row,
    row_at,
    rows,
    rows_behind,
    rows_of_parts,
)
from controller.results.exports import csv_text, dfq_bytes, qif_bytes
from controller.results.judged import JudgedPart, judged_parts, result_json
from controller.results.run import ResultsError, fold

from .model import (
    AlarmNotice,
    Characteristic,
    Disposition,
    Finding,
    Notice,
    PartResult,
    Picture,
    Review,
)

READ_COUNT: Final = 500  # rows that are looked through at once
KEPT_COUNT: Final = 64  # results of a journal kept for other couriers
# Rows after which something else is to be told of a part: it is finished, a person has judged it, a
# later run knows where it is.
DONE, REVIEWED, FOLLOWED = (
    rows.PartDone.row_name, rows.PartReviewed.row_name, rows.PartFollowed.row_name,
)  # fmt: skip
ENDED: Final = (rows.RunEnded.row_name, rows.RunBrokeOff.row_name)
OF_PART: Final = (DONE, REVIEWED, FOLLOWED)
TELLING: Final = (*OF_PART, *ENDED)


class UntellableError(Exception):
    """A row that should be told of cannot be read; the message names run, part and reason.

    Attributes
    ----------
    key : what it would have been known by
    """

    def __init__(self, key: str, why: str) -> None:
        super().__init__(why)
        self.key = key


def notices_after(
    journal: Path,
    cell: str,
    seq: int,
    until: int | None = None,
    *,
    names: Collection[str] = (),
    count: int = READ_COUNT,
) -> tuple[list[tuple[int, list[Notice | UntellableError]]], int]:
    """Return what the next rows of a journal tell, row by row, and the last row looked at.

    Parameters
    ----------
    journal : its file
    cell : name of the cell, where a run does not give it
    seq : the last row that is known, 0 for none
    until : rows after this one are left alone; None for no such row
    names : names of the rows that are looked at; all if empty
    count : most rows that are looked at

    Raises
    ------
    JournalError : the journal cannot be read
    """
    new = rows_behind(journal, seq, count, until, names)
    told = [(row.seq, list(_told_by(journal, cell, row))) for row in new]
    return [one for one in told if one[1]], new[-1].seq if new else seq


def result_of(
    journal: Path, cell: str, run: str, part: int, revision: int | None = None
) -> PartResult:
    """Return the result of a part.

    Parameters
    ----------
    journal : its file
    cell : name of the cell, where the run does not give it
    run, part : whose
    revision : of its result; None for the last one

    Raises
    ------
    JournalError : the journal cannot be read
    ResultsError : it has no such part or revision, or one that cannot be read
    """
    first = row_at(journal, 1)
    telling = _telling(rows_of_parts(journal, run, [part], names=TELLING), part)
    if first is None or not telling or not 0 < (revision or 1) <= len(telling):
        what = "" if revision is None else f", revision {revision}"
        raise ResultsError(f"run {run} has no finished part {part}{what}")
    last = telling[-1 if revision is None else revision - 1]
    return _result(journal, first.hash, cell, run, part, last.seq)


def whole_result(journal: Path, run: str, part: int) -> Mapping[str, Any]:
    """Return all of a part's result, as `cellctl report --format json` has it.

    Parameters
    ----------
    journal : its file
    run, part : whose

    Raises
    ------
    JournalError : the journal cannot be read
    ResultsError : it has no such part, or one that cannot be read
    """
    return result_json(_judged(journal, run, part, rows_of_parts(journal, run, [part])))


def exported(journal: Path, result: PartResult, kind: Literal["csv", "qif", "dfq"]) -> bytes:
    """Return a result as a file that a factory reads, as of its revision.

    Parameters
    ----------
    journal : its file
    result : which one
    kind : kind of the file

    Raises
    ------
    JournalError : the journal cannot be read
    ResultsError : it has no such part, or one that cannot be read
    ValueError : nothing of it can be written as such a file
    """
    found = rows_of_parts(journal, result.run, [result.part], result.seq)
    parts = [_judged(journal, result.run, result.part, found)]
    if kind == "csv":
        return csv_text(parts).encode()
    return qif_bytes(parts) if kind == "qif" else dfq_bytes(parts)


def _told_by(journal: Path, cell: str, row: Row) -> Iterator[Notice | UntellableError]:
    parts: tuple[int, ...] = ()
    if row.name in OF_PART and row.part:
        parts = (row.part,)
    elif row.name in ENDED:
        parts = parts_of(journal, row.run)
    for part in parts:
        found = rows_of_parts(journal, row.run, [part], row.seq, TELLING)
        telling = _telling(found, part)
        if telling and telling[-1].seq == row.seq:
            yield _result_or_why(journal, cell, row.run, part, row.seq)
    alarm = _alarm(cell, row)
    if alarm is not None:
        yield alarm


def _telling(found: Sequence[Row], part: int) -> list[Row]:
    """Return the rows of a run that tell something new of a part: one revision each, in order.

    The run's end tells only of a part that was not finished before it.
    """
    telling: list[Row] = []
    for row in found:
        if row.name in ENDED:
            is_told = any(one.name in (DONE, *ENDED) for one in telling)
        else:  # a later run without a custody has the part's record itself
            is_followed_there = row.name == FOLLOWED and not row.body.get("custody")
            is_own = row.part == part and row.name in OF_PART
            is_told = not is_own or is_followed_there
        if not is_told:
            telling.append(row)
    return telling


def _result_or_why(
    journal: Path, cell: str, run: str, part: int, seq: int
) -> PartResult | UntellableError:
    first = row_at(journal, 1)
    try:
        return _result(journal, first.hash if first else "", cell, run, part, seq)
    except (ResultsError, ValueError) as error:
        return UntellableError(f"{cell}/{run}/{part}", f"run {run} part {part}: {error}")


@lru_cache(maxsize=KEPT_COUNT)
def _result(journal: Path, _: str, cell: str, run: str, part: int, seq: int) -> PartResult:
    """Return a result as of a row; kept by the journal's first hash, since files are replaced."""
    found = rows_of_parts(journal, run, [part], seq)
    return _payload(cell, _judged(journal, run, part, found), part, found, seq)


def _judged(journal: Path, run: str, part: int, found: Sequence[Row]) -> JudgedPart:
    if not any(row.part == part for row in found):
        raise ResultsError(f"run {run} has no part {part}")
    record = fold(run, journal.parent / run, list(found), None)
    return next(one for one in judged_parts(record) if one.part.number == part)


def _payload(
    cell: str, judged: JudgedPart, part: int, found: Sequence[Row], seq: int
) -> PartResult:
    header, report, verdict = judged.header, judged.part, judged.part.verdict
    stored = {
        name: str(sha256)
        for row in found
        if row.name == rows.FilesStored.row_name
        for name, sha256 in row.body.items()
    }
    labels = {face.face: face.label for face in (verdict.faces if verdict else ())}
    tray = _disposition(report.tray)
    review = report.review
    return PartResult(
        cell=header.cell if header.cell not in ("", "unknown") else cell,
        run=header.run_id,
        part=part,
        revision=len(_telling(found, part)),
        seq=seq,
        order=header.papers.get("order_number") or None,
        recipe=header.part,
        recipe_sha256=header.recipe_sha256 or None,
        serial=header.serial or None,
        lot=header.lot or None,
        operator=header.operator or None,
        begun=header.start,
        ended=header.end,
        verdict=judged.verdict,
        reasons=tuple(judged.reasons),
        tray=tray,
        disposition=tray if review is None else _disposition(review.verdict),
        review=None
        if review is None
        else Review(at=review.at, verdict=_word(review.verdict), who=review.who, why=review.why),
        custody=report.custody.value,
        is_emulated=bool(header.emulated_devices),
        is_dry=any(row.body.get("is_dry") for row in found if row.name == rows.RunBegan.row_name),
        compared_fraction=verdict.compared_fraction if verdict else None,
        characteristics=tuple(
            Characteristic(
                id=c.id, balloon=c.balloon, label=c.label, kind=c.kind, unit=c.unit,
                nominal=c.nominal, lower=c.lower, upper=c.upper, measured=c.measured, U=c.U,
                verdict=c.verdict,
            )
            for c in report.characteristics
        ),
        findings=tuple(
            Finding(
                number=f.number, kind=f.kind, view=f.view, size_mm=f.size_mm, area_mm2=f.area_mm2,
                faces=tuple(labels.get(face, f"F{face}") for face in f.faces),
                p_part_mm=f.p_part_mm, verdict=f.verdict or None,
            )
            for f in report.findings
        ),
        pictures=tuple(
            Picture(name=name, sha256=stored.get(name))
            for view in report.views
            for name in view.pictures.values()
        ),
    )  # fmt: skip


def _disposition(word: str | None) -> Disposition | None:
    return next((one for one in get_args(Disposition) if one == word), None)


def _word(verdict: str) -> Any:  # noqa: ANN401 - the model checks it
    return verdict


def _alarm(cell: str, row: Row) -> AlarmNotice | None:
    """Return the alarm that a row raises or acknowledges; None for none."""
    body, at = row.body, datetime.fromisoformat(row.t_utc)
    if row.name == rows.Acknowledged.row_name:
        return AlarmNotice(
            cell=cell, run=str(body.get("run", row.run)), part=None, seq=row.seq, at=at,
            change="acknowledged", number=None, code=str(body.get("code", "")), device=None,
            message=str(body.get("why", "")), action="", who=str(body.get("who", "")) or None,
        )  # fmt: skip
    try:
        told = rows.told_alarm(read_row(row.kind, row.name, body))
    except ValueError:  # not as this version writes it
        return None
    if told is None or told.is_repeated or (known := BY_NUMBER.get(told.number)) is None:
        return None
    return AlarmNotice(
        cell=cell, run=row.run, part=row.part or None, seq=row.seq, at=at, change="raised",
        number=told.number, code=known.code, message=told.message or known.words,
        device=told.device or None, action=told.action or known.action,
    )  # fmt: skip
