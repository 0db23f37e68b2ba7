"""A cell in memory, as wires see it: state, recipes, results, orders; what was asked is kept."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from datetime import UTC, datetime
from typing import Any, Literal
from weakref import WeakSet

from controller.plant.model import (
    AlarmNotice,
    CellState,
    Characteristic,
    OrderRequest,
    OrderState,
    PartResult,
)
from controller.plant.plant import Offer, RefusedError, UnknownError

AT = datetime(2026, 11, 28, 10, 15, tzinfo=UTC)


def idle_state(cell: str = "cell-3", **changes: Any) -> CellState:
    state = CellState(
        cell=cell,
        at=AT,
        state="free",
        packml="Stopped",
        is_ready=True,
        may_start="yes",
        is_emulated=True,
    )
    return state.model_copy(update=changes)


def part_result(part: int = 1, **changes: Any) -> PartResult:
    bore = Characteristic(
        id="d1", balloon=1, label="bore", kind="diameter", unit="mm", nominal=8.0, lower=7.9,
        upper=8.1, measured=8.0 + part / 100, U=0.02, verdict="pass",
    )  # fmt: skip
    result = PartResult(
        cell="cell-3", run="20261128-101500-123-holder", part=part, revision=1, seq=100 + part,
        order="PO-4711", recipe="holder", recipe_sha256="ab" * 32, serial=f"SN-{part:04}",
        lot="L7", operator="Ada", begun=AT, ended=AT, verdict="pass", reasons=(), tray="accept",
        disposition="accept", review=None, custody="tray", is_emulated=True, is_dry=False,
        compared_fraction=0.97, characteristics=(bore,), findings=(), pictures=(),
    )  # fmt: skip
    return result.model_copy(update=changes)


def alarm_notice(seq: int = 500, **changes: Any) -> AlarmNotice:
    notice = AlarmNotice(
        cell="cell-3", run="20261128-101500-123-holder", part=2, seq=seq, at=AT, change="raised",
        number=201, code="estop", device="I/O block", message="the emergency stop is pressed",
        action="make the cell safe",
    )  # fmt: skip
    return notice.model_copy(update=changes)


class FakePlant:
    """A `Plant` without a cell.

    Attributes
    ----------
    results : results so far, oldest first; add with `finish`
    told : orders, withdrawals, stops and aborts as they came: (what, number or reason, source)
    passwords : plant accounts
    checked : how often a password was checked
    """

    def __init__(self, cell: str = "cell-3") -> None:
        self.cell = cell
        self.software = "0.2.0"
        self.cell_file_sha256 = "cd" * 32
        self.results: list[PartResult] = []
        self.told: list[tuple[str, str, str]] = []
        self.passwords = {"mes": "correct horse battery"}
        self.checked = 0
        self.offers = (
            Offer("holder", "holder", "ab" * 32, 3, ""),
            Offer("plate", "plate", "ef" * 32, 1, ""),
            Offer("broken", "broken", "00" * 32, 1, "broken.yaml: unknown key"),
        )
        self._state = idle_state(cell)
        self._orders: dict[str, OrderState] = {}
        self._state_changed = asyncio.Condition()
        self._order_listeners: WeakSet[asyncio.Queue[OrderState]] = WeakSet()

    # what a test does

    async def become(self, **changes: Any) -> None:
        """Change the state."""
        async with self._state_changed:
            self._state = self._state.model_copy(update=changes)
            self._state_changed.notify_all()

    def finish(self, result: PartResult) -> PartResult:
        """Add a result."""
        self.results.append(result)
        return result

    def change_order(self, number: str, **changes: Any) -> OrderState:
        """Change an order, as the cell does while it works on it."""
        changed = self._orders[number].model_copy(update=changes)
        self._orders[number] = changed
        for listener in self._order_listeners:
            listener.put_nowait(changed)
        return changed

    # what a wire asks

    def may_enter(self, name: str, password: str) -> bool:
        self.checked += 1
        return self.passwords.get(name) == password

    def account_mark(self, name: str) -> str:
        return self.passwords.get(name, "")

    async def state(self) -> CellState:
        return self._state

    async def states(self) -> AsyncIterator[CellState]:
        last: CellState | None = None
        while True:
            async with self._state_changed:
                await self._state_changed.wait_for(lambda seen=last: self._state != seen)
                last = self._state
            yield last

    async def recipes(self) -> tuple[Offer, ...]:
        return self.offers

    async def parts(self, after: int, limit: int) -> tuple[PartResult, ...]:
        return tuple(one for one in self.results if one.seq > after)[:limit]

    async def part(self, run: str, part: int, revision: int | None = None) -> PartResult:
        found = [
            one
            for one in self.results
            if (one.run, one.part) == (run, part) and revision in (None, one.revision)
        ]
        if not found:
            raise UnknownError(f"no result of part {part} of run {run}")
        return found[-1]

    async def report(self, run: str, part: int) -> Mapping[str, Any]:
        return (await self.part(run, part)).model_dump(mode="json", by_alias=True)

    async def export(self, result: PartResult, kind: Literal["csv", "qif", "dfq"]) -> bytes:
        return f"{kind} {result.key}".encode()

    async def order(self, number: str, request: OrderRequest, source: str) -> OrderState:
        if not 0 < len(number) <= 80 or not number.isprintable():
            raise RefusedError("an order's number has 1 to 80 printable signs")
        self.told.append(("order", number, source))
        known = self._orders.get(number)
        if known is not None:
            if known.request != request and known.state != "queued":
                raise RefusedError(f"order {number} has begun with another content")
            return known
        keys = {offer.key: offer for offer in self.offers}
        refusal = ""
        for wanted in request.wanted:
            offer = keys.get(wanted.recipe)
            if offer is None:
                refusal = f"there is no recipe {wanted.recipe!r}"
            elif offer.problem:
                refusal = offer.problem
        if not refusal and self._state.may_start == "never":
            refusal = "the cell file does not let orders of a plant start runs"
        self._orders[number] = OrderState(
            cell=self.cell,
            number=number,
            state="refused" if refusal else "queued",
            reason=refusal,
            request=request,
            source=source,
            taken=AT,
            changed=AT,
            quantity=len(request.serials) or request.count,
        )
        return self.change_order(number)

    async def orders(self) -> tuple[OrderState, ...]:
        return tuple(self._orders.values())

    async def order_of(self, number: str) -> OrderState:
        if number not in self._orders:
            raise UnknownError(f"there is no order {number!r}")
        return self._orders[number]

    def order_changes(self) -> AsyncIterator[OrderState]:
        listener: asyncio.Queue[OrderState] = asyncio.Queue()
        self._order_listeners.add(listener)
        return _each(listener)

    async def withdraw(self, number: str, source: str) -> OrderState:
        self.told.append(("withdraw", number, source))
        order = await self.order_of(number)
        if order.state not in ("queued", "asked"):
            raise RefusedError(f"order {number} has begun, or is over")
        return self.change_order(number, state="stopped", reason=f"withdrawn by {source}")

    async def stop(self, source: str, why: str) -> str:
        self.told.append(("stop", why, source))
        if self._state.run is None:
            raise RefusedError("nothing runs")
        return "stopping"

    async def abort(self, source: str, why: str) -> str:
        self.told.append(("abort", why, source))
        if self._state.run is None:
            raise RefusedError("nothing runs")
        return "aborting"


async def _each(listener: asyncio.Queue[OrderState]) -> AsyncIterator[OrderState]:
    while True:
        yield await listener.get()
