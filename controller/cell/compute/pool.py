"""Make the worker process: a fresh one that ends with its parent, however the parent ends."""

import ctypes
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context

PR_SET_PDEATHSIG = 1  # linux/prctl.h


def make_pool() -> ProcessPoolExecutor:
    """Return the pool. Its process is a fresh one, since a fork would copy open devices into it.

    The worker ends with this process, however that ends. The first use must be in the main thread.
    """
    return ProcessPoolExecutor(
        max_workers=1,
        mp_context=get_context("spawn"),
        initializer=_belong_to,
        initargs=(os.getpid(),),
    )


@contextmanager
def worker_pool() -> Iterator[ProcessPoolExecutor]:
    """Yield the pool; at the end, discard whatever its worker has not finished."""
    pool = make_pool()
    try:
        yield pool
    finally:
        for child in active_children():
            child.terminate()
        pool.shutdown(cancel_futures=True)


def _belong_to(parent: int) -> None:
    """Make a worker end with its parent, and leave the terminal's signals to the parent."""
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # the parent died before the line above
        os._exit(1)
