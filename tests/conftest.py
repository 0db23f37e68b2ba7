"""How the tests share two cores, and which random examples they take.

Whole cells run one after the other, so do programs on wires; everything else runs beside them, file
by file (`scheduling.py`). The gate takes the same examples every time, so that it fails for a
change only; `HYPOTHESIS_PROFILE=explore pytest` looks for new ones, for whoever has the time to
find out why one fails.
"""

from __future__ import annotations

import gc
import os
import tempfile
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from scheduling import LongestFirst, is_drawn, is_quick, typical_seconds

# an example takes as long as the machine is busy
UNHURRIED = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("gate", derandomize=True, database=None, **UNHURRIED)
settings.register_profile("explore", derandomize=False, **UNHURRIED)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "gate"))

# a worker and a program it starts have a processor each: threads of numerical libraries, one for
# each processor, would wait for one another (numpy reads this when it is imported)
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")

OLD_ROUNDS = 1000  # collections of what is young for one of all there is

# no test notes its journals in the home of whoever runs it
os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="cellctl-tests-")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add what the gate draws its slow tests by."""
    group = parser.getgroup("slow tests")
    group.addoption(
        "--slow-share", type=float, default=1.0, metavar="SHARE",
        help="share of the slow tests that run, drawn (default: 1)",
    )  # fmt: skip
    group.addoption(
        "--slow-seed", default="", metavar="TEXT", help="what they are drawn by (a version)"
    )


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the tests of `pytest -m quick`, and leave out the slow ones that are not drawn."""
    seconds = typical_seconds()
    share, seed = config.getoption("slow_share"), config.getoption("slow_seed")
    left_out = []
    for item in items:
        if is_quick(item.nodeid, (mark.name for mark in item.iter_markers()), seconds):
            item.add_marker("quick")
        slow = item.get_closest_marker("slow")
        if slow and not slow.kwargs.get("always") and not is_drawn(item.nodeid, seed, share):
            left_out.append(item)
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        gone = set(left_out)
        items[:] = [item for item in items if item not in gone]


def pytest_collection_finish() -> None:
    """Have the collector look no more at what stays until the end: nine thousand tests.

    After that there is little left, and Python would look at all of it anew whenever a test has
    made a quarter more: for who reads the syntax trees of every module, twenty times.
    """
    gc.collect()
    gc.freeze()
    young, middle, _ = gc.get_threshold()
    gc.set_threshold(young, middle, OLD_ROUNDS)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LongestFirst | None:
    """Return what hands out whole files, where no other distribution is named."""
    if config.getoption("dist") != "loadfile":
        return None
    return LongestFirst(config, log, typical_seconds())
