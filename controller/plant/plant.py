"""What a wire may ask of the cell and do to it, and what a wire is. No I/O.

A wire knows nothing else of the cell: not the journal, not the control socket, no device. What it
cannot ask for here it cannot do, least of all open a gripper.
"""

from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

from .model import CellState, Notice, OrderRequest, OrderState, PartResult


class PlantError(Exception):
    """What a wire asked for is not done; the message says why, for the plant system's log."""


class UnknownError(PlantError):
    """There is no such part, order or recipe."""


class RefusedError(PlantError):
    """The cell does not take it: a permit is missing, or it is in no state for it."""


class RejectedError(PlantError):
    """A receiver says of one notice that it will never take it: it is kept for a person."""


@dataclass(frozen=True, slots=True)
class Offer:
    """A recipe that an order may name.

    Attributes
    ----------
    key : name in an order
    name : name of the product
    sha256 : of the recipe file
    count : parts of an order without a quantity
    problem : why it cannot be used; empty if it can
    """

    key: str
    name: str
    sha256: str
    count: int
    problem: str


class Plant(Protocol):
    """The cell, as wires see it. Everything may raise PlantError with a sentence.

    Attributes
    ----------
    cell : name of the cell
    software : version of cellctl
    cell_file_sha256 : of the cell file that is served
    """

    cell: str
    software: str
    cell_file_sha256: str

    def may_enter(self, name: str, password: str) -> bool:
        """Return whether a plant account has this password. Slow on purpose: call in a thread."""

    def account_mark(self, name: str) -> str:
        """Return a mark that changes with role and password of an account; empty for an unknown.

        Reads a file: call in a thread.
        """

    async def state(self) -> CellState:
        """Return the state of the cell, at most half a second old."""

    def states(self) -> AsyncIterator[CellState]:
        """Yield the state now, then each change."""

    async def recipes(self) -> tuple[Offer, ...]:
        """Return the recipes that an order may name."""

    async def parts(self, after: int, limit: int) -> tuple[PartResult, ...]:
        """Return results whose journal row is after a number, oldest first."""

    async def part(self, run: str, part: int, revision: int | None = None) -> PartResult:
        """Return a result.

        Parameters
        ----------
        run, part : whose
        revision : of its result; None for the last one

        Raises
        ------
        UnknownError : there is none
        """

    async def report(self, run: str, part: int) -> Mapping[str, Any]:
        """Return the whole result of a part, as `cellctl report --format json` has it.

        Raises
        ------
        UnknownError : there is none
        """

    async def export(self, result: PartResult, kind: Literal["csv", "qif", "dfq"]) -> bytes:
        """Return a result as a file that a factory reads, as of its revision.

        Raises
        ------
        PlantError : it cannot be written as such a file
        """

    async def order(self, number: str, request: OrderRequest, source: str) -> OrderState:
        """Take an order and return it; the same again changes nothing. The state tells a refusal.

        Parameters
        ----------
        number : the plant's own, 1 to 80 signs
        request : what is ordered
        source : account and wire, as in `mes by REST`

        Raises
        ------
        RefusedError : the number has another order, which has begun
        """

    async def orders(self) -> tuple[OrderState, ...]:
        """Return the orders, oldest first."""

    async def order_of(self, number: str) -> OrderState:
        """Return an order.

        Raises
        ------
        UnknownError : there is none
        """

    def order_changes(self) -> AsyncIterator[OrderState]:
        """Return an iterator over each order as it changes, from this call on."""

    async def withdraw(self, number: str, source: str) -> OrderState:
        """Take back an order that has not begun; return it.

        Raises
        ------
        RefusedError : it has begun, or is over
        UnknownError : there is none
        """

    async def stop(self, source: str, why: str) -> str:
        """Stop the running cell on a ramp, as `cellctl stop`; return its state.

        Raises
        ------
        RefusedError : nothing runs, or the cell says no
        """

    async def abort(self, source: str, why: str) -> str:
        """Stop the running cell at once, as `cellctl abort`; return its state.

        Raises
        ------
        RefusedError : nothing runs, or the cell says no
        """


class Wire(Protocol):
    """A way to a plant system.

    Attributes
    ----------
    name : name of the wire, and of its courier
    """

    name: str

    async def serve(self, plant: Plant) -> None:
        """Serve until cancelled; an error ends this wire alone, and it is begun again."""


@runtime_checkable
class Courier(Wire, Protocol):
    """A wire by which each notice must arrive."""

    async def deliver(self, notice: Notice) -> None:
        """Deliver a notice; return once the receiver has confirmed it.

        Raises
        ------
        RejectedError : the receiver will never take this one
        OSError, TimeoutError : it is not there; the notice is tried again
        """
