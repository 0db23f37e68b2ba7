"""The wire to a PLC: registers over Modbus TCP, the handshake, and what it asks of the plant."""

import asyncio
import logging
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

from controller.config.cell.plc import PlcSection

from ...model import Notice, OrderRequest, OrderState, PartResult
from ...plant import Plant, PlantError
from ..tasks import together
from ._server import ModbusServer
from .handshake import MAX_WAITING, Action, Handshake, StartOrder
from .registers import COMMAND, COUNT, CommandBit, FailureReason, read_command

log = logging.getLogger(__name__)

SOURCE: Final = "PLC"
ORDER: Final = "PLC-"  # how the numbers of its orders begin
# Seconds between two looks at how many results wait.
COUNT_S: Final = 1.0


class PlcWire:
    """The courier to a PLC: a result is delivered when the PLC has acknowledged it."""

    name = "plc"

    def __init__(self, settings: PlcSection) -> None:
        self._settings = settings
        self._values = {one.recipe: one.values for one in settings.recipes.values()}
        recipes = {number: one.recipe for number, one in settings.recipes.items()}
        self._handshake = Handshake(recipes, time.monotonic())
        self._inputs = [0] * COUNT
        # until the PLC writes its bits, a start counts as high, and so is no edge when it comes
        self._inputs[COMMAND] = int(CommandBit.START)
        self._wanted: asyncio.Queue[Action] = asyncio.Queue()
        self._changed = asyncio.Event()
        self._plant: Plant | None = None
        self._is_served = asyncio.Event()

    async def serve(self, plant: Plant) -> None:
        """Serve the registers, take orders and stops.

        Raises
        ------
        OSError : the address cannot be listened to
        """
        self._plant = plant
        self._is_served.set()
        settings = self._settings
        server = ModbusServer(
            COUNT, COMMAND, self._read, self._write, frozenset(map(str, settings.clients))
        )
        orders_known = asyncio.Event()
        try:
            async with together() as tasks:
                tasks.create_task(self._follow(plant, orders_known))
                await orders_known.wait()  # a start before would be a second order
                tasks.create_task(self._see(plant))
                tasks.create_task(self._act(plant))
                tasks.create_task(server.serve(*settings.address))
        finally:
            while not self._wanted.empty():
                self._wanted.get_nowait()
            self._handshake.abandon()

    async def deliver(self, notice: Notice) -> None:
        """Show a result of one of its orders; return once the PLC has acknowledged it.

        What a PLC did not order, and what became of a part later, is not for it; an alarm's number
        stands until the cell has no alarm.
        """
        if not isinstance(notice, PartResult):
            if notice.change == "raised" and notice.number is not None:
                self._handshake.alarm(notice.number)
            return
        if not _is_for_plc(notice):
            return
        await self._is_served.wait()
        self._handshake.show(notice, await self._values_for(notice))
        while self._handshake.is_shown:
            self._changed.clear()
            self._handshake.count_waiting(await self._waiting_from(notice))
            try:
                async with asyncio.timeout(COUNT_S):
                    await self._changed.wait()
            except TimeoutError:
                continue

    async def _values_for(self, result: PartResult) -> tuple[str, ...]:
        """Return which values the PLC wants: of the recipe as the order has named it."""
        assert self._plant is not None  # since it is served
        try:
            order = await self._plant.order_of(result.order or "")
        except PlantError:
            return ()
        return self._values.get(order.request.recipe or "", ())

    async def _waiting_from(self, shown: PartResult) -> int:
        """Return how many results wait for the PLC, the shown one among them."""
        assert self._plant is not None  # since it is served
        try:
            others = await self._plant.parts(shown.seq, MAX_WAITING)
        except PlantError:
            return 1
        return 1 + sum(_is_for_plc(one) for one in others)

    def _read(self) -> Sequence[int]:
        return self._handshake.registers(time.monotonic())[:COMMAND] + self._inputs[COMMAND:]

    def _write(self, address: int, values: Sequence[int]) -> None:
        self._inputs[address : address + len(values)] = values
        for action in self._handshake.write(read_command(self._inputs), time.monotonic()):
            self._wanted.put_nowait(action)
        self._changed.set()

    async def _see(self, plant: Plant) -> None:
        async for state in plant.states():
            self._handshake.see(state)

    async def _follow(self, plant: Plant, orders_known: asyncio.Event) -> None:
        changes = plant.order_changes()  # asked for first, so that none is missed
        for order in await plant.orders():
            if order.source == SOURCE and order.is_open:
                self._handshake.taken(order)
            self._heed(order)
        orders_known.set()
        async for order in changes:
            self._heed(order)

    def _heed(self, order: OrderState) -> None:
        known = self._handshake.order
        if known is not None and known.number == order.number:
            self._handshake.taken(order)

    async def _act(self, plant: Plant) -> None:
        while True:
            action = await self._wanted.get()
            command = CommandBit.START if isinstance(action, StartOrder) else CommandBit.STOP
            try:
                if isinstance(action, StartOrder):
                    self._handshake.taken(await self._order(plant, action))
                else:
                    await self._stop(plant)
            except PlantError as error:
                log.warning("PLC: %s", error)
                is_start = command is CommandBit.START
                self._handshake.fail(
                    command, FailureReason.ORDER_REFUSED if is_start else FailureReason.STOP_REFUSED
                )

    async def _stop(self, plant: Plant) -> None:
        """Take back the PLC's order if it has not begun; else stop the cell.

        Raises
        ------
        PlantError : there is nothing to stop
        """
        order = self._handshake.order
        if order is not None:
            try:
                await plant.withdraw(order.number, SOURCE)
            except PlantError:
                pass  # it has begun
            else:
                return
        await plant.stop(SOURCE, "stop bit of the PLC")

    async def _order(self, plant: Plant, action: StartOrder) -> OrderState:
        now = datetime.now(UTC)
        number = f"{ORDER}{now:%Y%m%d-%H%M%S}-{now.microsecond // 1000:03}"
        request = OrderRequest(
            recipe=action.recipe,
            quantity=action.quantity,
            serials=(action.serial,) if action.serial else (),
        )
        order = await plant.order(number, request, SOURCE)
        if order.state == "refused":
            log.warning("PLC: order %s is refused: %s", number, order.reason)
        return order


def _is_for_plc(result: PartResult) -> bool:
    return result.revision == 1 and (result.order or "").startswith(ORDER)
