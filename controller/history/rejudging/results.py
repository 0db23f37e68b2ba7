"""What was judged anew: kept in the store, and compared with what the parts were judged first."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import delete, insert, select

from ..tables import CHARACTERISTICS, MEASUREMENTS, PARTS, REJUDGED, RUNS
from .archive import IN_ORDER, SOURCE, Archive
from .task import ArchivedPart, Rejudged

NOT_JUDGED: Final = "not judged"
SEVERITY: Final = {"pass": 0, "not evaluated": 1, "indeterminate": 1, "fail": 2}
BATCH_COUNT: Final = 500  # parts compared at once, whose characteristics are in memory together


@dataclass(frozen=True, slots=True)
class PartTurn:
    """A part as it was judged, and as it is judged now.

    Attributes
    ----------
    run, number, serial, lot : the part
    was, now : verdicts; `now` is `NOT_JUDGED` where it could not be judged
    why : what turned it: its characteristics with values, else the first reason; the problem of a
        part that could not be judged
    lines_sha256 : hash of the result lines
    """

    run: str
    number: int
    serial: str
    lot: str
    was: str
    now: str
    why: str
    lines_sha256: str

    @property
    def is_turned(self) -> bool:
        """Whether it has another verdict."""
        return self.now not in (self.was, NOT_JUDGED)


def keep(archive: Archive, results: Sequence[tuple[ArchivedPart, Rejudged]]) -> None:
    """Write results into the store, all or none.

    Parameters
    ----------
    archive : the parts
    results : parts that were judged, without problems

    Raises
    ------
    HistoryError : the store cannot be written
    """
    rows = [
        {
            "part_id": part.part_id,
            **archive.judging.key,
            "verdict": found.verdict,
            "reasons": json.dumps(found.reasons),
            "characteristics": json.dumps(found.characteristics),
            "lines_sha256": found.lines_sha256,
            "seconds": found.seconds,
        }
        for part, found in results
    ]
    if not rows:
        return
    with archive.store.writing() as db:
        # another command may have judged them so meanwhile
        ids = [row["part_id"] for row in rows]
        db.execute(delete(REJUDGED).where(REJUDGED.c.part_id.in_(ids), archive.judging.rows))
        db.execute(insert(REJUDGED), rows)


def compared(archive: Archive, problems: Mapping[int, str]) -> Iterator[PartTurn]:
    """Yield each part with both verdicts, oldest first; one that was not judged with its problem.

    Parameters
    ----------
    archive : the parts
    problems : why parts could not be judged, by their key in the store

    Raises
    ------
    HistoryError : the store cannot be read
    """
    query = (
        select(
            PARTS.c.part_id, RUNS.c.run_id, PARTS.c.number, PARTS.c.serial, PARTS.c.lot,
            PARTS.c.verdict.label("was"), PARTS.c.reason, REJUDGED.c.verdict.label("now"),
            REJUDGED.c.reasons, REJUDGED.c.characteristics, REJUDGED.c.lines_sha256,
        )
        .select_from(
            SOURCE.outerjoin(
                REJUDGED, (REJUDGED.c.part_id == PARTS.c.part_id) & archive.judging.rows
            )
        )
        .where(archive.clause)
        .order_by(*IN_ORDER)
        .execution_options(yield_per=BATCH_COUNT)
    )  # fmt: skip
    with archive.store.reading() as db, archive.store.reading() as other:
        for rows in db.execute(query).partitions():
            turned = [row.part_id for row in rows if row.now not in (None, row.was)]
            before = _measured(other, turned)
            for row in rows:
                about = (row.run_id, int(row.number), row.serial, row.lot, row.was)
                if row.now is None:
                    why = problems.get(row.part_id, "")
                    yield PartTurn(*about, NOT_JUDGED, why, "")
                    continue
                why = ""
                if row.now != row.was:
                    why = _why(row, before.get(row.part_id, {}))
                yield PartTurn(*about, row.now, why, row.lines_sha256)


def _measured(db: Any, parts: Sequence[int]) -> dict[int, dict[str, Mapping[str, Any]]]:  # noqa: ANN401 - a connection
    """Return what was measured of some parts at first, by part and characteristic."""
    found: dict[int, dict[str, Mapping[str, Any]]] = {}
    c, m = CHARACTERISTICS.c, MEASUREMENTS.c
    query = (
        select(m.part_id, c.id, c.label, c.lower, c.upper, m.measured, m.U, m.verdict)
        .select_from(MEASUREMENTS.join(CHARACTERISTICS))
        .where(m.part_id.in_(parts))
        .order_by(m.part_id, m.ordinal)
    )
    for row in db.execute(query).mappings():
        found.setdefault(int(row["part_id"]), {})[str(row["id"])] = row
    return found


def _why(row: Any, before: Mapping[str, Mapping[str, Any]]) -> str:  # noqa: ANN401 - a row
    """Return what turned a part, in words: what became worse as it did, or better as it did."""
    turned = []
    now = {one["id"]: one for one in json.loads(row.characteristics)}
    is_worse = SEVERITY[row.now] > SEVERITY[row.was]
    bar = SEVERITY[row.now if is_worse else row.was]  # at least so bad after, or before
    for name in dict.fromkeys([*before, *now]):
        old, new = before.get(name), now.get(name)
        ends = [0 if one is None else SEVERITY[one["verdict"]] for one in (old, new)]
        good, bad = ends if is_worse else ends[::-1]
        if good < bar <= bad:
            turned.append(f"{(new or old or {}).get('label') or name}: {_one(old)} -> {_one(new)}")
    if turned:
        return "; ".join(turned)
    return (json.loads(row.reasons) or [""])[0] if is_worse else f"before: {row.reason}"


def _one(found: Mapping[str, Any] | None) -> str:
    """Return a characteristic with its value and limits, in words."""
    if found is None:
        return "not asked"
    if found["measured"] is None:
        return str(found["verdict"])
    U = "" if found["U"] is None else f" +- {found['U']:.3f}"
    return (
        f"{found['verdict']} ({found['measured']:.3f}{U} in "
        f"{found['lower']:.3f} to {found['upper']:.3f})"
    )
