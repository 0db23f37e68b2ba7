"""`pytest --cell FILE` as people run it: on emulated devices, and on another make's driver."""

from __future__ import annotations

import asyncio
import json
import os
import pty
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from acme_device import AcmeDevice, acme_device
from installed_here import register

ROOT = Path(__file__).resolve().parents[2]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
ACME = ROOT / "tests" / "data" / "acme"
OWN_GRIPPER = "gripper:     {address: emulated, transport: tcp, unit: 9}"
HANG_WALL_S = 600.0


@dataclass(frozen=True)
class Run:
    code: int
    text: str
    report: dict[str, Any]

    def verdicts(self, device: str) -> dict[str, str]:
        (tried,) = (one for one in self.report["devices"] if one["name"] == device)
        return {outcome["name"]: outcome["verdict"] for outcome in tried["outcomes"]}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return register(tmp_path)


def _all_of(terminal: int) -> bytes:
    """Read a terminal until nobody writes to it any more."""
    found = b""
    with suppress(OSError):  # how Linux says that its other end is closed
        while block := os.read(terminal, 65536):
            found += block
    return found


async def pytest_cell(folder: Path, *options: str, says: bytes = b"") -> Run:
    """Run `pytest --cell` in a folder of its own; a person at its terminal says something."""
    person, terminal = pty.openpty()
    report = folder / "report.html"
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--cell-report", str(report)),
        *options,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (folder, ROOT, ACME)))},
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
    )
    os.close(terminal)
    os.write(person, says)
    async with asyncio.timeout(HANG_WALL_S):
        out = await asyncio.to_thread(_all_of, person)
        await process.wait()
    os.close(person)
    found = report.with_suffix(".json")
    shown = json.loads(found.read_text()) if found.exists() else {}
    assert process.returncode is not None
    return Run(process.returncode, out.decode(), shown)


async def _emulated(folder: Path, devices: tuple[str, ...]) -> None:
    chosen = [word for name in devices for word in ("--cell-device", name)]
    run = await pytest_cell(
        folder, "--cell", str(CELL), "--allow-motion", "--cell-speed", "4", *chosen
    )
    assert run.code == 0, run.text
    for name in devices:
        assert set(run.verdicts(name).values()) == {"met"}
    page = (folder / "report.html").read_text()
    assert "emulated: no evidence about a real device" in page
    for place in ("Name", "Date", "Signature"):
        assert f"<div>{place}</div>" in page


async def test_emulated_devices_meet_all_requirements(folder: Path) -> None:
    await _emulated(folder, ("gripper", "lights", "io", "overhead"))


@pytest.mark.slow
async def test_the_emulated_arm_meets_all_requirements(folder: Path) -> None:
    await _emulated(folder, ("arm", "inspection"))


@pytest.fixture
def acme() -> Iterator[AcmeDevice]:
    """Serve an ACME gripper that takes its time, on a thread of its own."""
    serving = threading.Event()
    found: list[AcmeDevice] = []
    loop = asyncio.new_event_loop()

    async def serve() -> None:
        async with acme_device() as device:
            device.speed_mm_s = 40.0
            found.append(device)
            serving.set()
            await ended.wait()

    ended = asyncio.Event()
    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()))
    thread.start()
    assert serving.wait(60)
    yield found[0]
    loop.call_soon_threadsafe(ended.set)
    thread.join()
    loop.close()


@pytest.fixture
def acme_cell(folder: Path, acme: AcmeDevice) -> Path:
    text = CELL.read_text()
    assert OWN_GRIPPER in text
    path = folder / "cell.yaml"
    driver = f"{{driver: acme, address: '127.0.0.1:{acme.port}', settings: {{max_opening_mm: 60}}}}"
    path.write_text(text.replace(OWN_GRIPPER, f"gripper: {driver}"))
    return path


async def test_the_example_of_docs_drivers_meets_all_requirements(
    folder: Path, acme_cell: Path
) -> None:
    run = await pytest_cell(
        folder,
        *("--cell", str(acme_cell), "--cell-device", "gripper", "--allow-motion"),
        says=b"yes\n",
    )
    assert run.code == 0, run.text
    assert set(run.verdicts("gripper").values()) == {"met"}
    (tried,) = run.report["devices"]
    assert tried["model"] == "ACME gripper"
    assert not tried["is_emulated"]


async def test_a_real_device_moves_only_if_somebody_agrees(
    folder: Path, acme_cell: Path, acme: AcmeDevice
) -> None:
    run = await pytest_cell(
        folder,
        *("--cell", str(acme_cell), "--cell-device", "gripper", "--allow-motion"),
        says=b"no\n",
    )
    assert run.code == 0, run.text
    assert run.text.count("about to be commanded") == 1
    moving = {"limits", "units", "empty", "stop", "cancelled"}
    assert {n for n, v in run.verdicts("gripper").items() if v == "not tried"} == moving
    assert acme.opening_mm == acme.target_mm == 60.0


async def test_a_driver_that_fails_ends_pytest_with_1_and_is_named(
    folder: Path, acme_cell: Path
) -> None:
    broken = (ACME / "acme_gripper.py").read_text()
    assert "self._check(opening_mm)" in broken
    # before the example's own folder on the path
    (folder / "acme_gripper.py").write_text(broken.replace("self._check(opening_mm)", "pass"))
    run = await pytest_cell(
        folder,
        *("--cell", str(acme_cell), "--cell-device", "gripper", "--allow-motion"),
        says=b"yes\n",
    )
    assert run.code == 1
    assert run.verdicts("gripper")["limits"] == "not met"
    assert re.search(r"gripper: open_to\(61 mm\): was taken", run.text)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--cell", "nowhere.yaml"), "nowhere.yaml"),
        (("--cell", str(CELL), "--cell-device", "hand"), "no device `hand`; there are arm"),
        (("--cell", str(CELL), "tests"), "--cell tries devices alone; leave the paths away"),
    ],
)
async def test_wrong_options_end_in_one_sentence(
    folder: Path, options: tuple[str, ...], words: str
) -> None:
    (folder / "tests").mkdir()
    run = await pytest_cell(folder, *options)
    assert run.code == 4
    assert words in run.text
    assert "Traceback" not in run.text


async def test_without_the_option_nothing_of_it_is_loaded(folder: Path) -> None:
    (folder / "test_it.py").write_text(
        "import sys\n"
        "def test_it(pytestconfig):\n"
        "    assert pytestconfig.pluginmanager.hasplugin('cellctl')\n"
        "    assert not pytestconfig.pluginmanager.hasplugin('cellctl-conformance')\n"
        "    heavy = {'numpy', 'pydantic', 'pymodbus', 'cv2', 'controller.config', 'drivers'}\n"
        "    assert not heavy & set(sys.modules)\n"
    )
    run = await pytest_cell(folder, "test_it.py", "-p", "no:hypothesispytest")
    assert run.code == 0, run.text
