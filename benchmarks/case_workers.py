"""Worker processes for cases of which one may hang: each has a budget, results come as they end.

A case that spends its budget is given up with its process; the others go on.
"""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

Work = TypeVar("Work")
Result = TypeVar("Result")

LOOK_WALL_S: Final = 1.0  # from one look at the budgets to the next
WALL_PER_CPU: Final = 20.0  # a case that waits for something outside spends no CPU time


@dataclass(frozen=True, slots=True)
class Failed:
    """Why there is no result.

    Attributes
    ----------
    outcome : hang, crashed or broke off
    message : a sentence about it
    cpu_s : spent on the case, as far as that is known
    """

    outcome: str
    message: str
    cpu_s: float = 0.0


@dataclass(slots=True)
class _Worker(Generic[Work]):
    process: BaseProcess
    line: Connection
    work: Work | None = None
    since_wall_s: float = 0.0
    since_cpu_s: float = 0.0


@dataclass(slots=True)
class Workers(Generic[Work, Result]):
    """Processes that work through cases, each in a fresh interpreter.

    Attributes
    ----------
    run : what is done with a case; a function of a module
    count : of processes
    budget_cpu_s : of CPU time for one case, before it counts as hung
    """

    run: Callable[[Work], Result]
    count: int
    budget_cpu_s: float
    _workers: "list[_Worker[Work]]" = field(default_factory=list)

    def results(
        self, works: Sequence[Work], until_wall_s: float
    ) -> Iterator[tuple[Work, Result | Failed]]:
        """Yield each case with what became of it, as they end.

        Parameters
        ----------
        works : the cases, begun in this order
        until_wall_s : no case is begun after this reading of `time.monotonic`
        """
        left = list(reversed(works))
        try:
            while True:
                while left and time.monotonic() < until_wall_s and self._begin(left[-1]):
                    left.pop()
                busy = {one.line: one for one in self._workers if one.work is not None}
                if not busy:
                    return
                for line in wait(list(busy), LOOK_WALL_S):
                    yield self._take(busy.pop(line))  # type: ignore[arg-type,call-overload]  # lines alone were handed in
                for one in busy.values():
                    if (spent := self._overspent(one)) is not None:
                        work, cpu_s = one.work, _cpu_s(one.process) - one.since_cpu_s
                        assert work is not None
                        self._end(one)
                        yield work, Failed("hang", f"not done after {spent}", round(cpu_s, 2))
        finally:
            for one in list(self._workers):
                self._end(one)

    def _begin(self, work: Work) -> bool:
        """Hand a case to a worker that is free; return whether one was."""
        free = next((one for one in self._workers if one.work is None), None)
        if free is None:
            if len(self._workers) >= self.count:
                return False
            free = self._started()
        free.line.send(work)
        free.work, free.since_wall_s = work, time.monotonic()
        free.since_cpu_s = _cpu_s(free.process)
        return True

    def _started(self) -> "_Worker[Work]":
        context = get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=_serve, args=(there, self.run), daemon=True)
        process.start()
        there.close()
        worker: _Worker[Work] = _Worker(process, here)
        self._workers.append(worker)
        return worker

    def _take(self, worker: "_Worker[Work]") -> tuple[Work, Result | Failed]:
        work = worker.work
        assert work is not None
        try:
            answer: Result | Failed = worker.line.recv()
        except (EOFError, OSError):
            self._end(worker)
            code = worker.process.exitcode
            return work, Failed("crashed", f"its process ended with code {code}")
        worker.work = None
        return work, answer

    def _overspent(self, worker: "_Worker[Work]") -> str | None:
        """Return what a case has spent, if that is more than its budget."""
        cpu_s = _cpu_s(worker.process) - worker.since_cpu_s
        if cpu_s > self.budget_cpu_s:
            return f"{cpu_s:.0f} s of CPU time"
        wall_s = time.monotonic() - worker.since_wall_s
        return f"{wall_s:.0f} s" if wall_s > WALL_PER_CPU * self.budget_cpu_s else None

    def _end(self, worker: "_Worker[Work]") -> None:
        self._workers.remove(worker)
        worker.line.close()
        worker.process.kill()
        worker.process.join()


def _cpu_s(process: BaseProcess) -> float:
    """Return the CPU time that a process has spent [s]; 0 of one that has ended."""
    with suppress(OSError, IndexError):
        stat = Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2]
        user, system = stat.split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")
    return 0.0


def _serve(line: Connection, run: Callable[[Any], Any]) -> None:
    while True:
        try:
            work = line.recv()
        except EOFError:
            return
        began_s = time.process_time()
        try:
            answer = run(work)
        except Exception as error:  # noqa: BLE001  the next case is not to blame
            spent_s = time.process_time() - began_s
            answer = Failed("broke off", f"{type(error).__name__}: {error}", spent_s)
        line.send(answer)
