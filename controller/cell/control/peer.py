"""The process at the other end of a unix socket, by the kernel's word (unix(7), SO_PEERCRED)."""

import pwd
import socket
import struct
from dataclasses import dataclass
from typing import Final

_UCRED: Final = struct.Struct("3i")  # pid, uid, gid: struct ucred of <sys/socket.h>


@dataclass(frozen=True, slots=True)
class Peer:
    """A process that has connected.

    Attributes
    ----------
    pid : its number
    uid : uid of its user
    """

    pid: int
    uid: int

    @property
    def name(self) -> str:
        """The user's name, or number if the system has no name."""
        try:
            return pwd.getpwuid(self.uid).pw_name
        except KeyError:
            return f"uid {self.uid}"


def peer_of(connected: socket.socket) -> Peer:
    """Return the process and user at the other end of a connection."""
    packed = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size)
    pid, uid, _ = _UCRED.unpack(packed)
    return Peer(pid, uid)
