"""What a thread has freed goes back to the system, and not to the next array of that thread."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from controller.memory import map_large_arrays

# Threads make pictures' arrays of growing size, all at once, as the page's do; then all are freed.
PROGRAM = """
import sys, threading
from types import SimpleNamespace
import numpy as np
from controller.memory import map_large_arrays

def own_mb():
    with open("/proc/self/smaps_rollup") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("Anonymous:")) / 1024

def work(barrier):
    for megabytes in (5, 10, 10):
        array = np.ones((megabytes << 20) + 7, np.uint8)
        small = [bytearray(2000) for _ in range(10)]  # what is kept above a freed array
        barrier.wait()
        del array

def measure():
    barrier = threading.Barrier(6)
    np.ones(10)
    before = own_mb()
    is_over = threading.Event()
    steps = lambda: (work(barrier), barrier.wait(), is_over.wait())
    threads = [threading.Thread(target=steps) for _ in range(5)]
    for one in threads:
        one.start()
    work(barrier)
    barrier.wait()
    print(own_mb() - before)
    is_over.set()

if sys.argv[1] == "page":
    from controller.page import serving
    serving.server_of = lambda *_: SimpleNamespace(run=measure)
    serving.serve(None, None, None)
elif sys.argv[1] == "mapped":
    map_large_arrays()
    measure()
else:
    measure()
"""


def kept_mb(how: str) -> float:
    command = [sys.executable, "-c", PROGRAM, how]
    found: float = json.loads(subprocess.check_output(command, text=True, timeout=120))
    return found


def test_threads_keep_nothing_of_large_arrays_that_they_have_freed() -> None:
    assert kept_mb("mapped") < 5.0  # half of one thread's largest array
    assert kept_mb("as it is") > 50.0  # every thread's: what the call is there for


def test_the_page_keeps_nothing_of_pictures_that_it_has_shown() -> None:
    assert kept_mb("page") < 5.0


def test_another_c_library_does_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ctypes.CDLL", lambda _: object())
    map_large_arrays()
