"""The workers: processes of this machine, or those of a Dask cluster."""

import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

from controller.config import ConfigError
from controller.processes import worker_pool

MAX_COUNT: Final = 512
SCHEMES: Final = ("tcp://", "tls://", "ucx://", "ws://", "wss://")  # schemes known to Dask
CONNECT_S: Final = 30.0


@dataclass(frozen=True, slots=True)
class Jobs:
    """Value of ``--jobs``.

    Attributes
    ----------
    count : number of processes on this machine; 1 is this process alone
    scheduler : address of a Dask scheduler, "" for none
    """

    count: int = 1
    scheduler: str = ""

    @property
    def is_alone(self) -> bool:
        """Whether nobody else works."""
        return self.count == 1 and not self.scheduler


LOCAL: Final = Jobs()


@dataclass(frozen=True, slots=True)
class TaskPool:
    """An executor, and the number of tasks it runs at a time."""

    executor: Executor
    count: int


def jobs_among(text: str | None) -> Jobs:
    """Return the value of ``--jobs``: a number, ``all``, or the address of a Dask scheduler.

    Raises
    ------
    ConfigError : it is none of these
    """
    if text is None:
        return LOCAL
    if text == "all":
        return Jobs(min(len(os.sched_getaffinity(0)), MAX_COUNT))
    if text.startswith(SCHEMES):
        return Jobs(scheduler=text)
    if text.isascii() and text.isdigit() and 1 <= int(text) <= MAX_COUNT:
        return Jobs(int(text))
    raise ConfigError(
        f"--jobs {text}: expected a number from 1 to {MAX_COUNT}, `all`, or the address of a Dask "
        "scheduler such as tcp://127.0.0.1:8786"
    )


@contextmanager
def open_pool(jobs: Jobs) -> Iterator[TaskPool | None]:
    """Yield the pool, None where this process works alone; at the end, drop unfinished work.

    Parameters
    ----------
    jobs : number of processes, or their pool

    Raises
    ------
    ConfigError : Dask is not installed, its scheduler does not answer, or it has no worker
    """
    if jobs.scheduler:
        with _dask(jobs.scheduler) as pool:
            yield pool
    elif jobs.is_alone:
        yield None
    else:
        with worker_pool("controller.catalogue", jobs.count) as pool:
            yield TaskPool(pool, jobs.count)


@contextmanager
def _dask(address: str) -> Iterator[TaskPool]:
    try:
        distributed: Any = import_module("distributed")  # untyped
    except ImportError as error:
        raise ConfigError(
            f"--jobs {address}: Dask is not installed; install cellctl[dask]"
        ) from error
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--jobs {address}: no Dask scheduler answers there") from error
    with client:
        count = sum(client.ncores().values())
        if not count:
            raise ConfigError(f"--jobs {address}: the scheduler has no worker; start one")
        executor = client.get_executor(pure=False, retries=1)
        try:
            yield TaskPool(executor, count)
        finally:
            executor.shutdown(wait=False)  # cancels what is not done
