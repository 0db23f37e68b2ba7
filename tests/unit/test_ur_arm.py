"""The UR driver against a scripted controller on real sockets (`ur_controller`)."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest
from ur_controller import SPEED, UrController

from drivers.clock import CellClock
from drivers.errors import (
    ArmStalledError,
    DeviceError,
    FaultError,
    LinkError,
    MotionStoppedError,
    PositionLostError,
    RefusedError,
    SilentLineError,
    StalledError,
    WrongDeviceError,
)
from drivers.gripper_modbus import GripperConfig
from drivers.kinds import Stop
from drivers.ur_arm import (
    ControllerAddress,
    LocalControlError,
    PowerOffError,
    SafetyStopError,
    UrArm,
    UrcapJaws,
    UrSettings,
    UrShape,
)

PARK_DEG = (0.0, -100.0, 110.0, -100.0, -90.0, 0.0)


def arm_at(robot: UrController, model: str = "ur5e", **settings: Any) -> UrArm:
    clock = CellClock(speed=SPEED, min_timeout_wall_s=0.5)
    given = {f"{name}_port": robot.ports[name] for name in ("dashboard", "script", "gripper")}
    jaws = UrcapJaws("127.0.0.1", robot.ports["gripper"], clock, GripperConfig())
    address = ControllerAddress("127.0.0.1", robot.ports["rtde"])
    shape = UrShape(model, 170.0, PARK_DEG)
    return UrArm(address, shape, UrSettings(rtde_hz=50.0, **given, **settings), jaws, clock)


@asynccontextmanager
async def ready(robot: UrController, **settings: Any) -> AsyncIterator[UrArm]:
    async with robot.serving():
        arm = arm_at(robot, **settings)
        await arm.connect()
        await arm.enable_power()
        try:
            yield arm
        finally:
            await arm.aclose()


async def until(robot: UrController, claim: Callable[[], bool]) -> None:
    """Wait until a claim holds of a controller that goes on."""
    async with asyncio.timeout(20.0):
        while not claim():
            await robot.next_tick()


@pytest.fixture
def robot() -> UrController:
    return UrController()


def moved(robot: UrController, *by_deg: float) -> np.ndarray:
    return np.array(robot.q) + np.radians([*by_deg, *[0.0] * (6 - len(by_deg))])


# ---- connecting -------------------------------------------------------------------------------
async def test_connecting_moves_and_sets_nothing_and_names_the_arm(robot: UrController) -> None:
    before = list(robot.q)
    async with robot.serving():
        async with arm_at(robot) as arm:
            assert arm.model == "Universal Robots UR5e, Robotiq 2F by URCap"
            assert arm.firmware == "PolyScope 5.11.1"
            assert arm.is_homed
            assert arm.identity is not None
            assert not arm.identity.was_restarted
            np.testing.assert_allclose(await arm.read_q(), before, atol=1e-12)
            assert robot.lines == []
            assert robot.sets == []
        assert robot.lines == ["stopj(17.453293)"]  # closing stops


async def test_another_arm_than_the_cell_files_is_named(robot: UrController) -> None:
    robot.model = "UR10"
    async with robot.serving():
        with pytest.raises(
            WrongDeviceError, match=r"has a UR10e, the cell file says `model: ur5e`"
        ):
            await arm_at(robot).connect()


async def test_a_cb3_is_not_an_e_series_of_the_same_name(robot: UrController) -> None:
    robot.version = (3, 15, 4, 1)
    async with robot.serving():
        with pytest.raises(WrongDeviceError, match=r"has a UR5, the cell file says `model: ur5e`"):
            await arm_at(robot).connect()
        async with arm_at(robot, "ur5") as arm:
            await arm.enable_power()  # it knows no remote control
            await arm.move_joints(moved(robot, 3.0))


async def test_something_else_on_the_dashboards_port_is_named(robot: UrController) -> None:
    robot.greeting = "SSH-2.0-OpenSSH_8.9"
    async with robot.serving():
        with pytest.raises(WrongDeviceError, match=r"greets with 'SSH-2\.0-OpenSSH_8\.9'"):
            await arm_at(robot).connect()


async def test_a_controller_that_is_not_there_is_named_with_what_to_check() -> None:
    robot = UrController()
    async with robot.serving():
        arm = arm_at(robot)
    with pytest.raises(LinkError, match=r"no RTDE at 127\.0\.0\.1:\d+ .*check the cable"):
        await arm.connect()


async def test_fields_that_an_old_controller_lacks_are_done_without(robot: UrController) -> None:
    robot.lacks = frozenset({"tcp_offset", "payload_cog"})
    async with ready(robot):
        assert robot.payload[0] == pytest.approx(0.925)
    robot.lacks = frozenset({"speed_scaling"})
    async with robot.serving():
        with pytest.raises(WrongDeviceError, match=r"has no speed_scaling; PolyScope 3\.7"):
            await arm_at(robot).connect()


# ---- power and safety -------------------------------------------------------------------------
async def test_an_arm_that_is_off_is_switched_on_and_its_brakes_are_released(
    robot: UrController,
) -> None:
    robot.robot_mode = 3
    async with robot.serving(), arm_at(robot) as arm:
        assert not arm.is_homed
        with pytest.raises(PositionLostError):
            await arm.read_q()
        assert not (await arm.read_jaws()).is_pressing
        await arm.enable_power()
        assert robot.robot_mode == 7
        assert arm.is_powered
        orders = [line for line in robot.asked if line in ("power on", "brake release")]
        assert orders == ["power on", "brake release"]


async def test_payload_and_tcp_are_set_once_and_read_back(robot: UrController) -> None:
    settings = {"payload_kg": 1.25, "centre_of_mass_mm": (1.0, -2.0, 60.0)}
    async with ready(robot, **settings) as arm:
        assert robot.payload == pytest.approx((1.25, 0.001, -0.002, 0.060))
        assert robot.tcp == pytest.approx((0.0, 0.0, 0.170, 0.0, 0.0, 0.0))
        count = len(robot.lines)
        await arm.enable_power()
        assert len(robot.lines) == count


async def test_a_payload_that_is_not_taken_is_refused_with_what_the_controller_says(
    robot: UrController,
) -> None:
    robot.refuses = "set_payload"
    async with robot.serving(), arm_at(robot) as arm:
        with pytest.raises(RefusedError, match=r"payload was not taken; it says: compile error"):
            await arm.enable_power()
        assert not arm.is_powered


async def test_local_control_is_said_in_a_sentence_and_nothing_is_sent(robot: UrController) -> None:
    robot.is_remote = False
    async with robot.serving(), arm_at(robot) as arm:
        with pytest.raises(LocalControlError, match="choose `Remote Control` at the top right"):
            await arm.enable_power()
        assert robot.lines == []
        with pytest.raises(PowerOffError, match="enable its power first"):
            await arm.move_joints(moved(robot, 5.0))
        # connections made in local control stay without it: new ones are made
        robot.is_remote = True
        await arm.enable_power()
        await arm.move_joints(moved(robot, 5.0))


async def test_a_script_port_that_was_closed_is_opened_again_with_power(
    robot: UrController,
) -> None:
    async with ready(robot) as arm:
        robot.close_scripts()
        await until(robot, lambda: robot.script_count == 0)
        with pytest.raises(LinkError, match="script port: the controller has closed"):
            await arm.move_joints(moved(robot, 5.0))
        assert robot.asked[-1] == "stop"  # by the other way
        robot.is_remote = False
        with pytest.raises(LocalControlError, match="choose `Remote Control`"):
            await arm.move_joints(moved(robot, 5.0))
        robot.is_remote = True
        await arm.enable_power()
        await arm.move_joints(moved(robot, 5.0))


async def test_a_program_that_is_paused_and_does_not_go_on_is_a_stall(
    robot: UrController,
) -> None:
    async with ready(robot) as arm:
        move = asyncio.ensure_future(arm.move_joints(moved(robot, 60.0)))
        await until(robot, lambda: abs(robot.qd[0]) > 0.1)
        robot.runtime_state, robot.qd = 4, [0.0] * 6
        with pytest.raises(ArmStalledError, match="its program is paused"):
            await move


@pytest.mark.parametrize(
    ("mode", "message"),
    [
        (3, "protective stop: see what it met"),
        (5, "safeguard stop: close its safeguard"),
        (6, "emergency stop of the system: release"),
        (7, "emergency stop of the robot: release"),
        (8, "violation of the safety configuration"),
        (9, "fault of the safety system"),
        (42, "safety mode 42: read the log"),
    ],
)
async def test_a_safety_stop_is_an_alarm_with_its_number_and_the_way_out(
    robot: UrController, mode: int, message: str
) -> None:
    robot.safety_mode = mode
    async with robot.serving(), arm_at(robot) as arm:
        with pytest.raises(SafetyStopError, match=message) as found:
            await arm.enable_power()
        assert found.value.code == mode
        assert "unlock protective stop" not in robot.asked
        assert "close safety popup" not in robot.asked
        # where a person is needed at the robot, its heartbeat says so too
        if mode in (3, 6, 7, 8, 9):
            with pytest.raises(SafetyStopError, match=message):
                await arm.read_opening_mm()


async def test_a_protective_stop_is_unlocked_on_a_persons_word(robot: UrController) -> None:
    robot.safety_mode = 3
    async with robot.serving(), arm_at(robot) as arm:
        await arm.clear_safety_stop()
        assert robot.safety_mode == 1
        with pytest.raises(RefusedError, match="Cannot unlock protective stop until 5s"):
            await arm.clear_safety_stop()


async def test_a_protective_stop_in_mid_motion_ends_the_move_with_an_alarm(
    robot: UrController,
) -> None:
    async with ready(robot) as arm:
        move = asyncio.ensure_future(arm.move_joints(moved(robot, 60.0)))
        await until(robot, lambda: abs(robot.qd[0]) > 0.1)
        robot.safety_mode = 3
        with pytest.raises(SafetyStopError, match="protective stop"):
            await move


# ---- moving -----------------------------------------------------------------------------------
async def test_a_move_ends_where_it_was_sent_at_rest(robot: UrController) -> None:
    async with ready(robot) as arm:
        target = moved(robot, 10.0, -5.0, 3.0)
        await arm.move_joints(target)
        np.testing.assert_allclose(robot.q, target, atol=1e-3)
        assert robot.qd == [0.0] * 6
        (line,) = [line for line in robot.lines if line.startswith("movej")]
        assert line.endswith(f"a={np.radians(80.0):.6f}, v={np.radians(60.0):.6f})")
        count = len(robot.lines)
        await arm.move_joints(target)  # it is there already
        assert len(robot.lines) == count


async def test_a_share_of_the_speed_is_a_share_of_v(robot: UrController) -> None:
    async with ready(robot) as arm:
        await arm.move_joints(moved(robot, 4.0), speed_share=0.25)
        assert robot.lines[-1].endswith(f"v={np.radians(15.0):.6f})")


async def test_a_slow_slider_takes_longer_and_is_no_error(robot: UrController) -> None:
    async with ready(robot) as arm:
        robot.slider = 0.04
        begun_s = robot.time_s
        target = moved(robot, 10.0)
        await arm.move_joints(target)
        np.testing.assert_allclose(robot.q, target, atol=1e-3)
        # far beyond the patience of a move at full speed: 2 forecasts and 2 s
        assert robot.time_s - begun_s > 8.0


async def test_a_slider_at_zero_waits_until_it_is_moved_again(robot: UrController) -> None:
    async with ready(robot) as arm:
        robot.slider = 0.0
        target = moved(robot, 5.0)
        move = asyncio.ensure_future(arm.move_joints(target))
        sent_s = robot.time_s
        await until(robot, lambda: robot.time_s > sent_s + 10.0)
        assert not move.done()
        robot.slider = 1.0
        await move
        np.testing.assert_allclose(robot.q, target, atol=1e-3)


async def test_a_door_that_is_soon_shut_again_only_holds_the_move_up(robot: UrController) -> None:
    async with ready(robot) as arm:
        target = moved(robot, 20.0)
        move = asyncio.ensure_future(arm.move_joints(target))
        await until(robot, lambda: abs(robot.qd[0]) > 0.1)
        robot.safety_mode = 5
        opened_s = robot.time_s
        await until(robot, lambda: robot.time_s > opened_s + 0.3)
        robot.safety_mode = 1
        await move
        np.testing.assert_allclose(robot.q, target, atol=1e-3)


async def test_a_refused_line_ends_the_move_with_what_the_controller_says(
    robot: UrController,
) -> None:
    async with ready(robot) as arm:
        robot.refuses = "movej"
        before = list(robot.q)
        with pytest.raises(RefusedError, match=r"not begun; it says: compile error: movej"):
            await arm.move_joints(moved(robot, 5.0))
        assert robot.q == before
        assert robot.lines[-1].startswith("stopj")


async def test_a_program_that_ends_short_of_the_target_is_a_stall(robot: UrController) -> None:
    async with ready(robot) as arm:
        robot.ends_at = 0.5
        with pytest.raises(ArmStalledError, match=r"ended 5\.00 deg short of its target"):
            await arm.move_joints(moved(robot, 10.0))


async def test_targets_that_no_joint_reaches_are_refused_before_a_byte_goes_out(
    robot: UrController,
) -> None:
    async with ready(robot) as arm:
        count = len(robot.lines)
        for q in (moved(robot, 361.0), np.full(6, np.nan), np.zeros(5), moved(robot, 0, 0, 100.0)):
            with pytest.raises(ValueError, match="arm: "):
                await arm.move_joints(q)
        for share in (0.0, 1.5, float("nan")):
            with pytest.raises(ValueError, match="share"):
                await arm.move_joints(moved(robot, 1.0), speed_share=share)
        assert len(robot.lines) == count


# ---- stopping ---------------------------------------------------------------------------------
async def test_a_stop_overtakes_the_move_and_is_proven_by_the_joints(robot: UrController) -> None:
    async with ready(robot) as arm:
        target = moved(robot, 90.0)
        move = asyncio.ensure_future(arm.move_joints(target))
        waiting = asyncio.ensure_future(arm.move_joints(target))
        await until(robot, lambda: abs(robot.qd[0]) > 0.5)
        await arm.stop(Stop.DEAD)
        assert robot.qd == [0.0] * 6
        assert abs(robot.q[0] - target[0]) > 0.3
        for one in (move, waiting):
            with pytest.raises(MotionStoppedError):
                await one
        assert [line for line in robot.lines if line.startswith("movej")] == robot.lines[-2:-1]
        await arm.move_joints(target)  # the next move goes on from there


async def test_a_slow_stop_brakes_gently(robot: UrController) -> None:
    async with ready(robot) as arm:
        await arm.stop(Stop.RAMP)
        assert robot.lines[-1] == f"stopj({np.radians(115.0):.6f})"


async def test_a_cancelled_move_has_stopped_when_it_ends(robot: UrController) -> None:
    async with ready(robot) as arm:
        target = moved(robot, 90.0)
        move = asyncio.ensure_future(arm.move_joints(target))
        await until(robot, lambda: abs(robot.qd[0]) > 0.5)
        move.cancel()
        with pytest.raises(asyncio.CancelledError):
            await move
        assert robot.qd == [0.0] * 6
        assert abs(robot.q[0] - target[0]) > 0.3


async def test_an_arm_that_does_not_obey_is_stopped_by_the_dashboard_and_told(
    robot: UrController,
) -> None:
    async with ready(robot) as arm:
        move = asyncio.ensure_future(arm.move_joints(moved(robot, 300.0)))
        await until(robot, lambda: abs(robot.qd[0]) > 0.5)
        robot.is_deaf = True
        with pytest.raises(
            StalledError, match=r"still moves at \d+ deg/s.*press the emergency stop"
        ):
            await arm.stop(Stop.DEAD)
        assert robot.asked[-1] == "stop"
        await asyncio.gather(move, return_exceptions=True)


async def test_the_blind_stop_is_the_line_that_stops(robot: UrController) -> None:
    async with ready(robot) as arm:
        blind = arm.blind_stop()
        assert blind is not None
        move = asyncio.ensure_future(arm.move_joints(moved(robot, 120.0)))
        await until(robot, lambda: abs(robot.qd[0]) > 0.5)
        host, _, port = blind.place.rpartition(":")
        _, writer = await asyncio.open_connection(host, int(port))
        for frame in blind.frames:
            writer.write(frame)
        with pytest.raises(ArmStalledError, match="short of its target"):
            await move
        writer.close()


# ---- the line ---------------------------------------------------------------------------------
async def test_silence_and_a_pulled_cable_are_known(robot: UrController) -> None:
    async with robot.serving():
        arm = arm_at(robot)
        await arm.connect()
        robot.is_mute = True
        with pytest.raises(SilentLineError, match=r"no state for 0\.5 s"):
            await arm.read_jaws()
        robot.is_mute = False
        await arm.read_jaws()
        robot.drop()
        with pytest.raises(LinkError):
            await arm.read_jaws()
        await arm.connect()  # plugged in again: the same driver opens again
        await arm.read_jaws()
        await arm.aclose()
        await arm.aclose()


async def test_a_cable_that_is_pulled_in_mid_motion_ends_the_move(robot: UrController) -> None:
    async with ready(robot) as arm:
        move = asyncio.ensure_future(arm.move_joints(moved(robot, 90.0)))
        await until(robot, lambda: abs(robot.qd[0]) > 0.5)
        robot.drop()
        with pytest.raises(LinkError):
            await move


# ---- positions --------------------------------------------------------------------------------
async def test_positions_are_taken_over_where_it_was_sent_and_not_where_it_was_moved(
    robot: UrController,
) -> None:
    async with robot.serving(), arm_at(robot) as arm:
        here = np.array(robot.q)
        await arm.take_over_positions(np.stack([here - 0.2, here + 0.1]))
        with pytest.raises(PositionLostError, match=r"elbow stands 5\.7 deg beside .*moved it"):
            await arm.take_over_positions(here + np.radians([0, 0, 5.7, 0, 0, 0]))
        np.testing.assert_allclose(await arm.read_kept_q(here), here)
        assert robot.lines == []
        robot.robot_mode = 3
        with pytest.raises(PositionLostError, match="switched off"):
            await arm.take_over_positions(here)


async def test_home_moves_nothing_but_jaws_that_have_been_without_power(
    robot: UrController,
) -> None:
    robot.sta = 0
    async with robot.serving(), arm_at(robot) as arm:
        assert arm.identity is not None
        assert arm.identity.was_restarted
        assert not arm.is_homed
        with pytest.raises(PositionLostError):
            await arm.read_q()
        await arm.enable_power()
        with pytest.raises(PowerOffError, match="home the arm"):
            await arm.move_joints(moved(robot, 1.0))
        with pytest.raises(PositionLostError, match="activation would open and close it"):
            await arm.drive_jaws(-3.0)
        before = list(robot.q)
        await arm.home()
        assert arm.is_homed
        assert robot.sets == ["ACT 0", "ACT 1"]
        await arm.home()
        assert robot.sets == ["ACT 0", "ACT 1"]
        assert robot.q == before
        assert not any(line.startswith("movej") for line in robot.lines)


async def test_homing_with_a_part_presses_and_opens_no_jaw(robot: UrController) -> None:
    robot.part_at, robot.position, robot.wanted = 130.0, 130.0, 255
    async with ready(robot) as arm:
        held_mm = await arm.read_opening_mm()
        assert await arm.home_keeping_jaws(robot.q, held_mm) == pytest.approx(held_mm)
        robot.part_at = 230.0  # taken out
        assert await arm.home_keeping_jaws(robot.q, held_mm) < 1.0
        robot.position = robot.wanted = 20
        count = len(robot.sets)
        with pytest.raises(PositionLostError, match="somebody moved them"):
            await arm.home_keeping_jaws(robot.q, held_mm)
        robot.sta = 0
        with pytest.raises(PositionLostError, match="activation would open it"):
            await arm.home_keeping_jaws(robot.q, held_mm)
        assert len(robot.sets) == count


# ---- jaws -------------------------------------------------------------------------------------
async def test_a_grasp_ends_on_the_part_and_says_how_wide(robot: UrController) -> None:
    robot.part_at = 130.0
    async with ready(robot) as arm:
        opening_mm = await arm.grasp(40)
        assert opening_mm == pytest.approx(100 * 85 / 227, abs=0.4)
        assert robot.sets[-1].startswith("POS 255 ")
        assert "FOR 24" in robot.sets[-1]  # 40 N of 20 to 235
        jaws = await arm.read_jaws()
        assert jaws.is_pressing
        assert jaws.opening_mm == pytest.approx(opening_mm)
        await arm.stop(Stop.DEAD)  # jaws that hold go on holding
        assert (await arm.read_jaws()).is_pressing
        robot.part_at = 230.0
        assert await arm.grasp(40) == pytest.approx(0.0, abs=0.4)
        assert (await arm.read_jaws()).is_pressing  # on each other


async def test_openings_are_millimetres_and_bounded(robot: UrController) -> None:
    async with ready(robot) as arm:
        assert arm.max_opening_mm == 85.0
        for wanted_mm in (25.0, 60.0):
            assert await arm.move_gripper_mm(wanted_mm) == pytest.approx(wanted_mm, abs=0.3)
            assert await arm.read_opening_mm() == pytest.approx(wanted_mm, abs=0.3)
        assert not (await arm.read_jaws()).is_pressing
        assert await arm.drive_jaws(-10.0) == pytest.approx(10.0, abs=0.6)
        count = len(robot.sets)
        for wrong_mm in (-1.0, 86.0, float("nan")):
            with pytest.raises(ValueError, match="arm gripper"):
                await arm.move_gripper_mm(wrong_mm)
        for force in (0, -1, 1000):
            with pytest.raises(ValueError, match="presses with above 0 to 235 N"):
                await arm.grasp(force)
        assert len(robot.sets) == count


async def test_an_obstacle_of_empty_jaws_is_an_error(robot: UrController) -> None:
    robot.part_at = 130.0
    async with ready(robot) as arm:
        with pytest.raises(StalledError, match="met an obstacle at"):
            await arm.move_gripper_mm(0.0)


async def test_a_stop_ends_jaws_under_way_where_they_are(robot: UrController) -> None:
    async with ready(robot) as arm:
        closing = asyncio.ensure_future(arm.grasp(40))
        await until(robot, lambda: robot.position > 60)
        await arm.stop(Stop.DEAD)
        with pytest.raises(MotionStoppedError):
            await closing
        assert robot.position < 220


async def test_a_fault_of_the_gripper_is_named_with_its_number(robot: UrController) -> None:
    async with ready(robot) as arm:
        robot.flt = 8
        with pytest.raises(FaultError, match="fault 8") as found:
            await arm.read_opening_mm()
        assert found.value.code == 8


async def test_a_gripper_without_its_urcap_is_named(robot: UrController) -> None:
    async with robot.serving():
        arm = arm_at(robot)
        robot.sta = 3
        jaws = UrcapJaws("127.0.0.1", 1, CellClock(speed=SPEED), GripperConfig())
        with pytest.raises(LinkError, match=r"no gripper .Robotiq URCap. at 127"):
            await jaws.connect()
        await arm.aclose()


async def test_free_lets_the_arm_be_led_until_it_is_enabled_again(robot: UrController) -> None:
    async with ready(robot) as arm:
        await arm.stop(Stop.FREE)
        assert robot.is_led
        assert not arm.is_powered
        with pytest.raises(DeviceError):
            await arm.move_joints(moved(robot, 1.0))
        led = moved(robot, 2.0)
        robot.q = led.tolist()
        np.testing.assert_allclose(await arm.read_q(), led)
        await arm.enable_power()
        assert not robot.is_led
        await arm.move_joints(moved(robot, 1.0))


async def test_an_arm_that_cannot_be_led_is_refused(robot: UrController) -> None:
    async with ready(robot) as arm:
        robot.refuses = "freedrive_mode"
        with pytest.raises(RefusedError, match=r"led by hand.*compile error"):
            await arm.stop(Stop.FREE)
        assert not robot.is_led


async def test_the_jaws_are_wider_open_than_they_read_by_their_measured_zero(
    robot: UrController,
) -> None:
    async with ready(robot) as arm:
        await arm.move_gripper_mm(40.0)
        as_designed, read_mm = robot.position, await arm.read_opening_mm()
    async with ready(robot, jaw_zero_mm=0.8) as arm:
        assert await arm.read_opening_mm() == pytest.approx(read_mm + 0.8)
        await arm.move_gripper_mm(40.0)
        # closed farther by two counts of 0.37 mm
        assert robot.position == as_designed + 2


# ---- settings ---------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"payload_kg": -1.0}, "payload_kg: 0 to 20"),
        ({"payload_kg": float("nan")}, "payload_kg"),
        ({"rtde_hz": 1000.0}, "rtde_hz: 20 to 500"),
        ({"gripper": "modbus"}, "gripper_address"),
        ({"gripper_address": "10.0.0.9:502"}, "gripper_address"),
        ({"gripper": "modbus", "gripper_address": "10.0.0.9"}, "host:port"),
        ({"centre_of_mass_mm": (0.0, 0.0, 5000.0)}, "within 500 mm"),
        ({"jaw_closed_counts": 2}, "jaw_closed_counts: 4 to 255"),
    ],
)
def test_settings_that_cannot_be_are_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        UrSettings(**given)


def test_the_address_is_a_host_with_or_without_the_port_of_rtde() -> None:
    assert ControllerAddress.of("192.168.0.9") == ControllerAddress("192.168.0.9", 30004)
    assert ControllerAddress.of("robot.local:40004") == ControllerAddress("robot.local", 40004)
    for wrong in ("", "a b", "host:0", "host:99999", "host:port"):
        with pytest.raises(ValueError, match="host or host:port"):
            ControllerAddress.of(wrong)
