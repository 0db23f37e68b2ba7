"""Orders of a plant: taken once, kept, started when the cell is free and a permit is given.

Nothing here moves the cell: an order becomes `cellctl run`, started as the page starts it, and that
run has all its own checks and questions. An order is never started twice: what is started is noted
before, and whether it has begun is read from the journal.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final, Literal
from weakref import WeakSet

from pydantic import ValidationError

from controller.cell.control import StandingReply
from controller.cell.journal import (
    JOURNAL_NAME,
    JournalError,
    read_rows_named,
    rows,
)
from controller.cell.lock import LOCK_NAME, read_holder
from controller.launching import CountedRecipe, Launcher, LaunchRefusedError, RunRequest

from .model import Disposition, OrderRequest, OrderState, OrderWord
from .outbox import Book
from .plant import RefusedError, UnknownError
from .tally import RunTally

POLL_WALL_S: Final = 0.5
# A run that was started writes its first row within this time, on a busy machine, too; planning may
# come before it.
BEGIN_WALL_S: Final = 1800.0
MAX_NUMBER: Final = 80
MAX_OPEN: Final = 1000
# Names of an order's counts, by where the parts went.
COUNTED: Final[Mapping[Disposition, str]] = {
    "accept": "accepted", "reject": "rejected", "quarantine": "quarantined",
}  # fmt: skip


class OrderBook:
    """The orders of a cell.

    Parameters
    ----------
    runs_dir : folder of all runs
    book : keeps them
    cell : name of the cell
    launcher : starts runs
    may_start : the cell file's permit
    standing : returns what is known of the cell without asking a run
    now : UTC
    """

    def __init__(
        self,
        runs_dir: Path,
        book: Book,
        cell: str,
        launcher: Launcher,
        may_start: Literal["never", "asked", "yes"],
        standing: Callable[[], StandingReply],
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        self._runs_dir = runs_dir
        self._journal = runs_dir / JOURNAL_NAME
        self._book = book
        self._cell = cell
        self._launcher = launcher
        self._may_start = may_start
        self._standing = standing
        self._now = now
        self._tally: RunTally | None = None
        self._changes: WeakSet[asyncio.Queue[OrderState]] = WeakSet()  # held by who asks
        self._one_at_a_time = asyncio.Lock()
        self._has_new = asyncio.Event()

    async def take(self, number: str, request: OrderRequest, source: str) -> OrderState:
        """Take an order and return it; the same again changes nothing. The state tells a refusal.

        Parameters
        ----------
        number : the plant's own, 1 to 80 signs
        request : what is ordered
        source : account and wire, as in `mes by REST`

        Raises
        ------
        RefusedError : the number makes no sense, has another order that has begun, or too many wait
        """
        if not 0 < len(number) <= MAX_NUMBER or not number.isprintable():
            raise RefusedError(f"an order's number has 1 to {MAX_NUMBER} printable signs")
        async with self._one_at_a_time:
            kept = await asyncio.to_thread(self._all)
            known = kept.get(number)
            if known is not None:
                if known.request == request:
                    return known
                if known.started is not None:
                    raise RefusedError(
                        f"order {number} is {known.state} with other contents; give a new number"
                    )
            if sum(one.is_open for one in kept.values()) >= MAX_OPEN:
                raise RefusedError(f"{MAX_OPEN} orders wait already")
            now = self._now()
            state, reason = await self._first_word(request)
            found = OrderState(
                cell=self._cell, number=number, state=state, reason=reason, request=request,
                source=source[:200], taken=now, changed=now, quantity=request.count,
            )  # fmt: skip
            self._has_new.set()
            return await self._keep(found)

    async def _first_word(self, request: OrderRequest) -> tuple[OrderWord, str]:
        """Return the state of a new order, and why."""
        if self._may_start == "never":
            return "refused", "this cell takes no remote starts: `connect.may_start` is never"
        choices = await self._launcher.choices()
        for one in request.wanted:
            found = choices.recipe(one.recipe)
            if found is None:
                return "refused", f"`{one.recipe}`: there is no such recipe"
            if found.problem:
                return "refused", found.problem
        if self._may_start == "asked":
            return "asked", "a person at the cell releases it: `cellctl orders --release NUMBER`"
        return "queued", ""

    async def all(self) -> tuple[OrderState, ...]:
        """Return the orders, oldest first."""
        return tuple((await asyncio.to_thread(self._all)).values())

    async def find(self, number: str) -> OrderState:
        """Return an order; see `Plant.order_of`."""
        return await self._find(number)

    async def withdraw(self, number: str, source: str) -> OrderState:
        """Take back an order that has not begun; return it.

        Raises
        ------
        RefusedError : it has begun, or is over
        UnknownError : there is none
        """
        async with self._one_at_a_time:
            kept = await self._find(number)
            if kept.state not in ("queued", "asked"):
                raise RefusedError(f"order {number} is {kept.state}; it is not taken back")
            return await self._change(kept, "refused", f"taken back by {source}")

    def changes(self) -> AsyncIterator[OrderState]:
        """Return an iterator over each order as it changes, from this call on."""
        queue: asyncio.Queue[OrderState] = asyncio.Queue(maxsize=MAX_OPEN)
        self._changes.add(queue)
        return _each(queue)

    async def run(self) -> None:
        """Start and follow orders until cancelled."""
        while True:
            with suppress(JournalError, OSError):  # asked again at once; the state tells of it
                await self.step()
            self._has_new.clear()
            with suppress(TimeoutError):
                async with asyncio.timeout(POLL_WALL_S):
                    await self._has_new.wait()

    async def step(self) -> None:
        """Look at each order once: follow those that run, start the next one that may."""
        async with self._one_at_a_time:
            kept = await asyncio.to_thread(all_orders, self._book, are_open=True)
            begun = [one for one in kept.values() if one.state == "running"]
            waiting = [one for one in kept.values() if one.state == "queued"]
            for one in begun:
                await self._follow(one)
            if waiting and not begun:
                await self._start(waiting[0])

    async def _start(self, one: OrderState) -> None:
        why = await asyncio.to_thread(self._why_not)
        if why:
            if one.reason != why:
                await self._change(one, "queued", why)
            return
        request = one.request
        recipes = tuple(
            CountedRecipe(recipe=each.recipe, count=each.quantity) for each in request.wanted
        )
        try:
            wanted = RunRequest(
                recipes=recipes,
                lot=request.lot,
                order_number=one.number,
                serials=request.serials,
            )
            # on the disk before anything is started: an order is never started twice
            one = await self._change(one, "running", "starting", started=self._now())
            await self._launcher.start(wanted, one.source[:MAX_NUMBER])
        except (LaunchRefusedError, ValidationError) as error:
            is_for_now = isinstance(error, LaunchRefusedError) and error.status == 409
            # another run was quicker: the order waits on
            await self._change(one, "queued" if is_for_now else "refused", str(error), started=None)

    def _why_not(self) -> str:
        """Return why no run can begin now; empty if one can."""
        standing = self._standing()
        return "" if standing.state == "free" else standing.message or "the cell is not free"

    async def _follow(self, one: OrderState) -> None:
        """Read from the journal what became of an order that was started."""
        found = await asyncio.to_thread(self._progress, one)
        if found is not None:
            if one.model_copy(update=found) != one:
                await self._keep(one.model_copy(update={**found, "changed": self._now()}))
            return
        facts = self._launcher.facts()
        if facts is not None and facts["code"] is not None:
            lines = [line for line in facts["lines"] if line.startswith("cellctl:")]
            why = (lines or facts["lines"] or [f"exit code {facts['code']}"])[-1]
            await self._change(one, "refused", why.removeprefix("cellctl: "))
        elif facts is None and one.started is not None:
            # started by a bridge that is gone; its run may still be planning
            standing = await asyncio.to_thread(self._standing)
            is_late = self._now() - one.started > timedelta(seconds=BEGIN_WALL_S)
            if standing.state != "taken" and is_late:
                await self._change(
                    one, "refused", "the run that was started for it never began; order it anew"
                )

    def _progress(self, one: OrderState) -> dict[str, Any] | None:
        """Return what the journal has of an order's run; None before its first row."""
        if not self._journal.is_file():
            return None
        # asked before the rows: a run that ends meanwhile has written its last row
        has_cell = read_holder(self._runs_dir / LOCK_NAME) is not None
        run = one.run or self._run_of(one)
        if run is None:
            return None
        if self._tally is None or self._tally.run != run:
            self._tally = RunTally(self._journal, run)
        tally = self._tally
        tally.look()
        assert tally.began is not None  # by which the run was found
        done, quantity = len(tally.trays), tally.began.count
        state: OrderWord = "running"
        reason = ""
        if tally.end is not None:
            word = str(tally.end.body.get("end", "broke_off"))
            state = "done" if word == "complete" and done >= (quantity or 1) else "stopped"
            reason = "" if state == "done" else str(tally.end.body.get("message") or word)
        elif not has_cell:
            state, reason = "stopped", "the run was cut off"
        counts = {name: tally.counts.get(tray, 0) for tray, name in COUNTED.items()}
        return {
            "run": run, "quantity": quantity, "done": done, **counts, "state": state,
            "reason": reason,
        }  # fmt: skip

    def _run_of(self, one: OrderState) -> str | None:
        """Return the run that was started for an order; None before its first row."""
        assert one.started is not None
        # the journal's clock may be a little behind this process's own
        earliest = (one.started - timedelta(seconds=2)).isoformat()
        began = [
            row.run
            for row in read_rows_named(self._journal, (rows.RunBegan.row_name,), earliest)
            if row.body.get("order_number") == one.number
        ]
        return began[-1] if began else None

    def _all(self) -> dict[str, OrderState]:
        return all_orders(self._book)

    async def _find(self, number: str) -> OrderState:
        found = (await asyncio.to_thread(self._all)).get(number)
        if found is None:
            raise UnknownError(f"there is no order {number}")
        return found

    async def _change(
        self, one: OrderState, state: OrderWord, reason: str, **more: datetime | None
    ) -> OrderState:
        update = {"state": state, "reason": reason[:500], "changed": self._now(), **more}
        return await self._keep(one.model_copy(update=update))

    async def _keep(self, one: OrderState) -> OrderState:
        await asyncio.to_thread(keep, self._book, one)
        for queue in tuple(self._changes):
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(one)
        return one


async def _each(queue: asyncio.Queue[OrderState]) -> AsyncIterator[OrderState]:
    while True:
        yield await queue.get()


def all_orders(book: Book, *, are_open: bool = False) -> dict[str, OrderState]:
    """Return the orders of a book by their numbers, oldest first.

    Parameters
    ----------
    book : keeps them
    are_open : only those that are not over
    """
    found = map(OrderState.model_validate_json, book.orders(are_open=are_open))
    return {one.number: one for one in found}


def keep(book: Book, order: OrderState) -> None:
    """Keep an order."""
    body = order.model_dump_json(by_alias=True)
    book.put_order(order.number, body, is_over=not order.is_open)


def release(book: Book, numbers: Sequence[str], who: str) -> list[OrderState]:
    """Release orders that wait for a person at the cell; return them.

    Parameters
    ----------
    book : keeps the orders
    numbers : their numbers
    who : the person

    Raises
    ------
    RefusedError : one does not wait for a person
    UnknownError : there is none of a number
    """
    kept = all_orders(book)
    for number in numbers:
        if number not in kept:
            raise UnknownError(f"there is no order {number}")
        if kept[number].state != "asked":
            raise RefusedError(f"order {number} is {kept[number].state}; it asks for no release")
    update = {"state": "queued", "reason": f"released by {who}", "changed": datetime.now(UTC)}
    released = [kept[number].model_copy(update=update) for number in numbers]
    for one in released:
        keep(book, one)
    return released
