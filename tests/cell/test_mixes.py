"""Any device real and any other emulated, by one line of the cell file each.

A real device is one whose address is in the cell file: here each of the six in turn is of an
emulated cell that was started apart, and the five others are of the one beside the run. That it is
really the one meant is proven by its cable: once that is cut, this device fails and no other does.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from installed_here import register

from controller.cell.devices import Devices, clocks, resolve
from controller.cell.devices.clocks import find_clock
from controller.cell.devices.emulator import emulated_cell, emulator_command
from controller.config import EMULATED_CELL, Cell, load_cell
from controller.conformance.lines import DeviceLine, EmulatedLine, PortRelay
from controller.setup.drivers import KIND_OF, require_drivers
from drivers.clock import CellClock
from drivers.errors import DeviceError
from drivers.kinds import Signal

SHORT = ("gripper",)  # the others need a longer run
NAMES = tuple(
    name if name in SHORT else pytest.param(name, marks=pytest.mark.slow) for name in KIND_OF
)


@dataclass(frozen=True)
class Apart:
    """An emulated cell that stands for real devices: their addresses, and a hand on its cables."""

    ready: dict[str, Any]
    control: Path

    def address(self, name: str) -> str:
        offered = self.ready["devices"][name]
        if isinstance(offered, str):
            return offered
        return f"{offered['host']}:{offered['port']}"

    async def line(self, name: str) -> tuple[DeviceLine, str]:
        """Return the device's cable, and the address at this end of it."""
        if KIND_OF[name] == "arm":
            return EmulatedLine.of_arm(self.control), self.address(name)
        if KIND_OF[name] == "camera":
            return EmulatedLine.of_camera(self.control, name), self.address(name)
        relay = PortRelay(self.address(name))
        return relay, await relay.start()


@pytest.fixture(scope="module")
def apart(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Apart]:
    control = tmp_path_factory.mktemp("apart") / "control"
    more = ("--control", str(control))
    command = emulator_command(EMULATED_CELL, (), speed=1.0, seed=2, more=more)
    with emulated_cell(command) as ready:
        yield Apart(ready, control)


@pytest.fixture(scope="module")
def beside() -> Iterator[dict[str, Any]]:
    with emulated_cell(emulator_command(EMULATED_CELL, (), speed=1.0, seed=1)) as ready:
        yield ready


@pytest.fixture(autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install this checkout as it is now."""
    monkeypatch.syspath_prepend(str(register(tmp_path_factory.mktemp("installed"))))


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait longer for the emulators, which this computer may keep from answering."""
    monkeypatch.setattr(clocks, "MIXED_TIMEOUT_WALL_S", 15.0)


def cell_with(folder: Path, lines: dict[str, str]) -> Cell:
    """Return the emulated cell with other lines for some of its devices."""
    text = EMULATED_CELL.read_text().splitlines()
    for name, section in lines.items():
        (place,) = (
            i
            for i, line in enumerate(text)
            if line.startswith(f"  {name}:  ") and "emulated" in line
        )
        text[place] = f"  {name}: {section}"
    path = folder / "cell.yaml"
    path.write_text("\n".join(text))
    cell = load_cell(path)
    require_drivers(path, cell)
    return cell


@asynccontextmanager
async def opened(cell: Cell, ready: dict[str, Any]) -> AsyncIterator[tuple[Devices, CellClock]]:
    """Open all devices of a cell as a run does."""
    clock = find_clock(cell, ready).open()
    try:
        async with clock.attending():
            devices = Devices.build(cell, resolve(cell, ready["devices"]), clock)
            try:
                await devices.connect()
                yield devices, clock
            finally:
                await devices.aclose()
    finally:
        clock.close()


def uses(devices: Devices, clock: CellClock) -> dict[str, Callable[[], Awaitable[object]]]:
    """Return for each device what cannot be done without it."""

    async def inputs() -> None:
        async with clock.timeout(2.0):
            await devices.io.wait_for("guard_closed", Signal.OK)

    levels = cycle((0.5, 0.25))  # what is so already is not sent again

    async def lit() -> None:
        await devices.lights.set({"station_ring": next(levels)})

    async def frame(name: str) -> None:
        camera = getattr(devices, name)
        await camera.resume()
        try:
            taken = await camera.frame_after(clock.now_s())
        finally:
            with suppress(DeviceError):
                await camera.pause()
        assert taken.image.shape == camera.shape

    return {
        "arm": devices.arm.read_jaws,
        "gripper": devices.gripper.status,
        "lights": lit,
        "io": inputs,
        "overhead": lambda: frame("overhead"),
        "inspection": lambda: frame("inspection"),
    }


async def is_known_gone(name: str, devices: Devices, use: Callable[[], Awaitable[object]]) -> None:
    """Wait until a device whose cable is cut is reported, or its inputs are unknown."""
    if name == "io":
        with devices.io.watch() as changes:
            while devices.io.signal("guard_closed") is not Signal.UNKNOWN:
                await anext(aiter(changes))
        return
    with pytest.raises(DeviceError):
        await use()


@pytest.mark.parametrize("name", NAMES)
async def test_one_real_device_works_with_five_emulated_ones(
    name: str, apart: Apart, beside: dict[str, Any], tmp_path: Path
) -> None:
    async with AsyncExitStack() as stack:
        line, address = await apart.line(name)
        stack.push_async_callback(line.aclose)
        unit = ", unit: 9" if name == "gripper" else ""
        cell = cell_with(tmp_path, {name: f"{{address: '{address}'{unit}}}"})
        assert set(cell.emulated_devices) == set(KIND_OF) - {name}
        assert find_clock(cell, beside).is_mixed
        devices, clock = await stack.enter_async_context(opened(cell, beside))
        use = uses(devices, clock)
        for one in use.values():
            await one()
        await devices.gripper.activate()
        await devices.gripper.open_to(40.0)
        assert (await devices.gripper.status()).opening_mm == pytest.approx(40.0, abs=1.0)
        await line.cut()
        await is_known_gone(name, devices, use[name])
        for other in set(use) - {name}:
            await use[other]()
        await line.mend()


@pytest.mark.slow
async def test_pictures_from_a_folder_beside_a_real_arm_and_emulated_lamps(
    apart: Apart, beside: dict[str, Any], tmp_path: Path
) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    assert cv2.imwrite(str(folder / "1.png"), np.full((1024, 1280), 7, np.uint8))
    cell = cell_with(
        tmp_path,
        {
            "arm": f"{{address: '{apart.address('arm')}'}}",
            "overhead": "{driver: folder, address: pictures, settings: {at_end: loop}}",
        },
    )
    assert find_clock(cell, beside).is_mixed
    async with opened(cell, beside) as (devices, clock):
        for one in uses(devices, clock).values():
            await one()
        await devices.overhead.resume()
        assert int((await devices.overhead.frame_after(clock.now_s())).image.max()) == 7
