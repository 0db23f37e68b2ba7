"""The sessions of the emulated controller, without sockets; bytes are in test_emu_ur_golden.py."""

import struct
from itertools import pairwise

import pytest
from emu_ur_bench import run, running_arm, until
from hypothesis import given
from hypothesis import strategies as st

from emulators.gripper_modbus import JawModel, RobotiqDevice
from emulators.ur_arm import (
    CYCLE_S,
    DashboardSession,
    RobotMode,
    RtdeSession,
    Software,
    UrArm,
    UrcapSession,
)
from emulators.ur_arm.wires import BadFrameError

VERSION_2 = bytes.fromhex("00 05 56 00 02")
START = bytes.fromhex("00 03 53")
PAUSE = bytes.fromhex("00 03 50")


# --- RTDE -----------------------------------------------------------------------------------------


def frame(kind: str, payload: bytes = b"") -> bytes:
    return struct.pack(">HB", 3 + len(payload), ord(kind)) + payload


def outputs(names: str, frequency_hz: float = 500.0) -> bytes:
    return frame("O", struct.pack(">d", frequency_hz) + names.encode())


def frames(data: bytes) -> list[tuple[str, bytes]]:
    found = []
    while data:
        size, kind = struct.unpack_from(">HB", data)
        found.append((chr(kind), data[3:size]))
        data = data[size:]
    return found


def rtde(arm: UrArm, taken: set[str] | None = None) -> RtdeSession:
    session = RtdeSession(arm, Software(), set() if taken is None else taken)
    session.feed(VERSION_2)
    return session


# ur_rtde 1.6.5's RTDEReceiveInterface asks for these, with a comma behind the last
UR_RTDE = (
    "timestamp,target_q,target_qd,target_qdd,target_current,target_moment,actual_q,actual_qd,"
    "actual_current,joint_control_output,actual_TCP_pose,actual_TCP_speed,actual_TCP_force,"
    "target_TCP_pose,target_TCP_speed,actual_digital_input_bits,joint_temperatures,"
    "actual_execution_time,robot_mode,joint_mode,safety_mode,safety_status,"
    "actual_tool_accelerometer,speed_scaling,target_speed_fraction,actual_momentum,"
    "actual_main_voltage,actual_robot_voltage,actual_robot_current,actual_joint_voltage,"
    "actual_digital_output_bits,runtime_state,standard_analog_input0,standard_analog_input1,"
    "standard_analog_output0,standard_analog_output1,robot_status_bits,safety_status_bits,"
    "ft_raw_wrench,payload,payload_cog,payload_inertia,output_int_register_2,"
    "output_int_register_12,output_int_register_19,output_double_register_0,"
)


def test_every_field_that_a_stranger_asks_for_has_a_type_and_a_value() -> None:
    session = rtde(UrArm())
    ((kind, payload),) = frames(session.feed(outputs(UR_RTDE, 125.0)))
    types = payload[1:].decode().split(",")
    assert kind == "O"
    assert payload[0] == 1
    assert len(types) == UR_RTDE.count(",")
    assert "NOT_FOUND" not in types
    session.feed(START)
    sizes = {
        "DOUBLE": 8, "VECTOR6D": 48, "VECTOR3D": 24, "INT32": 4,
        "UINT32": 4, "UINT64": 8, "VECTOR6INT32": 24,
    }  # fmt: skip
    ((kind, payload),) = frames(session.due())
    assert len(payload) == 1 + sum(sizes[one] for one in types)


@pytest.mark.parametrize(("frequency_hz", "expected"), [(500.0, 50), (125.0, 12), (10.0, 1)])
def test_packages_come_at_the_frequency_that_was_asked_for(
    frequency_hz: float, expected: int
) -> None:
    arm = UrArm()
    session = rtde(arm)
    session.feed(outputs("timestamp", frequency_hz) + START)
    stamps: list[float] = []

    def note() -> None:
        if data := session.due():
            stamps.append(struct.unpack(">d", data[4:])[0])

    arm.on_cycle.append(note)
    arm.advance(50 * CYCLE_S)
    assert len(stamps) == expected
    steps = {round(b - a, 9) for a, b in pairwise(stamps)}
    assert steps <= {round(1.0 / frequency_hz, 9)}


def test_nothing_is_sent_before_the_start_and_after_a_pause() -> None:
    session = rtde(UrArm())
    session.feed(outputs("timestamp"))
    assert session.due() == b""
    session.feed(START)
    assert session.due() != b""
    session.feed(PAUSE)
    assert session.due() == b""


@pytest.mark.parametrize("names", ["nonsense", "timestamp,nonsense", ""])
def test_a_recipe_that_is_not_valid_cannot_be_started(names: str) -> None:
    session = rtde(UrArm())
    session.feed(outputs(names))
    replies = frames(session.feed(START))
    assert [kind for kind, _ in replies] == ["M", "S"]
    assert replies[1][1] == b"\x00"
    assert session.due() == b""


@pytest.mark.parametrize("frequency_hz", [0.0, -1.0, 501.0, float("nan")])
def test_a_frequency_out_of_range_is_refused_with_a_message(frequency_hz: float) -> None:
    replies = frames(rtde(UrArm()).feed(outputs("timestamp", frequency_hz)))
    assert [kind for kind, _ in replies] == ["M", "O"]
    assert replies[1][1][0] == 0


def test_version_1_has_no_frequency_and_no_recipe() -> None:
    session = RtdeSession(UrArm(), Software(), set())
    assert frames(session.feed(frame("O", b"robot_mode"))) == [("O", b"INT32")]
    session.feed(START)
    assert frames(session.due()) == [("U", struct.pack(">i", 3))]


def test_an_input_belongs_to_the_client_that_took_it_until_it_leaves() -> None:
    arm, taken = UrArm(), set[str]()
    one, other = rtde(arm, taken), rtde(arm, taken)
    asked = frame("I", b"input_int_register_20")
    assert frames(one.feed(asked)) == [("I", b"\x01INT32")]
    assert frames(one.feed(asked)) == [("I", b"\x02INT32")]
    assert frames(other.feed(asked)) == [("I", b"\x00IN_USE")]
    one.close()
    assert frames(other.feed(asked)) == [("I", b"\x01INT32")]


def test_inputs_take_effect_by_their_masks() -> None:
    arm = UrArm()
    arm.digital_outputs = 0b0001
    session = rtde(arm)
    session.feed(frame("I", b"standard_digital_output_mask,standard_digital_output"))
    session.feed(START)
    session.feed(frame("U", bytes((1, 0b0110, 0b0011))))
    assert arm.digital_outputs == 0b0011


def test_an_input_register_reads_back_as_an_output() -> None:
    session = rtde(UrArm())
    session.feed(outputs("input_double_register_7"))
    session.feed(frame("I", b"input_double_register_7") + START)
    session.feed(frame("U", b"\x01" + struct.pack(">d", 2.5)))
    assert frames(session.due()) == [("U", b"\x01" + struct.pack(">d", 2.5))]


@pytest.mark.parametrize(
    "request_bytes",
    [frame("Z"), frame("V", b"\x02"), frame("U", b"\x07\x00"), frame("U"), frame("O", b"abc")],
)
def test_a_package_that_makes_no_sense_gets_a_message_and_the_next_one_its_answer(
    request_bytes: bytes,
) -> None:
    session = rtde(UrArm())
    replies = frames(session.feed(request_bytes + frame("v")))
    assert [kind for kind, _ in replies] == ["M", "v"]


def test_the_bits_of_a_protective_stop_are_those_of_the_page() -> None:
    arm = running_arm()
    session = rtde(arm)
    session.feed(outputs("safety_status_bits,robot_status_bits,runtime_state") + START)
    run(arm, "sleep(9)")
    arm.protective_stop()
    ((_, payload),) = frames(session.due())
    assert struct.unpack(">III", payload[1:]) == (1 << 2 | 1 << 10, 0b11, 4)


PACKAGES = st.one_of(
    st.binary(max_size=8),
    st.builds(frame, st.sampled_from("VvOISPUMX"), st.binary(max_size=24)),
    st.sampled_from([VERSION_2, START, PAUSE, outputs("timestamp,actual_q"), frame("I", b"a,,")]),
    st.builds(
        lambda mask, share: frame("U", b"\x01" + struct.pack(">Id", mask, share)),
        st.integers(0, 2**32 - 1),
        st.floats(),
    ),
)


@given(st.lists(PACKAGES, max_size=12))
def test_whatever_arrives_the_controller_answers_in_whole_frames_or_hangs_up(
    packages: list[bytes],
) -> None:
    arm = UrArm()
    session = RtdeSession(arm, Software(), set())
    session.feed(frame("I", b"speed_slider_mask,speed_slider_fraction"))
    for package in packages:
        try:
            replies = session.feed(package)
        except BadFrameError:
            return
        assert sum(3 + len(payload) for _, payload in frames(replies)) == len(replies)
        frames(session.due())
        assert 0.0 <= arm.slider <= 1.0


@given(st.lists(st.one_of(st.binary(max_size=9), st.sampled_from([b"\n", b"SET POS ", b"GET "]))))
def test_whatever_lines_arrive_text_comes_back(pieces: list[bytes]) -> None:
    _, urcap = gripping_arm()
    dashboard = DashboardSession(UrArm(), Software())
    for piece in pieces:
        assert all(reply for reply in urcap.feed(piece))
        dashboard.feed(piece).decode()


# --- the dashboard --------------------------------------------------------------------------------


def ask(session: DashboardSession, *lines: str) -> list[str]:
    replies = session.feed("".join(f"{line}\n" for line in lines).encode())
    return replies.decode().splitlines()


def test_the_dashboard_tells_and_switches_power() -> None:
    arm = UrArm()
    session = DashboardSession(arm, Software())
    assert ask(session, "robotmode", "power on") == ["Robotmode: POWER_OFF", "Powering on"]
    assert ask(session, "ROBOTMODE") == ["Robotmode: BOOTING"]
    assert ask(session, "brake release") == ["Brake releasing"]
    until(arm, lambda: arm.robot_mode is RobotMode.RUNNING)
    assert ask(session, "robotmode", "safetystatus") == [
        "Robotmode: RUNNING",
        "Safetystatus: NORMAL",
    ]
    assert ask(session, "power off", "robotmode") == ["Powering off", "Robotmode: POWER_OFF"]


def test_the_dashboard_follows_a_program() -> None:
    arm = running_arm()
    session = DashboardSession(arm, Software())
    assert ask(session, "running", "stop", "play") == [
        "Program running: false",
        "Failed to execute: stop",
        "Failed to execute: play",
    ]
    run(arm, "def work():\n sleep(9)\nend")
    arm.advance(0.1)
    assert ask(session, "running", "programState") == ["Program running: true", "PLAYING work"]
    assert ask(session, "pause", "programState") == ["Pausing program", "PAUSED work"]
    assert ask(session, "play", "stop") == ["Starting program", "Stopped"]


def test_a_protective_stop_is_unlocked_after_5_s() -> None:
    arm = running_arm()
    session = DashboardSession(arm, Software())
    arm.protective_stop()
    assert ask(session, "safetymode") == ["Safetymode: PROTECTIVE_STOP"]
    (reply,) = ask(session, "unlock protective stop")
    assert reply.startswith("Cannot unlock protective stop until 5s after occurrence")
    arm.advance(5.0)
    assert ask(session, "unlock protective stop", "safetymode") == [
        "Protective stop releasing",
        "Safetymode: NORMAL",
    ]


def test_local_mode_answers_questions_and_refuses_orders_even_later() -> None:
    arm = UrArm()
    arm.set_remote(is_remote=False)
    session = DashboardSession(arm, Software())
    reply = ask(session, "is in remote control", "power on")
    assert reply[0] == "false"
    assert reply[1].startswith("Command is not allowed due to safety reasons")
    arm.set_remote(is_remote=True)
    assert "reconnect" in ask(session, "power on")[0]
    assert ask(DashboardSession(arm, Software()), "power on") == ["Powering on"]


def test_what_the_dashboard_does_not_know_and_the_end() -> None:
    session = DashboardSession(UrArm(), Software())
    assert ask(session, "make coffee") == ["could not understand: 'make coffee'"]
    assert ask(session, "quit", "robotmode") == ["Disconnected"]
    assert session.has_quit


# --- the URCap ------------------------------------------------------------------------------------


def gripping_arm() -> tuple[UrArm, UrcapSession]:
    gripper = RobotiqDevice(JawModel(opening_mm=40.0))
    return running_arm(gripper=gripper), UrcapSession(gripper)


def test_the_gripper_is_activated_moved_and_read_by_lines_of_text() -> None:
    arm, session = gripping_arm()
    assert session.feed(b"GET STA\nSET ACT 0\nSET ACT 1 GTO 1\n") == [b"STA 0", b"ack", b"ack"]
    arm.advance(3.0)
    assert session.feed(b"GET STA\nGET ACT\n") == [b"STA 3", b"ACT 1"]
    assert session.feed(b"SET POS 255 SPE 255 FOR 0\nGET OBJ\n")[0] == b"ack"
    arm.advance(0.1)
    assert session.feed(b"GET OBJ\n") == [b"OBJ 0"]
    arm.advance(2.0)
    assert session.feed(b"GET OBJ\nGET POS\nGET PRE\n") == [b"OBJ 3", b"POS 230", b"PRE 255"]
    assert arm.joints().jaw_opening_mm == pytest.approx(0.0, abs=0.1)


def test_a_part_between_the_jaws_is_felt() -> None:
    arm, session = gripping_arm()
    session.feed(b"SET ACT 0\nSET ACT 1 GTO 1\n")
    arm.advance(3.0)
    arm.grasp_limit_mm = 20.0
    session.feed(b"SET POS 255\n")
    arm.advance(5.0)
    assert session.feed(b"GET OBJ\n") == [b"OBJ 2"]
    assert arm.joints().jaw_opening_mm == pytest.approx(20.0, abs=0.02)


@pytest.mark.parametrize(
    "line",
    [b"GET XYZ", b"SET POS 256", b"SET POS -1", b"SET POS", b"SET STA 3", b"POS 3", b"", b"\xff"],
)
def test_a_line_that_makes_no_sense_gets_a_question_mark(line: bytes) -> None:
    _, session = gripping_arm()
    assert session.feed(line + b"\n") == [b"?"]


def test_the_gripper_has_power_while_the_arm_has() -> None:
    arm, session = gripping_arm()
    arm.power_off()
    assert session.feed(b"GET POS\nSET POS 9\n") == [b"?", b"?"]
    arm.start_running()
    assert session.feed(b"GET STA\n") == [b"STA 0"]
