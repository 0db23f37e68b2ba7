"""The workers: processes of this machine, or those of a Dask cluster (`cluster.py`)."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from controller.config import ConfigError
from controller.processes import worker_pool

from .cluster import open_cluster
from .working import TaskPool, WorkPool

MAX_COUNT: Final = 512
SCHEMES: Final = ("tcp://", "tls://", "ucx://", "ws://", "wss://")  # schemes known to Dask


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
def open_pool(
    jobs: Jobs, told: Callable[[str], None] = lambda words: None
) -> Iterator[WorkPool | None]:
    """Yield the pool, None where this process works alone; at the end, drop unfinished work.

    Parameters
    ----------
    jobs : number of processes, or their pool
    told : hears of a cluster's workers: how many there are, and which are refused

    Raises
    ------
    ConfigError : Dask is not installed, or its scheduler does not answer
    """
    if jobs.scheduler:
        with open_cluster(jobs.scheduler, told) as cluster:
            yield cluster
    elif jobs.is_alone:
        yield None
    else:
        with worker_pool("controller.catalogue", jobs.count) as pool:
            yield TaskPool(pool, jobs.count)
