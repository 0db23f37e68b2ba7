"""The driver of an OnRobot RG and the emulated one behind its box.

Sections (§) are those of modbus_devices.md.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from cross_bench import HANG_WALL_S, until
from modbus_bench import ModbusBench, modbus_bench

from drivers.errors import (
    BadReplyError,
    FaultError,
    MotionStoppedError,
    StalledError,
    WrongDeviceError,
)
from drivers.gripper_onrobot import MODELS, RgGripper, decode_state
from drivers.kinds import Hold
from emulators.gripper_modbus import JawModel
from emulators.gripper_onrobot import RG2, RG6, ComputeBoxDevice, RgDevice, RgType

WIDEST_MM = {"rg2": 110.0, "rg6": 160.0}  # §3.2
TYPES: dict[str, RgType] = {"rg2": RG2, "rg6": RG6}


@dataclass
class Bench:
    line: ModbusBench
    device: RgDevice
    gripper: RgGripper

    @property
    def jaws(self) -> JawModel:
        return self.device.jaws


@asynccontextmanager
async def bench(folder: Path, model: str = "rg2", there: str = "") -> AsyncIterator[Bench]:
    there = there or model
    widest_mm = WIDEST_MM[there]
    jaws = JawModel(opening_mm=widest_mm, target_mm=widest_mm, stroke_mm=widest_mm)
    device = RgDevice(jaws, TYPES[there])
    devices = [device, ComputeBoxDevice(device)]
    async with modbus_bench("block", devices, [device], folder) as line:
        async with asyncio.timeout(HANG_WALL_S):
            yield Bench(line, device, RgGripper(line.link, MODELS[model], 65))


@pytest.mark.parametrize("model", ["rg2", "rg6"])
async def test_it_goes_where_it_is_sent(tmp_path: Path, model: str) -> None:
    async with bench(tmp_path, model) as b:
        first = await b.gripper.connect()
        assert first.opening_mm == b.gripper.max_opening_mm == WIDEST_MM[model]
        assert b.gripper.model == f"OnRobot {model.upper()}"
        assert b.gripper.firmware == "1.0 build 1"
        for opening_mm in (0.0, 33.3, WIDEST_MM[model]):
            reading = await b.gripper.open_to(opening_mm)
            assert reading.has_arrived
            assert b.jaws.opening_mm == pytest.approx(opening_mm, abs=0.06)


async def test_a_part_is_held_until_it_is_gone(tmp_path: Path) -> None:
    async with bench(tmp_path) as b:
        await b.gripper.connect()
        b.jaws.grasp_limit_mm = 30.0
        grasp = await b.gripper.close_on(30.0, force_n=35.0)
        assert grasp.object_detected
        assert grasp.opening_mm == pytest.approx(30.0, abs=0.1)
        assert b.jaws.force_n == pytest.approx(35.0)
        assert await b.gripper.hold() is Hold.HELD
        # a controller that starts anew takes it over
        other = RgGripper(b.line.link, MODELS["rg2"], 65)
        assert (await other.connect()).has_contact
        assert await other.hold() is Hold.HELD
        b.jaws.grasp_limit_mm = None
        await b.gripper.wait_lost()
        assert await b.gripper.hold() is Hold.LOST
        await b.gripper.open_to(60.0)
        assert await b.gripper.hold() is Hold.NOTHING


async def test_a_stop_keeps_what_is_held(tmp_path: Path) -> None:
    async with bench(tmp_path) as b:
        await b.gripper.connect()
        b.jaws.grasp_limit_mm = 30.0
        await b.gripper.close_on(30.0, force_n=35.0)
        await b.gripper.stop()
        assert await b.gripper.hold() is Hold.HELD


async def test_something_in_the_path_is_a_stall(tmp_path: Path) -> None:
    async with bench(tmp_path) as b:
        await b.gripper.connect()
        b.jaws.grasp_limit_mm = 50.0
        with pytest.raises(StalledError, match=r"ended at 50\.0 mm on their way to 20\.0 mm"):
            await b.gripper.open_to(20.0)


async def test_a_stop_ends_the_move(tmp_path: Path) -> None:
    async with bench(tmp_path) as b:
        await b.gripper.connect()
        move = asyncio.create_task(b.gripper.open_to(0.0))
        await until(lambda: b.jaws.opening_mm < 100.0)
        await b.gripper.stop()
        with pytest.raises(MotionStoppedError):
            await move
        assert b.jaws.opening_mm > 0.0


async def test_a_triggered_switch_stops_it_until_it_is_activated(tmp_path: Path) -> None:
    async with bench(tmp_path) as b:
        await b.gripper.connect()
        move = asyncio.create_task(b.gripper.open_to(0.0))
        await until(lambda: b.jaws.opening_mm < 100.0)
        b.device.raise_fault(1)
        with pytest.raises(FaultError, match="switch_1_triggered") as raised:
            await move
        assert raised.value.code == 0x08
        stopped_mm = b.jaws.opening_mm
        with pytest.raises(FaultError):
            await b.gripper.open_to(50.0)
        assert b.jaws.opening_mm == stopped_mm
        assert (await b.gripper.activate()).is_activated
        assert b.jaws.opening_mm == stopped_mm  # switching it off and on moves nothing
        await b.gripper.open_to(50.0)


async def test_a_pressed_switch_prevents_activation(tmp_path: Path) -> None:
    async with bench(tmp_path) as b:
        await b.gripper.connect()
        b.device.pressed.add(2)
        b.device.raise_fault(2)
        with pytest.raises(FaultError, match="switch_2, switch_2_triggered"):
            await b.gripper.activate()


async def test_another_model_is_the_wrong_device(tmp_path: Path) -> None:
    async with bench(tmp_path, "rg2", there="rg6") as b:
        with pytest.raises(WrongDeviceError, match="expected an OnRobot RG2, product 20, found"):
            await b.gripper.connect()


@pytest.mark.parametrize(
    "call",
    [
        lambda g: g.open_to(110.1),
        lambda g: g.close_on(30.0, force_n=40.1),
        lambda g: g.close_on(30.0, force_n=0.0),
    ],
)
async def test_what_is_out_of_range_is_not_sent(
    tmp_path: Path, call: Callable[[RgGripper], Awaitable[Any]]
) -> None:
    async with bench(tmp_path) as b:
        await b.gripper.connect()
        sent = len(b.line.sent())
        with pytest.raises(ValueError, match=r"110 mm|40 N"):
            await call(b.gripper)
        assert len(b.line.sent()) == sent


def test_a_status_bit_without_a_meaning_is_no_status() -> None:
    with pytest.raises(BadReplyError, match="0080"):
        decode_state((0x0080, 0, 0, 0, 0, 0, 0, 100))


def test_a_width_below_zero_is_read_as_such() -> None:
    assert decode_state((0, 0, 0, 0, 0, 0, 0, 0xFFFB))[1] == -0.5
