"""Every end is a stop: what would end a run halts the arm first and leaves a report.

Signals (Ctrl-C, Ctrl-Z, a closed terminal, `kill`), a parent that has died, a reader that has left,
a worker process or an emulated cell that is gone. Only SIGKILL and a power cut are not heard; the
next start learns of them from the journal.
"""

import asyncio
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import active_children
from types import FrameType
from typing import Final

from controller.cell.dispatcher import WORKER_GONE, Dispatcher

from ..terminal.output import is_output_gone, warn

LOOK_WALL_S: Final = 0.2
ENDS: Final = {
    signal.SIGINT: ("stopped by the operator (Ctrl-C)", "stop"),
    signal.SIGTERM: ("stopped by the operator (SIGTERM)", "stop"),
    signal.SIGQUIT: ("stopped by the operator (SIGQUIT)", "stop"),
    # a suspended controller could neither see a door open nor stop anything
    signal.SIGTSTP: ("stopped by the operator (Ctrl-Z: a cell cannot be suspended)", "stop"),
    signal.SIGHUP: ("the terminal is gone (SIGHUP)", "terminal_gone"),
}
# a run in the background may use a terminal that would suspend it for that
UNHEARD: Final = (signal.SIGTTIN, signal.SIGTTOU)


class Ends:
    """Hears what would end a command, from its first line to its last.

    Until a run is under way, a signal ends the command at once. Then it asks the run to stop. Once
    the run has ended, nobody hears it: the report is being written.
    """

    def __init__(self) -> None:
        self._parent = os.getppid()
        # nohup, or a service: whoever has SIGHUP ignored wants the run to outlive its parent
        self._is_detached = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        self._on_end: Callable[[signal.Signals], None] | None = None
        self._is_over = False

    @contextmanager
    def heard(self) -> Iterator["Ends"]:
        """Listen; afterwards signals do what they did before."""
        before = {number: signal.getsignal(number) for number in (*ENDS, *UNHEARD)}
        for number in ENDS:
            if number is not signal.SIGHUP or not self._is_detached:
                signal.signal(number, self._on_signal)
        for number in UNHEARD:
            signal.signal(number, signal.SIG_IGN)
        try:
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
    def stopping(self, dispatcher: Dispatcher, emulator: int | None) -> Iterator[None]:
        """Turn every end into a stop of this dispatcher; a second Ctrl-C gives up waiting for it.

        Inside a task, which is the one that is given up.

        Parameters
        ----------
        emulator : process of the emulated cell that this command has started
        """
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None
        asked: list[signal.Signals] = []

        def stop(number: signal.Signals) -> None:
            asked.append(number)
            if len(asked) == 1:
                warn("stopping: the arm halts, nothing is released (Ctrl-C again: give up)")
                dispatcher.request_stop(*ENDS[number])
            elif number in (signal.SIGINT, signal.SIGTERM):
                task.cancel()

        def on_end(number: signal.Signals) -> None:
            loop.call_soon_threadsafe(stop, number)

        self._on_end = on_end
        watch = asyncio.create_task(self._watch(dispatcher, emulator), name="ends")
        try:
            yield
        finally:
            self._is_over = True
            watch.cancel()

    async def _watch(self, dispatcher: Dispatcher, emulator: int | None) -> None:
        """Look for those ends that no signal tells of."""
        workers = {child.pid for child in active_children()}
        while True:
            await asyncio.sleep(LOOK_WALL_S)
            if not self._is_detached and os.getppid() != self._parent:
                dispatcher.request_stop("the process that started this run is gone", "parent_gone")
                return
            if is_output_gone():
                dispatcher.request_stop("nobody reads the run's output any more", "output_gone")
                return
            if not workers <= {child.pid for child in active_children()}:
                dispatcher.request_abort(WORKER_GONE, "worker_gone")
                return
            if emulator is not None and _has_ended(emulator):
                dispatcher.request_abort("the emulated cell has ended", "emulator_gone")
                return


def _has_ended(child: int) -> bool:
    """Return whether a child process has ended; whoever started it still learns how."""
    with suppress(ChildProcessError):
        return os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    return True
