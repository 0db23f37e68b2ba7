"""Make worker processes: fresh ones that end with their parent, however the parent ends.

This module imports nothing that computes, so that a process loads only the code its orders need.
"""

import ctypes
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import active_children, get_context

from .loading import loading

PR_SET_PDEATHSIG = 1  # linux/prctl.h
# what a terminal, or who stops a whole group of processes, sends to each of them: the parent
# decides when its workers end
LEFT_TO_PARENT = (
    signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGHUP, signal.SIGTSTP,
)  # fmt: skip


def make_pool(module: str = "", count: int = 1, niceness: int = 0) -> ProcessPoolExecutor:
    """Return the pool. Its processes are fresh ones, since a fork would copy open devices into it.

    A worker ends with this process, however that ends. The first use must be in the main thread.

    Parameters
    ----------
    module : module that a process imports when it starts, "" for those its first order needs
    count : number of worker processes
    niceness : their niceness, as in `nice`
    """
    return ProcessPoolExecutor(
        max_workers=count,
        mp_context=get_context("spawn"),
        initializer=_begin,
        initargs=(os.getpid(), niceness, module),
    )


@contextmanager
def worker_pool(
    module: str = "", count: int = 1, niceness: int = 0
) -> Iterator[ProcessPoolExecutor]:
    """Yield the pool; at the end, discard whatever its processes have not finished.

    Parameters
    ----------
    module : module that a process imports when it starts, "" for those its first order needs
    count : number of worker processes
    niceness : their niceness, as in `nice`
    """
    pool = make_pool(module, count, niceness)
    try:
        yield pool
    finally:
        for child in active_children():
            child.kill()
        pool.shutdown(cancel_futures=True)


def _begin(parent: int, niceness: int, module: str) -> None:
    """Make a worker end with its parent, and leave signals to a group to the parent."""
    for number in LEFT_TO_PARENT:
        signal.signal(number, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.nice(niceness)
    if os.getppid() != parent:  # the parent died before the line above
        os._exit(1)
    if module:
        with loading():
            import_module(module)
