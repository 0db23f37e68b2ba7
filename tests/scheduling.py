"""Which process runs which tests: whole files, the longest first. Which slow tests a gate runs.

What the tests of a file share (a compiled part, a plan, a recorded run) is prepared by the process
that runs them. A file whose tests go to two processes is prepared twice, so a file is a unit and
goes to one. Some files start processes of their own that keep time; these are one unit together.

The groups of pytest-xdist's own `--dist loadgroup` are not relied on: it writes a group into
`Item._nodeid`, which pytest 9.2 does not read, so that each test is a unit. That what is shared is
made once is held by `test_shared_work.py`.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from xdist.scheduler import LoadScopeScheduling

if TYPE_CHECKING:
    import pytest
    from xdist.workermanage import WorkerController

HERE = Path(__file__).parent
# CPU seconds of each unit of one and more, as `benchmarks/bench_suite.py --keep` last wrote them;
# of units that came since, the seconds that pytest gave in a run of the gate
TYPICAL = HERE / "data" / "typical_seconds.json"
SPECIAL = frozenset({"slow", "kernel", "hardware"})  # marks of tests that ask for more than a file
SHORT_CPU_S = 2.0  # what a file may take that is run on a second Python, too: 250 of 315 do
# Each of these starts processes of its own that keep time: two of them at once would only wait. A
# file belongs to the first group that names the start of its path.
GROUPS = {
    "whole cells": (
        "cell/",
        "cross/test_emulated_cell",
        "cross/test_examples",
        "unit/test_emu_world_app",
    ),
    "wires": (
        "cross/",
        "unit/test_emu_camera",
        "unit/test_camera_genicam_wire",
        "unit/test_conformance_plugin",
    ),
}


def unit_of(nodeid: str) -> str:
    """Return the group of a test, or else its file."""
    file = nodeid.partition("::")[0].removeprefix("tests/")
    for group, starts in GROUPS.items():
        if file.startswith(starts):
            return group
    return file


class LongestFirst(LoadScopeScheduling):
    """Hands out units, the longest first, so that no process is left alone with a long one."""

    def __init__(self, config: pytest.Config, log: Any, seconds: Mapping[str, float]) -> None:
        super().__init__(config, log)
        self._seconds = seconds

    def _split_scope(self, nodeid: str) -> str:
        return unit_of(nodeid)

    def _assign_work_unit(self, node: WorkerController) -> None:
        longest = max(self.workqueue, key=lambda unit: self._seconds.get(unit, 0.0))
        self.workqueue.move_to_end(longest, last=False)
        super()._assign_work_unit(node)


def typical_seconds() -> dict[str, float]:
    """Return the CPU seconds that each unit took when they were last kept."""
    return {str(k): float(v) for k, v in json.loads(TYPICAL.read_text()).items()}


def is_quick(nodeid: str, marks: Iterable[str], seconds: Mapping[str, float]) -> bool:
    """Return whether a test is a quick one: of a file of unit tests of less than a second.

    Parameters
    ----------
    nodeid, marks : name of the test, and the names of its marks
    seconds : `typical_seconds`, which has no unit of less than a second
    """
    unit = unit_of(nodeid)
    return unit.startswith("unit/") and unit not in seconds and not SPECIAL & set(marks)


def is_drawn(nodeid: str, seed: str, share: float) -> bool:
    """Return whether a test is one of a share of all, drawn by its name and a seed."""
    digest = hashlib.sha256(f"{seed} {nodeid}".encode()).digest()
    return int.from_bytes(digest[:8], "big") < share * 2**64


def short_files() -> list[str]:
    """Return the files of unit tests that take `SHORT_CPU_S` at most, from the root on."""
    seconds = typical_seconds()
    files = sorted((HERE / "unit").glob("test_*.py"))
    names = [str(file.relative_to(HERE.parent)) for file in files]
    return [name for name in names if seconds.get(unit_of(name), 0.0) <= SHORT_CPU_S]


if __name__ == "__main__":
    sys.stdout.write(" ".join(short_files()) + "\n")
