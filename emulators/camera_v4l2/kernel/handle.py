"""The context of every ioctl of the camera: its open file, and its possible failures."""

import errno
from dataclasses import dataclass, field
from typing import Protocol

from .abi import PRIORITY_INTERACTIVE


class Refused(Exception):  # noqa: N818 - an answer to a client, not a failure of the emulator
    """The ioctl fails with `number`, as errno(3) numbers it."""

    def __init__(self, number: int) -> None:
        super().__init__(errno.errorcode.get(number, str(number)))
        self.number = number


class NotYet(Exception):  # noqa: N818 - the answer comes later
    """A blocking DQBUF has no frame yet: try again after the next wake."""


class ClientMemory(Protocol):
    """The client's address space, for the few ioctls whose structs hold pointers."""

    def fetch(self, address: int, size_bytes: int) -> bytes:
        """Return the bytes at an address; raises `Refused` (EFAULT) if there are none."""

    def store(self, address: int, data: bytes) -> None:
        """Write bytes to an address; raises `Refused` (EFAULT) where that is not allowed."""


@dataclass(slots=True)
class PendingEvent:
    """A control's change that a handle has not fetched yet."""

    changes: int
    at_monotonic_s: float
    sequence: int
    payload: bytes


@dataclass(slots=True, eq=False)
class Handle:
    """One open file of the camera.

    Attributes
    ----------
    subscriptions : control id -> flags of the subscription
    events : control id -> what changed, oldest first; changes of one control are merged
    """

    number: int
    priority: int = PRIORITY_INTERACTIVE
    subscriptions: dict[int, int] = field(default_factory=dict)
    events: dict[int, PendingEvent] = field(default_factory=dict)
    events_sent: int = 0
