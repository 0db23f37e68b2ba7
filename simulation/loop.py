"""An event loop on virtual time: seeded, without threads, sockets or a clock of the computer.

When nothing is ready, time jumps to the next timer. Tasks that are ready at one moment run in an
order drawn from the seed; plain callbacks keep the order they were asked for, as asyncio promises
it. Work for a thread or a process is done here, some virtual time after it was ordered.

Tasks and callbacks belong to a *process* (`SimulatedProcess`): what a task starts belongs to the
process of that task. A process can be killed between any two steps, and from then on nothing of it
runs, no `finally` either.
"""

import asyncio
import contextvars
import gc
import logging
import math
import random
import sys
import warnings
from collections.abc import Callable, Coroutine, Generator
from concurrent.futures import Executor
from typing import Any, Final, TypeVar, TypeVarTuple

from controller.virtual_time import VirtualTimeLoop

from .wires import Factory, Ports

Result = TypeVar("Result")
Arguments = TypeVarTuple("Arguments")

START_S: Final = 1_000.0  # not 0, so that a default of 0.0 is not taken for an instant
MAX_THREAD_DELAY_S: Final = 0.002  # longest delay of a thread's work, from order to start and back
CLOSING_COUNT: Final = 8  # a `finally` that awaits ignores the first ones

_owner: contextvars.ContextVar["SimulatedProcess | None"] = contextvars.ContextVar(
    "owner", default=None
)


class SimulatedProcess:
    """Tasks that are started and ended together, such as one controller.

    Attributes
    ----------
    is_alive : True if its tasks run
    step_count : number of steps of its tasks and callbacks so far
    late_until_s : nothing of it runs before, as after SIGSTOP or in a pause of the collector
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.is_alive = True
        self.step_count = 0
        self.late_until_s = -math.inf
        self.waiting: list[asyncio.Handle] = []


class _Task(asyncio.Task[Result]):
    """A task with a number, by which the ready ones are put in order before they are shuffled."""

    number: int
    owner: SimulatedProcess | None


class SimulatedLoop(VirtualTimeLoop):
    """The loop.

    Parameters
    ----------
    seed : decides the order of what is ready at one moment, and how late threads are

    Attributes
    ----------
    after_step : called after each step with the process it belonged to
    """

    def __init__(self, seed: int) -> None:
        super().__init__(START_S)
        self._rng = random.Random(f"loop {seed}")
        self._task_count = 0
        self._killed: list[asyncio.Task[Any]] = []
        self.step_count = 0
        self.after_step: Callable[[SimulatedProcess | None], None] | None = None
        self.ports = Ports(self, random.Random(f"wires {seed}"))
        self.set_task_factory(self._make_task)
        self.set_exception_handler(self._keep_error)
        self.errors: list[dict[str, Any]] = []

    # --- processes ------------------------------------------------------------------------------

    def spawn(
        self, process: SimulatedProcess, work: Coroutine[Any, Any, Result]
    ) -> asyncio.Task[Result]:
        """Start a coroutine as the first task of a process."""
        context = contextvars.copy_context()
        context.run(_owner.set, process)
        return self.create_task(work, context=context)

    def kill(self, process: SimulatedProcess) -> None:
        """End a process where it stands; its ends of all wires are cut."""
        process.is_alive = False
        # held, or the garbage collector would run the `finally` of what is killed
        self._killed += [t for t in asyncio.all_tasks(self) if getattr(t, "owner", None) is process]
        self.ports.cut(process)

    def hold_up(self, process: SimulatedProcess, duration_s: float) -> None:
        """Stall a process for a time; events due meanwhile run afterwards."""
        process.late_until_s = self.time() + duration_s
        nobody = contextvars.Context()
        self.call_at(process.late_until_s, self._go_on, process, context=nobody)

    def _go_on(self, process: SimulatedProcess) -> None:
        process.late_until_s = -math.inf
        waiting, process.waiting = process.waiting, []
        self._ready.extend(waiting)

    def owner(self) -> SimulatedProcess | None:
        """Return the process whose step is running."""
        return _owner.get()

    def _make_task(
        self,
        loop: asyncio.AbstractEventLoop,
        work: Coroutine[Any, Any, Result] | Generator[Any, None, Result],
        context: contextvars.Context | None = None,
    ) -> asyncio.Task[Result]:
        task: _Task[Result] = _Task(work, loop=loop, context=context)
        self._task_count += 1
        task.number = self._task_count
        owner = _owner.get() if context is None else context.get(_owner)
        task.owner = owner
        return task

    def _keep_error(self, loop: asyncio.AbstractEventLoop, what: dict[str, Any]) -> None:
        self.errors.append(what)

    # --- steps ----------------------------------------------------------------------------------

    def _run_once(self) -> None:
        """Run all that is ready now; tasks among it in an order drawn from the seed."""
        batch = self._take_ready()
        for handle in batch if len(batch) == 1 else self._shuffled(batch):
            if handle._cancelled:
                continue
            owner = handle._context.get(_owner)
            if owner is not None:
                if not owner.is_alive:
                    continue
                if self.time() < owner.late_until_s:
                    owner.waiting.append(handle)
                    continue
                owner.step_count += 1
            self.step_count += 1
            handle._run()
            if self.after_step is not None:
                self.after_step(owner)

    def _shuffled(self, batch: list[Any]) -> list[Any]:
        """Return the ready handles, with the steps of tasks in an order drawn from the seed."""
        steps = [
            (number, place)
            for place, handle in enumerate(batch)
            if (number := _task_number(handle)) is not None
        ]
        if len(steps) < 2:
            return batch
        places = [place for _, place in steps]
        steps.sort()  # sets of tasks are in no order that a seed could repeat
        self._rng.shuffle(steps)
        out = list(batch)
        for place, (_, taken) in zip(places, steps, strict=True):
            out[place] = batch[taken]
        return out

    # --- what would leave the process ------------------------------------------------------------

    def run_in_executor(
        self,
        executor: Executor | None,
        func: Callable[[*Arguments], Result],
        *args: *Arguments,
    ) -> asyncio.Future[Result]:
        """Do the work here, a moment later; return its future."""
        done: asyncio.Future[Result] = self.create_future()

        def work() -> None:
            try:
                result = func(*args)
            except Exception as error:  # noqa: BLE001  whatever it raises is the caller's
                self.call_later(self._thread_delay_s(), _settle, done, None, error)
            else:
                self.call_later(self._thread_delay_s(), _settle, done, result, None)

        self.call_later(self._thread_delay_s(), work)
        return done

    def _thread_delay_s(self) -> float:
        return self._rng.random() * MAX_THREAD_DELAY_S

    async def create_connection(  # type: ignore[override]  # what is used of it
        self, protocol_factory: Factory, host: str = "", port: int = 0, **_: object
    ) -> tuple[asyncio.Transport, asyncio.BaseProtocol]:
        """Connect to a server of this loop; ConnectionRefusedError if none listens there."""
        return await self.ports.connect(protocol_factory, (str(host), int(port)))

    async def create_server(  # type: ignore[override]  # what is used of it
        self, protocol_factory: Factory, host: str = "", port: int = 0, **_: object
    ) -> asyncio.AbstractServer:
        """Listen on a port of this loop alone; port 0 takes the next free one."""
        return self.ports.listen(protocol_factory, str(host), int(port or 0))

    async def create_unix_connection(  # type: ignore[override]  # what is used of it
        self, protocol_factory: Factory, path: object = "", **_: object
    ) -> tuple[asyncio.Transport, asyncio.BaseProtocol]:
        """Connect to a unix socket of this loop."""
        return await self.ports.connect(protocol_factory, (str(path), 0))

    async def create_unix_server(  # type: ignore[override]  # what is used of it
        self, protocol_factory: Factory, path: object = "", **_: object
    ) -> asyncio.AbstractServer:
        """Listen on a unix socket of this loop alone; no file is made."""
        return self.ports.listen(protocol_factory, str(path), 0, is_unix=True)

    # --- the end --------------------------------------------------------------------------------

    def bury(self) -> None:
        """Drop killed processes and pending tasks; call it when all has been read.

        Their `finally` blocks run now, on wires that are cut, and can do nothing.
        """
        hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
        level = logging.root.manager.disable
        logging.disable(logging.CRITICAL)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                for task in {*asyncio.all_tasks(self), *self._killed}:
                    _close(task)
                self._ready.clear()
                self._scheduled.clear()
                self._killed.clear()
                gc.collect()
        finally:
            logging.disable(level)
            sys.unraisablehook = hook


def _close(task: asyncio.Task[Any]) -> None:
    """Run the `finally` blocks of a task that will not be stepped again."""
    task._log_destroy_pending = False  # type: ignore[attr-defined]  # not in the types
    work = task.get_coro()
    for _ in range(CLOSING_COUNT):
        try:
            work.close()
        except BaseException:  # noqa: BLE001  (it is dead already, and on wires that are cut)
            continue
        return


def _task_number(handle: Any) -> int | None:
    """Return the number of the task that a handle steps, None for any other callback."""
    return getattr(getattr(handle._callback, "__self__", None), "number", None)


def _settle(done: "asyncio.Future[Any]", result: Any, error: Exception | None) -> None:
    if done.done():
        return
    if error is not None:
        done.set_exception(error)
    else:
        done.set_result(result)
