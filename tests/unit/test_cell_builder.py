"""What the cell passes to a driver of each kind: the device's address and settings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from controller.cell.devices import DeviceBuilder, resolve
from controller.cell.devices.build import IO_POLL_WALL_S
from controller.config import EMULATED_CELL, Cell, ConfigError, load_cell
from drivers.clock import CellClock
from drivers.kinds import Site
from drivers.modbus_link import RtuAddress

KINDS = ("arm", "camera", "gripper", "io", "lights")
PACKAGE = """
from dataclasses import dataclass
from drivers.kinds import Driver

@dataclass(frozen=True)
class Settings:
    note: str = "none"

DRIVER = Driver(Settings, lambda site, settings: (site, settings.note))
"""


@pytest.fixture
def cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cell:
    """Return a cell whose devices all have the driver of a package that shows what it gets."""
    (tmp_path / "shows.py").write_text(PACKAGE)
    info = tmp_path / "shows-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: shows\nVersion: 1.0\n")
    lines = "".join(f"{kind}.shows = shows:DRIVER\n" for kind in KINDS)
    (info / "entry_points.txt").write_text(f"[cellctl.drivers]\n{lines}")
    monkeypatch.syspath_prepend(str(tmp_path))
    text = EMULATED_CELL.read_text()
    file = tmp_path / "cell.yaml"
    file.write_text(
        text.replace(
            "{address: emulated", "{driver: shows, settings: {note: hello}, address: 127.0.0.1:502"
        )
    )
    return load_cell(file)


def built(cell: Cell, speed: float = 1.0) -> dict[str, Any]:
    builder = DeviceBuilder(cell, resolve(cell, {}), CellClock(speed))
    devices: dict[str, Any] = {
        "arm": builder.arm(),
        "gripper": builder.gripper(),
        "lights": builder.lights(),
        "io": builder.io(),
        "overhead": builder.camera("overhead"),
        "inspection": builder.camera("inspection"),
    }
    return devices


def test_settings_reach_every_driver(cell: Cell) -> None:
    for name, (site, note) in built(cell).items():
        assert note == "hello"
        assert site.name == name
        assert site.address == "127.0.0.1:502"


def test_each_kind_gets_what_it_needs_and_no_more(cell: Cell) -> None:
    sites: dict[str, Site] = {name: site for name, (site, _) in built(cell).items()}
    assert [name for name, site in sites.items() if site.polling] == ["io"]
    assert [name for name, site in sites.items() if site.lamps] == ["lights"]
    assert [name for name, site in sites.items() if site.capture] == ["overhead", "inspection"]
    assert [name for name, site in sites.items() if site.inputs] == ["io"]
    ring = next(lamp for lamp in sites["lights"].lamps if lamp.name == "table_ring")
    assert (ring.analog, ring.relay) == (1, 1)  # as in the cell file, counted from 0
    capture = sites["overhead"].capture
    assert capture is not None
    assert (capture.width, capture.height, capture.exposure_s) == (1280, 1024, 0.010)


def test_a_faster_clock_does_not_poll_the_hosts_devices_more_often(cell: Cell) -> None:
    site, _ = built(cell, speed=10.0)["io"]
    assert site.polling.poll_s / 10.0 >= IO_POLL_WALL_S


async def test_devices_on_one_line_share_it(cell: Cell) -> None:
    sites = {name: site for name, (site, _) in built(cell).items()}
    assert sites["gripper"].open_link() is sites["io"].open_link()
    # the lamp unit has another rate, which a TCP line does not know
    assert sites["gripper"].open_link() is sites["lights"].open_link()


def test_an_input_is_where_the_cell_file_has_it(cell: Cell) -> None:
    moved = cell.interlocks.model_copy(update={"door": 4, "supply": 1})
    site, _ = built(cell.model_copy(update={"interlocks": moved}))["io"]
    assert site.inputs == {
        "estop_ok": 0, "guard_closed": 4, "part_in_nest": 2, "part_in_gripper": 3,
        "supply_ok": 1, "acknowledge": 5,
    }  # fmt: skip


RTU = "{address: /dev/ttyUSB1, transport: rtu, "


def cell_with(tmp_path: Path, **extra: str) -> Cell:
    """Return the emulated cell with further keys of some devices."""
    text = EMULATED_CELL.read_text()
    for device, keys in extra.items():
        text, count = re.subn(rf"({device}:\s+){{address: emulated[^}}]*}}", rf"\1{keys}", text)
        assert count == 1
    file = tmp_path / "cell.yaml"
    file.write_text(text)
    return load_cell(file)


def lines_of(cell: Cell) -> tuple[Any, ...]:
    where = dict.fromkeys(("arm", "overhead", "inspection"), "/dev/null")
    where |= {"lights": {"host": "127.0.0.1", "port": 1}, "io": {"host": "127.0.0.1", "port": 2}}
    builder = DeviceBuilder(cell, resolve(cell, where), CellClock())
    builder.gripper()
    builder.lights()
    return builder.links


def test_what_the_file_says_of_a_line_reaches_it(tmp_path: Path) -> None:
    cell = cell_with(tmp_path, gripper=RTU + "echo: true, reply_s: 0.7, retries: 3, unit: 9}")
    gripper, lights = lines_of(cell)
    assert gripper.address == RtuAddress("/dev/ttyUSB1", 115200, echoes=True)
    assert (gripper.reply_timeout_s, gripper.retry_count) == (0.7, 3)
    assert (lights.reply_timeout_s, lights.retry_count) == (cell.timing.modbus_reply_s, 1)


@pytest.mark.parametrize(
    "differing", [{"echo": "true"}, {"reply_s": "0.5"}, {"retries": "0"}, {"baudrate": "19200"}]
)
def test_devices_on_one_line_say_the_same_of_it(differing: dict[str, str], tmp_path: Path) -> None:
    keys = {"baudrate": "115200"} | differing
    own = ", ".join(f"{key}: {value}" for key, value in keys.items())
    same = cell_with(tmp_path, gripper=RTU + own + ", unit: 9}", lights=RTU + own + "}")
    assert len(lines_of(same)) == 1
    cell = cell_with(tmp_path, gripper=RTU + "unit: 9}", lights=RTU + own + "}")
    with pytest.raises(ConfigError, match=r"lights and devices\.gripper: both are on the line"):
        lines_of(cell)


@pytest.mark.parametrize(
    "keys", ["transport: tcp, echo: true", "transport: rtu, returns_ids: false"]
)
def test_what_a_transport_has_not_is_refused(keys: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"`echo` is for rtu|`returns_ids` is for Modbus TCP"):
        cell_with(tmp_path, gripper="{address: '10.0.0.1:502', " + keys + "}")
