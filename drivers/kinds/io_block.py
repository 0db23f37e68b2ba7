"""An I/O block: only an input freshly known to be healthy counts as healthy."""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from enum import Enum
from types import TracebackType
from typing import Protocol, Self

from messages import key


class Signal(Enum):
    """The known state of an input. Only OK is OK."""

    OK = "ok"  # the input reads 1
    NOT_OK = key("not ok")  # it reads 0: pressed, open, absent, or its wire is broken
    UNKNOWN = "unknown"  # no fresh reading: treat as NOT_OK, record as different

    @property
    def is_ok(self) -> bool:
        """Whether it is known to be OK."""
        return self is Signal.OK


@dataclass(frozen=True, slots=True)
class Change:
    """An input has changed, after debouncing.

    Attributes
    ----------
    name : name of the input
    signal, previous : now and before
    at_s : cell instant of the reading that decided it, or at which readings became too old [s]
    """

    name: str
    signal: Signal
    previous: Signal
    at_s: float


@dataclass(frozen=True, slots=True)
class Polling:
    """The polling of inputs.

    Attributes
    ----------
    poll_s : from one reading to the next [cell s]
    stale_s : an input read longer ago is unknown [cell s]
    """

    poll_s: float
    stale_s: float


class Changes(Protocol):
    """Changes as they come, until the context ends: ``with ... as changes: async for ...``."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None: ...

    def __aiter__(self) -> AsyncIterator[Change]: ...


class IoBlock(Protocol):
    """The inputs of the cell, by the names the cell gives them.

    Attributes
    ----------
    model : name used in messages and the journal, once connected
    """

    @property
    def model(self) -> str: ...  # noqa: D102  (an attribute)

    async def connect(self) -> object:
        """Begin to read the inputs, switch nothing; return the block's identity, for the log."""
        ...

    def signal(self, name: str) -> Signal:
        """Return the known state of an input now."""
        ...

    def watch(self) -> Changes:
        """Return all changes from now on."""
        ...

    async def wait_for(self, name: str, signal: Signal) -> None:
        """Wait until an input is known to have a state."""
        ...

    async def clear_watchdog(self) -> None:
        """Clear the block's own note of a missed master; nothing if it keeps none."""
        ...

    async def aclose(self) -> None:
        """End reading; outputs stay as they are."""
        ...
