"""Clients that nobody here wrote drive the emulated UR controller: ur_rtde, urx and pyRobotiqUR.

They need an environment of their own, which `CELLCTL_UR_CLIENTS` names by its Python:
`python -m venv E && E/bin/pip install ur_rtde urx pyrobotiqur`. Their ports are fixed, so
that each arm has an address of its own.
"""

import json
import os
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from numpy.testing import assert_allclose

PYTHON = os.environ.get("CELLCTL_UR_CLIENTS", "")
PATIENCE_WALL_S = 180.0


def missing(module: str) -> str:
    """Return why a stranger cannot be tried, empty if it can."""
    if not PYTHON:
        return f"a Python with {module} (CELLCTL_UR_CLIENTS)"
    found = subprocess.run([PYTHON, "-c", f"import {module}"], capture_output=True, check=False)
    return "" if found.returncode == 0 else f"{module} in {PYTHON}"


def needs(module: str) -> pytest.MarkDecorator:
    why = missing(module)
    return pytest.mark.skipif(bool(why), reason=why or "all is here")


@contextmanager
def served(host: str, *arguments: str) -> Iterator[None]:
    """Serve one arm on the standard ports of an address."""
    process = subprocess.Popen(
        [sys.executable, "-m", "emulators.ur_arm", "--host", host, "--standard-ports", *arguments],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        assert json.loads(process.stdout.readline())["host"] == host
        yield
    finally:
        process.terminate()
        process.stdout.close()
        assert process.wait(PATIENCE_WALL_S) == 0


def told(program: str) -> Any:
    """Run a stranger's program and return what it prints last, as JSON."""
    done = subprocess.run(
        [PYTHON, "-W", "ignore", "-c", textwrap.dedent(program)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_WALL_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@needs("rtde_receive")
def test_ur_rtde_powers_the_arm_reads_its_state_and_switches_its_outputs() -> None:
    with served("127.0.78.1", "--seed", "3"):
        found = told(
            """
            import json, time
            import dashboard_client, rtde_io, rtde_receive

            def wait(is_so):
                while not is_so():
                    time.sleep(0.05)

            host = "127.0.78.1"
            dashboard = dashboard_client.DashboardClient(host)
            dashboard.connect()
            before = dashboard.robotmode()
            dashboard.powerOn()
            wait(lambda: "IDLE" in dashboard.robotmode())
            dashboard.brakeRelease()
            wait(lambda: "RUNNING" in dashboard.robotmode())
            state = rtde_receive.RTDEReceiveInterface(host)
            io = rtde_io.RTDEIOInterface(host)
            io.setStandardDigitalOut(3, True)
            io.setSpeedSlider(0.4)
            wait(lambda: state.getDigitalOutState(3))
            wait(lambda: abs(state.getSpeedScaling() - 0.4) < 1e-9)
            print(json.dumps({
                "before": before,
                "version": dashboard.polyscopeVersion(),
                "model": dashboard.getRobotModel(),
                "safety": dashboard.safetystatus(),
                "remote": dashboard.isInRemoteControl(),
                "mode": state.getRobotMode(),
                "safety_mode": state.getSafetyMode(),
                "q": state.getActualQ(),
                "qd": state.getActualQd(),
                "inertia": state.getPayloadInertia(),
                "fraction": state.getTargetSpeedFraction(),
                "outputs": state.getActualDigitalOutputBits(),
            }))
            """
        )
    assert found["before"] == "Robotmode: POWER_OFF"
    assert found["version"].startswith("5.11.1")
    assert (found["model"], found["safety"], found["remote"]) == (
        "UR5",
        "Safetystatus: NORMAL",
        True,
    )
    assert (found["mode"], found["safety_mode"]) == (7, 1)
    assert_allclose(found["q"], (0, -1.571, 1.571, -1.571, -1.571, 0), atol=0.1001)
    assert found["qd"] == found["inertia"] == [0.0] * 6
    assert (found["fraction"], found["outputs"]) == (0.4, 1 << 3)


@needs("urx")
def test_urx_moves_the_arm_by_joints_and_by_poses() -> None:
    # urx 0.11 knows the packets of controllers up to 3.4
    with served("127.0.78.2", "--running", "--software", "3.4"):
        found = told(
            """
            import json, logging, time
            import urx.urrobot

            logging.disable(logging.ERROR)
            robot = urx.urrobot.URRobot("127.0.78.2", use_rt=True)
            reached = robot.movej([0.3, -1.4, 1.4, -1.5, -1.4, 0.2], acc=1.0, vel=0.5)
            pose = robot.getl(wait=True)
            pose[2] += 0.03
            robot.movex("movej", pose, acc=1.0, vel=0.5)
            lifted = robot.getl(wait=True)
            robot.set_digital_out(2, True)
            while not robot.get_digital_out(2, wait=True):
                pass
            print(json.dumps({
                "running": robot.is_running(),
                "reached": reached,
                "pose": pose,
                "lifted": lifted,
                "realtime": list(robot.rtmon.q_actual(wait=True)),
                "joints": robot.getj(wait=True),
            }))
            robot.close()
            """
        )
    assert found["running"]
    assert_allclose(found["reached"], (0.3, -1.4, 1.4, -1.5, -1.4, 0.2), atol=2e-3)
    assert_allclose(found["lifted"], found["pose"], atol=2e-3)
    assert_allclose(found["realtime"], found["joints"], atol=1e-6)


@needs("pyrobotiqur")
def test_pyrobotiqur_activates_closes_and_opens_the_gripper() -> None:
    with served("127.0.78.3", "--running"):
        found = told(
            """
            import json
            from pyrobotiqur import RobotiqGripper

            gripper = RobotiqGripper("127.0.78.3")
            gripper.connect()
            gripper.reset()
            gripper.activate()
            status, fault = int(gripper.get_status()), gripper.get_fault()
            closed, seen = gripper.close()
            opened, _ = gripper.open()
            print(json.dumps([status, fault, closed, int(seen), opened]))
            """
        )
    # active, no fault, closed with nothing between, open: modbus_devices.md 2.3 to 2.5
    assert found == [3, 0, 230, 3, 3]
