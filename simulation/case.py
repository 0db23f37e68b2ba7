"""One seeded case: a part through a cell whose controllers are killed and whose devices fail.

`run_case(Case(...))` is the whole of it; a failing seed is one line.
"""

import asyncio
import hashlib
import random
import shutil
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from controller.cell.journal import Row, read_rows
from drivers.errors import DeviceError

from .cell import Controller, Scene, SimulatedCell
from .invariants import Watch
from .loop import NothingLeftError, SimulatedLoop, SimulatedProcess

MAX_CELL_S: Final = 3600.0  # a case that is not done by then hangs
PART_STEPS: Final = 110_000  # of a controller that works on one part
DEAD_S: Final = 4.0  # from a kill to the next start
PART_ROWS: Final = 96  # that a run of one part writes
NEAR_STEPS: Final = 300  # that a controller makes until the devices have heard of a row


@dataclass(frozen=True, slots=True)
class Kill:
    """When a controller is killed.

    Attributes
    ----------
    row : once its run has written so many rows; 0: from the beginning
    steps : and then after so many of its steps
    """

    row: int = 0
    steps: int = 0

    @classmethod
    def drawn(cls, rng: random.Random) -> "Kill":
        """Return a moment: half of them anywhere, half of them right after a row of the journal."""
        if rng.random() < 0.5:
            return cls(steps=rng.randrange(PART_STEPS))
        return cls(rng.randrange(PART_ROWS), rng.randrange(NEAR_STEPS))


@dataclass(frozen=True, slots=True)
class Case:
    """What is to happen.

    Attributes
    ----------
    seed : decides all that is not said here
    kill : when the first controller is killed; None for no kill
    recovery : what the next start does with a part in a gripper
    starts : of controllers, at most
    """

    seed: int
    scene: Scene = field(default_factory=Scene)
    kill: Kill | None = None
    recovery: str = "refuse"
    starts: int = 4


@dataclass(slots=True)
class Ended:
    """What became of a case.

    Attributes
    ----------
    ends : how each start ended: the batch's end and its code, or the error it broke off with
    messages : of these ends
    truth : of the world, at the end
    violations : as sentences
    killed_in : state and last row of the controller that was killed
    custody_at_kill : who had the part then
    cell_s : how long it took
    steps : of the loop
    digest : of the journal's bytes
    """

    case: Case
    ends: list[str] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)
    truth: dict[str, Any] = field(default_factory=dict)
    violations: list[str] = field(default_factory=list)
    killed_in: str = ""
    custody_at_kill: str = ""
    cell_s: float = 0.0
    steps: int = 0
    digest: str = ""
    faults: list[str] = field(default_factory=list)

    @property
    def is_parked_or_sorted(self) -> bool:
        """Whether the last run ended with the part in a tray."""
        return bool(self.ends) and self.ends[-1] == "complete" and bool(self.truth["tray"])


def run_case(case: Case, folder: Path | None = None) -> Ended:
    """Run a case and return what became of it.

    Parameters
    ----------
    case : what is to happen
    folder : where journal and files go, left there; None for a temporary one
    """
    where = Path(tempfile.mkdtemp(prefix="cellctl-simulation-", dir=_memory()))
    try:
        target = folder or where / "cell"
        if target.exists():
            shutil.rmtree(target)
        return _Run(case, target).run()
    finally:
        shutil.rmtree(where, ignore_errors=True)


def _memory() -> Path | None:
    """Return a folder in memory, where there is one: the journal syncs often."""
    shm = Path("/dev/shm")
    return shm if shm.is_dir() else None


class _Run:
    def __init__(self, case: Case, folder: Path) -> None:
        self.case = case
        self.loop = SimulatedLoop(case.seed)
        self.rng = random.Random(f"case {case.seed}")
        self.cell = SimulatedCell(self.loop, case.seed, case.scene, folder)
        self.watch = Watch(self.cell)
        self.ended = Ended(case)

    def run(self) -> Ended:
        loop, ended = self.loop, self.ended
        try:
            with suppress(NothingLeftError):
                loop.run_until_complete(self._story())
            ended.cell_s = round(self.cell.now_s(), 3)
            ended.steps = loop.step_count
            ended.truth = self.cell.truth()["parts"][0]
            ended.violations = [str(one) for one in self.watch.violations]
            ended.violations += [f"loop: {one.get('message')}: {one.get('exception')!r}"
                                 for one in loop.errors]  # fmt: skip
            ended.digest = journal_digest(self.cell.journal_path)
            return ended
        finally:
            loop.bury()
            loop.close()

    async def _story(self) -> None:
        async with asyncio.timeout(MAX_CELL_S), self.cell:
            self.cell.after_slice = self.watch.look
            await self._first()
            while self.ended.ends[-1] == "killed" and len(self.ended.ends) < self.case.starts:
                await asyncio.sleep(DEAD_S)
                self._check_rest()
                await self._start(None)
            await asyncio.sleep(DEAD_S)
            self._check_rest()
            self.cell.catch_up()

    async def _first(self) -> None:
        await self._start(self.case.kill)

    async def _start(self, kill: Kill | None) -> None:
        is_first = not self.ended.ends
        options = {} if is_first else {"recovery": self.case.recovery}
        controller = self.cell.controller(**options)
        self.watch.permitted()
        killed = asyncio.Event()

        due = None if kill is None or kill.row else kill.steps

        def after_step(owner: SimulatedProcess | None) -> None:
            nonlocal due
            if kill is None or owner is not controller.process or not owner.is_alive:
                return
            if due is None and controller.row_count >= kill.row:
                due = owner.step_count + kill.steps
            if due is not None and owner.step_count >= due:
                self._kill(controller)
                killed.set()

        task = controller.start()
        self.loop.after_step = after_step if kill is not None else None
        waiting = asyncio.ensure_future(killed.wait())
        await asyncio.wait({task, waiting}, return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        self.loop.after_step = None
        if not task.done():
            self._note("killed", "")
            return
        try:
            outcome = task.result().outcome
        except (DeviceError, Exception) as error:  # noqa: BLE001  an end like any other
            self._note(f"broke off: {type(error).__name__}", str(error))
            return
        self._note(outcome.end if not outcome.code else f"{outcome.end} {outcome.code}",
                   outcome.message)  # fmt: skip
        self.watch.stopped()

    def _note(self, end: str, message: str) -> None:
        self.ended.ends.append(end)
        self.ended.messages.append(message)

    def _kill(self, controller: Controller) -> None:
        self.watch.remember_rows()
        controller.kill()
        last = list(read_rows(self.cell.journal_path))[-1:]
        row = f"{last[0].kind} {last[0].name}" if last else "nothing"
        self.ended.killed_in = f"{controller.state} after {row}"
        self.ended.custody_at_kill = self.cell.truth()["parts"][0]["custody"]

    def _check_rest(self) -> None:
        """Check what must be so whenever the cell rests."""
        self.watch.check_folded()
        found: Sequence[Row] = self.watch.check_journal()
        self.watch.check_once(found)
        self.watch.check_custody(found)


def journal_digest(path: Path) -> str:
    """Return the SHA-256 of all that a journal's rows say."""
    digest = hashlib.sha256()
    if path.exists():
        for row in read_rows(path):
            digest.update(repr(row).encode())
    return digest.hexdigest()
