"""Groups of parts with a common feature, and the use of their time."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from ..run import RunRecord
from .folding import PartTakt, RunTakt, takt_of
from .uses import BUSY, TimeUse

GROUPS: Final[Mapping[str, Callable[[RunTakt, PartTakt], str]]] = {
    "run": lambda run, part: run.run_id,
    "recipe": lambda run, part: part.recipe,
    "lot": lambda run, part: run.lot,
    "order": lambda run, part: run.order_number,
    "operator": lambda run, part: run.operator,
    "day": lambda run, part: f"{run.start:%Y-%m-%d}",
    "part": lambda run, part: f"{run.run_id} {part.number}",
}
MIN_NAMED_SHARE: Final = 0.005  # share of all time below which a use is not named in the line


@dataclass(frozen=True, slots=True)
class TaktGroup:
    """Parts together [cell s].

    Attributes
    ----------
    name : name of the group
    part_count, unjudged_count : parts in their tray; parts begun that have no verdict, but for
        those whose record another run has
    planned_ahead_count : of them, whose plan was made while the arm had the part before
    seconds : by use, with what belongs to no part of these runs, such as homing, if any
    execute_s, busy_s : of Execute, and of that what the arm did by its plan
    judged_execute_s : of Execute, what the parts in their tray took
    forecast_s : forecast of the parts that are done and had a plan, with `forecast_took_s`, what
        they took
    late_wall_s : for how long the controller itself was late [wall s]
    has_cell_clock : false where seconds of some runs are the wall's
    """

    name: str
    part_count: int
    unjudged_count: int
    planned_ahead_count: int
    seconds: Mapping[TimeUse, float]
    execute_s: float
    busy_s: float
    judged_execute_s: float
    forecast_s: float
    forecast_took_s: float
    late_wall_s: float
    has_cell_clock: bool

    @property
    def total_s(self) -> float:
        """The total time; the uses add up to it."""
        return sum(self.seconds.values())

    @property
    def busy_share(self) -> float | None:
        """Share of Execute in which the arm did its plan's work; None without Execute."""
        return self.busy_s / self.execute_s if self.execute_s > 0 else None

    @property
    def part_s(self) -> float | None:
        """Execute seconds of a part that has a verdict; None without one."""
        return self.judged_execute_s / self.part_count if self.part_count else None


def grouped(runs: Iterable[RunTakt], by: str) -> tuple[TaktGroup, ...]:
    """Return the groups, in the order of their first part.

    Parameters
    ----------
    runs : their takt
    by : one of `GROUPS`
    """
    name_of = GROUPS[by]
    found: dict[str, list[tuple[RunTakt, PartTakt]]] = {}
    for run in runs:
        for part in run.parts:
            found.setdefault(name_of(run, part), []).append((run, part))
        if by in ("run", "lot", "order", "operator", "day"):  # not divided among the parts
            found.setdefault(name_of(run, run.around), []).append((run, run.around))
    return tuple(_group(name, members) for name, members in found.items())


def run_takt(record: RunRecord) -> TaktGroup:
    """Return the arm's time in a run, split by use.

    Parameters
    ----------
    record : record of the run
    """
    (group,) = grouped([takt_of(record)], "run")
    return group


def _group(name: str, members: Iterable[tuple[RunTakt, PartTakt]]) -> TaktGroup:
    members = list(members)
    parts = [part for _, part in members]
    timed = [part for part in parts if part.is_done and part.forecast_s is not None]
    return TaktGroup(
        name=name,
        part_count=sum(part.is_done for part in parts),
        unjudged_count=sum(
            part.number > 0 and part.is_counted and not part.is_done for part in parts
        ),
        planned_ahead_count=sum(part.is_planned_ahead for part in parts),
        seconds={use: sum(part.seconds.get(use, 0.0) for part in parts) for use in TimeUse},
        execute_s=sum(part.execute_s for part in parts),
        busy_s=sum(part.busy_s for part in parts),
        judged_execute_s=sum(part.execute_s for part in parts if part.is_done),
        forecast_s=sum(part.forecast_s or 0.0 for part in timed),
        forecast_took_s=sum(part.execute_s for part in timed),
        late_wall_s=sum(part.late_wall_s for part in parts),
        has_cell_clock=all(run.has_cell_clock for run, _ in members),
    )


def takt_json(group: TaktGroup) -> dict[str, Any]:
    """Return a group as plain JSON values; the seconds by use add up to `total_s`.

    Parameters
    ----------
    group : group of parts
    """
    share, part_s = group.busy_share, group.part_s
    return {
        "name": group.name,
        "parts": group.part_count,
        "unjudged": group.unjudged_count,
        "planned_ahead": group.planned_ahead_count,
        "seconds": {use.value: round(seconds, 3) for use, seconds in group.seconds.items()},
        "total_s": round(group.total_s, 3),
        "execute_s": round(group.execute_s, 3),
        "busy_s": round(group.busy_s, 3),
        "busy_share": None if share is None else round(share, 4),
        "s_a_part": None if part_s is None else round(part_s, 2),
        "forecast_s": round(group.forecast_s, 2),
        "forecast_took_s": round(group.forecast_took_s, 2),
        "late_wall_s": round(group.late_wall_s, 3),
        "clock": "cell" if group.has_cell_clock else "wall",
    }


def takt_line(group: TaktGroup) -> str:
    """Return the arm's work and waiting in one sentence; empty without Execute.

    Parameters
    ----------
    group : group of parts
    """
    share = group.busy_share
    if share is None:
        return ""
    waits = sorted(((s, use) for use, s in group.seconds.items() if use not in BUSY), reverse=True)
    named = [f"{use.words} {s:.0f} s" for s, use in waits if s >= MIN_NAMED_SHARE * group.total_s]
    part = "" if group.part_s is None else f", {group.part_s:.0f} s a part"
    if group.unjudged_count:
        part += f" ({group.unjudged_count} without a verdict left out)"
    clock = "" if group.has_cell_clock else " (by the wall clock)"
    waited = f"; it waited for {', '.join(named)}" if named else ""
    return f"arm busy {100 * share:.0f} % of {group.execute_s:.0f} s{part}{waited}{clock}"
