"""A visit in which a person, or a script, moves the cell by orders: `cellctl jog`.

It is a visit like a step of commissioning: with journal, locks, interlocks, watchers, permit, and a
stop that halts metal first. The pilot gives the orders; a stop by the pilot halts the motion and
keeps the visit; any other end (Ctrl-C, a closed terminal, an open door) ends it.
"""

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

from controller.arrays import FloatArray
from controller.cell.devices import Devices
from controller.cell.devices.clocks import FoundClock
from controller.cell.errors import CellError, InterlockError, NoPermitError
from controller.cell.operator import Operator
from controller.config import Cell
from controller.config.calibration_reference import CalibrationName
from controller.config.calibrations import Calibration
from drivers.errors import DeviceError
from messages import key

from ..bench import Bench
from ..evidence import StepEvidence
from ..procedure import StepRecord, cell_digest
from ..visit import Build, StepVisit, VisitOrder
from .goals import RefusedMotionError
from .jogger import ArmReading, Jogger
from .orders import JogOrder, Verb, WrongOrderError, read_order

Result = TypeVar("Result")
REFRESH_S: Final = 0.5  # period of live readings while nothing moves [cell s]


class Pilot(Operator, Protocol):
    """The person or script that gives orders, answers questions, and watches.

    Attributes
    ----------
    is_live : the reading is wanted anew all the time
    ends_at_refusal : a refused order ends it all: the next one was meant for another place
    """

    is_live: bool
    ends_at_refusal: bool

    async def order(self) -> str | None:
        """Return the next order; None once there is none any more."""
        ...

    async def wants_stop(self) -> None:
        """Return once the motion is to halt; awaited while an order is carried out."""
        ...

    def show(self, reading: ArmReading) -> None:
        """Take the arm's state."""
        ...

    def done(self, order: str, words: str) -> None:
        """Take the result of an order."""
        ...

    def refused(self, order: str, why: str) -> None:
        """Take the reason why an order was not carried out, or not to its end."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class TakenOver:
    """The arm's position when the pilot took it.

    Attributes
    ----------
    q : (6,)
    T_world_tcp : (4, 4)
    """

    q: FloatArray
    T_world_tcp: FloatArray


class JogStep:
    """Orders until there are no more.

    Parameters
    ----------
    pilot : gives them
    accept : check: returns the reason why a position cannot be taken, empty if it can; None takes
        none

    Attributes
    ----------
    taken : position of the arm at the order `take`
    """

    name = "jog"
    title = "move the arm by orders"
    needs: tuple[str, ...] = ()
    uses: tuple[CalibrationName, ...] = ()
    makes: tuple[CalibrationName, ...] = ()
    valid_days: int | None = None

    def __init__(self, pilot: Pilot, accept: Callable[[TakenOver], str] | None) -> None:
        self._pilot = pilot
        self._accept = accept
        self.taken: TakenOver | None = None

    async def run(self, bench: Bench) -> Mapping[CalibrationName, Calibration]:
        """Carry out orders; return no calibration.

        Raises
        ------
        DeclinedError : a person does not agree to motion
        InterlockError : an interlock rule does not hold
        CellError, DeviceError : an order was refused, where that ends it all
        """
        jogger = Jogger(bench)
        if self._pilot.is_live:
            self._pilot.show(await jogger.read())
        await bench.permit_motion("The arm moves by your orders, slowly.")
        while True:
            text = await self._next_order(bench, jogger)
            if text is None:
                return {}
            try:
                order = read_order(text)
                if order.verb is Verb.QUIT:
                    return {}
                words = await self._carried_out(jogger, order)
            except (InterlockError, NoPermitError):
                raise
            except (CellError, DeviceError) as error:
                self._pilot.refused(text, str(error))
                if self._pilot.ends_at_refusal:
                    raise
                continue
            self._pilot.done(text, words)
            if self.taken is not None:
                return {}

    async def _next_order(self, bench: Bench, jogger: Jogger) -> str | None:
        """Return the next order; display the arm's state meanwhile."""
        ordered = _task(self._pilot.order())
        try:
            while True:
                # the watchers report a device that is gone
                with suppress(DeviceError):
                    self._pilot.show(await jogger.read())
                if not self._pilot.is_live:
                    return await ordered
                pause = _task(bench.clock.sleep(REFRESH_S))
                await asyncio.wait({ordered, pause}, return_when=asyncio.FIRST_COMPLETED)
                pause.cancel()
                if ordered.done():
                    return ordered.result()
        finally:
            ordered.cancel()

    async def _carried_out(self, jogger: Jogger, order: JogOrder) -> str:
        if order.verb is Verb.STOP:
            await jogger.halt()
            return "halted"
        if order.verb is Verb.TAKE:
            return await self._take(jogger)
        moving, stopped = _task(jogger.carry_out(order)), _task(self._pilot.wants_stop())
        try:
            await asyncio.wait({moving, stopped}, return_when=asyncio.FIRST_COMPLETED)
            if not moving.done():
                await jogger.halt()
                raise RefusedMotionError(key("stopped: arm and grippers have halted"))
            return await moving
        finally:
            # a verb that is cancelled stops the arm before it ends
            for task in (moving, stopped):
                task.cancel()
            await asyncio.gather(moving, stopped, return_exceptions=True)

    async def _take(self, jogger: Jogger) -> str:
        if self._accept is None:
            raise WrongOrderError("`take` is an order of `cellctl teach`")
        reading = await jogger.read()
        if reading.q is None or reading.T_world_tcp is None:
            raise RefusedMotionError(key("the arm is not homed: its position is invalid"))
        taken = TakenOver(reading.q, reading.T_world_tcp)
        if why := self._accept(taken):
            raise RefusedMotionError(why)
        self.taken = taken
        return "taken"


def _task(work: Coroutine[Any, Any, Result]) -> asyncio.Task[Result]:
    return asyncio.create_task(work)


@dataclass(frozen=True, slots=True, kw_only=True)
class JogOrders:
    """The order of a jog.

    Attributes
    ----------
    cell : as calibrated so far
    emulated : report of the emulator about itself; empty without one
    clock : clock of the cell
    folder : folder of all runs, with the journal
    by : name of the person who jogs
    recipe : name in the journal
    """

    cell: Cell
    emulated: Mapping[str, Any]
    clock: FoundClock
    folder: Path
    by: str
    recipe: str = "jog"


class JogSession:
    """A jog under way; anything that would end it stops it instead.

    Parameters
    ----------
    orders : orders that the session understands
    pilot : gives the orders
    accept : as for `JogStep`
    build : function that builds the drivers from cell, addresses and clock
    """

    def __init__(
        self,
        orders: JogOrders,
        pilot: Pilot,
        accept: Callable[[TakenOver], str] | None = None,
        build: Build = Devices.build,
    ) -> None:
        self._step = JogStep(pilot, accept)
        now = datetime.now(UTC)
        run_id = f"{now:%Y%m%d-%H%M%S}-{now.microsecond // 1000:03d}-{orders.recipe}"
        self._visit = StepVisit(
            VisitOrder(
                step=self._step,
                recipe={"name": orders.recipe},
                cell=orders.cell,
                digest=cell_digest(orders.cell),
                emulated=orders.emulated,
                clock=orders.clock,
                folder=orders.folder,
                run_id=run_id,
                by=orders.by,
                based_on={},
            ),
            pilot,
            None,
            StepEvidence(orders.folder / run_id, lambda text: None),
            build,
        )

    @property
    def taken(self) -> TakenOver | None:
        """The arm's position at the order `take`; None without one."""
        return self._step.taken

    def request_stop(self, message: str, code: str) -> None:
        """Halt metal, then end."""
        self._visit.stop(message, code)

    def request_abort(self, message: str, code: str) -> None:
        """Do the same."""
        self._visit.stop(message, code)

    async def run(self) -> StepRecord:
        """Connect, carry out orders, come to rest; return the outcome.

        Raises
        ------
        BaseException : a bug; the cell was halted
        """
        return await self._visit.run()
