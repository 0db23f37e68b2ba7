"""Whole cells in simulation: kills, faults by chance, every fault in every state.

The real controller and drivers on the emulated devices and world, in one process on one virtual
clock (`simulation/`, ADR 36); no pictures are made. Each case is one seed, and one that fails
can be run again:

    python benchmarks/bench_simulation.py --kills 2000 --out kills.jsonl     goes on where it ends
    python benchmarks/bench_simulation.py --runs 1000 --fault-rate 0.05
    python benchmarks/bench_simulation.py --faults
    python benchmarks/bench_simulation.py --kills 40 --only 12     seed 12 alone
"""

import argparse
import json
import logging
import os
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from bench import Arguments, note, show
from case_workers import Failed, Workers

from simulation.case import Case, Ended, Kill, run_case
from simulation.cell import PLACES, Scene
from simulation.faults import FAULTS, names_it

SCENES = tuple(
    Scene(recipe, pose, place)
    for place in range(len(PLACES))
    for recipe, pose in (
        ("holder", 0), ("idler_riser", 0), ("widget", 0), ("holder", 1), ("idler_riser", 1),
        ("widget", 1), ("featuretype", 0),
    )
)  # fmt: skip
STATES = (
    "resetting", "acquiring", "recognising", "planning", "grasping", "presenting", "inspecting",
    "handing", "withdrawing", "placing",
)  # fmt: skip
BEFORE = {"withdrawing": ("drop from the arm", "presenting")}  # what leads to a state


@dataclass
class Ran:
    """What became of a case, as a line of a file."""

    key: str
    kind: str
    seed: int
    scene: str
    outcome: str
    ends: list[str]
    message: str
    violations: list[str]
    killed_in: str
    custody_at_kill: str
    custody: str
    tray: str | None
    caused: list[str]
    recoveries: list[str]
    verdict: str
    fault: str = ""
    state: str = ""
    cell_s: float = 0.0
    cpu_s: float = 0.0
    extra: dict[str, float] = field(default_factory=dict)


def kill_cases(count: int, first: int, recovery: str) -> Iterator[tuple[str, Case]]:
    """Yield cases with one kill each, at a moment that the seed decides."""
    for seed in range(first, first + count):
        kill = Kill.drawn(random.Random(f"kill {seed}"))
        yield f"kill/{seed}", Case(seed, SCENES[seed % len(SCENES)], kill, recovery)


def run_cases(count: int, first: int, rate: float) -> Iterator[tuple[str, Case]]:
    """Yield cases in which holds fail by chance."""
    for seed in range(first, first + count):
        yield f"run/{rate:g}/{seed}", Case(seed, SCENES[seed % len(SCENES)], fault_rate=rate)


def fault_cases(
    first: int, faults: Iterable[str], states: Sequence[str]
) -> Iterator[tuple[str, Case]]:
    """Yield every fault in every state."""
    for number, name in enumerate(faults):
        for state in states:
            seed = first + number * len(STATES) + STATES.index(state)
            case = Case(seed, Scene(), fault=(name, state), before=BEFORE.get(state))
            yield f"fault/{name}/{state}/{first}", case


def outcome_of(ended: Ended) -> str:
    """Return one word for what became of a case; the worst that is so."""
    rules = {one.split(" at ")[0] for one in ended.violations}
    if rules & {"dropped", "jaws opened"}:
        return "silent drop"
    if "contact" in rules:
        return "collision"
    if rules:
        return "violation"
    if ended.is_hung:
        return "hang"
    last = ended.ends[-1]
    if last == "complete":
        if not ended.truth["tray"]:
            return "silent drop"
        if ended.verdict == "FAIL":
            return "wrong verdict"  # every part here is good
        if ended.truth["tray"] != "accept":
            return "parked"
        return "recovered" if ended.recoveries or len(ended.ends) > 1 else "complete"
    if last == "held no_part" and len(ended.ends) > 1 and ended.truth["tray"] == "accept":
        return "recovered"  # it had been sorted before the kill: the next start waits for another
    return last.split()[0]


def run_one(work: tuple[str, Case]) -> Ran:
    """Run a case in this process."""
    logging.disable(logging.CRITICAL)
    key, case = work
    started_s = time.process_time()
    ended = run_case(case)
    cpu_s = time.process_time() - started_s
    outcome = outcome_of(ended)
    fault, state = case.fault or ("", "")
    if outcome in ("held", "stopped", "aborted") and fault:
        is_named = names_it(FAULTS[fault], ended.messages[-1])
        outcome = f"{outcome}, named" if is_named else f"{outcome}, wrong message"
    if outcome == "complete" and fault:
        of_it = [one for one in ended.caused if one.startswith(fault)]
        if not of_it:
            outcome = "not reached"  # the state, in a run without further faults
        elif "not now" in of_it[0]:
            outcome = "not now"  # nothing held that could be lost
    extra = {"holds": len(ended.holds), "failed_holds": sum(one.was_hit for one in ended.holds)}
    return Ran(
        key=key,
        kind=key.split("/")[0],
        seed=case.seed,
        scene=name_of(case.scene),
        outcome=outcome,
        ends=ended.ends,
        message=ended.messages[-1],
        violations=ended.violations,
        killed_in=ended.killed_in,
        custody_at_kill=ended.custody_at_kill,
        custody=ended.truth["custody"],
        tray=ended.truth["tray"],
        caused=ended.caused,
        recoveries=ended.recoveries,
        verdict=ended.verdict,
        fault=fault,
        state=state,
        cell_s=ended.cell_s,
        cpu_s=round(cpu_s, 2),
        extra=extra,
    )


def load(path: Path | None) -> list[Ran]:
    """Return what a file holds; a last line cut short is made again."""
    rans = []
    if path is not None and path.is_file():
        for line in path.read_text(encoding="utf-8").splitlines():
            try:
                rans.append(Ran(**json.loads(line)))
            except (ValueError, TypeError):
                continue
    return rans


def run_all(cases: Sequence[tuple[str, Case]], args: argparse.Namespace) -> list[Ran]:
    """Run what the file does not hold yet; return all."""
    wanted = {key for key, _ in cases}
    rans = [ran for ran in load(args.out) if ran.key in wanted]
    done = {ran.key for ran in rans}
    left = [work for work in cases if work[0] not in done]
    until_s = time.monotonic() + args.minutes * 60.0

    def keep(ran: Ran) -> None:
        rans.append(ran)
        if args.out is not None:
            args.out.parent.mkdir(parents=True, exist_ok=True)
            with args.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(ran)) + "\n")
        note({"case": ran.key, "outcome": ran.outcome, "cpu_s": ran.cpu_s})

    workers: Workers[tuple[str, Case], Ran] = Workers(run_one, args.jobs, args.budget)
    for (key, case), result in workers.results(left, until_s):
        keep(no_end(key, case, result) if isinstance(result, Failed) else result)
    return rans


def no_end(key: str, case: Case, failed: Failed) -> Ran:
    """Return the line of a case that came to no end by itself."""
    fault, state = case.fault or ("", "")
    return Ran(
        key, key.split("/")[0], case.seed, name_of(case.scene), failed.outcome, [failed.outcome],
        failed.message, [], "", "", "", None, [], [], "", fault, state, cpu_s=failed.cpu_s,
    )  # fmt: skip


def name_of(scene: Scene) -> str:
    """Return a scene in one word."""
    return f"{scene.recipe}/{scene.pose_index}/{scene.place}"


def summary(rans: Sequence[Ran]) -> dict[str, Any]:
    """Return the figures of one kind of cases."""
    rules = Counter(one.split(" at ")[0] for ran in rans for one in ran.violations)
    cpu = sorted(ran.cpu_s for ran in rans)
    return {
        "cases": len(rans),
        "outcomes": dict(Counter(ran.outcome for ran in rans).most_common()),
        "ended_in_a_tray": sum(bool(ran.tray) for ran in rans),
        "violations": dict(rules),
        "holds": round(sum(ran.extra.get("holds", 0) for ran in rans)),
        "failed_holds": round(sum(ran.extra.get("failed_holds", 0) for ran in rans)),
        "cpu_s_median": cpu[len(cpu) // 2] if cpu else 0.0,
        "cpu_s_worst": cpu[-1] if cpu else 0.0,
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Run what is asked for, print the tables."""
    parser = Arguments(__doc__, kills=2, first=101)
    parser.add_argument("--kills", type=int, default=0, help="cases with one kill each")
    parser.add_argument("--recovery", default="auto", choices=("refuse", "auto"))
    parser.add_argument("--runs", type=int, default=0, help="cases with faults by chance")
    parser.add_argument("--fault-rate", type=float, default=0.05, help="share of holds that fail")
    parser.add_argument("--faults", action="store_true", help="every fault in every state")
    parser.add_argument("--fault", choices=tuple(FAULTS), help="this fault alone")
    parser.add_argument("--state", choices=STATES, help="this state alone")
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--only", help="the case of this key or seed alone")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument(
        "--budget", type=float, default=240.0, help="CPU s after which a case counts as hung"
    )
    parser.add_argument("--minutes", type=float, default=1e6, help="begin no case after so long")
    parser.add_argument("--out", type=Path, help="JSON lines; goes on where the file ends")
    args = parser.parse_args(argv)
    # notes of journals of simulated cells are nobody else's
    os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="cellctl-bench-")
    faults = [args.fault] if args.fault else list(FAULTS)
    states = [args.state] if args.state else list(STATES)
    kinds: dict[str, Callable[[], Iterable[tuple[str, Case]]]] = {
        "kill": lambda: kill_cases(args.kills, args.first, args.recovery),
        "run": lambda: run_cases(args.runs, args.first, args.fault_rate),
        "fault": lambda: fault_cases(args.first, faults, states) if args.faults else (),
    }
    out: dict[str, Any] = {}
    every: list[Ran] = []
    for kind, make in kinds.items():
        cases = [
            one for one in make()
            if args.only in (None, one[0], str(one[1].seed))
        ]  # fmt: skip
        if cases:
            rans = run_all(cases, args)
            every += rans
            out[kind] = summary(rans)
    columns = ("key", "scene", "outcome", "cell_s", "cpu_s", "ends", "message", "violations")
    show(args, [{name: getattr(ran, name) for name in columns} for ran in every], out)
    return int(any(ran.violations for ran in every))


if __name__ == "__main__":
    sys.exit(main())
