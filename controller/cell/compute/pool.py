"""The worker process: made fresh, ended with its parent, whatever ends that."""

import ctypes
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context

PR_SET_PDEATHSIG = 1  # linux/prctl.h


def make_pool() -> ProcessPoolExecutor:
    """Return the pool; fresh processes, since a fork would copy open devices into them.

    Its worker ends with this process, however that ends. To be used first from the main thread.
    """
    return ProcessPoolExecutor(
        max_workers=1,
        mp_context=get_context("spawn"),
        initializer=_belong_to,
        initargs=(os.getpid(),),
    )


@contextmanager
def worker_pool() -> Iterator[ProcessPoolExecutor]:
    """Yield the pool; what its worker is still at when it is no longer needed is thrown away."""
    pool = make_pool()
    try:
        yield pool
    finally:
        for child in active_children():
            child.terminate()
        pool.shutdown(cancel_futures=True)


def _belong_to(parent: int) -> None:
    """Tie a worker's life to its parent's, and leave the terminal's signals to that."""
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it has died before that
        os._exit(1)
