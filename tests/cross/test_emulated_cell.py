"""The drivers against the whole emulated cell: light, pictures and a grasp, over the real wires."""

import asyncio
import json
import logging
import math
import os
import re
import signal
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from cross_bench import HANG_WALL_S

from controller.cell.devices.clocks import FoundClock, find_clock
from controller.config import load_cell
from drivers.camera_v4l2 import Camera, CameraConfig
from drivers.clock import CellClock
from drivers.io_modbus import CellIo, Signal
from drivers.lighting_modbus import LampChannel, Lights, LightsConfig
from drivers.modbus_link import ModbusLink, TcpAddress
from drivers.umi_scara import Axis, StatusBits, UmiScara, WireExchange

ROOT = Path(__file__).parents[2]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
SPEED = 10.0
X_MM, Y_MM = 360.0, 0.0


@pytest.fixture
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="emu-", dir="/tmp") as name:
        yield Path(name)


class Cell:
    """An emulated cell with one block in it, and its control port."""

    def __init__(
        self, ready: dict[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        self.devices = ready["devices"]
        self.pid = int(ready["pid"])
        self.clock_path = Path(ready["clock"])
        self.clock = CellClock.of_emulator(self.clock_path)
        self._reader, self.writer = reader, writer

    async def ask(self, verb: str, **order: Any) -> dict[str, Any]:
        self.writer.write(json.dumps({"do": verb, **order}).encode() + b"\n")
        answer: dict[str, Any] = json.loads(await self._reader.readline())
        assert answer.pop("ok"), answer
        return answer


@pytest.fixture
async def cell(folder: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Cell]:
    part = folder / "block.stl"
    trimesh.creation.box((60.0, 40.0, 20.0)).export(part)
    control = folder / "control.sock"
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    arguments = ("--part", str(part), "--speed", str(SPEED), "--control", str(control))
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "emulators", "--cell", str(CELL), *arguments),
        *("--pose", "0", "--at", f"{X_MM},{Y_MM},0", "--camera-transport", "socket"),
        stdout=asyncio.subprocess.PIPE,
        cwd=ROOT,
        env=os.environ | {"TMPDIR": str(folder), "XDG_CACHE_HOME": str(folder)},
    )
    assert process.stdout is not None
    async with asyncio.timeout(HANG_WALL_S):
        ready = json.loads(await process.stdout.readline())
    one = Cell(ready, *await asyncio.open_unix_connection(str(control)))
    async with one.clock.attending():
        yield one
    one.clock.close()
    one.writer.close()
    await one.writer.wait_closed()
    process.terminate()
    async with asyncio.timeout(HANG_WALL_S):
        assert await process.wait() == 0


async def test_a_frame_after_the_light_shows_the_light(cell: Cell) -> None:
    where = cell.devices["lights"]
    config = LightsConfig(
        lamps=(LampChannel("backlight", 1, 1), LampChannel("ring", 2, 2)),
        analog_unit=where["analog_unit"],
        relay_unit=where["relay_unit"],
    )
    link = ModbusLink(TcpAddress(where["host"], where["port"]), cell.clock)
    sight = CameraConfig(device=cell.devices["overhead"], fps=10.0, exposure_s=0.010)
    async with link, Lights(link, config) as lights, Camera(sight, cell.clock) as camera:
        levels: dict[str, float] = {}
        for lamp, level in (("backlight", 1.0), ("ring", 1.0), ("backlight", 0.5)):
            await lights.all_off()
            since_s = await lights.set({lamp: level}, settle=True)
            frame = await camera.frame_after(since_s)
            # 60 x 40 mm in the middle of the picture, the table round it
            levels[f"{lamp} {level} part"] = float(frame.image[480:540, 600:680].mean())
            levels[f"{lamp} {level} table"] = float(frame.image[100:160, 600:680].mean())
        since_s = await lights.all_off(settle=True)
        dark = (await camera.frame_after(since_s)).image
    assert levels["backlight 1.0 part"] < 12.0
    assert 195.0 < levels["backlight 1.0 table"] < 225.0
    assert levels["backlight 0.5 table"] == pytest.approx(
        levels["backlight 1.0 table"] / 2.0 + 2.0, rel=0.03
    )
    assert 90.0 < levels["ring 1.0 part"] < 190.0
    assert levels["ring 1.0 table"] < 70.0
    assert dark.mean() < 6.0


async def test_a_cell_or_a_controller_without_a_processor_for_seconds_times_nothing_out(
    cell: Cell, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG, "drivers")
    where = cell.devices["io"]
    sight = CameraConfig(device=cell.devices["overhead"], fps=5.0, exposure_s=0.010)
    said: list[WireExchange] = []
    async with (
        ModbusLink(TcpAddress(where["host"], where["port"]), cell.clock) as link,
        CellIo(link) as io,
        UmiScara(cell.devices["arm"], clock=cell.clock, trace=said.append) as arm,
        Camera(sight, cell.clock) as camera,
    ):
        await io.wait_for("estop_ok", Signal.OK)
        for _ in range(3):
            os.kill(cell.pid, signal.SIGSTOP)
            # ten cell seconds if time went on: far more than a reply or a reading may take
            asyncio.get_running_loop().call_later(1.0, os.kill, cell.pid, signal.SIGCONT)
            asked_s = cell.clock.now_s()
            frame, bits = await asyncio.gather(camera.frame_after(asked_s), arm.status(Axis.ZED))
            assert frame.timestamp_s > asked_s
            assert not bits & StatusBits.MOVING
            time.sleep(1.0)  # noqa: ASYNC251  (now the controller is stopped, its loop with it)
            assert io.signal("estop_ok") is Signal.OK
    assert all(exchange.reply for exchange in said)
    assert "asking again" not in caplog.text
    assert "inputs unknown" not in caplog.text
    assert cell.clock.speed_reached < SPEED


async def test_addresses_given_by_hand_find_the_emulators_clock(
    cell: Cell, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    text = CELL.read_text()
    for name, where in cell.devices.items():
        address = where if isinstance(where, str) else f"localhost:{where['port']}"
        text = re.sub(rf"({name}: *{{address: )emulated", rf"\g<1>'{address}'", text)
    by_hand = folder / "by_hand.yaml"
    by_hand.write_text(text)
    found = find_clock(load_cell(by_hand), {})
    assert found == FoundClock(cell.clock_path, SPEED)
    # one device of another cell: no clock is both devices' own
    elsewhere = folder / "elsewhere.yaml"
    elsewhere.write_text(re.sub(r"(arm: *{address: )'[^']*'", r"\1/dev/ttyUSB0", text))
    assert find_clock(load_cell(elsewhere), {}) == FoundClock(is_mixed=True)
    named = folder / "named.yaml"
    named.write_text(elsewhere.read_text() + f"clock: {cell.clock_path}\n")
    assert find_clock(load_cell(named), {}) == FoundClock(cell.clock_path, SPEED)


def counts_at(x_mm: float, y_mm: float, z_mm: float) -> dict[Axis, int]:
    """Return where the arm's tip is at a place, pointing down, jaws along y; umi_rtx.md 6.5."""
    phi = math.degrees(math.atan2(y_mm, x_mm))
    elbow = 2.0 * math.degrees(math.acos(math.hypot(x_mm, y_mm) / 507.0))
    return {
        Axis.SHOULDER: round((phi - elbow / 2.0) * 29.221),
        Axis.ELBOW: round(elbow * 14.611),
        Axis.YAW: round(-phi * 9.740),
        Axis.WRIST1: round(-90.0 * 13.487),
        Axis.WRIST2: round(-90.0 * 13.487),
        Axis.ZED: round((z_mm + 177.0 - 915.0) * 3.750),
    }


async def test_the_arm_picks_a_part_up_over_its_serial_line(cell: Cell) -> None:
    async with UmiScara(cell.devices["arm"], clock=cell.clock) as arm:
        await arm.enable_power()
        await arm.home()
        above, at = counts_at(X_MM, Y_MM, 120.0), counts_at(X_MM, Y_MM, 6.0)
        await arm.open_jaws()
        await arm.move_counts({k: v for k, v in above.items() if k is not Axis.ZED})
        await arm.move_counts(above)
        await arm.move_counts(at)
        opening_mm = await arm.grasp(40)
        await arm.move_counts(above)
        assert await arm.read_opening_mm() == pytest.approx(opening_mm, abs=0.2)
    # a count of the gripper is 0.06 to 0.08 mm wide
    assert opening_mm == pytest.approx(40.0, abs=0.2)
    truth = await cell.ask("truth")
    (part,) = truth["parts"]
    assert part["custody"] == "arm"
    assert np.array(part["T_world_part"])[2, 3] > 100.0
    assert truth["collisions"] == []
