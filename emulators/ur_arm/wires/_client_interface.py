"""The client interfaces 30001 to 30003: packets of state and messages; universal_robots.md 4.

Sections (§) are those of universal_robots.md.
"""

import struct
from collections.abc import Sequence
from typing import Final

from .._facts import DH_ALPHA_RAD, JOINT_COUNT, Software
from .._model import Message, UrArm
from .._modes import RuntimeState, SafetyMode
from .._motion import LARGEST_ACCELERATION_RAD_PER_S2, ZERO
from ._fields import (
    AMBIENT_C,
    EARTH_M_PER_S2,
    SUPPLY_V,
    elbow_m,
    is_emergency,
    is_powered,
    joint_mode,
    tool_volts,
)

ROBOT_STATE: Final = 16
ROBOT_MESSAGE: Final = 20
_TEXT, _VERSION, _ERROR_CODE, _EXCEPTION = 0, 3, 6, 10  # kinds of messages, §4.2
_FROM_ROBOT, _FROM_CONTROLLER = -2, 7  # sources of messages, §4.2
_VIOLATION_LEVEL: Final = 3  # report level, §4.2
READ_ONLY_CODE: Final = 210  # a program on a connection that may only read, §4.2
BUILT: Final = b"2021-03-11, 00:00:00"
# default speed and acceleration of joints and tool, and the equivalent radius [rad/s, rad/s^2, m/s,
# m/s^2, m]
_DEFAULTS: Final = (1.05, 1.4, 0.25, 1.2, 0.1)


def _packet(kind: int, payload: bytes) -> bytes:
    return struct.pack(">IB", 5 + len(payload), kind) + payload


def _microseconds(arm: UrArm) -> int:
    return round(arm.time_s * 1e6)


# --- messages -------------------------------------------------------------------------------------


def version_message(arm: UrArm, software: Software) -> bytes:
    """Return the message that greets a client."""
    name = b"URControl"
    body = struct.pack(">B", len(name)) + name
    body += struct.pack(">BBiI", software.major, software.minor, software.bugfix, software.build)
    return _message(arm, _FROM_ROBOT, _VERSION, body + BUILT)


def message_packet(arm: UrArm, message: Message) -> bytes:
    """Return what the controller tells about a program."""
    text = message.text.encode()
    if message.code:
        body = struct.pack(">iiiII", message.code, 0, _VIOLATION_LEVEL, 0, 0) + text
        return _message(arm, _FROM_CONTROLLER, _ERROR_CODE, body)
    if message.line:
        body = struct.pack(">ii", message.line, message.column) + text
        return _message(arm, _FROM_CONTROLLER, _EXCEPTION, body)
    return _message(arm, _FROM_CONTROLLER, _TEXT, text)


def _message(arm: UrArm, source: int, kind: int, body: bytes) -> bytes:
    return _packet(ROBOT_MESSAGE, struct.pack(">QbB", _microseconds(arm), source, kind) + body)


# --- the state of 30001 and 30002 -----------------------------------------------------------------


def state_packet(arm: UrArm, software: Software, *, is_first: bool = False) -> bytes:
    """Return one packet of state.

    Parameters
    ----------
    arm, software : the controller
    is_first : with the kinematics and the configuration, which only the first one has
    """
    parts = [
        _robot_mode(arm, software),
        _joints(arm),
        _tool(arm),
        _master_board(arm, software),
        _cartesian(arm, software),
    ]
    if is_first:
        parts += [_kinematics(arm), _configuration(arm)]
    parts.append(_packet(7, struct.pack(">7d", *ZERO, 0.0)))  # force mode
    parts.append(_packet(8, bytes(4 if software.is_at_least(5, 0) else 2)))  # teach button
    return _packet(ROBOT_STATE, b"".join(parts))


def _robot_mode(arm: UrArm, software: Software) -> bytes:
    body = struct.pack(
        ">Q7?BBdd",
        _microseconds(arm),
        True,
        True,
        is_powered(arm),
        is_emergency(arm),
        arm.safety_mode is SafetyMode.PROTECTIVE_STOP,
        arm.runtime_state is RuntimeState.PLAYING,
        arm.runtime_state in (RuntimeState.PAUSING, RuntimeState.PAUSED),
        arm.robot_mode,
        0,  # control mode: position
        arm.slider,
        arm.speed_scaling,
    )
    if software.is_at_least(3, 2):
        body += struct.pack(">d", 1.0)  # the most that the slider may ask for
    if software.is_at_least(3, 5):
        body += b"\0"
    return _packet(0, body)


def _joints(arm: UrArm) -> bytes:
    mode = joint_mode(arm)
    volts = SUPPLY_V if is_powered(arm) else 0.0
    return _packet(
        1,
        b"".join(
            struct.pack(
                ">dddffffB",
                arm.q_rad[number],
                arm.target.q[number],
                arm.qd_rad_per_s[number],
                0.0,
                volts,
                AMBIENT_C,
                AMBIENT_C,
                mode,
            )
            for number in range(JOINT_COUNT)
        ),
    )


def _tool(arm: UrArm) -> bytes:
    volts = SUPPLY_V if is_powered(arm) else 0.0
    body = struct.pack(
        ">BBddfBffB", 0, 0, 0.0, 0.0, volts, tool_volts(arm), 0.0, AMBIENT_C, joint_mode(arm)
    )
    return _packet(2, body)


def _master_board(arm: UrArm, software: Software) -> bytes:
    body = struct.pack(
        ">iiBBddBBddffffBBB",
        arm.digital_inputs,
        arm.digital_outputs,
        0,
        0,
        0.0,
        0.0,
        0,
        0,
        *arm.analog_outputs,
        AMBIENT_C,
        SUPPLY_V if is_powered(arm) else 0.0,
        0.0,
        0.0,
        arm.safety_mode,
        arm.safety_mode is SafetyMode.REDUCED,
        0,
    )
    body += bytes(4)
    if software.is_at_least(5, 0):
        body += bytes(3)
    return _packet(3, body)


def _cartesian(arm: UrArm, software: Software) -> bytes:
    values: Sequence[float] = arm.tcp_pose(arm.q_rad)
    if software.is_at_least(3, 2):
        values = (*values, *arm.tcp.values)
    return _packet(4, struct.pack(f">{len(values)}d", *values))


def _kinematics(arm: UrArm) -> bytes:
    """Return the links as this arm has them; nobody has calibrated it."""
    a = [value / 1000.0 for value in arm.facts.dh_a_mm]
    d = [value / 1000.0 for value in arm.facts.dh_d_mm]
    return _packet(5, struct.pack(">6I24dI", *[0] * 6, *ZERO, *a, *d, *DH_ALPHA_RAD, 0))


def _configuration(arm: UrArm) -> bytes:
    facts = arm.facts
    limits = [value for limit in facts.limits_rad for value in (-limit, limit)]
    speeds = [
        value
        for speed in facts.speed_limits_rad_per_s
        for value in (speed, LARGEST_ACCELERATION_RAD_PER_S2)
    ]
    a = [value / 1000.0 for value in facts.dh_a_mm]
    d = [value / 1000.0 for value in facts.dh_d_mm]
    body = struct.pack(
        ">12d12d5d24d4i",
        *limits,
        *speeds,
        *_DEFAULTS,
        *a,
        *d,
        *DH_ALPHA_RAD,
        *ZERO,
        0,
        0,
        facts.number,
        0,
    )
    return _packet(6, body)


# --- the state of 30003 ---------------------------------------------------------------------------


def realtime_packet(arm: UrArm, software: Software) -> bytes:
    """Return one packet of the real-time client interface."""
    volts = SUPPLY_V if is_powered(arm) else 0.0
    pose, target_pose = arm.tcp_pose(arm.q_rad), arm.tcp_pose(arm.target.q)
    values: list[float] = [
        arm.time_s,
        *arm.target.q,
        *arm.target.qd,
        *arm.target.qdd,
        *ZERO,  # currents
        *ZERO,  # moments
        *arm.q_rad,
        *arm.qd_rad_per_s,
        *ZERO,  # currents
        *ZERO,  # control currents
        *pose,
        *arm.tcp_speed(arm.q_rad, arm.qd_rad_per_s),
        *ZERO,  # force
        *target_pose,
        *arm.tcp_speed(arm.target.q, arm.target.qd),
        float(arm.digital_inputs),
        *(AMBIENT_C,) * JOINT_COUNT,
        0.0,
        0.0,
        float(arm.robot_mode),
        *(float(joint_mode(arm)),) * JOINT_COUNT,
        float(arm.safety_mode),
        *ZERO,  # for the maker
        0.0,
        0.0,
        EARTH_M_PER_S2,
        *ZERO,  # for the maker
        arm.speed_scaling,
        0.0,
        0.0,
        0.0,
        SUPPLY_V,
        volts,
        0.0,
        *(volts,) * JOINT_COUNT,
        float(arm.digital_outputs),
        float(arm.runtime_state),
    ]
    if software.is_at_least(5, 0):
        values += [*elbow_m(arm), 0.0, 0.0, 0.0]
    if software.is_at_least(5, 4):
        values.append(float(arm.safety_mode))
    if software.is_at_least(5, 9):
        values += [0.0, 0.0, 0.0]
    if software.is_at_least(5, 10):
        values += [arm.payload_kg, *arm.payload_centre_m, *arm.payload_inertia_kg_m2]
    return struct.pack(f">I{len(values)}d", 4 + 8 * len(values), *values)
