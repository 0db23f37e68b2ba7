"""Hundreds of parts through the running cell, with noise, slips and drops: does it help itself?

Two forms. By default the real dispatcher, actions, drivers and wires run against the emulated arm,
grippers and world with its physics; recognition answers with the world's truth and noise, and
inspection with what the camera would see of the part where it truly is, so that no picture is made
(`runs_stand_ins.py`). With --whole, every run is a `cellctl run` with pictures and everything.

Slips, drops, missed grips and slips in the fixed gripper are caused at random moments of random
steps over the tests' control port. What is counted comes from the journal and from the world's own
record of contacts and of who held what.

    python benchmarks/bench_runs.py --count 200 --out runs.jsonl     go on where the file ends
    python benchmarks/bench_runs.py --count 20 --parts holder featuretype --fault-rate 0.2
    python benchmarks/bench_runs.py --whole --count 6
    python benchmarks/bench_runs.py --out runs.jsonl --tell          the summary only
"""

import argparse
import asyncio
import contextlib
import hashlib
import itertools
import json
import logging
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from runs_stand_ins import Noise, StandIns, TruthCamera, World

from controller.cell import workers
from controller.cell.actions import Actions
from controller.cell.devices import Devices, resolve
from controller.cell.dispatcher import Dispatcher, Outcome
from controller.cell.journal import Journal, Row, read_rows
from controller.cell.records import PartRecord, Progress
from controller.cell.recovery import Trouble
from controller.cell.run import EMULATED_TIMEOUT_WALL_S
from controller.cli._emulator import emulated_cell, emulator_command
from controller.config import build_layout
from controller.planning import Pick, resting_pose
from drivers.clock import CellClock

ROOT = Path(__file__).parents[1]
SHARED = ROOT.parent / "shared" / "parts"
RECIPES = ("featuretype", "flange_xy", "holder", "idler_riser", "widget")
SHARED_PARTS = (
    "angle_block", "cycloidal_gear", "cycloidal_gear_mirror", "disc_cam_a", "disc_cam_b",
    "nist_ftc06",
)  # fmt: skip
RUN_LIMIT_WALL_S = 240.0
SETTLE_LIMIT_S = 20.0  # [cell s] for a part that was laid down
LEAST_PROBABILITY = 0.02  # of a way to lie that is tried
FREE_FALL_MM = 12.0  # let go this high above the table, a part falls
NEW_SHARE = 0.002  # of the samples; a view that adds less has inspected again

log = logging.getLogger("bench_runs")


@dataclass(frozen=True)
class Job:
    """One run to make."""

    part: str
    pose: int
    seed: int
    fault_rate: float

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
    faults: list[str] = field(default_factory=list)
    recoveries: list[str] = field(default_factory=list)
    covered: float = 0.0
    promised: float = 0.0
    reachable: float = 0.0
    views: int = 0
    regrips: int = 0
    plans: int = 0
    twice: int = 0  # views after a recovery that showed nothing new
    double_open: int = 0  # let go in the air by the jaws themselves
    collisions: list[str] = field(default_factory=list)
    forecast_s: float = 0.0
    took_s: float = 0.0
    plan_wall_s: list[float] = field(default_factory=list)
    skipped_s: float = 0.0
    cell_s: float = 0.0
    wall_s: float = 0.0

    @property
    def is_complete(self) -> bool:
        return self.end == "complete" and self.tray is not None and self.tray == self.true_tray

    @property
    def has_no_plan(self) -> bool:
        """The planner said why not before anything was touched: a refusal, not a failure."""
        return self.code == "no_plan" and not self.faults and self.plans == 0


class Faults:
    """Causes a trouble in some steps, at a random moment, fitting who has the part then."""

    def __init__(
        self, world: World, clock: CellClock, rate: float, rng: np.random.Generator
    ) -> None:
        self._world, self._clock, self._rate, self._rng = world, clock, rate, rng
        self._step: object = None
        self._tasks: list[asyncio.Task[None]] = []
        self.caused: list[str] = []

    def watch(self, part: PartRecord) -> None:
        """Be told of progress; draws once a step."""
        plan = part.plan
        if plan is None or (part.verdict is not None and part.tray is not None):
            return
        if part.next_step < len(plan.steps):
            step: Any = plan.steps[part.next_step]
        elif part.verdict is not None:
            step = next(iter(plan.place.values()))
        else:
            return
        if step is self._step:
            return
        self._step = step
        # the same draws whatever is done with them: one step's luck is not the next one's
        luck, moment, kind, size = self._rng.uniform(size=4)
        if luck < self._rate:
            delay_s = float(moment) * step.seconds
            self._tasks.append(asyncio.create_task(self._cause(step, delay_s, kind, size)))

    async def _cause(self, step: Any, delay_s: float, kind: float, size: float) -> None:  # noqa: ANN401
        if isinstance(step, Pick) and kind < 0.5:
            await self._world("miss")
            self.caused.append("missed grip")
            return
        await self._clock.sleep(delay_s)
        for _ in range(40):  # until somebody alone has it
            custody = (await self._world("truth"))["parts"][0]["custody"]
            if custody in ("arm", "fixture"):
                break
            await self._clock.sleep(0.5)
        else:
            return
        name = f"{custody} {type(step).__name__}"
        if kind > 0.5 if isinstance(step, Pick) else kind < 0.5:
            await self._world("lose_part", gripper=custody)
            self.caused.append(f"drop from {name}")
            return
        along = (2.0 + 6.0 * size) * (1 if kind > 0.75 else -1)
        if custody == "fixture":
            along /= 2.0
        turn = float(np.degrees(0.3 * (size - 0.5)))
        await self._world("slip", gripper=custody, along_mm=float(along), turn_deg=turn)
        self.caused.append(f"slip in {name} {along:+.1f} mm {turn:+.0f} deg")

    async def aclose(self) -> None:
        for task in self._tasks:
            task.cancel()
        for outcome in await asyncio.gather(*self._tasks, return_exceptions=True):
            if isinstance(outcome, Exception):
                self.caused.append(f"fault failed: {outcome!r}")


class Bench:
    """One emulated cell, and parts of one kind through it."""

    def __init__(self, part: str, recipe: Path, cell: Path, speed: float, scratch: Path) -> None:
        self.part, self.speed, self._scratch = part, speed, scratch
        self.job = workers.Job(recipe, cell)
        self.context = workers.context(self.job)

    def poses(self) -> list[int]:
        """Return the ways to lie that are worth trying, one of those that look alike."""
        return [
            p.index
            for p in self.context.poses
            if p.probability >= LEAST_PROBABILITY and not p.marginal and p.same_as in (-1, p.index)
        ]

    async def run_group(
        self, jobs: Sequence[Job], pool: ProcessPoolExecutor, ready: dict[str, Any], control: Path
    ) -> list[Ran]:
        """Make runs one after the other until one leaves the cell in a state to clear by hand."""
        world = World(control)
        clock = CellClock(self.speed, EMULATED_TIMEOUT_WALL_S)
        cell = self.context.cell
        devices = Devices.build(cell, resolve(cell, ready["devices"]), clock)
        for name in ("overhead", "inspection"):
            setattr(devices, name, TruthCamera(world, clock))
        done: list[Ran] = []
        try:
            await devices.connect()
            for job in jobs:
                ran = await self._run(job, pool, world, clock, devices)
                done.append(ran)
                if ran.end != "complete":
                    break
        finally:
            await devices.aclose()
            await world.aclose()
        return done

    async def _run(
        self, job: Job, pool: ProcessPoolExecutor, world: World, clock: CellClock, devices: Devices
    ) -> Ran:
        seed = int.from_bytes(hashlib.sha256(job.key.encode()).digest()[:8], "little")
        rng, fault_rng = (np.random.default_rng([seed, i]) for i in (0, 1))
        await self._lay(job, world, rng, clock)
        before = await world("truth")
        time_before = await world("time")
        folder = self._scratch / job.key.replace("/", "-")
        journal = Journal(folder / "journal.sqlite", "run")
        minds = StandIns(self.job, pool, Noise(), rng)
        progress = Progress()
        faults = Faults(world, clock, job.fault_rate, fault_rng)
        actions: Actions

        def on_progress() -> None:
            troubles = [r.trouble for r in actions.part.recoveries]
            minds.has_recovered = any(t is not Trouble.SEEN_TOO_LITTLE for t in troubles)
            faults.watch(actions.part)

        actions = Actions(
            minds, self.context.recipe, cell=self.context.cell,
            layout=build_layout(self.context.cell), devices=devices, clock=clock, journal=journal,
            folder=folder, progress=progress, on_progress=on_progress,
        )  # fmt: skip
        dispatcher = Dispatcher(actions, devices, journal, clock, on_progress)
        started = time.monotonic()
        try:
            async with asyncio.timeout(RUN_LIMIT_WALL_S):
                outcome = await dispatcher.run(1)
        except TimeoutError:
            outcome = Outcome("aborted", f"not done after {RUN_LIMIT_WALL_S} s", "bench_limit", "")
        finally:
            await faults.aclose()
            journal.close()
        wall_s = time.monotonic() - started
        after, time_after = await world("truth"), await world("time")
        ran = Ran(job.key, job.part, job.pose, job.seed, outcome.end, outcome.code, outcome.message)
        ran.wall_s, ran.faults = round(wall_s, 1), faults.caused
        ran.cell_s = round(time_after["world_s"] - time_before["world_s"], 1)
        ran.skipped_s = round(time_after["skipped_s"] - time_before["skipped_s"], 2)
        ran.plan_wall_s = [round(s, 2) for s in minds.plan_wall_s]
        _read_world(ran, before, after)
        _read_part(ran, actions.part, minds)
        _read_journal(ran, list(read_rows(folder / "journal.sqlite")))
        return ran

    async def _lay(
        self, job: Job, world: World, rng: np.random.Generator, clock: CellClock
    ) -> None:
        """Lay the part down in a pose, anywhere parts are laid, any way round."""
        pose = next(p for p in self.context.poses if p.index == job.pose)
        area = self.context.cell.table.drop_area
        x, y = rng.uniform(*area.x), rng.uniform(*area.y)
        T = resting_pose(self.context.solid, pose, x, y, rng.uniform(-np.pi, np.pi))
        T[2, 3] += 0.5
        await world("place", T_world_part=T.tolist())
        until = clock.now_s() + SETTLE_LIMIT_S
        while not (await world("truth"))["at_rest"] and clock.now_s() < until:
            await clock.sleep(0.2)


def _read_world(ran: Ran, before: dict[str, Any], after: dict[str, Any]) -> None:
    ran.true_tray = after["parts"][0]["tray"]
    known = len(before["collisions"])
    ran.collisions = [
        f"{c['moving']} into {c['other']} {c['depth_mm']:.1f} mm at {c['at_s']:.1f} s"
        for c in after["collisions"][known:]
    ]
    for event in after["events"][len(before["events"]) :]:
        if event["what"] == "released" and not event["is_held"]:
            ran.double_open += event["lowest_mm"] > FREE_FALL_MM


def _read_part(ran: Ran, part: PartRecord, minds: StandIns) -> None:
    weights = minds.weights
    ran.verdict = None if part.verdict is None else part.verdict.verdict.value
    ran.tray = part.tray
    ran.twice = count_twice(minds)
    ran.views, ran.plans = len(part.results), part.plan_count
    ran.recoveries = [r.trouble.value for r in part.recoveries]
    seen = part.seen
    ran.covered = 0.0 if seen is None else round(float(weights[seen].sum()), 4)
    if part.plan is not None:
        ran.reachable = round(part.plan.reachable_fraction, 4)
        ran.regrips = part.plan.regrip_count


def _read_journal(ran: Ran, rows: Sequence[Row]) -> None:
    steps = [r.body for r in rows if r.kind == "outcome" and r.name == "step"]
    ran.forecast_s = round(sum(float(s["forecast_s"]) for s in steps), 1)
    ran.took_s = round(sum(float(s["seconds"]) for s in steps), 1)
    plans = [r.body for r in rows if r.kind == "decision" and r.name == "plan"]
    if plans:
        ran.promised = float(plans[0]["covered_fraction"])


def count_twice(minds: StandIns) -> int:
    """Return how many views after a recovery showed nothing that had not been seen before.

    The first view under a grip proves the hold by sight, and is no second inspection.
    """
    seen, count = np.zeros(len(minds.views[0].samples) if minds.views else 0, dtype=bool), 0
    for view in minds.views:
        is_old = (view.samples & ~seen).mean() < NEW_SHARE
        count += bool(is_old and view.is_after_recovery and not view.is_first_of_hold)
        seen |= view.samples
    return count


# --- many runs ----------------------------------------------------------------------------------


def part_file(name: str, scratch: Path) -> tuple[Path, Path]:
    """Return a recipe for a part, of the project's or a made one, and its cell."""
    cell = ROOT / "recipes/cells/emulated.yaml"
    if name in RECIPES:
        return ROOT / f"recipes/{name}.yaml", cell
    path = scratch / f"{name}.yaml"
    stl = SHARED / f"{name}.stl"
    path.write_text(f"name: {name}\npart: {stl}\nunit: mm\ncell: {cell}\n")
    return path, cell


def schedule(benches: dict[str, list[int]], args: argparse.Namespace) -> list[Job]:
    """Return the runs to make: every part and way to lie in turn, until there are enough."""
    kinds = [(name, pose) for name, poses in benches.items() for pose in poses]
    # likely poses of every part first, so that a short bench sees every part
    kinds.sort(key=lambda k: (benches[k[0]].index(k[1]), list(benches).index(k[0])))
    jobs = []
    for number, (name, pose) in zip(range(args.count), itertools.cycle(kinds), strict=False):
        jobs.append(Job(name, pose, args.seed + number // len(kinds), args.fault_rate))
    return jobs


def run_jobs(args: argparse.Namespace, scratch: Path) -> None:
    """Make the runs that the file does not hold yet."""
    done = {ran.key for ran in load(args.out)}
    names = [n for n in args.parts if n in RECIPES or (SHARED / f"{n}.stl").is_file()]
    for name in set(args.parts) - set(names):
        print(f"{name}: left out, its file is not here", file=sys.stderr)
    with workers.make_pool() as pool:
        benches = {}
        for name in names:
            recipe, cell = part_file(name, scratch)
            benches[name] = Bench(name, recipe, cell, args.speed, scratch)
        jobs = [j for j in schedule({n: b.poses() for n, b in benches.items()}, args)
                if j.key not in done]  # fmt: skip
        for name, bench in benches.items():
            mine = [j for j in jobs if j.part == name]
            while mine:
                taken = mine[: args.per_start]
                rans = _with_cell(bench, taken, pool, args, scratch)
                for ran in rans:
                    args.out.parent.mkdir(parents=True, exist_ok=True)
                    with args.out.open("a") as file:
                        file.write(json.dumps(asdict(ran)) + "\n")
                    print(line_of(ran), flush=True)
                mine = mine[max(1, len(rans)) :]


def _with_cell(
    bench: Bench,
    jobs: Sequence[Job],
    pool: ProcessPoolExecutor,
    args: argparse.Namespace,
    scratch: Path,
) -> list[Ran]:
    control = scratch / "control.sock"
    control.unlink(missing_ok=True)
    part = scratch / f"{bench.part}.stl"
    bench.context.solid.mesh.export(part)
    command = emulator_command(
        bench.job.cell_path, [part], speed=args.speed, seed=jobs[0].seed,
        more=("--empty", "--control", str(control), "--camera-transport", "socket"),
    )  # fmt: skip
    with emulated_cell(command, scratch / "emulator.log") as ready:
        return asyncio.run(bench.run_group(jobs, pool, ready, control))


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
        + (f"  {r.code}: {r.message[:150]}" if r.message else "")
    )


def tell(rans: Sequence[Ran]) -> dict[str, Any]:
    """Return what the runs come to."""
    refused = [r for r in rans if r.has_no_plan]
    tried = [r for r in rans if not r.has_no_plan]
    hit = [r for r in tried if r.faults]
    ratios = np.array(
        [r.took_s / r.forecast_s for r in tried if r.forecast_s > 0 and r.is_complete]
    )
    plans = np.array([s for r in tried for s in r.plan_wall_s[1:]])
    return {
        "runs": len(rans),
        "refused_before_anything_moved": len(refused),
        "tried": len(tried),
        "complete": sum(r.is_complete for r in tried),
        "complete_share": round(sum(r.is_complete for r in tried) / max(1, len(tried)), 4),
        "with_faults": len(hit),
        "faults": sum(len(r.faults) for r in tried),
        "complete_with_faults": sum(r.is_complete for r in hit),
        "recoveries": dict(Counter(t for r in tried for t in r.recoveries)),
        "collisions": sum(len(r.collisions) for r in rans),
        "inspected_twice": sum(r.twice for r in rans),
        "double_open": sum(r.double_open for r in rans),
        "forecast_ratio_median": None if not len(ratios) else round(float(np.median(ratios)), 3),
        "forecast_ratio_5_95": [round(float(v), 3) for v in np.quantile(ratios, [0.05, 0.95])]
        if len(ratios)
        else None,
        "replan_wall_s_median": None if not len(plans) else round(float(np.median(plans)), 2),
        "replan_wall_s_max": None if not len(plans) else round(float(plans.max()), 2),
        "world_s_lost": round(sum(r.skipped_s for r in rans), 2),
        "not_complete": dict(Counter(r.code or r.end for r in tried if not r.is_complete)),
        "wall_s": round(sum(r.wall_s for r in rans), 0),
        "cores": os.cpu_count(),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--parts", nargs="+", default=[*RECIPES, *SHARED_PARTS])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--speed", type=float, default=15.0)
    parser.add_argument("--fault-rate", type=float, default=0.05, help="of steps, each")
    parser.add_argument("--per-start", type=int, default=25, help="runs per emulated cell")
    parser.add_argument("--out", type=Path, default=None, help="JSON lines; gone on with")
    parser.add_argument("--tell", action="store_true", help="only sum up what --out holds")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    logging.basicConfig(level=logging.ERROR)
    with tempfile.TemporaryDirectory(prefix="cellruns") as folder:
        scratch = Path(folder)
        args.out = args.out or scratch / "runs.jsonl"
        if not args.tell:
            run_jobs(args, scratch)
        summary = tell(load(args.out))
    if args.json:
        print(json.dumps(summary))
    else:
        for name, value in summary.items():
            print(f"{name:32} {value}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
