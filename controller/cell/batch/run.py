"""Runs one batch from connecting to rest: builds the cell, runs the dispatcher, cleans up."""

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from concurrent.futures import Executor
from contextlib import AbstractAsyncContextManager, asynccontextmanager, nullcontext, suppress
from dataclasses import dataclass
from typing import Any, Final

from controller.config import Cell, Recipe
from controller.planning.model import CellLayout
from controller.planning.motion import ProvenMove, Swept
from controller.setup.layout import build_layout
from drivers.clock import CellClock
from messages import key, say

from ..compute import Compute, Job
from ..custody import Custody, custody_of, where_it_is
from ..custody.known_journals import after_known, open_noted_journal
from ..devices import Devices, resolve
from ..devices.clocks import Speed
from ..devices.supervision import CallerPrograms, Supervised
from ..journal import (
    HOST_STAMPS,
    JOURNAL_NAME,
    CellJournal,
    Journal,
    JournalError,
    Stamps,
    rows,
)
from ..operator import NOBODY, Journaled, Operator, require_acknowledged
from ..operator.notices import Notices
from ..recovery import Beside, HomingBounds, Interrupted
from ..services.records import BatchProduct, PartRecord, RunProgress
from .assembly import Batch, assemble, product_of
from .beginning import RunStart, begin, who_and_what
from .dispatcher import BatchEnd, Dispatcher
from .order import RunOrder
from .starting import recipe_for, refuse, start


@dataclass(frozen=True, slots=True)
class Outfit:
    """The run's equipment on its computer.

    Attributes
    ----------
    compute : returns the compute service of a job, given the worker process
    devices : returns the drivers, given cell file, addresses and clock
    stamps : the clocks that the journal's rows are stamped by
    on_row : called with number, kind and name of each row of the journal, from any thread
    """

    compute: Callable[[Job, Executor], Compute] = Compute
    devices: Callable[[Cell, Mapping[str, dict[str, Any]], CellClock], Devices] = Devices.build
    stamps: Stamps = HOST_STAMPS
    on_row: Callable[[int, str, str], None] | None = None


HOST: Final = Outfit()


@dataclass(frozen=True, slots=True)
class RunResult:
    """The result of a run.

    Attributes
    ----------
    parts : and what became of each
    speed : speed of the cell's time
    why_not_verified : reason why the cell's verification does not count; empty if it does, or if
        the cell is emulated as drawn
    """

    outcome: BatchEnd
    parts: tuple[PartRecord, ...]
    speed: Speed
    why_not_verified: str = ""


def new_run_id(recipe: Recipe, stamps: Stamps = HOST_STAMPS, more: int = 0) -> str:
    """Return a name for a run that sorts by time.

    Parameters
    ----------
    recipe : the first of the run
    stamps : the clock
    more : recipes beside it
    """
    now = stamps.utc()
    others = f"+{more}" if more else ""
    return f"{now:%Y%m%d-%H%M%S}-{now.microsecond // 1000:03d}-{recipe.name}{others}"


async def run_batch(
    order: RunOrder,
    pool: Executor,
    on_progress: Callable[[RunProgress], None],
    on_dispatcher: Callable[[Dispatcher], None],
    on_notice: Callable[[str], None] = lambda text: None,
    outfit: Outfit = HOST,
    operator: Operator = NOBODY,
    ahead: Executor | None = None,
    callers: CallerPrograms | None = None,
) -> RunResult:
    """Run a batch to rest and return its result; everything from here on is in the journal.

    Parameters
    ----------
    order : order to run, and the folder for its files
    pool : the worker process
    on_progress : called on the event loop with every change; must return at once
    on_dispatcher : called once before devices are connected, with what can stop the run
    on_notice : called with sentences that the operator should read
    outfit : services of this computer that the run uses
    operator : person who decides where the cell cannot
    ahead : a worker process for the next part, while the arm has the one before; None for none
    callers : callers whose stop orders the supervisor takes while the event loop is late

    Raises
    ------
    JournalError : the journal cannot be written, and nothing may move without it
    JournalLostError : the journal that is noted there is lost, so that custody is unknown
    DeviceError : a device does not answer; nothing has moved
    """
    where = resolve(order.cell, order.emulated.get("devices", {}))
    # in a thread, since a long journal takes a second to check
    opened, began = await asyncio.to_thread(_open_journal, order, where, outfit.stamps)
    order.folder.mkdir(parents=True, exist_ok=True)
    journal = opened.journal
    journal.on_row = outfit.on_row
    if not order.clock.is_virtual:
        journal.write_behind()
    if opened.notice:
        on_notice(opened.notice)
    try:
        decider = Journaled(operator, journal)
        found = await begin(order, began, journal, outfit.stamps, on_notice)
        products = _products(order, outfit, pool, ahead)
        progress = RunProgress()
        async with _cell_time(order, journal) as clock, _notices(order) as notices:
            devices = outfit.devices(order.cell, where, clock)
            speed = Speed(clock.speed)

            def show() -> None:
                if notice := speed.look(clock):
                    on_notice(notice)
                progress.speed = speed
                on_progress(progress)

            layout = build_layout(order.cell)
            batch = assemble(
                products,
                order.cell,
                layout,
                devices,
                clock,
                journal,
                order.folder,
                progress,
                show,
                decider,
                found.calibration,
                numbers=order.papers.numbers,
                stored=found.stored,
                on_alarm=notices.take,
                is_stepwise=order.is_stepwise,
            )
            on_dispatcher(batch.dispatcher)
            run = _Run(order, journal, decider, found, products, layout, devices, batch)
            supervision: AbstractAsyncContextManager[object] = nullcontext()
            if not order.clock.is_virtual:
                supervision = _supervision(order, devices, clock, batch, on_notice, callers)
            try:
                async with clock.attending():
                    outcome = await run.to_rest(show, supervision)
            except BaseException as error:
                run.note_broken_off(error)
                raise
        return _result(order, found, outcome, batch.record.parts, speed, journal)
    finally:
        if unwritten := await asyncio.to_thread(journal.close):
            on_notice(
                f"{unwritten} rows of the run could not be written to {journal.path}: the journal "
                "ends before the run did. Look at the cell before you start again"
            )


def _open_journal(
    order: RunOrder, where: Mapping[str, dict[str, Any]], stamps: Stamps
) -> tuple[CellJournal, rows.RunBegan]:
    """Return the cell's journal, and the first row of this run."""
    began = after_known(who_and_what(order, where))
    path, is_vouched_for = order.runs_dir / JOURNAL_NAME, order.is_part_removed
    opened = open_noted_journal(path, order.run_id, began, stamps, may_begin_anew=is_vouched_for)
    return opened, began


def _products(
    order: RunOrder, outfit: Outfit, pool: Executor, ahead: Executor | None
) -> tuple[BatchProduct, ...]:
    """Return the products of an order, each with its compute services."""
    return tuple(
        product_of(
            outfit.compute(job, pool),
            one.recipe,
            order.cell,
            one.count,
            number,
            None if ahead is None else outfit.compute(job, ahead),
        )
        for number, (one, job) in enumerate(zip(order.ordered, order.jobs, strict=True))
    )


@asynccontextmanager
async def _cell_time(order: RunOrder, journal: Journal) -> AsyncIterator[CellClock]:
    """Yield the cell's clock, which also stamps the journal's rows meanwhile."""
    clock = order.clock.open()
    journal.cell_clock = clock.now_s
    try:
        yield clock
    finally:
        journal.cell_clock = None
        clock.close()


@asynccontextmanager
async def _supervision(
    order: RunOrder,
    devices: Devices,
    clock: CellClock,
    batch: Batch,
    on_notice: Callable[[str], None],
    callers: CallerPrograms | None,
) -> AsyncIterator[None]:
    """Have a supervisor stop the cell while the event loop cannot; name the wires it cannot reach.

    Raises
    ------
    LinkError : the supervisor does not start; nothing has moved
    """
    shared = order.clock.path
    supervised = Supervised(
        devices,
        clock,
        "" if shared is None else str(shared),
        lambda: batch.gate.permits.permit is not None,
        lambda why: batch.dispatcher.request_abort(why, "supervised"),
        callers,
    )
    async with supervised.beating():
        for name in supervised.unreached:
            on_notice(
                say(
                    "{name}: accepts no second connection, so the supervisor cannot "
                    "stop it while the controller is late",
                    name=name,
                )
            )
        yield


@asynccontextmanager
async def _notices(order: RunOrder) -> AsyncIterator[Notices]:
    """Yield the runner of a command per alarm; wait in the end for those still running."""
    facts = {"run": order.run_id, "recipe": order.recipe.name, "cell": order.cell.name}
    notices = Notices(order.cell.on_alarm, order.cell.folder, facts)
    try:
        yield notices
    finally:
        await asyncio.to_thread(notices.close)


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """A built cell, from connecting its devices to rest."""

    order: RunOrder
    journal: Journal
    operator: Operator
    found: RunStart
    products: tuple[BatchProduct, ...]
    layout: CellLayout
    devices: Devices
    batch: Batch

    async def to_rest(
        self, show: Callable[[], None], supervision: AbstractAsyncContextManager[object]
    ) -> BatchEnd:
        """Connect the devices, run the batch if it may begin, and let go of the devices.

        Parameters
        ----------
        show : shows what is so now
        supervision : entered once the devices are connected, before anything moves
        """
        try:
            self.batch.record.progress.label = "connecting"
            show()
            self.journal.write(rows.Connected(await self.devices.connect()))
            async with supervision, self.batch.signals.told():
                outcome = await self._run()
            show()
            return outcome
        finally:
            await self.batch.taking.ahead.aclose()
            await self.batch.ahead.aclose()
            await self.devices.aclose()

    async def _run(self) -> BatchEnd:
        barred = await _barred(self.order, self.journal, self.operator)
        if barred is not None:
            return barred
        # until it is decided what becomes of it, the status has what the journals know
        self.batch.record.part.custody = custody_of(self.found.known)
        held = await start(
            self.order,
            self.devices,
            self.journal,
            self.found.known,
            self.found.began,
            self.layout,
            self.operator,
            self._sweep,
            self._back,
        )
        if isinstance(held, BatchEnd):
            return held
        self.batch.record.part.custody = Custody.ON_TABLE
        if held is not None:
            folder = self.order.runs_dir / held.left.run
            self.batch.resumption.accept(held, folder, self._product_of(held.left))
        return await self.batch.dispatcher.run()

    def _product_of(self, left: Interrupted) -> BatchProduct:
        """Return the product of an interrupted part; the first where the part is unknown."""
        return self.products[recipe_for(left, self.found.began) or 0]

    async def _sweep(self, left: Interrupted, bounds: HomingBounds) -> Swept:
        """Prove the space that homing with a part sweeps."""
        return await self._product_of(left).compute.homing_swept(*bounds.arguments)

    async def _back(self, left: Interrupted, beside: Beside) -> ProvenMove:
        """Prove that an arm beside its path goes back to it."""
        return await self._product_of(left).compute.proven_back(*beside.arguments)

    def note_broken_off(self, error: BaseException) -> None:
        """Write that the run has not come to rest, and where the part is, if still possible."""
        where = where_it_is(self.batch.record.part.custody)
        with suppress(JournalError):
            self.journal.write(
                rows.RunBrokeOff(error=str(error) or type(error).__name__, where=where)
            )


def _result(
    order: RunOrder,
    found: RunStart,
    outcome: BatchEnd,
    parts: tuple[PartRecord, ...],
    speed: Speed,
    journal: Journal,
) -> RunResult:
    """Write the end of a run, and return it."""
    ended = rows.RunEnded(
        end=outcome.end,
        message=outcome.message,
        parts=len(parts),
        speed=rows.SpeedReached(**speed.as_json()),
    )
    with suppress(JournalError):  # the outcome says so; the operator is told either way
        journal.write(ended)
    is_as_drawn = order.emulated.get("as_drawn", False) and not order.cell.calibration
    why = "" if is_as_drawn else found.calibration.why_not_verified
    return RunResult(outcome, parts, speed, why)


async def _barred(order: RunOrder, journal: Journal, operator: Operator) -> BatchEnd | None:
    """Return the outcome of a start barred by an unacknowledged stop, else None."""
    latch = await require_acknowledged(journal, order.cell.name, operator)
    if latch is None:
        return None
    return refuse(journal, latch.words, code="not_acknowledged", where=key("Nothing has moved."))
