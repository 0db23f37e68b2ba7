"""The arm's gripper on a Modbus line of its own, by the fixed gripper's driver, emulated."""

from __future__ import annotations

from pathlib import Path

import pytest
from modbus_bench import modbus_bench

from drivers.gripper_modbus import GripperConfig
from drivers.modbus_link import TcpAddress
from drivers.ur_arm import ModbusJaws
from emulators.gripper_modbus import JawModel, RobotiqDevice


async def test_the_jaws_of_an_arm_may_be_on_modbus(tmp_path: Path) -> None:
    device = RobotiqDevice(JawModel(), 9)
    async with modbus_bench("tcp", [device], [device], tmp_path) as line:
        assert isinstance(line.link.address, TcpAddress)
        jaws = ModbusJaws(line.link.address, line.clock, GripperConfig(unit=9))
        found = await jaws.connect()
        assert not found.is_activated
        assert not found.is_pressing
        await jaws.activate()
        moved = await jaws.move_to(40.0)
        assert moved.opening_mm == pytest.approx(40.0, abs=0.5)
        assert moved.is_activated
        assert not moved.is_pressing
        shut = await jaws.close(40.0, 1.0)
        assert shut.opening_mm == pytest.approx(0.0, abs=1.0)
        assert shut.is_pressing
        await jaws.stop()
        await jaws.aclose()
        assert (await jaws.connect()).is_activated  # the same jaws open again
        await jaws.aclose()
        assert jaws.force_range_n == (20.0, 235.0)
        assert jaws.max_opening_mm == 85.0
