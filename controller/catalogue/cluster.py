"""A Dask cluster as a pool: workers come, die and are refused while it works.

Each task is bound to the workers that are known to have this very software. So a task whose workers
are all gone is handed out again, to those that came meanwhile; where there is none it waits here.
"""

import logging
import time
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib import import_module
from queue import Empty, SimpleQueue
from typing import Any, Final

from controller.config import ConfigError

from .software import software_here, why_other
from .working import PoolLostError

CONNECT_S: Final = 30.0
LOOK_S: Final = 1.0  # between looks at the workers, each a question of a millisecond
# Deaths of its workers after which a task is given up, as Dask's own `allowed-failures`.
MAX_DEATHS: Final = 3


class WorkerEndedError(Exception):
    """A task that ends its workers, for want of memory say."""

    def __init__(self, count: int) -> None:
        super().__init__(f"{count} workers ended while they had it (for want of memory?)")


@dataclass(eq=False, slots=True)
class _Task:
    """A task, and where it is.

    Attributes
    ----------
    remote : Dask's future; None while no worker is there for it
    workers : addresses of the workers that may take it
    deaths : how often all of these ended while they had it
    """

    call: Callable[..., Any]
    arguments: tuple[object, ...]
    remote: Any = None
    workers: frozenset[str] = field(default_factory=frozenset)
    deaths: int = 0


class WorkerCluster:
    """The workers of a scheduler that have this software.

    Parameters
    ----------
    client : Dask's client
    address : of the scheduler, for messages
    told : hears of the workers
    """

    def __init__(self, client: Any, address: str, told: Callable[[str], None]) -> None:  # noqa: ANN401 - untyped
        self._client, self._address, self._told = client, address, told
        self._tasks: dict[Future[Any], _Task] = {}
        self._refused: dict[str, str] = {}
        self._threads: dict[str, int] = {}  # of the workers in use, by address
        self._most = 0  # workers at a time, in use or not
        self._words = ""
        self._looked_s = -LOOK_S
        self._is_any_done: SimpleQueue[None] = SimpleQueue()
        self._look()

    @property
    def count(self) -> int:
        """Number of tasks that run at a time now, at least 1."""
        return max(1, sum(self._threads.values()))

    def submit(self, call: Callable[..., Any], *arguments: object) -> Future[Any]:
        """Hand out a task, or keep it until there is a worker for it; return its future.

        Raises
        ------
        PoolLostError : the scheduler went away
        """
        future: Future[Any] = Future()
        task = self._tasks[future] = _Task(call, arguments)
        self._hand_out(task)
        return future

    def wait(self, futures: Collection[Future[Any]]) -> set[Future[Any]]:
        """Return those that are done; see `WorkPool`.

        Raises
        ------
        PoolLostError : the scheduler went away
        """
        while True:
            for future in [f for f, task in self._tasks.items() if _is_done(task)]:
                self._settle(future, self._tasks[future].remote)
            done = {future for future in futures if future.done()}
            self._look()
            if done:
                return done
            with suppress(Empty):
                self._is_any_done.get(timeout=LOOK_S)

    def close(self) -> None:
        """Drop what is not done."""
        for task in self._tasks.values():
            if task.remote is not None:
                task.remote.cancel()

    def _settle(self, future: Future[Any], remote: Any) -> None:  # noqa: ANN401 - untyped
        if remote.cancelled():  # by nobody here: the client has lost its scheduler
            raise self._lost()
        del self._tasks[future]
        error = remote.exception()
        if error is None:
            future.set_result(remote.result())
        elif type(error).__name__ == "KilledWorker":
            future.set_exception(WorkerEndedError(MAX_DEATHS + 1))
        else:
            future.set_exception(error)

    def _look(self) -> None:
        """See which workers there are; hand out again what waits for those that are gone."""
        if time.monotonic() - self._looked_s < LOOK_S:
            return
        try:
            there = dict(self._client.nthreads())
            new = [one for one in there if one not in self._threads and one not in self._refused]
            answers = self._client.run(software_here, workers=new, on_error="return") if new else {}
        except (OSError, ValueError, RuntimeError) as error:
            raise self._lost() from error
        self._looked_s = time.monotonic()
        for worker in [one for one in new if one in answers]:  # others ended meanwhile
            why = why_other(answers[worker])
            if why:
                self._refused[worker] = why
                self._told(f"worker {worker} is not used: it {why}; install the same there")
            else:
                self._threads[worker] = there[worker]
        self._refused = {worker: why for worker, why in self._refused.items() if worker in there}
        self._threads = {one: there[one] for one in self._threads if one in there}
        self._tell()
        self._again(
            [
                future
                for future, task in self._tasks.items()
                if not _is_done(task) and not task.workers & self._threads.keys()
            ]
        )

    def _again(self, futures: Sequence[Future[Any]]) -> None:
        """Hand out tasks whose workers are gone; give up the one that ends them.

        Workers take tasks in their order, so the first of several is the one that was in hand.
        """
        for future in futures:
            task = self._tasks[future]
            task.deaths += task.remote is not None
            if task.deaths < MAX_DEATHS:
                self._hand_out(task)
                continue
            del self._tasks[future]
            future.set_exception(WorkerEndedError(MAX_DEATHS))
            for other in self._tasks.values():
                other.deaths = 0

    def _tell(self) -> None:
        used = len(self._threads)
        self._most = max(self._most, used + len(self._refused))
        words = f"workers: {used} of {self._most}"
        if not used:
            words = (
                f"workers: none at {self._address} yet; waiting for one "
                f"(`dask worker {self._address}`)"
            )
            if self._most:
                words = f"workers: 0 of {self._most}; waiting for one"
        if words != self._words:
            self._words = words
            self._told(words)

    def _hand_out(self, task: _Task) -> None:
        if task.remote is not None:
            task.remote.cancel()
            task.remote = None
        task.workers = frozenset(self._threads)
        if not task.workers:
            return
        try:
            task.remote = self._client.submit(
                task.call,
                *task.arguments,
                pure=False,
                workers=sorted(task.workers),
                allow_other_workers=False,
            )
            task.remote.add_done_callback(lambda _: self._is_any_done.put(None))
        except (OSError, ValueError, RuntimeError) as error:
            raise self._lost() from error

    def _lost(self) -> PoolLostError:
        return PoolLostError(f"the Dask scheduler at {self._address} went away")


def _is_done(task: _Task) -> bool:
    return task.remote is not None and bool(task.remote.done())


@contextmanager
def open_cluster(address: str, told: Callable[[str], None]) -> Iterator[WorkerCluster]:
    """Yield the workers of a Dask scheduler; at the end, drop unfinished work.

    Parameters
    ----------
    address : address of the scheduler
    told : hears of the workers

    Raises
    ------
    ConfigError : Dask is not installed, its scheduler does not answer, or TLS has no certificate
    """
    try:
        distributed: Any = import_module("distributed")  # untyped
    except ImportError as error:
        raise ConfigError(
            f"--jobs {address}: Dask is not installed; install cellctl[dask]"
        ) from error
    for name in [one for one in logging.root.manager.loggerDict if one.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)  # said here, in a sentence
    # pictures travel with the order that needs them
    warnings.filterwarnings("ignore", message="Sending large graph")
    _require_certificates(distributed, address)
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--jobs {address}: no Dask scheduler answers there ({error})") from error
    with client:
        try:
            cluster = WorkerCluster(client, address, told)
        except PoolLostError as error:
            raise ConfigError(f"--jobs {address}: {error}") from error
        try:
            yield cluster
        finally:
            cluster.close()


def _require_certificates(distributed: Any, address: str) -> None:  # noqa: ANN401 - untyped
    """Require that the settings of TLS fit the address; Dask's own message names no setting.

    Raises
    ------
    ConfigError : they do not, or a file of them cannot be read
    """
    try:
        settings = distributed.Security().get_connection_args("client")
    except (OSError, TypeError, ValueError) as error:
        raise ConfigError(f"--jobs {address}: the certificates of TLS: {error}") from error
    is_tls = address.startswith(("tls://", "wss://"))
    if is_tls and settings.get("ssl_context") is None:
        raise ConfigError(
            f"--jobs {address}: TLS needs a certificate; name its files in "
            "DASK_DISTRIBUTED__COMM__TLS__CA_FILE, ...__TLS__CLIENT__CERT and ...__TLS__CLIENT__KEY"
        )
    if settings.get("require_encryption") and not is_tls:
        raise ConfigError(
            f"--jobs {address}: DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION is set; use an address "
            "that begins with tls://"
        )
