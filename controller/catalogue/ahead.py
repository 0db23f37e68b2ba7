"""The order of the work: parts are finished in the order of demand."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import Any

from .tasks import Compiled, PartWork, certify_some, compile_one, prepare_one
from .working import AHEAD, PoolLostError, WorkPool

Finish = Callable[[Any], None]


@dataclass(frozen=True, slots=True)
class Made:
    """Results computed ahead for one part.

    Attributes
    ----------
    compiled : results of compiling; None where the pool ended first
    planned : the certificates are in the cache, too
    """

    compiled: Compiled | None
    planned: bool = False


@dataclass(slots=True, eq=False)
class _Part:
    """Progress of a part."""

    work: PartWork
    compiled: Compiled | None = None
    left: int = 1  # number of known, unfinished tasks
    planned: bool = False


@dataclass(order=True, slots=True)
class _Task:
    """An unassigned task; parts that are wanted earlier come first."""

    number: int
    turn: int
    call: Callable[..., Any] = field(compare=False)
    arguments: tuple[Any, ...] = field(compare=False)
    finish: Finish = field(compare=False)


class Ahead:
    """Work on parts, given to a pool a little ahead of what is wanted next.

    Parameters
    ----------
    pool : pool of worker processes
    works : the parts, in the order in which they are wanted
    """

    def __init__(self, pool: WorkPool, works: Sequence[PartWork]) -> None:
        self._pool = pool
        self._parts = [_Part(work) for work in works]
        self._waiting: list[_Task] = []
        self._running: dict[Future[Any], _Task] = {}
        self._turn = 0
        self.failure: BaseException | None = None
        for number, part in enumerate(self._parts):
            self._add(number, compile_one, (part.work,), self._compiled(number))
        self._feed()

    def wait_for(self, number: int) -> Made:
        """Return the results of a part once they are complete or the pool has ended.

        Parameters
        ----------
        number : number of the part, from 0
        """
        part = self._parts[number]
        while part.left and self.failure is None:
            try:
                done = self._pool.wait(self._running)
            except PoolLostError as error:
                self.failure = error
                break
            for future in done:
                self._take(future)
            self._feed()
        return Made(part.compiled, part.planned)

    def _take(self, future: Future[Any]) -> None:
        """Take a result; a worker that died, or fell over a defect, ends the work ahead.

        The process that wants the part compiles it itself, and reports the defect with its own
        message.
        """
        task = self._running.pop(future)
        try:
            result = future.result()
        except Exception as error:  # noqa: BLE001 - met again, and shown then
            self.failure = self.failure or error
            return
        self._parts[task.number].left -= 1
        task.finish(result)

    def _feed(self) -> None:
        """Hand out the next tasks, enough to keep every worker busy."""
        while (
            self._waiting and self.failure is None and len(self._running) < AHEAD * self._pool.count
        ):
            task = heappop(self._waiting)
            try:
                future = self._pool.submit(task.call, *task.arguments)
            except PoolLostError as error:
                self.failure = error
                return
            self._running[future] = task

    def _add(
        self, number: int, call: Callable[..., Any], arguments: tuple[Any, ...], finish: Finish
    ) -> None:
        self._turn += 1
        heappush(self._waiting, _Task(number, self._turn, call, arguments, finish))

    def _compiled(self, number: int) -> Finish:
        """Return the tasks after compiling: one for all poses, or one for each share of them."""
        part = self._parts[number]

        def finish(result: Compiled) -> None:
            part.compiled = result
            if part.work.cell is None or result.error is not None:
                return
            part.left += 1
            others = sum(bool(p.left) for p in self._parts[number + 1 :])
            if others >= self._pool.count or len(result.distinct) < 2:
                self._add(
                    number, certify_some, (part.work, result.distinct), self._certified(number)
                )
            else:
                self._add(number, prepare_one, (part.work,), self._prepared(number))

        return finish

    def _prepared(self, number: int) -> Finish:
        part = self._parts[number]

        def finish(_: None) -> None:
            assert part.compiled is not None
            poses = part.compiled.distinct
            shares = [poses[k :: self._pool.count] for k in range(self._pool.count)]
            for share in filter(None, shares):
                part.left += 1
                self._add(number, certify_some, (part.work, share), self._certified(number))

        return finish

    def _certified(self, number: int) -> Finish:
        part = self._parts[number]

        def finish(_: None) -> None:
            part.planned = part.left == 0

        return finish
