"""Figures of a shift, a day, a lot: yield, time against forecast, findings, recoveries, alarms.

The definitions:

- judged: the part has a verdict. First pass: it passed the first time that its serial number was
  judged by its recipe; a part without a serial number counts as judged for the first time.
- time against forecast: of the steps that were done and had a forecast, so that a plan that was
  broken off does not count as fast [cell s].
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import ColumnElement, Integer, and_, case, cast, func, literal, or_, select

from .queries import RUN_NAME, Filters
from .rows_of import NO_VERDICT
from .store import Store
from .tables import ALARMS, FINDING_FACES, FINDINGS, PARTS, RECOVERIES, RUNS

GROUPS: Final = ("day", "run", "recipe", "lot", "order", "operator", "cell")


@dataclass(frozen=True, slots=True)
class Group:
    """Figures of the parts of a group.

    Attributes
    ----------
    first_count, first_pass_count : parts judged for the first time, and those of them that passed
    forecast_s, actual_s : times of the completed steps, all parts together [cell s]
    wall_s : time from the first row of a part to its last, all parts with a verdict together
    """

    name: str
    part_count: int
    judged_count: int
    pass_count: int
    fail_count: int
    indeterminate_count: int
    first_count: int
    first_pass_count: int
    forecast_s: float
    actual_s: float
    wall_s: float
    finding_count: int
    recovery_count: int
    emulated_count: int

    @property
    def first_pass_yield(self) -> float | None:
        """Share of the parts judged for the first time that passed, 0..1."""
        return self.first_pass_count / self.first_count if self.first_count else None

    @property
    def part_s(self) -> float | None:
        """Seconds of a part that has a verdict, by the clock; None without one."""
        return self.wall_s / self.judged_count if self.judged_count else None

    @property
    def against_forecast(self) -> float | None:
        """Seconds taken per second of forecast."""
        return self.actual_s / self.forecast_s if self.forecast_s else None


@dataclass(frozen=True, slots=True)
class EventCount:
    """The count of an event: its names, and its number of parts."""

    names: tuple[str, ...]
    count: int
    part_count: int


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of the parts that filters select.

    Attributes
    ----------
    groups : in order of their names
    findings : by kind and label of the face; a finding on two faces counts on both
    recoveries : by fault and action
    alarms : by number, code and device; their parts are not counted
    """

    groups: tuple[Group, ...]
    findings: tuple[EventCount, ...]
    recoveries: tuple[EventCount, ...]
    alarms: tuple[EventCount, ...]


def figures(store: Store, filters: Filters, by: str = "recipe") -> Figures:
    """Return the figures of parts.

    Parameters
    ----------
    store : store to read
    filters : parts to select
    by : one of `GROUPS`

    Raises
    ------
    ValueError : there is no such group
    HistoryError : the store cannot be read
    """
    if by not in GROUPS:
        raise ValueError(f"by {by}: one of {', '.join(GROUPS)}")
    clause = filters.clause()
    on_face = (FINDING_FACES.c.part_id == FINDINGS.c.part_id) & (
        FINDING_FACES.c.finding == FINDINGS.c.ordinal
    )
    with store.reading() as db:
        groups = tuple(
            Group(
                str(name),
                *(int(v) for v in found[:7]),
                *(float(v) for v in found[7:10]),
                *(int(v) for v in found[10:]),
            )
            for name, *found in db.execute(_groups(clause, by))
        )
        findings = _tally(
            db.execute(
                select(
                    FINDINGS.c.kind, func.coalesce(FINDING_FACES.c.label, ""), *_counts(FINDINGS)
                )
                .select_from(FINDINGS.join(PARTS).outerjoin(FINDING_FACES, on_face))
                .where(clause)
                .group_by(FINDINGS.c.kind, FINDING_FACES.c.label)
            ).all()
        )
        recoveries = _tally(
            db.execute(
                select(RECOVERIES.c.fault, RECOVERIES.c.action, *_counts(RECOVERIES))
                .select_from(RECOVERIES.join(PARTS))
                .where(clause)
                .group_by(RECOVERIES.c.fault, RECOVERIES.c.action)
            ).all()
        )
        runs = select(PARTS.c.run_no).where(filters.clause(is_each=True))
        alarms = _tally(
            db.execute(
                select(ALARMS.c.alarm, ALARMS.c.code, ALARMS.c.device, func.count(), literal(0))
                .where(ALARMS.c.run_no.in_(runs))
                .group_by(ALARMS.c.alarm, ALARMS.c.code, ALARMS.c.device)
            ).all()
        )
    return Figures(groups, findings, recoveries, alarms)


def tally_json(what: str, tally: EventCount) -> Mapping[str, Any]:
    """Return a count as plain JSON values.

    Parameters
    ----------
    what : ``finding``, ``recovery`` or ``alarm``
    tally : of it
    """
    names = {
        "finding": ("kind", "face"),
        "recovery": ("fault", "action"),
        "alarm": ("number", "code", "device"),
    }[what]
    return {**dict(zip(names, tally.names, strict=True)), "count": tally.count}


def _counts(table: Any) -> tuple[ColumnElement[int], ColumnElement[int]]:  # noqa: ANN401
    return func.count(), func.count(func.distinct(table.c.part_id))


def _groups(clause: ColumnElement[bool], by: str) -> Any:  # noqa: ANN401 - a query
    p = PARTS.c
    is_judged = p.verdict != NO_VERDICT
    # among all parts, not those of the filters: a part judged in May is no new one in June
    other = PARTS.alias("other")
    is_before = or_(
        other.c.start < p.start, and_(other.c.start == p.start, other.c.part_id < p.part_id)
    )
    earlier = select(other.c.part_id).where(
        p.serial != "",
        other.c.serial == p.serial,
        other.c.recipe == p.recipe,
        other.c.verdict != NO_VERDICT,
        other.c.is_counted,
        is_before,
    )
    is_first = is_judged & ~earlier.exists()
    named = select(RUNS.c.run_no, RUNS.c.cell, RUN_NAME.label("run")).subquery()
    name = {"run": named.c.run, "cell": named.c.cell, "order": p.order_number}.get(by)
    name = p[by] if name is None else name

    def count(condition: ColumnElement[bool]) -> ColumnElement[int]:
        return func.sum(case((condition, 1), else_=0))

    return (
        select(
            name,
            func.count(),
            count(is_judged),
            count(p.verdict == "pass"),
            count(p.verdict == "fail"),
            count(p.verdict == "indeterminate"),
            count(is_first),
            count(is_first & (p.verdict == "pass")),
            func.sum(p.done_forecast_s),
            func.sum(p.done_actual_s),
            func.sum(case((is_judged, p.wall_s), else_=0.0)),
            func.sum(p.finding_count),
            func.sum(p.recovery_count),
            func.sum(cast(p.is_emulated, Integer)),
        )
        .select_from(
            PARTS.join(named, named.c.run_no == p.run_no) if by in ("run", "cell") else PARTS
        )
        .where(clause)
        .group_by(name)
        .order_by(name)
    )


def _tally(found: Any) -> tuple[EventCount, ...]:  # noqa: ANN401 - rows of names and two counts
    """Return counts, most frequent first."""
    tallies = [
        EventCount(tuple(map(str, names)), int(count), int(parts)) for *names, count, parts in found
    ]
    return tuple(sorted(tallies, key=lambda one: (-one.count, one.names)))


def group_json(group: Group) -> Mapping[str, Any]:
    """Return a group as plain JSON values."""
    return {
        "name": group.name,
        "parts": group.part_count,
        "judged": group.judged_count,
        "pass": group.pass_count,
        "fail": group.fail_count,
        "indeterminate": group.indeterminate_count,
        "first": group.first_count,
        "first_pass": group.first_pass_count,
        "first_pass_yield": group.first_pass_yield,
        "forecast_s": group.forecast_s,
        "actual_s": group.actual_s,
        "against_forecast": group.against_forecast,
        "wall_s": group.wall_s,
        "findings": group.finding_count,
        "recoveries": group.recovery_count,
        "emulated": group.emulated_count,
    }
