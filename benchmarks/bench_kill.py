"""SIGKILL a controller at a random moment, start again, and ask the world what became of the part.

    python benchmarks/bench_kill.py [--seeds 1-25] [--speed 10] [--json]
    python benchmarks/bench_kill.py --cell recipes/cells/ur5e.yaml --at grasping,inspecting:2

The emulated cell is a process of its own and lives on. The first controller is killed at a moment
drawn from the seed, anywhere from the first picture to the tray. A second one is started on the
same folder of runs with `--auto-recover`. Where the part was, what was let go and where it ended
is the world's own word (its control port); what the controllers believed is in the journal. Then
the record is counted: the one part of the world is one part in the history, with its tray.
With --at it is killed soon after it has entered a state for the first or a further time; a moment
that never comes is told, and is no kill.
"""

import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench import EMULATED, Arguments, note, show
from kill_world import KillWorld, kill_world, lines_of, start

from controller.cell.journal import first_flaw, read_rows
from controller.history import Filters, fill, list_parts, open_store
from controller.results.judged import counted_parts
from controller.results.run import list_runs, load_run

RECIPE, PART, CELL_SEED = "recipes/holder.yaml", "recipes/parts/holder.stl", 8
# cell seconds from the first picture to beyond the tray
SPAN_S = 170.0
STAGE_S = 2.0  # cell seconds within which a stage is cut off
# a part that is let go higher than this above what is below it has been dropped
DROP_MM = 15.0
# custody in the journal, and who holds the part in the world
HOLDERS = {
    "in_arm": {"arm"}, "in_fixture": {"fixture"}, "in_both": {"both"},
    "on_table": {"free"}, "placed": {"free"}, "lost": {"free"},
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Moment:
    """When a controller is killed.

    Attributes
    ----------
    state : the state that it has to have entered
    time : for the how manieth time
    span_s : within so many cell seconds after that, as the seed draws it
    """

    state: str = "acquiring"
    time: int = 1
    span_s: float = SPAN_S

    @classmethod
    def of(cls, text: str) -> "Moment":
        """Return the moment that ``STATE`` or ``STATE:TIME`` names."""
        state, _, number = text.partition(":")
        return cls(state, int(number or 1), STAGE_S)


def kill_at(seed: int, speed: float, folder: Path, cell: Path, at: Moment) -> dict[str, Any] | None:
    """Kill a controller at a random moment, start again, and return what happened.

    None where the run ended before that moment came.
    """
    delay_s = random.Random(seed).uniform(0.0, at.span_s)
    runs = folder / "runs"
    with kill_world(folder, PART, seed=CELL_SEED, speed=speed, drawing=cell) as world:
        state, result = _run_until(world, runs, at, delay_s)
        if result:
            return None
        killed = world.when_still()
        before = _part(killed)
        second = start(world, RECIPE, runs, "--auto-recover")
        states = []
        with second:
            for line in lines_of(second):
                if line.get("event") == "result":
                    result = line
                elif line.get("state") not in states[-1:]:
                    states.append(line.get("state"))
        after = world.when_still()
    rows = list(read_rows(runs / "journal.sqlite"))
    said = [row.body for row in rows if row.name == "recovery_proposed"]
    new = after["events"][len(killed["events"]) :]
    free = [e for e in after["events"] if e["what"] == "released" and not e["is_held"]]
    dropped = [
        e for e in new if e["what"] in ("released", "lost") and not e["is_held"]
        and e["lowest_mm"] > DROP_MM
    ]  # fmt: skip
    stated = said[-1]["custody"] if said else "on_table"
    part = _part(after)
    outcome = {
        "seed": seed,
        "killed_in": state,
        "after_s": round(delay_s, 1),
        "held_by": before["custody"],
        "stated": stated,
        "intents": said[-1]["intents"] if said else [],
        "decision": said[-1]["decision"] if said else "",
        "why": said[-1].get("person") or said[-1].get("why", "") if said else "",
        "end": result.get("end"),
        "code": result.get("code"),
        "tray": part["tray"],
        "dropped": len(dropped),
        "released_count": len(free),
        "journal": first_flaw(runs / "journal.sqlite") or "whole",
        "states": states,
        **counted(runs),
    }
    outcome["stated_right"] = before["custody"] in HOLDERS.get(str(stated), set())
    outcome["ok"] = (
        outcome["stated_right"]
        and part["tray"] is not None
        and not dropped
        and len(free) == 1
        and outcome["journal"] == "whole"
        and outcome["counted"] == outcome["listed"] == 1
        and outcome["recorded_tray"] == part["tray"]
    )
    return outcome


def counted(runs: Path) -> dict[str, Any]:
    """Return how many parts the records of all runs and the history have, and the tray of one.

    Parameters
    ----------
    runs : folder of all runs
    """
    records = [load_run(runs, one.run_id) for one in list_runs(runs)]
    store = open_store(f"sqlite:///{runs / 'history.sqlite'}")
    try:
        fill(store, runs)
        listed = list_parts(store, Filters(), 100)
    finally:
        store.close()
    trays = [str(one["tray"]) for one in listed.parts]
    return {
        "counted": sum(len(counted_parts(record)) for record in records),
        "listed": listed.count,
        "recorded_tray": trays[0] if len(trays) == 1 else None,
    }


def _run_until(
    world: KillWorld, runs: Path, at: Moment, delay_s: float
) -> tuple[str, dict[str, Any]]:
    """Run a controller until so long after a moment, and kill it; return its state."""
    state, entered, result = "", 0, {}
    first = start(world, RECIPE, runs)
    until_s: float | None = None
    with first:
        for line in lines_of(first):
            before, state = state, line.get("state") or state
            if line.get("event") == "result":
                return "complete", line
            entered += state == at.state != before
            if until_s is None and entered == at.time:
                until_s = world.truth()["time_s"] + delay_s
            if until_s is not None:
                break
        while first.poll() is None and world.truth()["time_s"] < (until_s or 0.0):
            time.sleep(0.005)
        if first.poll() is None:
            os.kill(first.pid, signal.SIGKILL)
            for line in lines_of(first):
                state = line.get("state") or state
    return state, result


def _part(truth: dict[str, Any]) -> dict[str, Any]:
    part: dict[str, Any] = truth["parts"][0]
    return part


def main() -> int:
    parser = Arguments(__doc__, seeds="101")
    parser.add_argument("--seeds", default="1-25", help="first and last seed")
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--cell", type=Path, default=EMULATED, help="cell file as drawn")
    parser.add_argument("--at", default="", help="STATE[:TIME], ...: one kill in each")
    parser.add_argument("--until", type=float, default=float("inf"), metavar="S",
                        help="begin no further kill after so many seconds")  # fmt: skip
    args = parser.parse_args()
    first, _, last = args.seeds.partition("-")
    outcomes: list[dict[str, Any]] = []
    began_s = time.monotonic()
    moments = [Moment.of(one) for one in args.at.split(",") if one]
    seeds = range(1, len(moments) + 1) if moments else range(int(first), int(last or first) + 1)
    for seed in seeds:
        at = moments[seed - 1] if moments else Moment()
        if time.monotonic() - began_s > args.until:
            break
        with tempfile.TemporaryDirectory() as folder:
            outcome = kill_at(seed, args.speed, Path(folder), args.cell, at)
        if outcome is not None:
            outcomes.append(outcome)
        note(outcome or {"seed": seed, "never came": f"{at.state}:{at.time}"})
    tally = Counter(f"{one['held_by']} -> {one['tray'] or one['end']}" for one in outcomes)
    summary = {
        "statements_right": sum(one["stated_right"] for one in outcomes),
        "dropped": sum(one["dropped"] for one in outcomes),
        "counted_once": sum(one["counted"] == one["listed"] == 1 for one in outcomes),
        "released_twice": sum(one["released_count"] > 1 for one in outcomes),
        "ended": dict(tally),
        "kills": len(outcomes),
        "ok": sum(one["ok"] for one in outcomes),
    }
    show(args, outcomes, summary)
    return 0 if summary["ok"] == summary["kills"] else 1


if __name__ == "__main__":
    sys.exit(main())
