"""The UR driver lets the emulated arm be led by hand: two readings of one script manual."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import CellClock
from drivers.gripper_modbus import GripperConfig
from drivers.kinds import Stop
from drivers.ur_arm import ControllerAddress, UrArm, UrcapJaws, UrSettings, UrShape

PARK_DEG = (0.0, -100.0, 110.0, -100.0, -90.0, 0.0)


@pytest.fixture
def controller(tmp_path: Path) -> Iterator[tuple[dict[str, int], Path]]:
    control = tmp_path / "ur.sock"
    command = [sys.executable, "-m", "emulators.ur_arm", "--control", str(control)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline()), control
        finally:
            process.terminate()


def state_of(control: Path) -> dict[str, Any]:
    with socket.socket(socket.AF_UNIX) as line:
        line.connect(str(control))
        line.sendall(b'{"do": "arm_state"}\n')
        with line.makefile() as file:
            return dict(json.loads(file.readline()))


async def test_an_arm_that_was_let_go_holds_again_once_it_is_enabled(
    controller: tuple[dict[str, int], Path],
) -> None:
    ports, control = controller
    settings = UrSettings(
        dashboard_port=ports["dashboard"],
        script_port=ports["primary"],
        gripper_port=ports["urcap"],
    )
    jaws = UrcapJaws("127.0.0.1", ports["urcap"], CellClock(), GripperConfig())
    arm = UrArm(
        ControllerAddress("127.0.0.1", ports["rtde"]),
        UrShape("ur5e", 177.0, PARK_DEG),
        settings,
        jaws,
    )
    try:
        await arm.connect()
        await arm.enable_power()
        await arm.home()
        await arm.stop(Stop.FREE)
        led = state_of(control)
        assert (led["program"], led["runtime_state"]) == ("cellctl_freedrive", "PLAYING")
        assert not arm.is_powered
        there = await arm.read_q()
        await arm.enable_power()
        assert state_of(control)["runtime_state"] == "STOPPED"
        goal = there + np.radians([3.0, 0, 0, 0, 0, 0])
        await arm.move_joints(goal)
        np.testing.assert_allclose(await arm.read_q(), goal, atol=1e-3)
    finally:
        await arm.aclose()
