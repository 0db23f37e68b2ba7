"""Who controls the camera, and for how long without a word.

The heartbeat is the only thing of the camera that keeps the wall clock: it is the client's host
that must not have died, and that lives by the wall clock however fast the world's time runs.
"""

import ipaddress
from dataclasses import dataclass
from typing import Final, NamedTuple

from ..protocol import bootstrap as boot
from ..protocol.gvcp import Refused, Status

_KNOWN_BITS: Final = boot.PRIVILEGE_CONTROL | boot.PRIVILEGE_EXCLUSIVE


class Peer(NamedTuple):
    """The sender of a datagram."""

    host: str
    port: int

    @property
    def word(self) -> int:
        """Its address as a register has it."""
        return int(ipaddress.IPv4Address(self.host))


@dataclass(slots=True)
class ControlChannel:
    """The privilege of one client at a time.

    Attributes
    ----------
    holder : who controls the camera; None if nobody does
    privilege : bits of the register
    """

    holder: Peer | None = None
    privilege: int = 0
    _heard_wall_s: float = 0.0

    def may_read(self, peer: Peer) -> bool:
        """Return whether a client may read: another's exclusive access forbids it."""
        is_exclusive = bool(self.privilege & boot.PRIVILEGE_EXCLUSIVE)
        return self.holder in (None, peer) or not is_exclusive

    def may_write(self, peer: Peer) -> bool:
        """Return whether a client may write registers other than the privilege's own."""
        return self.holder == peer

    def take(self, peer: Peer, bits: int, wall_s: float) -> None:
        """Carry out a write of the privilege: take it, change it, or give it back.

        Parameters
        ----------
        peer : its sender
        bits : as written
        wall_s : CLOCK_MONOTONIC [wall s]

        Raises
        ------
        Refused : another client has it
        """
        if bits & ~_KNOWN_BITS:
            raise Refused(Status.INVALID_PARAMETER)
        if self.holder not in (None, peer):
            raise Refused(Status.ACCESS_DENIED)
        self.privilege = bits
        self.holder = peer if bits else None
        self._heard_wall_s = wall_s

    def hear(self, peer: Peer, wall_s: float) -> None:
        """Note a request of the client that controls the camera."""
        if peer == self.holder:
            self._heard_wall_s = wall_s

    def ends_wall_s(self, timeout_s: float) -> float | None:
        """Return when the client counts as dead unless it is heard [wall s]."""
        return None if self.holder is None else self._heard_wall_s + timeout_s

    def drop(self) -> None:
        """Let nobody control the camera."""
        self.holder, self.privilege = None, 0
