"""Parts of one kind through one emulated cell, with noise and troubles; see `bench_runs.py`."""

import asyncio
import hashlib
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from runs_record import Job, Ran, read_journal, read_world
from runs_stand_ins import TimedStandIns, TruthCamera, World

from controller.cell import compute
from controller.cell.batch import Batch, Outcome, PartRecord, Progress, assemble, product_of
from controller.cell.devices import Devices, resolve
from controller.cell.devices.clocks import find_clock
from controller.cell.journal import Journal, read_rows
from controller.cell.machine import PartFault
from controller.planning import Pick, ReceiveStep, resting_pose
from controller.setup.layout import build_layout
from drivers.clock import CellClock

RUN_LIMIT_WALL_S = 400.0
SETTLE_LIMIT_S = 20.0  # [cell s] for a part that was laid down
MIN_PROBABILITY = 0.02  # of a way to lie that is tried
NEW_SHARE = 0.002  # of the samples; a view that adds less has shown nothing new


class Faults:
    """Causes troubles at random moments, each fitting who has the part then.

    Parameters
    ----------
    rate, per : how likely each ``hold`` (from a gripper's closing to its opening) is to slip, to
        lose the part, or to miss it, or each ``step``
    """

    def __init__(
        self, world: World, clock: CellClock, rate: float, per: str, rng: np.random.Generator
    ) -> None:
        self._world, self._clock, self._rate, self._per, self._rng = world, clock, rate, per, rng
        self._step: object = None
        self._hold = ""
        self._is_due = False
        self._tasks: list[asyncio.Task[None]] = []
        self.caused: list[str] = []

    def watch(self, part: PartRecord) -> None:
        """Be told of progress; draws once a step, or once a hold and then in one of its steps."""
        plan = part.plan
        if plan is None or (part.verdict is not None and part.tray is not None):
            return
        rest: list[Any] = list(plan.steps[part.next_step :])
        if rest or part.verdict is not None:
            rest.append(next(iter(plan.place.values())))
        if not rest or rest[0] is self._step:
            return
        step = self._step = rest[0]
        # the same draws whatever is done with them: one step's luck is not the next one's
        luck, turn, moment, kind, size = self._rng.uniform(size=5)
        if self._per == "step":
            is_hit = luck < self._rate
        else:
            hold = "fixture" if isinstance(step, ReceiveStep) else "arm"
            if hold != self._hold or isinstance(step, Pick):
                self._hold, self._is_due = hold, bool(luck < self._rate)
            ends = (k for k, one in enumerate(rest) if isinstance(one, ReceiveStep))
            left = 1 if hold == "fixture" else next(ends, len(rest))
            is_hit = self._is_due and turn < 1.0 / max(1, left)
            self._is_due = self._is_due and not is_hit
        if is_hit:
            delay_s = float(moment) * step.seconds * (0.4 if isinstance(step, ReceiveStep) else 1.0)
            self._tasks.append(asyncio.create_task(self._cause(step, delay_s, kind, size)))

    async def _cause(self, step: Any, delay_s: float, kind: float, size: float) -> None:  # noqa: ANN401
        is_missed = isinstance(step, Pick) and kind < 0.5
        if is_missed:
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
        if isinstance(step, Pick) or kind < 0.5:
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
        self.job = compute.Job(recipe, cell)
        self.context = compute.context(self.job)

    def poses(self) -> list[int]:
        """Return the ways to lie that are worth trying, one of those that look alike."""
        return [
            p.index
            for p in self.context.poses
            if p.probability >= MIN_PROBABILITY and not p.marginal and p.is_distinct
        ]

    async def run_group(
        self, jobs: Sequence[Job], pool: ProcessPoolExecutor, ready: dict[str, Any], control: Path
    ) -> list[Ran]:
        """Make runs one after the other until one leaves the cell in a state to clear by hand."""
        world = World(control)
        cell = self.context.cell
        clock = find_clock(cell, ready).open()
        devices = Devices.build(cell, resolve(cell, ready["devices"]), clock)
        for name in ("overhead", "inspection"):
            setattr(devices, name, TruthCamera(world, clock))
        done: list[Ran] = []
        async with clock.attending():
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
        clock.close()
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
        minds = TimedStandIns(self.job, pool, rng)
        progress = Progress()
        faults = Faults(world, clock, job.fault_rate, job.fault_per, fault_rng)
        batch: Batch

        def on_progress() -> None:
            part = batch.record.part
            minds.has_recovered = any(
                r.fault is not PartFault.SEEN_TOO_LITTLE for r in part.recoveries
            )
            faults.watch(part)

        batch = assemble(
            (product_of(minds, self.context.recipe, self.context.cell),), self.context.cell,
            layout=build_layout(self.context.cell), devices=devices, clock=clock, journal=journal,
            folder=folder, progress=progress, on_progress=on_progress,
        )  # fmt: skip
        started = time.monotonic()
        try:
            async with asyncio.timeout(RUN_LIMIT_WALL_S):
                outcome = await batch.dispatcher.run()
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
        ran.speed_reached = round(ran.cell_s / wall_s, 2)
        ran.plan_wall_s = [round(s, 2) for s in minds.plan_wall_s]
        read_world(ran, before, after)
        _read_part(ran, batch.record.part, minds)
        read_journal(ran, list(read_rows(folder / "journal.sqlite")))
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


def _read_part(ran: Ran, part: PartRecord, minds: TimedStandIns) -> None:
    weights = minds.weights
    ran.verdict = None if part.verdict is None else part.verdict.verdict.value
    ran.tray = part.tray
    ran.twice, ran.nothing_new = count_twice(minds)
    ran.views, ran.plans = len(part.results), part.plan_count
    ran.recoveries = [r.fault.value for r in part.recoveries]
    seen = part.in_sight
    ran.covered = 0.0 if seen is None else round(float(weights[seen].sum()), 4)
    if part.plan is not None:
        ran.reachable = round(part.plan.reachable_fraction, 4)
        ran.regrips = part.plan.regrasp_count


def count_twice(minds: TimedStandIns) -> tuple[int, int]:
    """Return how many views after a recovery inspected again, and how many turned out to.

    The first number counts views whose every wanted sample had truly been seen before, the second
    those that then showed nothing new, since the part sat otherwise than planned. The first view
    under a grip proves the hold by sight, and is no second inspection.
    """
    seen, wanted, shown = np.zeros(0, dtype=bool), 0, 0
    for view in minds.views:
        if len(seen) == 0:
            seen = np.zeros_like(view.samples)
        if view.is_after_recovery and not view.is_first_of_hold:
            wanted += not (view.promised & ~seen).any()
            shown += bool((view.samples & ~seen).mean() < NEW_SHARE)
        seen |= view.samples
    return wanted, shown
