"""The bridge: the cell as wires see it, and the process that serves them.

Each wire and each receiver has a task of its own. One that ends by an error is begun again after a
pause, and keeps no other from its work.
"""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

from controller.cell.control import ControlError, Order, RunningCell
from controller.cell.journal import JOURNAL_NAME, JournalError
from controller.config import ConfigError
from controller.config.files import file_sha256
from controller.config.shipped import SHIPPED
from controller.launching import Launcher, RecipeChoice
from controller.page.security import Accounts, AccountsError, Role
from controller.results.run import ResultsError

from .folding import TELLING, exported, notices_after, result_of, whole_result
from .model import CellState, OrderRequest, OrderState, PartResult
from .orders import OrderBook
from .outbox import FIRST_PAUSE_WALL_S, Outbox
from .plant import Offer, PlantError, RefusedError, UnknownError, Wire
from .standing import StateReader

log = logging.getLogger(__name__)
STATE_WALL_S: Final = 0.25
LONGEST_PAUSE_WALL_S: Final = 60.0
STATE_AGE_WALL_S: Final = 0.5  # a state no older than this is told again
WHO_MAX: Final = 200


class CellPlant:
    """The cell as wires see it; see `controller.plant.plant.Plant`.

    Parameters
    ----------
    runs_dir, project_dir : folders of runs and of recipes
    cell : name of the cell
    software : version of cellctl
    cell_file_sha256 : of the cell file
    reader : reads the state
    orders : the orders
    launcher : knows the recipes
    accounts : accounts of plant systems
    """

    def __init__(
        self,
        runs_dir: Path,
        project_dir: Path,
        cell: str,
        software: str,
        cell_file_sha256: str,
        reader: StateReader,
        orders: OrderBook,
        launcher: Launcher,
        accounts: Accounts,
    ) -> None:
        self.cell = cell
        self.software = software
        self.cell_file_sha256 = cell_file_sha256
        self._runs_dir = runs_dir
        self._journal = runs_dir / JOURNAL_NAME
        self._project_dir = project_dir
        self._reader = reader
        self._orders = orders
        self._launcher = launcher
        self._accounts = accounts
        self._reading = asyncio.Lock()
        self._last: tuple[float, CellState] | None = None

    def may_enter(self, name: str, password: str) -> bool:
        """Return whether a plant account has this password. Slow on purpose: call in a thread.

        Raises
        ------
        PlantError : the accounts cannot be read
        """
        try:
            found = self._accounts.find(name, password)
        except AccountsError as error:
            raise PlantError(str(error)) from error
        return found is not None and found.role is Role.PLANT

    def account_mark(self, name: str) -> str:
        """Return a mark that changes with role and password of an account; empty for an unknown.

        Raises
        ------
        PlantError : the accounts cannot be read
        """
        try:
            return self._accounts.mark(name)
        except AccountsError as error:
            raise PlantError(str(error)) from error

    async def state(self) -> CellState:
        """Return the state of the cell, at most half a second old."""
        async with self._reading:
            now_s = time.monotonic()
            if self._last is None or now_s - self._last[0] > STATE_AGE_WALL_S:
                self._last = (now_s, await asyncio.to_thread(self._reader.read))
            return self._last[1]

    async def states(self) -> AsyncIterator[CellState]:
        """Yield the state now, then each change."""
        told: CellState | None = None
        while True:
            found = await self.state()
            if told is None or found.model_copy(update={"at": told.at}) != told:
                told = found
                yield found
            await asyncio.sleep(STATE_WALL_S)

    async def recipes(self) -> tuple[Offer, ...]:
        """Return the recipes that an order may name."""
        choices = await self._launcher.choices()
        return await asyncio.to_thread(lambda: tuple(self._offer(one) for one in choices.recipes))

    async def parts(self, after: int, limit: int) -> tuple[PartResult, ...]:
        """Return results whose journal row is after a number, oldest first."""
        return await asyncio.to_thread(self._parts, after, limit)

    async def part(self, run: str, part: int, revision: int | None = None) -> PartResult:
        """Return a result.

        Parameters
        ----------
        run, part : whose
        revision : of its result; None for the last one
        """
        return await asyncio.to_thread(self._part, run, part, revision)

    async def report(self, run: str, part: int) -> Mapping[str, Any]:
        """Return the whole result of a part, as `cellctl report --format json` has it.

        Raises
        ------
        UnknownError : there is none
        """
        try:
            return await asyncio.to_thread(whole_result, self._journal, run, part)
        except (JournalError, ResultsError) as error:
            raise UnknownError(str(error)) from error

    async def export(self, result: PartResult, kind: Literal["csv", "qif", "dfq"]) -> bytes:
        """Return a result as a file that a factory reads, as of its revision.

        Raises
        ------
        PlantError : it cannot be written as such a file
        """
        try:
            return await asyncio.to_thread(exported, self._journal, result, kind)
        except (JournalError, ResultsError, ValueError) as error:
            raise PlantError(str(error)) from error

    async def order(self, number: str, request: OrderRequest, source: str) -> OrderState:
        """Take an order and return it; the same again changes nothing. The state tells a refusal.

        Parameters
        ----------
        number : the plant's own, 1 to 80 signs
        request : what is ordered
        source : account and wire, as in `mes by REST`
        """
        return await self._orders.take(number, request, source)

    async def orders(self) -> tuple[OrderState, ...]:
        """Return the orders, oldest first."""
        return await self._orders.all()

    async def order_of(self, number: str) -> OrderState:
        """Return an order."""
        return await self._orders.find(number)

    def order_changes(self) -> AsyncIterator[OrderState]:
        """Return an iterator over each order as it changes, from this call on."""
        return self._orders.changes()

    async def withdraw(self, number: str, source: str) -> OrderState:
        """Take back an order that has not begun; return it."""
        return await self._orders.withdraw(number, source)

    async def stop(self, source: str, why: str) -> str:
        """Stop the running cell on a ramp, as `cellctl stop`; return its state."""
        return await asyncio.to_thread(self._order_cell, "stop", source, why)

    async def abort(self, source: str, why: str) -> str:
        """Stop the running cell at once, as `cellctl abort`; return its state."""
        return await asyncio.to_thread(self._order_cell, "abort", source, why)

    def _order_cell(self, name: str, source: str, why: str) -> str:
        try:
            body = Order(who=source[:WHO_MAX], why=why[:WHO_MAX])
            reply = RunningCell(self._runs_dir).order(name, body)
        except (ControlError, OSError) as error:
            raise RefusedError(str(error)) from error
        if reply.decision == "refused":
            raise RefusedError(reply.reason)
        return reply.state

    def _offer(self, one: RecipeChoice) -> Offer:
        own = self._project_dir / one.key
        path = own if own.is_file() else SHIPPED / f"{one.key}.yaml"
        try:
            sha256 = file_sha256(path)
        except ConfigError:
            sha256 = ""
        return Offer(one.key, one.name, sha256, one.count, one.problem)

    def _parts(self, after: int, limit: int) -> tuple[PartResult, ...]:
        found: list[PartResult] = []
        if not self._journal.is_file():
            return ()
        try:
            while len(found) < limit:
                told, last = notices_after(
                    self._journal, self.cell, after, names=TELLING, count=limit - len(found)
                )
                found += [
                    one for _, notices in told for one in notices if isinstance(one, PartResult)
                ]
                if last == after:
                    break
                after = last
        except JournalError as error:
            raise PlantError(str(error)) from error
        return tuple(found[:limit])

    def _part(self, run: str, part: int, revision: int | None) -> PartResult:
        try:
            found = result_of(self._journal, self.cell, run, part, revision)
        except (JournalError, ResultsError) as error:
            raise UnknownError(str(error)) from error
        return found


async def serve(plant: CellPlant, orders: OrderBook, wires: Sequence[Wire],
                boxes: Sequence[Outbox]) -> None:  # fmt: skip
    """Serve wires, deliver and follow orders until cancelled.

    Parameters
    ----------
    plant : the cell as wires see it
    orders : its orders
    wires : wires to serve
    boxes : outbox of each receiver
    """
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(orders.run())
        for wire in wires:
            tasks.create_task(_serve_again(wire, plant))
        for box in boxes:
            tasks.create_task(box.run())


async def _serve_again(wire: Wire, plant: CellPlant) -> None:
    """Serve a wire; begin again after an error."""
    pause_s = FIRST_PAUSE_WALL_S
    while True:
        began_s = time.monotonic()
        try:
            await wire.serve(plant)
        except Exception as error:  # noqa: BLE001 - whatever ends one wire must not end the others
            log.warning("%s: %s", wire.name, error or type(error).__name__)
        if time.monotonic() - began_s > LONGEST_PAUSE_WALL_S:
            pause_s = FIRST_PAUSE_WALL_S
        await asyncio.sleep(pause_s)
        pause_s = min(2 * pause_s, LONGEST_PAUSE_WALL_S)
