"""Speaks to a running cell through its control socket; blocking, for commands."""

import http.client
import os
import socket
from pathlib import Path
from typing import Final

from pydantic import BaseModel

from messages import key, say

from ..lock import LOCK_NAME, Holder, read_holder
from .peer import peer_of
from .place import ControlError
from .words import DecisionReply, ErrorReply, SomeReply, StatusReply, reply_of

REPLY_LIMIT_WALL_S: Final = 30.0
MAX_REPLY_BYTES: Final = 1_000_000


class NoRunError(ControlError):
    """No run has this cell."""


class NotServedError(ControlError):
    """The run that has this cell does not serve its control socket yet, or no longer.

    Attributes
    ----------
    holder : run and its user
    """

    def __init__(self, message: str, holder: Holder) -> None:
        super().__init__(message)
        self.holder = holder


class _UnixConnection(http.client.HTTPConnection):
    """HTTP over a unix socket whose peer is the same user."""

    def __init__(self, path: Path) -> None:
        super().__init__("localhost", timeout=REPLY_LIMIT_WALL_S)
        self._path = path

    def connect(self) -> None:
        """Connect, and check the identity of the server."""
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.sock.settimeout(REPLY_LIMIT_WALL_S)
        self.sock.connect(str(self._path))
        if peer_of(self.sock).uid != os.getuid():
            raise ControlError(
                say("{path}: another user listens there; nothing was sent", path=self._path)
            )


class RunningCell:
    """A running cell, seen from another process.

    Parameters
    ----------
    runs_dir : folder of the runs, by whose lock the cell is found
    """

    def __init__(self, runs_dir: Path) -> None:
        self._runs_dir = runs_dir

    def status(self) -> StatusReply:
        """Return the cell's status.

        Raises
        ------
        NoRunError : no run has this cell
        NotServedError : one has it that is starting or ending
        ControlError : it does not answer, or not with what it must
        """
        status, body = self._ask("GET", "/status", None)
        if status != 200:
            raise ControlError(_reply_of(ErrorReply, body).error)
        return _reply_of(StatusReply, body)

    def order(self, name: str, body: BaseModel) -> DecisionReply:
        """Give an order; return the cell's decision.

        Parameters
        ----------
        name : name of its endpoint
        body : person, reason and further fields

        Raises
        ------
        NoRunError : no run has this cell
        NotServedError : one has it that is starting or ending
        ControlError : it does not answer, or not with what it must
        """
        status, reply = self._ask("POST", f"/{name}", body.model_dump_json(exclude_none=True))
        if status not in (200, 409):
            raise ControlError(_reply_of(ErrorReply, reply).error)
        return _reply_of(DecisionReply, reply)

    def _ask(self, method: str, path: str, body: str | None) -> tuple[int, bytes]:
        holder = self._holder()
        place = Path(holder.control)
        connection = _UnixConnection(place)
        try:
            connection.request(method, path, body, {"Content-Type": "application/json"})
            reply = connection.getresponse()
            return reply.status, reply.read(MAX_REPLY_BYTES)
        except (FileNotFoundError, ConnectionRefusedError) as error:
            raise NotServedError(
                say(
                    "{place}: nobody listens there yet, or any more: the run is starting or ending",
                    place=place,
                ),
                holder,
            ) from error
        except (OSError, http.client.HTTPException) as error:
            raise ControlError(
                say(
                    "{place}: the run does not answer ({error}); is its process "
                    "stopped, or the machine overloaded?",
                    place=place,
                    error=error or type(error).__name__,
                )
            ) from error
        finally:
            connection.close()

    def _holder(self) -> Holder:
        """Return the run that holds the cell's lock file, which also names its control socket."""
        holder = read_holder(self._runs_dir / LOCK_NAME)
        if holder is None:
            raise NoRunError(
                say(
                    "no run at this cell: nobody holds {lock_file}. Start one with "
                    "`cellctl run`, or name its folder with --runs",
                    lock_file=self._runs_dir / LOCK_NAME,
                )
            )
        if not holder.control:
            raise ControlError(
                say("{holder} has the cell; it is no run, and cannot be acted on", holder=holder)
            )
        return holder


def _reply_of(model: type[SomeReply], body: bytes) -> SomeReply:
    try:
        return reply_of(model, body)
    except ValueError as error:
        raise ControlError(
            key("the run's answer cannot be read; is it another version?")
        ) from error
