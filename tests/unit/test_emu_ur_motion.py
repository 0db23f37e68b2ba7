"""Times and ways are computed by hand: a trapezoid of way s, speed v and acceleration a takes
s/v + v/a; a triangle 2 sqrt(s/a)."""

import math

import pytest
from emu_ur_bench import FOLDED, is_at_rest, run, running_arm, said, shifted, until
from numpy.testing import assert_allclose

from emulators.gripper_modbus import RobotiqDevice
from emulators.ur_arm import CYCLE_S, JointErrors, RobotMode, RuntimeState, SafetyMode, UrArm

SLACK_S = 0.004  # a program begins with the next cycle, and its end shows with the one after


def time_of(arm: UrArm, program: str) -> float:
    assert run(arm, program) == ""
    return until(arm, lambda: not arm.is_program_running)


def movej(q: list[float], **options: float) -> str:
    words = "".join(f", {name}={value}" for name, value in options.items())
    return f"movej({q}{words})"


@pytest.mark.parametrize(
    ("way_rad", "a", "v", "expected_s"),
    [
        (1.0, 1.0, 0.5, 2.5),
        (-1.0, 1.0, 0.5, 2.5),
        (0.25, 1.0, 2.0, 1.0),  # too short for its speed: a triangle
        (2.0, 8.0, 9.0, 2.0 / math.pi + math.pi / 8.0),  # joint limit pi rad/s
    ],
)
def test_a_move_takes_the_time_of_its_trapezoid(
    way_rad: float, a: float, v: float, expected_s: float
) -> None:
    arm = running_arm()
    taken_s = time_of(arm, movej(shifted(0, way_rad), a=a, v=v))
    assert taken_s == pytest.approx(expected_s, abs=SLACK_S + CYCLE_S)
    until(arm, lambda: is_at_rest(arm), 0.5)
    assert_allclose(arm.q_rad, shifted(0, way_rad), atol=1e-9)


def test_a_move_without_numbers_has_the_defaults_of_the_manual() -> None:
    assert time_of(running_arm(), movej(shifted(5, 1.0))) == pytest.approx(
        1.0 / 1.05 + 1.05 / 1.4, abs=SLACK_S + CYCLE_S
    )


def test_a_duration_counts_in_place_of_speed_and_acceleration() -> None:
    taken_s = time_of(running_arm(), movej(shifted(1, 0.6), a=0.1, v=0.1, t=1.5))
    assert taken_s == pytest.approx(1.5, abs=SLACK_S + CYCLE_S)


def test_all_joints_arrive_together_and_stay_on_a_straight_line() -> None:
    arm = running_arm()
    goal = [q + way for q, way in zip(FOLDED, (0.9, -0.3, 0.3, 0.6, 0.0, -0.45), strict=True)]
    run(arm, movej(goal, a=1.0, v=0.5))
    while arm.is_program_running:
        arm.advance(0.05)
        ways = [q - start for q, start in zip(arm.target.q, FOLDED, strict=True)]
        share = ways[0] / 0.9
        assert_allclose(ways, [share * way for way in (0.9, -0.3, 0.3, 0.6, 0.0, -0.45)], atol=1e-9)
        assert max(map(abs, arm.target.qd)) <= 0.5 + 1e-9


def test_no_joint_of_a_ur10e_is_faster_than_its_limit() -> None:
    arm = running_arm("ur10e")
    run(arm, movej(shifted(0, 2.0), a=20.0, v=3.0))
    fastest = 0.0
    while arm.is_program_running:
        arm.advance(CYCLE_S)
        fastest = max(fastest, arm.target.qd[0])
    assert fastest == pytest.approx(math.radians(120.0))


def test_joints_follow_their_set_points_with_a_lag_and_rest_on_them() -> None:
    arm = running_arm()
    run(arm, movej(shifted(0, 1.0), a=1.0, v=0.5))
    arm.advance(1.0)
    assert arm.target.q[0] - arm.q_rad[0] == pytest.approx(0.5 * 0.010, rel=0.15)
    assert arm.qd_rad_per_s[0] == pytest.approx(0.5, rel=1e-3)
    until(arm, lambda: is_at_rest(arm))
    assert arm.q_rad == arm.target.q


def test_a_goal_as_a_pose_is_reached_by_the_tcp() -> None:
    arm = running_arm()
    x, y, z, rx, ry, rz = arm.tcp_pose(arm.q_rad)
    tool = 0.12
    run(
        arm,
        f"def f():\n set_tcp(p[0, 0, {tool}, 0, 0, 0])\n"
        f" movej(p[{x}, {y}, {z + 0.05}, {rx}, {ry}, {rz}])\nend",
    )
    until(arm, lambda: is_at_rest(arm) and not arm.is_program_running)
    assert_allclose(arm.tcp_pose(arm.q_rad), (x, y, z + 0.05, rx, ry, rz), atol=1e-6)
    assert arm.tcp.values[2] == tool


def test_the_tcp_s_speed_is_the_change_of_its_position() -> None:
    arm = running_arm()
    run(arm, movej([q + 0.5 for q in FOLDED], a=1.0, v=0.5))
    arm.advance(0.6)
    before, speed = arm.tcp_pose(arm.target.q), arm.tcp_speed(arm.target.q, arm.target.qd)
    arm.advance(CYCLE_S)
    after = arm.tcp_pose(arm.target.q)
    moved = [(b - a) / CYCLE_S for a, b in zip(before[:3], after[:3], strict=True)]
    assert_allclose(speed[:3], moved, atol=2e-3)


CORNER = shifted(0, 1.0)
BEHIND = [q + way for q, way in zip(CORNER, (0.0, 0.5, 0.0, 0.0, 0.0, 0.0), strict=True)]


def around_the_corner(r: float) -> str:
    first, second = movej(CORNER, a=1.0, v=0.5, r=r), movej(BEHIND, a=1.0, v=0.5)
    return f"def f():\n {first}\n {second}\nend"


@pytest.mark.parametrize(("r", "expected_s"), [(0.0, 4.0), (9.0, 3.5)])
def test_a_blend_saves_the_time_of_one_ramp_at_most(r: float, expected_s: float) -> None:
    arm = running_arm()
    taken_s = time_of(arm, around_the_corner(r))
    assert taken_s == pytest.approx(expected_s, abs=SLACK_S + 2 * CYCLE_S)
    until(arm, lambda: is_at_rest(arm), 0.5)
    assert_allclose(arm.q_rad, BEHIND, atol=1e-9)


def test_a_blend_passes_the_goal_within_its_radius_and_does_not_stop_there() -> None:
    arm = running_arm()
    corner_m = arm.tcp_pose(tuple(CORNER))[:3]  # type: ignore[arg-type]
    run(arm, around_the_corner(0.02))
    nearest_m, slowest = math.inf, math.inf
    arm.advance(1.0)
    while arm.target.q[1] < -1.1:
        arm.advance(CYCLE_S)
        nearest_m = min(nearest_m, math.dist(arm.tcp_pose(arm.target.q)[:3], corner_m))
        slowest = min(slowest, max(map(abs, arm.target.qd)))
        assert max(map(abs, arm.target.qd)) <= 0.5 + 1e-9
    assert 0.0 < nearest_m < 0.02
    assert slowest > 0.1


def test_a_pause_in_a_blend_goes_on_to_the_second_goal() -> None:
    arm = running_arm()
    run(arm, around_the_corner(9.0))
    arm.advance(2.2)
    assert arm.target.qd[0] > 0.0 < arm.target.qd[1]
    assert arm.pause()
    until(arm, lambda: is_at_rest(arm), 1.0)
    assert arm.play()
    until(arm, lambda: not arm.is_program_running and is_at_rest(arm))
    assert_allclose(arm.q_rad, BEHIND, atol=1e-9)


def test_half_the_slider_doubles_the_cruise() -> None:
    arm = running_arm()
    arm.slider = 0.5
    until(arm, lambda: arm.speed_scaling == 0.5)
    taken_s = time_of(arm, movej(shifted(0, 1.0), a=1.0, v=0.5))
    assert taken_s == pytest.approx(5.0, abs=SLACK_S + CYCLE_S)


def test_the_slider_at_zero_holds_the_arm_and_the_program() -> None:
    arm = running_arm()
    run(arm, movej(shifted(0, 1.0), a=1.0, v=0.5))
    arm.advance(1.0)
    arm.slider = 0.0
    until(arm, lambda: is_at_rest(arm), 2.0)
    arm.advance(5.0)
    assert arm.runtime_state is RuntimeState.PLAYING
    assert 0.3 < arm.q_rad[0] < 0.9
    arm.slider = 1.0
    until(arm, lambda: not arm.is_program_running, 5.0)
    assert arm.target.q[0] == pytest.approx(1.0)


def test_stopj_slows_down_by_its_deceleration() -> None:
    arm = running_arm()
    run(arm, movej(shifted(0, 2.0), a=1.0, v=0.5))
    arm.advance(2.0)
    at = arm.target.q[0]
    assert time_of(arm, "stopj(2.0)") == pytest.approx(0.25, abs=SLACK_S + CYCLE_S)
    assert arm.target.q[0] - at == pytest.approx(0.5**2 / (2 * 2.0), abs=1e-6)
    until(arm, lambda: is_at_rest(arm), 0.5)


def test_a_new_program_replaces_the_one_that_runs() -> None:
    arm = running_arm()
    run(arm, movej(shifted(0, 2.0), a=1.0, v=0.5))
    arm.advance(1.0)
    run(arm, movej(list(FOLDED), a=1.0, v=0.5))
    until(arm, lambda: is_at_rest(arm) and not arm.is_program_running)
    assert_allclose(arm.q_rad, FOLDED, atol=1e-9)


def test_speeds_never_jump_when_a_program_is_replaced_or_stopped() -> None:
    arm = running_arm()
    orders = {
        0.5: movej(shifted(0, -1.0), a=2.0, v=1.0),
        1.5: "stopj(4)",
        1.6: movej(shifted(0, 1.0), a=2.0, v=1.0),
        2.4: "set_digital_out(1, True)",
    }
    run(arm, movej(shifted(0, 2.0), a=2.0, v=1.0))
    speed = 0.0
    for cycle in range(round(4.0 / CYCLE_S)):
        if (order := orders.get(round(cycle * CYCLE_S, 6))) is not None:
            run(arm, order)
        arm.advance(CYCLE_S)
        assert abs(arm.target.qd[0] - speed) <= 8.0 * CYCLE_S + 1e-9
        speed = arm.target.qd[0]
    assert is_at_rest(arm)


def test_a_secondary_program_leaves_the_motion_alone() -> None:
    arm = running_arm()
    run(arm, movej(shifted(0, 1.0), a=1.0, v=0.5))
    arm.advance(1.0)
    assert run(arm, "sec lamp():\n set_digital_out(3, True)\nend") == ""
    assert arm.digital_outputs == 1 << 3
    taken_s = until(arm, lambda: not arm.is_program_running)
    assert taken_s == pytest.approx(1.5, abs=SLACK_S + CYCLE_S)


def test_outputs_payload_and_pauses_come_in_their_order() -> None:
    arm = running_arm()
    messages = said(arm)
    run(
        arm,
        "def work():\n"
        "  set_payload(1.5, [0, 0, 0.05])  # the gripper\n"
        "  set_configurable_digital_out(2, True)\n"
        "  sleep(0.5)\n"
        '  textmsg("lamp ", True)\n'
        "  set_configurable_digital_out(2, False)\n"
        "end",
    )
    arm.advance(0.4)
    assert (arm.payload_kg, arm.payload_centre_m) == (1.5, (0.0, 0.0, 0.05))
    assert arm.digital_outputs == 1 << 10
    assert messages == []
    arm.advance(0.2)
    assert arm.digital_outputs == 0
    assert [one.text for one in messages] == ["lamp True"]


@pytest.mark.parametrize(
    ("program", "word"),
    [
        ("def f():\n sleep(0.01)\n set_payload(9)\nend", "payload"),
        ("def f():\n sleep(0.01)\n movej(p[3, 0, 0, 0, 0, 0])\nend", "inverse_kinematics"),
        ("def f():\n sleep(0.01)\n movej([0, -1, 3.5, 0, 0, 0])\nend", "elbow"),
    ],
)
def test_a_program_that_fails_ends_with_an_exception_at_its_line(program: str, word: str) -> None:
    arm = running_arm()
    messages = said(arm)
    assert run(arm, program) == ""
    arm.advance(0.1)
    (message,) = messages
    assert word in message.text
    assert message.line == 3
    assert not arm.is_program_running
    assert arm.q_rad == FOLDED


def test_a_protective_stop_in_mid_motion_halts_at_once_and_the_program_can_go_on() -> None:
    arm = running_arm()
    run(arm, movej(shifted(0, 1.0), a=1.0, v=0.5))
    arm.advance(1.0)
    at = arm.target.q[0]
    arm.protective_stop("a hand")
    until(arm, lambda: is_at_rest(arm), 0.5)
    assert arm.q_rad[0] - at == pytest.approx(0.5**2 / 80.0, abs=1e-3)
    assert (arm.safety_mode, arm.runtime_state) == (
        SafetyMode.PROTECTIVE_STOP,
        RuntimeState.PAUSED,
    )
    assert arm.robot_mode is RobotMode.RUNNING
    assert "PROTECTIVE_STOP" in run(arm, "set_digital_out(0, True)")
    assert not arm.play()
    assert not arm.unlock_protective_stop()
    arm.advance(5.0)
    assert arm.unlock_protective_stop()
    assert is_at_rest(arm)
    assert arm.play()
    until(arm, lambda: not arm.is_program_running)
    assert arm.target.q[0] == pytest.approx(1.0)


def test_a_joint_that_runs_into_something_is_stopped_there_and_may_go_back() -> None:
    arm = running_arm()
    arm.place(shifted(0, 0.4))
    arm.obstruct("base", 1, True)
    arm.place(FOLDED)
    run(arm, movej(shifted(0, 1.0), a=1.0, v=0.5))
    until(arm, lambda: arm.safety_mode is SafetyMode.PROTECTIVE_STOP)
    arm.advance(6.0)
    assert arm.q_rad[0] <= 0.4
    assert arm.q_rad[0] == pytest.approx(0.4, abs=0.01)
    assert arm.stop_cause == "contact of base"
    arm.unlock_protective_stop()
    run(arm, movej(list(FOLDED), a=1.0, v=0.5))
    until(arm, lambda: is_at_rest(arm) and not arm.is_program_running)
    assert arm.q_rad[0] == 0.0


def test_a_jammed_joint_stops_the_arm_in_both_directions() -> None:
    arm = running_arm()
    for direction in (-1, 1):
        arm.obstruct("wrist1", direction, True)
    run(arm, movej(shifted(3, -0.2)))
    until(arm, lambda: arm.safety_mode is SafetyMode.PROTECTIVE_STOP, 1.0)
    assert arm.q_rad[3] == pytest.approx(FOLDED[3], abs=1e-4)


def test_an_emergency_stop_takes_power_and_program_until_power_is_asked_for() -> None:
    arm = running_arm()
    run(arm, movej(shifted(0, 1.0), a=1.0, v=0.5))
    arm.advance(1.0)
    arm.press_estop()
    until(arm, lambda: arm.robot_mode is RobotMode.POWER_OFF, 0.5)
    assert arm.safety_mode is SafetyMode.ROBOT_EMERGENCY_STOP
    assert is_at_rest(arm)
    assert not arm.power_on()
    arm.release_estop()
    assert (arm.safety_mode, arm.robot_mode) == (SafetyMode.NORMAL, RobotMode.POWER_OFF)
    assert not arm.is_program_running
    assert arm.release_brakes()
    until(arm, lambda: arm.robot_mode is RobotMode.RUNNING, 10.0)


def test_another_contact_of_the_chain_is_the_system_s_emergency_stop() -> None:
    arm = running_arm()
    arm.switch_supply("I/O block", False)
    assert arm.safety_mode is SafetyMode.SYSTEM_EMERGENCY_STOP
    arm.press_estop()
    arm.switch_supply("I/O block", True)
    assert not arm.has_supply
    arm.release_estop()
    assert arm.has_supply
    assert arm.supply_change_count == 2


def test_power_comes_by_booting_and_idle_and_brakes_let_go_last() -> None:
    arm = UrArm()
    assert arm.robot_mode is RobotMode.POWER_OFF
    assert "POWER_OFF" in run(arm, "set_digital_out(0, True)")
    assert arm.power_on()
    assert arm.robot_mode is RobotMode.BOOTING
    assert until(arm, lambda: arm.robot_mode is RobotMode.IDLE) == pytest.approx(5.0, abs=0.01)
    assert "IDLE" in run(arm, "movej([0, -1.5, 1.5, -1.5, -1.5, 0])")
    assert arm.release_brakes()
    assert until(arm, lambda: arm.robot_mode is RobotMode.RUNNING) == pytest.approx(1.0, abs=0.01)


def test_a_safeguard_stop_keeps_power_and_program() -> None:
    arm = running_arm()
    run(arm, movej(shifted(0, 1.0), a=1.0, v=0.5))
    arm.advance(1.0)
    arm.safeguard_stop(is_open=True)
    until(arm, lambda: is_at_rest(arm), 0.5)
    assert (arm.safety_mode, arm.robot_mode) == (SafetyMode.SAFEGUARD_STOP, RobotMode.RUNNING)
    arm.safeguard_stop(is_open=False)
    assert arm.runtime_state is RuntimeState.PAUSED
    assert arm.play()
    until(arm, lambda: not arm.is_program_running)
    assert arm.target.q[0] == pytest.approx(1.0)


def test_local_mode_ends_the_program() -> None:
    arm = running_arm()
    run(arm, movej(shifted(0, 1.0), a=1.0, v=0.5))
    arm.advance(1.0)
    arm.set_remote(is_remote=False)
    until(arm, lambda: is_at_rest(arm), 0.5)
    assert not arm.is_program_running


def test_time_in_one_piece_or_in_many_moves_the_arm_alike() -> None:
    one, many = running_arm(), running_arm()
    for arm in (one, many):
        run(arm, movej(shifted(0, 1.0), a=1.0, v=0.5))
    one.advance(1.2)
    for _ in range(288):
        many.advance(1.2 / 288)
    assert_allclose(one.q_rad, many.q_rad, atol=1e-9)
    assert one.cycle_count == many.cycle_count == 600


def test_true_joints_differ_from_the_encoders_by_the_arm_s_errors() -> None:
    arm = UrArm(errors=JointErrors((0.0, 0.002, 0.0, 0.0, 0.0, -0.001)))
    arm.place(FOLDED)
    assert arm.q_rad == FOLDED
    assert_allclose(arm.joints().q, (0.0, -1.498, 1.5, -1.5, -1.5, -0.001))


def test_the_world_moves_the_arm_reads_its_joints_and_limits_its_jaws() -> None:
    body = running_arm(gripper=RobotiqDevice())
    body.grasp_limit_mm = 30.0
    body.advance(1.0 / 240.0)
    assert_allclose(body.joints().q, FOLDED)
    assert body.joints().jaw_opening_mm == 85.0


def test_a_cold_arm_stands_where_its_seed_put_it() -> None:
    assert UrArm(seed=3).q_rad == UrArm(seed=3).q_rad != UrArm(seed=4).q_rad
