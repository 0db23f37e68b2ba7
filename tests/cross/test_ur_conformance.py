"""The UR driver and the emulated controller, two readings of one guide: the conformance suite."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from installed_here import register
from ur_cell import write_ur_cell

from controller.conformance.suite import MET, NOT_TRIED, Suite


@pytest.fixture(autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have this checkout's drivers, whatever an older installation offers."""
    monkeypatch.syspath_prepend(str(register(tmp_path_factory.mktemp("installed"))))


@pytest.fixture
def ports() -> Iterator[dict[str, int]]:
    command = [sys.executable, "-m", "emulators.ur_arm", "--speed", "4"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())
        finally:
            process.terminate()


def test_the_driver_meets_every_requirement_on_the_emulated_controller(
    ports: dict[str, int], tmp_path: Path
) -> None:
    settings = (
        f"{{dashboard_port: {ports['dashboard']}, script_port: {ports['primary']}, "
        f"gripper_port: {ports['urcap']}}}"
    )
    path = write_ur_cell(tmp_path / "cell.yaml", f"127.0.0.1:{ports['rtde']}", settings)
    suite = Suite(path, ["arm"], speed=1.0, allow_motion=True, prompt=lambda _: True)
    suite.open()
    try:
        found = [suite.attempt("arm", one) for one in suite.requirements("arm")]
    finally:
        suite.close()
    assert [(one.name, one.verdict, one.words) for one in found if one.verdict != MET] == []
    assert len(found) == 12
    assert NOT_TRIED not in {one.verdict for one in found}
