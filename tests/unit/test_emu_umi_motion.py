"""The arm's motion: profile, lag, stops, stalls, couplings, stop commands. umi_rtx.md 5, 7."""

import math

import pytest
from emu_umi_line import STEP_S, Line

from emulators.umi_scara import ArmModel, Axis

# umi_rtx.md 7: counts/s at SPEED 100
NOMINAL = {
    Axis.ZED: 412.0,
    Axis.SHOULDER: 672.0,
    Axis.ELBOW: 643.0,
    Axis.YAW: 1071.0,
    Axis.GRIPPER: 1400.0,
    Axis.WRIST1: 1400.0,
    Axis.WRIST2: 1400.0,
}
# umi_rtx.md 4.2: with the elbow at -2629 the hand's stop is at -1947; 5.2 rounds this to 1071
HAND = 1947 - 2629 / 3
MIDDLE = {
    Axis.ZED: -1500.0,
    Axis.SHOULDER: 0.0,
    Axis.ELBOW: 0.0,
    Axis.YAW: 0.0,
    Axis.GRIPPER: 500.0,
    Axis.WRIST1: -500.0,
    Axis.WRIST2: -500.0,
}


def line_in_the_middle(listening: int = 1) -> Line:
    line = Line(listening=listening)
    line.model.place(MIDDLE)
    line.model.reference()
    return line


@pytest.mark.parametrize("seed", range(20))
def test_a_cold_arm_stands_inside_all_its_stops_high_and_counts_from_zero(seed: int) -> None:
    model = ArmModel(seed=seed)
    at = {axis: motor.position for axis, motor in model.axes.items()}
    assert -600 <= at[Axis.ZED] <= 0
    assert abs(at[Axis.SHOULDER]) < 2630
    assert -2629 < at[Axis.ELBOW] < 2206
    assert abs(at[Axis.YAW] - at[Axis.ELBOW] / 3) < HAND
    assert -2642 < at[Axis.WRIST1] + at[Axis.WRIST2] < 108
    assert -3560 < at[Axis.WRIST1] - at[Axis.WRIST2] < 4882
    assert -30 < at[Axis.GRIPPER] < 1200
    assert {motor.counter for motor in model.axes.values()} == {0}
    assert at == {axis: motor.position for axis, motor in ArmModel(seed=seed).axes.items()}
    assert at != {axis: motor.position for axis, motor in ArmModel(seed=seed + 1).axes.items()}


@pytest.mark.parametrize("axis", list(Axis))
@pytest.mark.parametrize("speed", [30, 100, 150])
def test_a_numeric_go_takes_the_time_of_its_trapezoid(axis: Axis, speed: int) -> None:
    line = line_in_the_middle()
    line.write(axis, 4, speed)
    goal = round(MIDDLE[axis]) - 450
    line.write(axis, 3, goal)
    assert line.go(axis) == "00"
    top = speed / 100 * NOMINAL[axis]
    ramp = top * 0.25 / 2  # counts spent in each of the two ramps
    is_long = 2 * ramp < 450
    profile_s = 450 / top + 0.25 if is_long else 2 * math.sqrt(450 * 0.25 / top)
    settling_s = 0.05 * math.log(max(2.0, top * 0.05 / 2))  # the lag dies away into DEAD_BAND
    took_s = line.wait_for(0, 0, axis)
    assert profile_s - 0.05 <= took_s <= profile_s + settling_s + 0.15
    line.pass_time(0.5)
    assert (line.counter(axis), line.error(axis), line.status(axis)) == (goal, 0, 0)
    assert line.true(axis) == pytest.approx(goal)


@pytest.mark.parametrize("dt_s", [1 / 480, 1 / 240, 1.0])
def test_the_true_position_trails_the_counter_by_50_ms_of_speed(dt_s: float) -> None:
    line = line_in_the_middle()
    line.write(Axis.SHOULDER, 4, 100)
    line.drive({Axis.SHOULDER: +1})
    for _ in range(round(1.0 / dt_s)):
        line.model.advance(dt_s)
    assert line.model.axes[Axis.SHOULDER].error == pytest.approx(672 * 0.05, abs=1)
    # 0.25 s of ramp cost half of it; the exchange itself took 10 ms
    assert line.model.axes[Axis.SHOULDER].counter == pytest.approx(672 * (1.01 - 0.125), rel=0.01)


def test_halfway_polls_show_a_moving_axis_whose_encoder_is_counter_minus_error() -> None:
    line = line_in_the_middle()
    line.run(("70 03 00", "e0"), ("79 e8 03", "f5"), ("a2", "00"))
    line.pass_time(0.5)
    line.run(("11", "11 01 00"), ("17", "17 01 00"), ("a2", "03"))
    joint = line.model.joints()
    counter, error = (line.model.axes[Axis.SHOULDER].counter, line.model.axes[Axis.SHOULDER].error)
    assert 0 < error < 672 * 0.05 + 1
    assert counter - error == pytest.approx(math.degrees(joint.shoulder_rad) * 29.221, abs=1)


def test_a_relative_go_adds_to_the_counter_and_may_be_repeated() -> None:
    line = line_in_the_middle()
    line.run(("1b 02 00", "00"))
    line.write(Axis.ZED, 3, -100)
    for expected in (-1600, -1700):
        assert line.go(Axis.ZED) == "00"
        line.wait_for(0, 0, Axis.ZED)
        assert line.counter(Axis.ZED) == expected
    assert line.status(Axis.ZED) == 0x10


def test_a_go_with_one_busy_axis_starts_none() -> None:
    line = line_in_the_middle()
    line.write(Axis.SHOULDER, 3, 1000)
    line.write(Axis.ZED, 3, -1000)
    assert line.go(Axis.SHOULDER) == "00"
    line.run(("a6", "03"), ("bf", "03"))
    line.pass_time(0.5)
    assert line.counter(Axis.ZED) == -1500
    assert line.go(Axis.ZED) == "00"


def test_motors_without_power_acknowledge_a_go_and_stay() -> None:
    line = line_in_the_middle()
    line.run(("26", "00"), ("29", "00"), ("26", "00"), ("29", "00"))
    line.write(Axis.ZED, 3, 0)
    before = line.model.joints()
    assert line.go(Axis.ZED) == "00"
    line.drive({Axis.WRIST1: +1})
    assert line.status(Axis.ZED) == 0x02
    assert line.status(Axis.WRIST1) == 0x02
    line.pass_time(1.0)
    assert line.model.joints() == before


def test_power_given_back_moves_nothing() -> None:
    line = line_in_the_middle()
    line.write(Axis.ZED, 3, -600)
    assert line.go(Axis.ZED) == "00"
    line.pass_time(0.6)
    line.run(("26", "00"))
    at = line.true(Axis.ZED)
    line.run(("12", "12 02 00"), ("27", "00"))
    line.pass_time(0.5)
    assert line.true(Axis.ZED) == at
    assert line.go(Axis.ZED) == "00"
    line.wait_for(0, 0, Axis.ZED)
    assert line.counter(Axis.ZED) == -600


@pytest.mark.parametrize(
    ("axis", "direction", "stop"),
    [
        (Axis.ZED, +1, 0.0),
        (Axis.ZED, -1, -3554.0),
        (Axis.SHOULDER, +1, 2630.0),
        (Axis.SHOULDER, -1, -2630.0),
        (Axis.GRIPPER, -1, -30.0),
        (Axis.GRIPPER, +1, 1200.0),
        (Axis.YAW, +1, HAND),
        (Axis.YAW, -1, -HAND),
        (Axis.WRIST1, +1, 108.0 + 500.0),  # W1 + W2 = 108
        (Axis.WRIST1, -1, -2642.0 + 500.0),
    ],
)
def test_a_manual_drive_stalls_at_the_stop_and_says_so(
    axis: Axis, direction: int, stop: float
) -> None:
    line = line_in_the_middle()
    line.drive({axis: direction})
    assert line.status(axis) == 0x01
    line.wait_for(3, 1, axis, limit_s=15.0)
    assert line.status(axis) == 0x0A
    assert line.true(axis) == pytest.approx(stop)
    assert (line.counter(axis), line.error(axis)) == (round(stop), 0)
    line.pass_time(0.5)
    assert line.status(axis) == 0x0A  # the direction is latched to hold: it does not go on
    line.drive({axis: -direction})
    line.pass_time(0.3)
    assert line.status(axis) == 0x01
    assert (line.true(axis) - stop) * direction < 0


def test_the_elbow_with_a_limp_yaw_turns_to_its_own_stops_and_drags_the_hand() -> None:
    for direction, stop in ((-1, -2629.0), (+1, 2206.0)):
        line = line_in_the_middle()
        line.model.place({Axis.YAW: HAND * -direction})
        line.model.reference()
        line.write(Axis.YAW, 10, 0)
        line.drive({Axis.ELBOW: direction})
        line.wait_for(3, 1, Axis.ELBOW)
        assert line.true(Axis.ELBOW) == stop
        assert abs(line.true(Axis.YAW) - stop / 3) <= HAND + 1e-6


def test_the_elbow_with_a_held_yaw_stops_where_the_hand_meets_its_stop() -> None:
    line = line_in_the_middle()
    line.model.place({Axis.YAW: -800.0})
    line.model.reference()
    line.drive({Axis.ELBOW: +1})
    line.wait_for(3, 1, Axis.ELBOW)
    assert line.true(Axis.ELBOW) == pytest.approx(3 * (HAND - 800.0))
    assert line.true(Axis.YAW) == -800.0


def test_freed_axes_can_be_pushed_by_hand_and_the_encoders_notice() -> None:
    line = line_in_the_middle()
    line.model.push(Axis.SHOULDER, 300.0)
    assert line.true(Axis.SHOULDER) == 0.0  # held
    line.run(("26", "00"))
    for axis, way in {Axis.SHOULDER: 300, Axis.YAW: -250, Axis.ELBOW: 120}.items():
        line.model.push(axis, way)
        assert line.true(axis) == MIDDLE[axis] + way
        # the host computes ACTUAL_POSITION = CURRENT_POSITION - CP_ERROR; umi_rtx.md 2.5
        assert line.counter(axis) - line.error(axis) == way
    line.model.push(Axis.SHOULDER, 9999.0)
    assert line.true(Axis.SHOULDER) == 2630.0
    line.on(1).run(("27", "00"))
    line.pass_time(0.5)
    assert (line.true(Axis.SHOULDER), line.counter(Axis.SHOULDER)) == (2630.0, 2630)


def test_a_motor_without_force_never_drives() -> None:
    line = line_in_the_middle()
    line.write(Axis.SHOULDER, 10, 0)
    line.write(Axis.SHOULDER, 3, 500)
    assert line.go(Axis.SHOULDER) == "00"
    line.wait_for(0, 0, Axis.SHOULDER, limit_s=2.0)
    assert line.true(Axis.SHOULDER) == 0.0
    assert line.status(Axis.SHOULDER) & 0x0E


def test_an_obstacle_stalls_a_numeric_move_until_it_is_taken_away() -> None:
    line = line_in_the_middle()
    line.write(Axis.SHOULDER, 3, 1500)
    assert line.go(Axis.SHOULDER) == "00"
    line.pass_time(0.8)
    line.model.obstruct(Axis.SHOULDER, +1, blocked=True)
    at = line.true(Axis.SHOULDER)
    line.wait_for(0, 0, Axis.SHOULDER, limit_s=1.0)
    assert line.status(Axis.SHOULDER) == 0x0A
    assert line.counter(Axis.SHOULDER) == round(at)
    line.write(Axis.SHOULDER, 3, 0)
    assert line.go(Axis.SHOULDER) == "00"  # away from it the axis is free
    line.wait_for(0, 0, Axis.SHOULDER)
    assert line.status(Axis.SHOULDER) == 0
    line.model.obstruct(Axis.SHOULDER, +1, blocked=False)
    line.write(Axis.SHOULDER, 3, 1500)
    assert line.go(Axis.SHOULDER) == "00"
    line.wait_for(0, 0, Axis.SHOULDER)
    assert line.counter(Axis.SHOULDER) == 1500


def test_a_following_error_over_its_limit_stops_the_axis_before_the_stall_and_stays_readable() -> (
    None
):
    line = line_in_the_middle()
    line.write(Axis.SHOULDER, 2, 50)
    line.write(Axis.SHOULDER, 3, 1500)
    assert line.go(Axis.SHOULDER) == "00"
    line.pass_time(0.8)
    line.model.jam(Axis.SHOULDER)
    line.wait_for(0, 0, Axis.SHOULDER, limit_s=1.0)
    assert line.status(Axis.SHOULDER) == 0x06
    line.stop_both()
    assert line.error(Axis.SHOULDER) > 50  # umi_rtx.md 3.6: readable after the dead stop
    line.on(1).run(("17", "17 06 00"))
    line.model.jam(Axis.SHOULDER, jammed=False)
    at = line.true(Axis.SHOULDER)
    line.pass_time(0.5)
    assert line.true(Axis.SHOULDER) == at
    assert line.go(Axis.SHOULDER) == "00"
    line.wait_for(0, 0, Axis.SHOULDER)
    assert (line.status(Axis.SHOULDER), line.counter(Axis.SHOULDER)) == (0, 1500)


def test_a_dead_stop_is_instant_and_a_ramp_stop_takes_its_ramp() -> None:
    way = {}
    for opcode in ("24", "25"):
        line = line_in_the_middle()
        line.drive({Axis.SHOULDER: +1})
        line.pass_time(1.0)
        at = line.true(Axis.SHOULDER)
        line.run((opcode, "00"))
        line.wait_for(0, 0, Axis.SHOULDER, limit_s=0.5)
        line.pass_time(0.5)
        assert line.status(Axis.SHOULDER) == 0x02
        assert (line.error(Axis.SHOULDER)) == 0
        assert line.counter(Axis.SHOULDER) == round(line.true(Axis.SHOULDER))
        way[opcode] = line.true(Axis.SHOULDER) - at
    assert way["24"] == 0.0
    # lag at the start, half a ramp of 0.25 s from 672 counts/s
    assert way["25"] == pytest.approx(672 * 0.05 + 672 * 0.25 / 2, abs=5)


def test_a_stop_reaches_only_the_ip_that_hears_it() -> None:
    line = line_in_the_middle()
    line.drive({Axis.SHOULDER: +1})
    line.drive({Axis.WRIST1: -1})
    line.pass_time(0.2)
    line.on(0).run(("24", "00"))
    assert line.status(Axis.WRIST1) == 0x02
    assert line.status(Axis.SHOULDER) == 0x01


def test_a_manual_go_rewrites_all_five_controllers_of_its_ip() -> None:
    line = line_in_the_middle()
    line.drive({Axis.SHOULDER: +1, Axis.ZED: -1})
    line.pass_time(0.3)
    line.on(1).run(("80 10 00", "00"))  # zed up, the others hold
    line.pass_time(0.3)
    assert line.status(Axis.SHOULDER) == 0x02
    assert line.status(Axis.ZED) == 0x01
    assert line.model.axes[Axis.ZED].velocity > 0
    line.on(1).run(("80 ff 03", "00"))
    at = line.model.joints()
    line.pass_time(0.3)
    assert line.model.joints() == at
    assert line.status(Axis.ZED) == 0x02


@pytest.mark.parametrize(
    ("ip", "request_hex", "moves"),
    [
        (1, "80 04 00", {Axis.SHOULDER: +1}),
        (1, "80 02 00", {Axis.ELBOW: -1}),
        (1, "80 82 00", {Axis.ELBOW: -1, Axis.YAW: -1}),
        (1, "80 00 02", {Axis.GRIPPER: -1}),
        (1, "80 00 01", {Axis.GRIPPER: +1}),
        (1, "80 20 00", {Axis.ZED: -1}),
        (0, "80 60 00", {Axis.WRIST1: -1, Axis.WRIST2: +1}),
        (0, "80 90 00", {Axis.WRIST1: +1, Axis.WRIST2: -1}),
        (0, "80 a0 00", {Axis.WRIST1: -1, Axis.WRIST2: -1}),
    ],
)
def test_manual_go_drives_what_the_table_says(
    ip: int, request_hex: str, moves: dict[Axis, int]
) -> None:
    line = line_in_the_middle(listening=ip)
    line.run((request_hex, "00"))
    line.pass_time(0.3)
    for axis, start in MIDDLE.items():
        way = line.true(axis) - start
        assert way == 0 if axis not in moves else way * moves[axis] > 0


@pytest.mark.parametrize("opcode", [0xC0, 0xE0])
def test_interpolation_adds_signed_nibbles_to_the_set_points(opcode: int) -> None:
    line = line_in_the_middle()
    # umi_rtx.md 2.7: elbow +2, shoulder -3, zed +7, yaw +1; then elbow -8, gripper +7
    line.run((f"{opcode:02x} d2 17", "00"), (f"{opcode | 7:02x} 08 00", "00"))
    line.pass_time(1.0)
    assert line.model.axes[Axis.ELBOW].counter == -6
    assert line.model.axes[Axis.SHOULDER].counter == -3
    assert line.model.axes[Axis.ZED].counter == -1493
    assert line.model.axes[Axis.YAW].counter == 1
    assert line.model.axes[Axis.GRIPPER].counter == 507
    for axis in (Axis.ELBOW, Axis.SHOULDER, Axis.ZED, Axis.YAW, Axis.GRIPPER):
        assert line.model.axes[axis].error == 0


def test_interpolation_without_power_leaves_the_set_points_alone() -> None:
    line = line_in_the_middle()
    line.run(("26", "00"), ("e0 d2 17", "00"), ("4a", "83 24 fa"), ("42", "80 00 00"))


def test_a_target_just_past_a_stop_but_within_the_dead_band_is_an_arrival_not_a_stall() -> None:
    line = line_in_the_middle()
    line.write(Axis.GRIPPER, 3, -31)  # one count past the closed stop, DEAD_BAND is 2
    assert line.go(Axis.GRIPPER) == "00"
    line.wait_for(0, 0, Axis.GRIPPER)
    line.pass_time(1.0)
    assert line.status(Axis.GRIPPER) == 0
    assert line.true(Axis.GRIPPER) == -30.0
    assert (line.counter(Axis.GRIPPER), line.error(Axis.GRIPPER)) == (-31, -1)


def test_jaws_close_on_an_object_stall_there_and_keep_pressing_until_told_otherwise() -> None:
    line = line_in_the_middle()
    line.model.grasp_limit_mm = 20.0
    line.write(Axis.GRIPPER, 10, 25)
    line.write(Axis.GRIPPER, 3, -500)
    assert line.go(Axis.GRIPPER) == "00"
    assert line.model.jaw_force_fraction == 0.0
    line.wait_for(0, 0, Axis.GRIPPER, limit_s=2.0)
    assert line.status(Axis.GRIPPER) == 0x0A
    assert line.model.joints().jaw_opening_mm == pytest.approx(20.0)
    n = line.counter(Axis.GRIPPER)
    assert 0.0584 * n + 1.07e-5 * n * n == pytest.approx(20.0, abs=0.05)
    assert line.model.jaw_force_fraction == 0.25
    line.on(1).run(("60 0b 00", "c0"), ("6c", "d9 e7 ff"))  # CURRENT_FORCE -25: closing
    line.stop_both()
    line.on(1).run(("80 00 00", "00"))
    line.write(Axis.ZED, 3, -1000)
    assert line.go(Axis.ZED) == "00"
    line.wait_for(0, 0, Axis.ZED)
    assert line.model.jaw_force_fraction == 0.25
    line.write(Axis.GRIPPER, 3, 600)
    assert line.go(Axis.GRIPPER) == "00"
    assert line.model.jaw_force_fraction == 0.0


@pytest.mark.parametrize("release", ["26", "80 00 03", "20"])
def test_limp_jaws_do_not_press(release: str) -> None:
    line = line_in_the_middle()
    line.model.grasp_limit_mm = 10.0
    line.drive({Axis.GRIPPER: -1})
    line.wait_for(3, 1, Axis.GRIPPER)
    assert line.model.jaw_force_fraction == 0.4
    line.on(1).run((release, "00"))
    assert line.model.jaw_force_fraction == 0.0


def test_empty_jaws_close_fully() -> None:
    line = line_in_the_middle()
    line.write(Axis.GRIPPER, 3, -30)
    assert line.go(Axis.GRIPPER) == "00"
    line.wait_for(0, 0, Axis.GRIPPER)
    assert line.status(Axis.GRIPPER) == 0
    assert line.model.joints().jaw_opening_mm == 0.0


def test_joints_are_the_true_positions_in_the_reference_pages_units() -> None:
    model = ArmModel()
    model.place(
        {
            Axis.SHOULDER: 29.221 * 30,
            Axis.ELBOW: 14.611 * -45,
            Axis.YAW: 9.740 * 60,
            Axis.ZED: -1875.0,
            Axis.WRIST1: 13.487 * (-40 + 25),
            Axis.WRIST2: 13.487 * (-40 - 25),
            Axis.GRIPPER: 900.0,
        }
    )
    joints = model.joints()
    angles = (joints.shoulder_rad, joints.elbow_rad, joints.yaw_rad, joints.pitch_rad)
    assert [math.degrees(a) for a in angles] == pytest.approx([30, -45, 60, -40])
    assert math.degrees(joints.roll_rad) == pytest.approx(25)
    assert joints.zed_mm == pytest.approx(-500.0)
    assert joints.jaw_opening_mm == pytest.approx(61.2, abs=0.05)  # umi_rtx.md 5.5, table


def test_the_result_does_not_depend_on_the_worlds_step() -> None:
    ends = []
    for step_s in (1 / 240, 1 / 480, 1 / 60, 0.25):
        line = line_in_the_middle()
        line.write(Axis.SHOULDER, 3, 1000)
        line.write(Axis.WRIST1, 3, -900)
        assert (line.go(Axis.SHOULDER), line.go(Axis.WRIST1)) == ("00", "00")
        for _ in range(round(1.0 / step_s)):
            line.model.advance(step_s)
        ends.append((line.true(Axis.SHOULDER), line.true(Axis.WRIST1)))
    for end in ends[1:]:
        assert end == pytest.approx(ends[0], abs=3.0)


def test_no_time_changes_nothing() -> None:
    line = line_in_the_middle()
    line.drive({Axis.SHOULDER: +1})
    line.pass_time(40 * STEP_S)
    at = line.model.joints()
    line.model.advance(0.0)
    assert line.model.joints() == at
