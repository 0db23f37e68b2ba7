"""Parts in the store: a list by filters, and one part with all its rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

from sqlalchemy import Column, ColumnElement, Connection, and_, case, func, select

from .errors import HistoryError, NoSuchPartError
from .sentences import with_sentences
from .store import Store
from .tables import (
    ALARMS,
    CHARACTERISTICS,
    FINDING_FACES,
    FINDINGS,
    JOURNALS,
    MEASUREMENTS,
    PARTS,
    PICTURES,
    RECOVERIES,
    REVIEWS,
    RUNS,
    STEPS,
)

REVIEWS_ASKED: Final = ("awaiting", "reviewed", "accept", "reject")
# orders of a list; parts that are equal in it come newest first
SORTS: Final[Mapping[str, Column[Any]]] = {
    "start": PARTS.c.start,
    "serial": PARTS.c.serial,
    "recipe": PARTS.c.recipe,
    "lot": PARTS.c.lot,
    "order_number": PARTS.c.order_number,
    "operator": PARTS.c.operator,
    "verdict": PARTS.c.verdict,
    "seconds": PARTS.c.done_actual_s,
    "findings": PARTS.c.finding_count,
}
NAMED_COUNT: Final = 12  # runs that an error names
_HIDDEN: Final = frozenset(
    {"part_id", "run_no", "ordinal", "read_seq", "characteristic_no", "key", "run_name"}
)
_OTHER: Final = RUNS.alias("other_run")
_IS_SHARED: Final = (
    select(_OTHER.c.run_no)
    .where(_OTHER.c.run_id == RUNS.c.run_id, _OTHER.c.run_no != RUNS.c.run_no)
    .correlate(RUNS)
    .exists()
)
# a run's name: its id, behind the cell's name where other cells have the same
RUN_NAME: Final[ColumnElement[str]] = case(
    (_IS_SHARED, RUNS.c.cell + "/" + RUNS.c.run_id), else_=RUNS.c.run_id
)
# what a part's name is made of, with its number; `part_json` and `part_name` take it
NAME: Final[tuple[ColumnElement[Any], ...]] = (
    RUNS.c.run_id,
    RUNS.c.cell,
    RUN_NAME.label("run_name"),
)


@dataclass(frozen=True, slots=True)
class Filters:
    """The selection of parts; None and empty select all.

    Attributes
    ----------
    since, until : the part's first row is at or after the one, before the other; UTC, no zone
    review : one of `REVIEWS_ASKED`: those that await a person, that a person decided on, or how
    """

    recipe: str = ""
    verdict: str = ""
    serial: str = ""
    lot: str = ""
    order_number: str = ""
    operator: str = ""
    run: str = ""
    cell: str = ""
    since: datetime | None = None
    until: datetime | None = None
    review: str = ""

    def clause(self, *, is_each: bool = False) -> ColumnElement[bool]:
        """Return the condition on `PARTS`; asks `RUNS` if a run or a cell is named.

        Parameters
        ----------
        is_each : True to count a part of several runs in each, not only in the one with its record
        """
        c = PARTS.c
        named = {
            c.recipe: self.recipe,
            c.verdict: self.verdict,
            c.serial: self.serial,
            c.lot: self.lot,
            c.order_number: self.order_number,
            c.operator: self.operator,
        }
        clauses = [column == value for column, value in named.items() if value]
        if not is_each:
            clauses.append(c.is_counted)
        if self.review == "awaiting":
            clauses.append(c.awaits_review)
        elif self.review == "reviewed":
            clauses.append(c.review > "")  # which an index answers
        elif self.review:
            clauses.append(c.review == self.review)
        if self.run or self.cell:
            of_run = RUNS.c.run_id.startswith(self.run, autoescape=True)
            runs = select(RUNS.c.run_no).where(of_run)
            clauses.append(
                c.run_no.in_(runs.where(RUNS.c.cell == self.cell) if self.cell else runs)
            )
        if self.since is not None:
            clauses.append(c.start >= self.since)
        if self.until is not None:
            clauses.append(c.start < self.until)
        return and_(True, *clauses)


@dataclass(frozen=True, slots=True)
class Listed:
    """Parts of a list, newest first, and their total number."""

    count: int
    parts: tuple[Mapping[str, Any], ...]


def list_parts(
    store: Store,
    filters: Filters,
    limit: int,
    *,
    skipped: int = 0,
    sort: str = "start",
    is_rising: bool = False,
) -> Listed:
    """Return the parts that filters select, the newest first unless another order is given.

    Parameters
    ----------
    store : store to read
    filters : parts to select
    limit : largest number
    skipped : number of entries of the list before them
    sort : one of `SORTS`
    is_rising : True for ascending order

    Raises
    ------
    HistoryError : the store cannot be read
    """
    clause = filters.clause()
    by = SORTS[sort]
    order = by.asc() if is_rising else by.desc()
    newest = [PARTS.c.start.desc(), PARTS.c.part_id.desc()]
    if sort == "start":
        newest = [PARTS.c.part_id.asc() if is_rising else PARTS.c.part_id.desc()]
    # their keys first, from the index alone where there is one
    keys = (
        select(PARTS.c.part_id).where(clause).order_by(order, *newest).limit(limit).offset(skipped)
    ).subquery()
    query = (
        select(PARTS, *NAME)
        .join(RUNS)
        .join(keys, keys.c.part_id == PARTS.c.part_id)
        .order_by(order, *newest)
    )
    with store.reading() as db:
        count = db.execute(select(func.count()).select_from(PARTS).where(clause)).scalar_one()
        found = tuple(part_json(row) for row in db.execute(query).mappings())
        return Listed(int(count), with_sentences(db, found))


def find_parts(store: Store, word: str) -> tuple[Mapping[str, Any], ...]:
    """Return the full records of a part, oldest first: several if it was inspected more than once.

    Parameters
    ----------
    store : store to read
    word : a serial number, or ``RUN/NUMBER`` with a run's id or an unambiguous beginning of it;
        ``CELL/RUN/NUMBER`` where several cells have such a run

    Raises
    ------
    NoSuchPartError : there is none
    HistoryError : several runs begin so, or the store cannot be read
    """
    with store.reading() as db:
        of_run = (RUNS.c.outcome, RUNS.c.copied_to, JOURNALS.c.key.label("journal"))
        query = select(PARTS, *NAME, *of_run)
        query = query.select_from(PARTS.join(RUNS).join(JOURNALS))
        found = (
            db.execute(
                query.where(PARTS.c.serial == word, PARTS.c.is_counted).order_by(
                    PARTS.c.start, PARTS.c.part_id
                )
            )
            .mappings()
            .all()
        )
        run, _, number = word.rpartition("/")
        if not found and run and number.isdecimal() and len(number) < 10:
            run_no = _run_no(db, run)
            found = (
                db.execute(query.where(PARTS.c.run_no == run_no, PARTS.c.number == int(number)))
                .mappings()
                .all()
            )
        if not found:
            raise NoSuchPartError(
                f"no part `{word}` in store {store.name}: name a serial number, or a run and the "
                "number of the part in it as RUN/NUMBER (`cellctl history` lists them)"
            )
        return with_sentences(db, tuple(_full(db, row) for row in found))


def _run_no(db: Connection, word: str) -> int:
    cell, _, run = word.rpartition("/")
    is_meant = RUNS.c.run_id.startswith(run, autoescape=True)
    if cell:
        is_meant &= RUNS.c.cell == cell
    found = db.execute(
        select(RUNS.c.run_no, *NAME).where(is_meant).order_by(RUNS.c.run_id, RUNS.c.cell)
    ).all()
    exact = [one for one in found if one.run_id == run] or found
    if len(exact) > 1:
        names = ", ".join(one.run_name for one in exact[:NAMED_COUNT])
        raise HistoryError(f"{len(exact)} runs begin with `{word}`; name one: {names}")
    return int(exact[0].run_no) if exact else -1


def part_json(row: Mapping[Any, Any]) -> Mapping[str, Any]:
    """Return a row as plain JSON values, without the store's own keys; a part gets its name."""
    found: dict[str, Any] = {key: _plain(value) for key, value in row.items() if key not in _HIDDEN}
    if "run_name" in row:
        return {"part": part_name(row), "run": found.pop("run_id"), **found}
    return found


def part_name(row: Mapping[Any, Any]) -> str:
    """Return a part's name, by which `find_parts` finds it.

    Parameters
    ----------
    row : has `NAME` and the part's number
    """
    return f"{row['run_name']}/{row['number']}"


def _plain(value: object) -> object:
    return f"{value.isoformat()}+00:00" if isinstance(value, datetime) else value


def _full(db: Connection, part: Mapping[Any, Any]) -> Mapping[str, Any]:
    key = part["part_id"]
    measured = (
        select(CHARACTERISTICS, MEASUREMENTS)
        .join(MEASUREMENTS)
        .where(MEASUREMENTS.c.part_id == key)
        .order_by(MEASUREMENTS.c.ordinal)
    )
    alarms = (
        select(ALARMS)
        .where(ALARMS.c.run_no == part["run_no"], ALARMS.c.part == part["number"])
        .order_by(ALARMS.c.seq)
    )
    faces: dict[int, list[str]] = {}
    on = select(FINDING_FACES).where(FINDING_FACES.c.part_id == key)
    for row in db.execute(on.order_by(FINDING_FACES.c.ordinal)):
        faces.setdefault(row.finding, []).append(row.label)

    def of(table: Any) -> Sequence[Mapping[Any, Any]]:  # noqa: ANN401 - one of OF_PART
        query = select(table).where(table.c.part_id == key).order_by(table.c.ordinal)
        return list(db.execute(query).mappings())

    return {
        **part_json(part),
        "characteristics": [part_json(row) for row in db.execute(measured).mappings()],
        "findings": [
            {"number": row["ordinal"], **part_json(row), "faces": faces.get(row["ordinal"], [])}
            for row in of(FINDINGS)
        ],
        "pictures": [part_json(row) for row in of(PICTURES)],
        "steps": [part_json(row) for row in of(STEPS)],
        "recoveries": [part_json(row) for row in of(RECOVERIES)],
        "reviews": [part_json(row) for row in of(REVIEWS)],
        "alarms": [part_json(row) for row in db.execute(alarms).mappings()],
    }
