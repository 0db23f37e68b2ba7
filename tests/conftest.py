"""How the tests share two cores, and which random examples they take.

Whole cells run one after the other, so do programs on wires; everything else runs beside them. The
gate takes the same examples every time, so that it fails for a change only;
`HYPOTHESIS_PROFILE=explore pytest` looks for new ones, for whoever has the time to find out why one
fails.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# an example takes as long as the machine is busy
UNHURRIED = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("gate", derandomize=True, database=None, **UNHURRIED)
settings.register_profile("explore", derandomize=False, **UNHURRIED)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "gate"))

# a worker and a program it starts have a processor each: threads of numerical libraries, one for
# each processor, would wait for one another (numpy reads this when it is imported)
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# no test notes its journals in the home of whoever runs it
os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="cellctl-tests-")

HERE = Path(__file__).parent
# Each of these starts processes of its own that keep time: two of them at once would only wait. A
# file belongs to the first group that names the start of its path.
GROUPS = {
    "whole cells": (
        "cell/",
        "cross/test_emulated_cell",
        "cross/test_python_page",
        "unit/test_emu_world_app",
    ),
    "wires": ("cross/", "unit/test_emu_camera", "unit/test_conformance_plugin"),
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if not item.path.is_relative_to(HERE):
            continue  # a requirement of `pytest --cell` is in no file
        path = item.path.relative_to(HERE).as_posix()
        for group, starts in GROUPS.items():
            if path.startswith(starts):
                item.add_marker(pytest.mark.xdist_group(group))
                break
