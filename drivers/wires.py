"""The layer between drivers and their wires: none, a recorder, or a recording played back.

A driver is handed a `Wires` with its site and gives each wire one tap. The tap sees every byte,
and may answer in the device's place. `turn` is called before a caller gets a line that several
share: a recording keeps the order, and its playback holds a caller back until it is due, since
which of two that are ready goes first is chance (ADR 46). Knows no device.
"""

from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final, Protocol, TypeVar

Opened = TypeVar("Opened")
Address = TypeVar("Address")


class LineTap(Protocol):
    """One line of bytes: the arm's serial line, or a Modbus line."""

    async def turn(self, what: str) -> None:
        """Wait until a caller who will send ``what`` may queue for the line."""

    def taken(self, what: str) -> None:
        """Note that this caller has the line now."""

    def opening(self, make: Callable[[], Opened]) -> Opened:
        """Return the transport of a serial line, with the tap in between."""
        ...

    def unanswered(self) -> None:
        """Note that the driver of a serial line has given a reply up."""

    def opened(self, problem: str | None) -> None:
        """Note that a Modbus connection was opened, or why it could not be."""

    def carried(self, data: bytes, *, sending: bool, in_time: bool) -> None:
        """Note bytes on a Modbus connection.

        Parameters
        ----------
        data : bytes
        sending : True for requests
        in_time : somebody waits for them
        """

    def lost(self) -> None:
        """Note that the other end closed a Modbus connection."""


@dataclass(frozen=True, slots=True)
class Taken:
    """A frame as DQBUF gave it.

    Attributes
    ----------
    struct : ``struct v4l2_buffer``
    stamp_us : its time stamp, where it is another than the struct's; else None
    is_unread : True if nobody read its picture, which is not there
    """

    struct: bytes
    stamp_us: int | None = None
    is_unread: bool = False


class CameraTap(Protocol):
    """One camera: its calls in order, and its frames as they come."""

    def call(self, what: str, sent: bytes, do: Callable[[], bytes]) -> bytes:
        """Return a call's answer; an error of ``do`` passes through.

        Parameters
        ----------
        what : its name
        sent : the struct as it is sent
        do : makes the call
        """
        ...

    def dequeue(self, do: Callable[[], bytes], stamp_us: Callable[[bytes], int]) -> Taken:
        """Return the next frame; BlockingIOError if there is none yet."""
        ...

    def picture(self, do: Callable[[], bytes]) -> bytes:
        """Return the picture of the frame that was dequeued last."""
        ...

    def readiness_fd(self, do: Callable[[], int]) -> int:
        """Return the descriptor to wait on for the next frame."""
        ...

    def other(self, do: Callable[[], Any]) -> Any:  # noqa: ANN401  (whatever the call returns)
        """Make a call that is not recorded; return its result, None without a camera."""
        ...


class Wires(Protocol):
    """All wires of a cell."""

    def line(self, name: str) -> LineTap | None:
        """Return the tap of a serial line, None for none."""
        ...

    def modbus(self, address: Address) -> tuple[Address, LineTap | None]:
        """Return the address to connect to in place of ``address``, and the line's tap."""
        ...

    def camera(self, name: str) -> CameraTap | None:
        """Return the tap of a camera, None for none."""
        ...

    def thread(self, name: str) -> Executor:
        """Return the executor that makes one device's blocking calls, in order."""
        ...


class _Untapped:
    def line(self, name: str) -> LineTap | None:
        return None

    def modbus(self, address: Address) -> tuple[Address, LineTap | None]:
        return address, None

    def camera(self, name: str) -> CameraTap | None:
        return None

    def thread(self, name: str) -> Executor:
        return ThreadPoolExecutor(1, thread_name_prefix=name)


UNTAPPED: Final[Wires] = _Untapped()
