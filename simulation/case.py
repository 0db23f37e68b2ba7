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
from functools import cache
from pathlib import Path
from typing import Any, Final

from controller.cell.journal import Row, is_of, read_rows, rows
from controller.cell.machine import Event
from controller.cell.operator import Answer, Question
from controller.virtual_time import NothingLeftError

from .cell import Controller, Scene, SimulatedCell
from .faults import FAULTS, Cause
from .holds import Hold, Holds, Lengths
from .invariants import Watch
from .loop import SimulatedLoop, SimulatedProcess
from .power import cut_power

MAX_CELL_S: Final = 2400.0  # longest case; one that takes longer hangs
PART_STEPS: Final = 115_000  # steps of a controller that works on one part
PART_ROWS: Final = 140  # rows that a run of one part writes
NEAR_STEPS: Final = 300  # steps of a controller until the devices have heard of a row
DEAD_S: Final = (0.3, 12.0)  # shortest and longest time from a kill to the next start
LENGTHS_SEED: Final = 1  # seed of the run without faults that measures the holds
LOOK_S: Final = 0.4  # time that a person looks before they let a motion begin
REST_S: Final = 4.0  # time from the last end to the check of the world


@dataclass(frozen=True, slots=True)
class Kill:
    """The time at which a controller is killed.

    Attributes
    ----------
    row : number of rows of its run after which it applies; 0: from the beginning
    steps : and then after so many of its steps
    is_power_cut : its computer loses its power, and with it rows that were not secured
    """

    row: int = 0
    steps: int = 0
    is_power_cut: bool = False

    @classmethod
    def drawn(cls, rng: random.Random) -> "Kill":
        """Return a moment: half of them anywhere; a third is a power cut."""
        is_power_cut = rng.random() < 1 / 3
        if rng.random() < 0.5:
            return cls(0, rng.randrange(PART_STEPS), is_power_cut)
        return cls(rng.randrange(PART_ROWS), rng.randrange(NEAR_STEPS), is_power_cut)


@dataclass(frozen=True, slots=True)
class Case:
    """The plan of a case.

    Attributes
    ----------
    seed : seed of everything not given here
    kill : time at which the first controller is killed; None for no kill
    recovery : decision of the next start on a part in a gripper
    starts : largest number of starts of controllers
    fault : name in `FAULTS`, with the state that it befalls; None for none
    before : a fault that comes earlier, with its state, so that the state of `fault` is reached
    fault_rate : share of holds that fail by chance (`holds`)
    again : after a run that stopped a person looks, closes the door, resets the emergency stop,
        and starts anew; with `recovery` "auto" the cell goes on by itself, else they accept what
        the start proposes
    is_stepwise : a person lets each motion begin, after a look at it
    """

    seed: int
    scene: Scene = field(default_factory=Scene)
    kill: Kill | None = None
    recovery: str = "refuse"
    starts: int = 4
    fault: tuple[str, str] | None = None
    before: tuple[str, str] | None = None
    fault_rate: float = 0.0
    again: bool = False
    is_stepwise: bool = False


@dataclass(slots=True)
class Ended:
    """The end of a case.

    Attributes
    ----------
    ends : end of each start: the batch's end and its code, or the error it broke off with
    messages : messages of these ends
    truth : truth about the part, at the end
    violations : as sentences
    killed_in : state and last row of the controller that was killed
    custody_at_kill : holder of the part at that time
    caused : the faults that befell the cell
    recoveries : part faults that controllers recovered from
    verdict : verdict of the part, empty without one
    holds : in order, with what was drawn for them
    cell_s : duration
    steps : steps of the loop
    digest : digest of the journal
    """

    case: Case
    ends: list[str] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)
    truth: dict[str, Any] = field(default_factory=dict)
    violations: list[str] = field(default_factory=list)
    killed_in: str = ""
    custody_at_kill: str = ""
    caused: list[str] = field(default_factory=list)
    recoveries: list[str] = field(default_factory=list)
    verdict: str = ""
    holds: list[Hold] = field(default_factory=list)
    cell_s: float = 0.0
    steps: int = 0
    digest: str = ""

    @property
    def is_in_tray(self) -> bool:
        """Whether the last run was completed with the part in a tray."""
        return bool(self.ends) and self.ends[-1] == "complete" and bool(self.truth["tray"])

    @property
    def is_hung(self) -> bool:
        """Whether it did not come to rest in time."""
        return bool(self.ends) and self.ends[-1] == "hang"


def run_case(case: Case, folder: Path | None = None) -> Ended:
    """Run a case and return its end.

    Parameters
    ----------
    case : case to simulate
    folder : folder for journal and files, kept; None for a temporary one
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
    """Return a folder in memory, if there is one: the journal syncs often."""
    shm = Path("/dev/shm")  # nosec B108: the folder in it is made by mkdtemp
    return shm if shm.is_dir() else None


@cache
def hold_lengths(scene: Scene) -> Lengths:
    """Return the durations of each kind of hold in a run of a scene without faults [s]."""
    where = Path(tempfile.mkdtemp(prefix="cellctl-simulation-", dir=_memory()))
    try:
        run = _Run(Case(LENGTHS_SEED, scene), where / "cell")
        run.run()
        return run.holds.lengths_seen()
    finally:
        shutil.rmtree(where, ignore_errors=True)


class Accepting:
    """A person who looks, acknowledges a stop, and accepts the cell's proposal."""

    async def decide(self, question: Question) -> Answer | None:
        """Acknowledge, and accept the proposal of a start; answer nothing else."""
        if question.code not in ("part_left", "not_acknowledged"):
            return None
        return Answer(question.choices[0].key, "a person", "it is as it says")


class Attending:
    """A person who closes an open door, looks, acknowledges, and has the cell go on."""

    def __init__(self, cell: SimulatedCell) -> None:
        self._cell = cell

    async def attend(self, controller: Controller) -> None:
        """Have a controller go on each time it is held."""
        while True:
            await asyncio.sleep(LOOK_S)
            dispatcher = controller.dispatcher
            if dispatcher is None or not dispatcher.state.startswith("suspended_"):
                continue
            await self._close()
            for event in (Event.ACKNOWLEDGE, Event.RESUME):
                await dispatcher.command(event, "a person", "the cell is clear")

    async def _close(self) -> None:
        await asyncio.sleep(LOOK_S)
        self._cell.befall("door", closed=True)
        await asyncio.sleep(LOOK_S)  # until the I/O block was read


class Stepping:
    """A person who lets each motion begin after a look at it."""

    async def decide(self, question: Question) -> Answer | None:
        """Let a motion begin; answer nothing else."""
        if question.code != "next_motion":
            return None
        await asyncio.sleep(LOOK_S)
        return Answer(question.choices[0].key, "a person")


class _Run:
    def __init__(self, case: Case, folder: Path) -> None:
        self.case = case
        self.loop = SimulatedLoop(case.seed)
        self.rng = random.Random(f"case {case.seed}")
        self.cell = SimulatedCell(self.loop, case.seed, case.scene, folder)
        self.watch = Watch(self.cell)
        self.cause = Cause(self.cell, self.watch, random.Random(f"faults {case.seed}"))
        lengths = hold_lengths(case.scene) if case.fault_rate else {}
        luck = random.Random(f"holds {case.seed}")
        self.holds = Holds(self.cause, case.fault_rate, luck, lengths)
        self.ended = Ended(case)
        self.lost_from: int | None = None

    def run(self) -> Ended:
        loop, ended = self.loop, self.ended
        try:
            try:
                loop.run_until_complete(self._story())
            except (TimeoutError, NothingLeftError) as error:
                self._note("hang", f"not done after {MAX_CELL_S:.0f} s: {error}")
            ended.cell_s = round(self.cell.now_s(), 3)
            ended.steps = loop.step_count
            ended.truth = self.cell.truth()["parts"][0]
            ended.caused, ended.holds = self.cause.caused, self.holds.made
            ended.violations = [str(one) for one in self.watch.violations]
            ended.violations += [f"loop: {one.get('message')}: {one.get('exception')!r}"
                                 for one in loop.errors]  # fmt: skip
            ended.digest = journal_digest(self.cell.journal_path)
            self._read_journal()
            return ended
        finally:
            self.cell.close()
            loop.bury()
            loop.close()

    async def _story(self) -> None:
        async with asyncio.timeout(MAX_CELL_S), self.cell:
            self.cell.after_slice = self.watch.look
            self.holds.begin()
            await self._start(self.case.kill)
            if self.case.again:
                self.cell.operator = Accepting()
            while self._starts_again() and len(self.ended.ends) < self.case.starts:
                await asyncio.sleep(self.rng.uniform(*DEAD_S))
                if self.case.again:
                    self._put_right()
                self._check()
                await self._start(None)
            await asyncio.sleep(REST_S)
            self.cell.catch_up()
            self._check()
            self._check_rest()

    def _starts_again(self) -> bool:
        end = self.ended.ends[-1]
        if end == "killed" or not self.case.again:
            return end == "killed"
        return not end.startswith(("refused", "complete"))

    def _put_right(self) -> None:
        """Close the door, pull the emergency stop out and reset it, as a person would."""
        self.cell.befall("door", closed=True)
        self.cell.befall("estop", pressed=False)
        self.cell.befall("reset")

    async def _start(self, kill: Kill | None) -> None:
        options: dict[str, Any] = {} if not self.ended.ends else {"recovery": self.case.recovery}
        if self.case.again and options:
            options = {"recovery": "auto" if self.case.recovery == "auto" else "ask"}
        if self.case.is_stepwise:
            options["is_stepwise"], self.cell.operator = True, Stepping()
        controller = self.cell.controller(**options)
        self.watch.permitted()
        self._arm_faults(controller)
        if self.case.fault is not None and self.case.fault[0] == "door":
            self.cause.spawn(Attending(self.cell).attend(controller))
        killed = asyncio.Event()
        due = None if kill is None or kill.row else kill.steps

        def after_step(owner: SimulatedProcess | None) -> None:
            nonlocal due
            if kill is None or owner is not controller.process or not owner.is_alive:
                return
            if due is None and controller.row_count >= kill.row:
                due = owner.step_count + kill.steps
            if due is not None and owner.step_count >= due:
                self._kill(controller, kill)
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
        except Exception as error:  # noqa: BLE001  an end like any other
            self._note(f"broke off {type(error).__name__}", str(error))
            return
        self._note(f"{outcome.end} {outcome.code}".strip(), outcome.message)
        unconfirmed = {
            str(row.body["device"])
            for row in read_rows(self.cell.journal_path, controller.run_id)
            if row.name == rows.StopNotConfirmed.row_name
        }
        self.watch.stopped(frozenset(unconfirmed))

    def _arm_faults(self, controller: Controller) -> None:
        """Cause the case's faults during the first controller."""
        if self.case.fault is None or self.ended.ends:
            return
        name, state = self.case.fault
        if self.case.before is None:
            self.cause.at_state(controller, state, FAULTS[name])
            return
        before, at = self.case.before

        def then() -> None:
            self.cause.at_state(controller, state, FAULTS[name])

        self.cause.at_state(controller, at, FAULTS[before], then)

    def _note(self, end: str, message: str) -> None:
        self.ended.ends.append(end)
        self.ended.messages.append(message)

    def _kill(self, controller: Controller, kill: Kill) -> None:
        self.watch.remember_rows()
        controller.kill()
        last = []
        with suppress(Exception):  # it may not have begun
            last = list(read_rows(self.cell.journal_path))[-1:]
        row = f"{last[0].kind} {last[0].name}" if last else "nothing"
        how = "power cut" if kill.is_power_cut else "killed"
        self.ended.killed_in = f"{how} in {controller.state or 'connecting'} after {row}"
        self.ended.custody_at_kill = self.cell.truth()["parts"][0]["custody"]
        if kill.is_power_cut and last:
            self.lost_from = cut_power(self.cell.journal_path, self.rng)

    def _check(self) -> None:
        """Check the conditions that hold whenever no controller runs."""
        self.watch.check_folded()
        found: Sequence[Row] = self.watch.check_journal(lost_from=self.lost_from)
        self.watch.check_once(found)

    def _check_rest(self) -> None:
        """Check the conditions that hold once the cell is at rest."""
        if self.cell.journal_path.exists():
            self.watch.check_custody(list(read_rows(self.cell.journal_path)))

    def _read_journal(self) -> None:
        if self.cell.journal_path.exists():
            found = recoveries_and_verdict(self.cell.journal_path)
            self.ended.recoveries, self.ended.verdict = found


def recoveries_and_verdict(journal: Path) -> tuple[list[str], str]:
    """Return the part faults that controllers recovered from, and the last verdict, "" for none."""
    faults, verdict = [], ""
    for row in read_rows(journal):
        if is_of(row, rows.RecoveryBegun):
            faults.append(rows.RecoveryBegun.model_validate(row.body).fault)
        elif is_of(row, rows.PartJudged):
            verdict = rows.PartJudged.model_validate(row.body).verdict
    return faults, verdict


def journal_digest(path: Path) -> str:
    """Return the SHA-256 of all rows of a journal."""
    digest = hashlib.sha256()
    if path.exists():
        for row in read_rows(path):
            digest.update(repr(row).encode())
    return digest.hexdigest()
