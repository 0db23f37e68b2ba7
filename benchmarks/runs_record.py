"""What is known of one run of `bench_runs.py`: how it is read from world and journal."""

import contextlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from controller.cell.journal import Row

PUT_DOWN_MM = 1.0  # a held part pressed on the table by less is being put down on it
FREE_FALL_MM = 12.0  # let go this high above the table, a part falls


@dataclass(frozen=True)
class Job:
    """One run to make."""

    part: str
    pose: int
    seed: int
    fault_rate: float
    fault_per: str

    @property
    def key(self) -> str:
        return f"{self.part}/{self.pose}/{self.seed}"


@dataclass
class Ran:
    """What became of it."""

    key: str
    part: str
    pose: int
    seed: int
    end: str = ""
    code: str = ""
    message: str = ""
    verdict: str | None = None
    tray: str | None = None
    true_tray: str | None = None
    at_mm: list[float] = field(default_factory=list)  # where the part was at the end
    faults: list[str] = field(default_factory=list)
    recoveries: list[str] = field(default_factory=list)
    covered: float = 0.0
    promised: float = 0.0
    reachable: float = 0.0
    views: int = 0
    regrips: int = 0
    plans: int = 0
    twice: int = 0  # views after a recovery that were to show nothing new
    nothing_new: int = 0  # those that showed nothing new, whatever they were to show
    double_open: int = 0  # let go in the air by the jaws themselves
    collisions: list[str] = field(default_factory=list)
    put_down_touches: int = 0  # of the table, by a part that is being put down
    forecast_s: float = 0.0
    took_s: float = 0.0
    plan_wall_s: list[float] = field(default_factory=list)
    speed_reached: float = 0.0
    cell_s: float = 0.0
    wall_s: float = 0.0

    @property
    def is_complete(self) -> bool:
        return self.end == "complete" and self.tray is not None and self.tray == self.true_tray

    @property
    def has_no_plan(self) -> bool:
        """The planner said why not before anything was touched: a refusal, not a failure."""
        return self.code == "no_plan" and not self.faults and self.plans == 0


def read_world(ran: Ran, before: dict[str, Any], after: dict[str, Any]) -> None:
    ran.true_tray = after["parts"][0]["tray"]
    T = after["parts"][0]["T_world_part"]
    ran.at_mm = [] if T is None else [round(row[3], 0) for row in T[:3]]
    new = after["collisions"][len(before["collisions"]) :]
    is_put_down = [
        c["moving"].startswith("part ") and c["other"] == "table" and c["depth_mm"] < PUT_DOWN_MM
        for c in new
    ]
    told = [
        f"{c['moving']} into {c['other']} {c['depth_mm']:.1f} mm at {c['at_s']:.1f} s" for c in new
    ]
    ran.collisions = [words for words, is_wanted in zip(told, is_put_down, strict=True)
                      if not is_wanted]  # fmt: skip
    ran.put_down_touches = sum(is_put_down)
    for event in after["events"][len(before["events"]) :]:
        if event["what"] == "released" and not event["is_held"]:
            ran.double_open += event["lowest_mm"] > FREE_FALL_MM


def read_journal(ran: Ran, rows: Sequence[Row]) -> None:
    steps = [r.body for r in rows if r.kind == "outcome" and r.name == "step"]
    ran.forecast_s = round(sum(float(s["forecast_s"]) for s in steps), 1)
    ran.took_s = round(sum(float(s["seconds"]) for s in steps), 1)
    plans = [r.body for r in rows if r.kind == "decision" and r.name == "plan"]
    if plans:
        ran.promised = float(plans[0]["covered_fraction"])


def load(path: Path) -> list[Ran]:
    """Return the runs a file holds; a last line cut short is made again."""
    rans = []
    if path.is_file():
        for line in path.read_text().splitlines():
            with contextlib.suppress(ValueError):
                rans.append(Ran(**json.loads(line)))
    return rans


def line_of(r: Ran) -> str:
    ratio = r.took_s / r.forecast_s if r.forecast_s else 0.0
    return (
        f"{r.key:26} {r.end:9} {r.true_tray or '-':10} seen {100 * r.covered:5.1f} of "
        f"{100 * r.promised:5.1f} %  views {r.views:2} plans {r.plans} took/forecast {ratio:.2f} "
        f"wall {r.wall_s:5.1f}  faults {'; '.join(r.faults) or '-'}  "
        f"recoveries {', '.join(r.recoveries) or '-'}"
        + (f"  AGAIN {r.twice}" if r.twice else "")
        + (f"  DOUBLE OPEN {r.double_open}" if r.double_open else "")
        + (f"  COLLISIONS {r.collisions}" if r.collisions else "")
        + (f"  {r.code} at {r.at_mm}: {r.message[:150]}" if r.message else "")
    )
