"""An event loop on the recording's time: when nothing is ready, time jumps to the next timer.

No socket, no thread, no clock of the computer: a busy machine replays the same. Work that a run
gives to threads is done at once; results of the worker process are awaited without time passing,
and handed over at their recorded time.
"""

import asyncio
import math
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from typing import Protocol, TypeVar, TypeVarTuple

from controller.virtual_time import VirtualTimeLoop

Result = TypeVar("Result")
Arguments = TypeVarTuple("Arguments")


class Timed(Protocol):
    """An executor whose answers arrive at a known instant."""

    def answer(self, fn: Callable[[], Result]) -> tuple[Callable[[], Result], float]:
        """Compute; return a callable with the answer or error, and the loop's instant for it."""
        ...


class WireLoop(VirtualTimeLoop):
    """The loop.

    Parameters
    ----------
    start_s : its first instant [s]

    Attributes
    ----------
    ports : targets of `create_connection`, by host and port
    threads : executor of work given to threads; None runs it at once
    sources : next instant at which a descriptor that is no file's will be readable [s], None for
        never
    """

    def __init__(self, start_s: float) -> None:
        super().__init__(start_s)
        self.ports: dict[tuple[str, int], Callable[[asyncio.BaseProtocol], asyncio.Transport]] = {}
        self.threads: Timed | None = None
        self.sources: dict[int, Callable[[], float | None]] = {}
        self._watched: dict[int, asyncio.TimerHandle] = {}

    def _run_once(self) -> None:
        """Run all that is ready now, in the order of request."""
        for handle in self._take_ready():
            if not handle._cancelled:
                handle._run()

    def run_in_executor(
        self,
        executor: Executor | None,
        func: Callable[[*Arguments], Result],
        *args: *Arguments,
    ) -> asyncio.Future[Result]:
        """Do the work now, whatever its executor; return its future.

        Parameters
        ----------
        executor : executor to use; None for the threads
        func : the work
        *args : its arguments
        """
        done: asyncio.Future[Result] = self.create_future()
        timed: Timed | None = self.threads if executor is None else executor  # type: ignore[assignment]  # all are timed
        take: Callable[[], Result] = lambda: func(*args)  # noqa: E731
        at_s = self._now_s
        if timed is not None:
            take, at_s = timed.answer(partial(func, *args) if args else func)
        if at_s != math.inf:  # the recorded run ended before it had this answer
            self.call_at(max(at_s, self._now_s), _settle, done, take)
        return done

    async def create_connection(  # type: ignore[override]  # what is used of it
        self,
        protocol_factory: Callable[[], asyncio.BaseProtocol],
        host: str = "",
        port: int = 0,
        **_: object,
    ) -> tuple[asyncio.Transport, asyncio.BaseProtocol]:
        """Return a connection to a wire of the recording, and its protocol.

        Parameters
        ----------
        protocol_factory : makes the protocol
        host, port : as `ports` has them
        **_ : not used

        Raises
        ------
        ConnectionRefusedError : the recorded run was refused there, or has no such wire
        """
        connect = self.ports.get((str(host), int(port)))
        if connect is None:
            raise ConnectionRefusedError(f"the recording has no {host}:{port}")
        protocol = protocol_factory()
        return connect(protocol), protocol

    def add_reader(  # type: ignore[override]  # what is used of it
        self, fd: int, callback: Callable[[*Arguments], object], *args: *Arguments
    ) -> None:
        """Call something when a descriptor of `sources` is readable.

        Parameters
        ----------
        fd : the descriptor
        callback : function to call
        *args : arguments of the call
        """
        self.remove_reader(fd)
        due_s = self.sources[fd]()
        if due_s is not None:
            self._watched[fd] = self.call_at(max(due_s, self._now_s), callback, *args)

    def remove_reader(self, fd: int) -> bool:  # type: ignore[override]  # what is used of it
        """Watch a descriptor no more; return whether it was watched."""
        timer = self._watched.pop(fd, None)
        if timer is not None:
            timer.cancel()
        return timer is not None


def _settle(done: "asyncio.Future[Result]", take: Callable[[], Result]) -> None:
    if done.cancelled():
        return
    try:
        done.set_result(take())
    except Exception as error:  # noqa: BLE001  whatever it raises is the caller's
        done.set_exception(error)
