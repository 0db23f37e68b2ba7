"""Signals that would end a run stop it instead: the arm halts first, and there is a report.

The cause is a signal (Ctrl-C, Ctrl-Z, a closed terminal, `kill`), or the end of the parent process,
of the output's reader, of a worker process or of the emulated cell. SIGKILL and a power cut cannot
be caught; the next start finds them in the journal.
"""

import asyncio
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import active_children
from types import FrameType
from typing import Final, Protocol

from controller.cell.batch import WORKER_GONE

from ..terminal.output import is_output_gone, relayed, warn

LOOK_WALL_S: Final = 0.2
ENDS: Final = {
    signal.SIGINT: ("stopped by the operator (Ctrl-C)", "stop"),
    signal.SIGTERM: ("stopped by the operator (SIGTERM)", "stop"),
    signal.SIGQUIT: ("stopped by the operator (SIGQUIT)", "stop"),
    # a suspended controller could neither see a door open nor stop anything
    signal.SIGTSTP: ("stopped by the operator (Ctrl-Z: a cell cannot be suspended)", "stop"),
    signal.SIGHUP: ("the terminal was closed (SIGHUP)", "terminal_gone"),
}
# these would suspend a run in the background when it uses the terminal
UNHEARD: Final = (signal.SIGTTIN, signal.SIGTTOU)


class Stoppable(Protocol):
    """The work that an end stops."""

    def request_stop(self, message: str, code: str) -> None:
        """Come to rest, metal first."""
        ...

    def request_abort(self, message: str, code: str) -> None:
        """Come to rest at once, even if a device does not answer any more."""
        ...


class CommandEnds:
    """Catches everything that would end a command, from beginning to end.

    Before the run, a signal ends the command at once; during the run, it requests a stop; after it,
    while the report is written, it is ignored.
    """

    def __init__(self) -> None:
        self._parent = os.getppid()
        # SIGHUP is ignored under nohup or in a service: then the run is to outlive its parent
        self._is_detached = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        self._on_end: Callable[[signal.Signals], None] | None = None
        self._is_over = False

    @contextmanager
    def heard(self) -> Iterator["CommandEnds"]:
        """Catch signals and yield these ends; restore the former handlers afterwards.

        Output is relayed meanwhile: while it is blocked, no end could be heard.
        """
        before = {number: signal.getsignal(number) for number in (*ENDS, *UNHEARD)}
        for number in ENDS:
            if number is not signal.SIGHUP or not self._is_detached:
                signal.signal(number, self._on_signal)
        for number in UNHEARD:
            signal.signal(number, signal.SIG_IGN)
        try:
            with relayed():
                yield self
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._is_over:
            return
        if self._on_end is None:
            raise KeyboardInterrupt
        self._on_end(signal.Signals(number))

    @contextmanager
    def stopping(self, work: Stoppable, emulator: int | None) -> Iterator[None]:
        """Turn every end into a stop of this work; a second Ctrl-C no longer waits for it.

        Enter it inside a task: the second Ctrl-C cancels that task.

        Parameters
        ----------
        work : the batch, or whatever else is to stop
        emulator : process id of the emulated cell, None if this command has started none
        """
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None
        asked: list[signal.Signals] = []

        def stop(number: signal.Signals) -> None:
            asked.append(number)
            if len(asked) == 1:
                warn("stopping: the arm halts, nothing is released (Ctrl-C again: give up)")
                work.request_stop(*ENDS[number])
            elif number in (signal.SIGINT, signal.SIGTERM):
                task.cancel()

        def on_end(number: signal.Signals) -> None:
            loop.call_soon_threadsafe(stop, number)

        self._on_end = on_end
        watch = asyncio.create_task(self._watch(work, emulator), name="ends")
        try:
            yield
        finally:
            self._is_over = True
            watch.cancel()

    async def _watch(self, work: Stoppable, emulator: int | None) -> None:
        """Watch for the ends that no signal announces."""
        workers = {child.pid for child in active_children()}
        while True:
            await asyncio.sleep(LOOK_WALL_S)
            if not self._is_detached and os.getppid() != self._parent:
                work.request_stop("the process that started this run has ended", "parent_gone")
                return
            if is_output_gone():
                work.request_stop("the program that read the run's output has ended", "output_gone")
                return
            if not workers <= {child.pid for child in active_children()}:
                work.request_abort(WORKER_GONE, "worker_gone")
                return
            if emulator is not None and _has_ended(emulator):
                work.request_abort("the emulated cell has ended", "emulator_gone")
                return


def _has_ended(child: int) -> bool:
    """Return whether a child process has ended; leave its exit status to its parent code."""
    with suppress(ChildProcessError):
        return os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    return True
