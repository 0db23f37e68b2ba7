"""A pool of workers, and orders given to it a little ahead of what it has done."""

from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final, Protocol, TypeVar

AHEAD: Final = 2  # tasks handed out for each worker: one in hand, one waiting

Order = TypeVar("Order")
Result = TypeVar("Result")


class PoolLostError(Exception):
    """The pool ended while it had work; what it had finished is kept."""


class WorkPool(Protocol):
    """Processes that take tasks."""

    @property
    def count(self) -> int:
        """Number of tasks that run at a time now, at least 1."""

    def submit(self, call: Callable[..., Any], *arguments: object) -> Future[Any]:
        """Hand out a task; return its future.

        Raises
        ------
        PoolLostError : the pool has ended
        """

    def wait(self, futures: Collection[Future[Any]]) -> set[Future[Any]]:
        """Return those of some tasks that are done, one at least.

        Raises
        ------
        PoolLostError : the pool has ended
        """


@dataclass(frozen=True, slots=True)
class TaskPool:
    """An executor, and the number of tasks it runs at a time."""

    executor: Executor
    count: int

    def submit(self, call: Callable[..., Any], *arguments: object) -> Future[Any]:
        """Hand out a task; return its future. See `WorkPool`.

        Raises
        ------
        PoolLostError : the pool has ended
        """
        try:
            return self.executor.submit(call, *arguments)
        except (BrokenExecutor, OSError, RuntimeError) as error:
            raise PoolLostError(str(error) or type(error).__name__) from error

    def wait(self, futures: Collection[Future[Any]]) -> set[Future[Any]]:
        """Return those that are done; see `WorkPool`.

        Raises
        ------
        PoolLostError : the pool has ended
        """
        done, _ = wait(futures, return_when=FIRST_COMPLETED)
        for future in done:
            if not future.cancelled() and isinstance(error := future.exception(), BrokenExecutor):
                raise PoolLostError(str(error) or type(error).__name__) from error
        return done


def results_of(
    pool: WorkPool | None, call: Callable[[Order], Result], orders: Iterable[Order]
) -> Iterator[tuple[Order, Result | Exception]]:
    """Yield each order with its result, or with the error that it ended in, as they come.

    Orders are taken from the iterable as they can be handed out, so that it may be long.

    Parameters
    ----------
    pool : the pool; None to work in this process, in the order of the orders
    call : a function of a module, which gets an order
    orders : the orders

    Raises
    ------
    PoolLostError : the pool ended before all were done
    """
    if pool is None:
        for order in orders:
            yield order, _tried(call, order)
        return
    left = iter(orders)
    running: dict[Future[Any], Order] = {}
    while True:
        for order in islice(left, max(0, AHEAD * pool.count - len(running))):
            running[pool.submit(call, order)] = order
        if not running:
            return
        for future in pool.wait(running):
            yield running.pop(future), _tried(future.result)


def in_order(
    pool: WorkPool | None, call: Callable[[Order], Result], orders: Iterable[Order]
) -> Iterator[Result]:
    """Yield the result of each order in the order of the orders, as `map` does.

    Parameters
    ----------
    pool : the pool; None to work in this process
    call : a function of a module, which gets an order
    orders : the orders

    Raises
    ------
    PoolLostError : the pool ended before all were done
    Exception : the first error that an order ended in
    """
    if pool is None:
        yield from map(call, orders)
        return
    numbers: dict[int, int] = {}  # of the orders handed out, which live as long

    def counted() -> Iterator[Order]:
        for number, order in enumerate(orders):
            numbers[id(order)] = number
            yield order

    waiting: dict[int, Result | Exception] = {}
    next_one = 0
    for order, result in results_of(pool, call, counted()):
        waiting[numbers.pop(id(order))] = result
        while next_one in waiting:
            found = waiting.pop(next_one)
            next_one += 1
            if isinstance(found, Exception):
                raise found
            yield found


def _tried(call: Callable[..., Result], *arguments: object) -> Result | Exception:
    try:
        return call(*arguments)
    except Exception as error:  # noqa: BLE001 - one order's, not that of the others
        return error
