"""The fields of RTDE: their types, and what the arm has to say for each; universal_robots.md 2.3.

Currents, moments, forces and temperatures are not emulated: they read as of an arm at rest that
carries nothing. The registers of outputs stay 0, since no program of the subset writes them.
"""

import struct
from collections.abc import Callable, Mapping
from typing import Any, Final

from .._facts import JOINT_COUNT
from .._kinematics import flange_pose, link_poses
from .._model import UrArm
from .._modes import EMERGENCY, JointMode, RobotMode, SafetyMode
from .._motion import ZERO

FORMATS: Final[Mapping[str, str]] = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
NOT_FOUND: Final = "NOT_FOUND"
IN_USE: Final = "IN_USE"
SUPPLY_V: Final = 48.0  # of the robot and its joints
AMBIENT_C: Final = 25.0
EARTH_M_PER_S2: Final = 9.82  # as the controller has it by default

_SAFETY_BITS: Final[Mapping[SafetyMode, int]] = {
    SafetyMode.NORMAL: 1 << 0,
    SafetyMode.REDUCED: 1 << 1,
    SafetyMode.PROTECTIVE_STOP: 1 << 2 | 1 << 10,
    SafetyMode.RECOVERY: 1 << 3,
    SafetyMode.SAFEGUARD_STOP: 1 << 4 | 1 << 10,
    SafetyMode.SYSTEM_EMERGENCY_STOP: 1 << 5 | 1 << 7 | 1 << 10,
    SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7 | 1 << 10,
    SafetyMode.VIOLATION: 1 << 8 | 1 << 10,
    SafetyMode.FAULT: 1 << 9 | 1 << 10,
}


def joint_mode(arm: UrArm) -> JointMode:
    """Return the mode of all joints."""
    return {
        RobotMode.POWER_OFF: JointMode.POWER_OFF,
        RobotMode.BOOTING: JointMode.BOOTING,
        RobotMode.RUNNING: JointMode.RUNNING,
    }.get(arm.robot_mode, JointMode.IDLE)


def safety_bits(arm: UrArm) -> int:
    """Return safety_status_bits."""
    return _SAFETY_BITS[arm.safety_mode]


def is_powered(arm: UrArm) -> bool:
    """Return whether the joints have power."""
    return arm.robot_mode in (RobotMode.POWER_ON, RobotMode.IDLE, RobotMode.RUNNING)


def is_emergency(arm: UrArm) -> bool:
    """Return whether some emergency stop is pressed."""
    return arm.safety_mode in EMERGENCY


def _robot_bits(arm: UrArm) -> int:
    # bit 0 power on, bit 1 program running; the two buttons of the pendant are never pressed
    return int(is_powered(arm)) | int(arm.is_program_running) << 1


def _supply(arm: UrArm) -> float:
    return SUPPLY_V if is_powered(arm) else 0.0


def elbow_m(arm: UrArm) -> tuple[float, float, float]:
    """Return the elbow's position in the base's frame [m]."""
    x, y, z = (float(value) / 1000.0 for value in link_poses(arm.facts, arm.q_rad)[1][:3, 3])
    return x, y, z


def tool_volts(arm: UrArm) -> int:
    """Return the voltage at the tool connector: 24 V for a gripper there."""
    return 24 if arm.gripper is not None and is_powered(arm) else 0


Getter = Callable[[UrArm], Any]

OUTPUTS: Final[dict[str, tuple[str, Getter]]] = {
    "timestamp": ("DOUBLE", lambda arm: arm.time_s),
    "target_q": ("VECTOR6D", lambda arm: arm.target.q),
    "target_qd": ("VECTOR6D", lambda arm: arm.target.qd),
    "target_qdd": ("VECTOR6D", lambda arm: arm.target.qdd),
    "target_current": ("VECTOR6D", lambda arm: ZERO),
    "target_moment": ("VECTOR6D", lambda arm: ZERO),
    "actual_q": ("VECTOR6D", lambda arm: arm.q_rad),
    "actual_qd": ("VECTOR6D", lambda arm: arm.qd_rad_per_s),
    "actual_current": ("VECTOR6D", lambda arm: ZERO),
    "actual_current_window": ("VECTOR6D", lambda arm: ZERO),
    "joint_control_output": ("VECTOR6D", lambda arm: ZERO),
    "actual_TCP_pose": ("VECTOR6D", lambda arm: arm.tcp_pose(arm.q_rad)),
    "actual_TCP_speed": ("VECTOR6D", lambda arm: arm.tcp_speed(arm.q_rad, arm.qd_rad_per_s)),
    "actual_TCP_force": ("VECTOR6D", lambda arm: ZERO),
    "target_TCP_pose": ("VECTOR6D", lambda arm: arm.tcp_pose(arm.target.q)),
    "target_TCP_speed": ("VECTOR6D", lambda arm: arm.tcp_speed(arm.target.q, arm.target.qd)),
    "tcp_offset": ("VECTOR6D", lambda arm: arm.tcp.values),
    "actual_digital_input_bits": ("UINT64", lambda arm: arm.digital_inputs),
    "joint_temperatures": ("VECTOR6D", lambda arm: (AMBIENT_C,) * JOINT_COUNT),
    "actual_execution_time": ("DOUBLE", lambda arm: 0.0),
    "robot_mode": ("INT32", lambda arm: int(arm.robot_mode)),
    "joint_mode": ("VECTOR6INT32", lambda arm: (int(joint_mode(arm)),) * JOINT_COUNT),
    "safety_mode": ("INT32", lambda arm: int(arm.safety_mode)),
    "safety_status": ("INT32", lambda arm: int(arm.safety_mode)),
    "actual_tool_accelerometer": ("VECTOR3D", lambda arm: _gravity_at_tool(arm)),
    "speed_scaling": ("DOUBLE", lambda arm: arm.speed_scaling),
    "target_speed_fraction": ("DOUBLE", lambda arm: arm.slider),
    "actual_momentum": ("DOUBLE", lambda arm: 0.0),
    "actual_main_voltage": ("DOUBLE", lambda arm: SUPPLY_V),
    "actual_robot_voltage": ("DOUBLE", _supply),
    "actual_robot_current": ("DOUBLE", lambda arm: 0.0),
    "actual_joint_voltage": ("VECTOR6D", lambda arm: (_supply(arm),) * JOINT_COUNT),
    "actual_digital_output_bits": ("UINT64", lambda arm: arm.digital_outputs),
    "runtime_state": ("UINT32", lambda arm: int(arm.runtime_state)),
    "elbow_position": ("VECTOR3D", elbow_m),
    "elbow_velocity": ("VECTOR3D", lambda arm: (0.0, 0.0, 0.0)),
    "robot_status_bits": ("UINT32", _robot_bits),
    "safety_status_bits": ("UINT32", safety_bits),
    "analog_io_types": ("UINT32", lambda arm: 0),
    "standard_analog_input0": ("DOUBLE", lambda arm: 0.0),
    "standard_analog_input1": ("DOUBLE", lambda arm: 0.0),
    "standard_analog_output0": ("DOUBLE", lambda arm: arm.analog_outputs[0]),
    "standard_analog_output1": ("DOUBLE", lambda arm: arm.analog_outputs[1]),
    "io_current": ("DOUBLE", lambda arm: 0.0),
    "euromap67_input_bits": ("UINT32", lambda arm: 0),
    "euromap67_output_bits": ("UINT32", lambda arm: 0),
    "euromap67_24V_voltage": ("DOUBLE", lambda arm: 0.0),
    "euromap67_24V_current": ("DOUBLE", lambda arm: 0.0),
    "tool_mode": ("UINT32", lambda arm: int(joint_mode(arm))),
    "tool_analog_input_types": ("UINT32", lambda arm: 0),
    "tool_analog_input0": ("DOUBLE", lambda arm: 0.0),
    "tool_analog_input1": ("DOUBLE", lambda arm: 0.0),
    "tool_output_voltage": ("INT32", tool_volts),
    "tool_output_current": ("DOUBLE", lambda arm: 0.0),
    "tool_temperature": ("DOUBLE", lambda arm: AMBIENT_C),
    "tool_output_mode": ("UINT8", lambda arm: 0),
    "tool_digital_output0_mode": ("UINT8", lambda arm: 0),
    "tool_digital_output1_mode": ("UINT8", lambda arm: 0),
    "tcp_force_scalar": ("DOUBLE", lambda arm: 0.0),
    "joint_position_deviation_ratio": ("DOUBLE", lambda arm: 0.0),
    "collision_detection_ratio": ("DOUBLE", lambda arm: 0.0),
    "ft_raw_wrench": ("VECTOR6D", lambda arm: ZERO),
    "payload": ("DOUBLE", lambda arm: arm.payload_kg),
    "payload_cog": ("VECTOR3D", lambda arm: arm.payload_centre_m),
    "payload_inertia": ("VECTOR6D", lambda arm: arm.payload_inertia_kg_m2),
    "script_control_line": ("UINT32", lambda arm: arm.line if arm.is_program_running else 0),
    "output_bit_registers0_to_31": ("UINT32", lambda arm: 0),
    "output_bit_registers32_to_63": ("UINT32", lambda arm: 0),
    **{f"output_bit_register_{n}": ("BOOL", lambda arm: False) for n in range(64, 128)},
    **{f"output_int_register_{n}": ("INT32", lambda arm: 0) for n in range(48)},
    **{f"output_double_register_{n}": ("DOUBLE", lambda arm: 0.0) for n in range(48)},
}

INPUTS: Final[dict[str, str]] = {
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    "standard_digital_output_mask": "UINT8",
    "standard_digital_output": "UINT8",
    "configurable_digital_output_mask": "UINT8",
    "configurable_digital_output": "UINT8",
    "tool_digital_output_mask": "UINT8",
    "tool_digital_output": "UINT8",
    "standard_analog_output_mask": "UINT8",
    "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",
    "input_bit_registers0_to_31": "UINT32",
    "input_bit_registers32_to_63": "UINT32",
    **{f"input_bit_register_{n}": "BOOL" for n in range(64, 128)},
    **{f"input_int_register_{n}": "INT32" for n in range(48)},
    **{f"input_double_register_{n}": "DOUBLE" for n in range(48)},
}
_ZEROS: Final[Mapping[str, Any]] = {"BOOL": False, "DOUBLE": 0.0, "VECTOR6D": ZERO}


def input_register(name: str) -> tuple[str, Getter] | None:
    """Return type and getter of an input register read back as an output, None if there is none."""
    if not name.startswith("input_") or name not in INPUTS:
        return None
    kind = INPUTS[name]
    zero = _ZEROS.get(kind, 0)
    return kind, lambda arm: arm.registers.get(name, zero)


def _gravity_at_tool(arm: UrArm) -> tuple[float, float, float]:
    R_base_flange = flange_pose(arm.facts, arm.q_rad)[:3, :3]
    x, y, z = (float(value) * EARTH_M_PER_S2 for value in R_base_flange[2])
    return x, y, z


def apply_inputs(arm: UrArm, values: Mapping[str, Any]) -> None:
    """Let what a client has sent take effect; masks say which bits and values count."""
    if values.get("speed_slider_mask"):
        arm.slider = min(1.0, max(0.0, float(values.get("speed_slider_fraction", arm.slider))))
    for bank, first, count in (("standard", 0, 8), ("configurable", 8, 8), ("tool", 16, 2)):
        mask = values.get(f"{bank}_digital_output_mask", 0)
        level = values.get(f"{bank}_digital_output", 0)
        for bit in range(count):
            if mask >> bit & 1:
                arm.set_output(first + bit, is_on=bool(level >> bit & 1))
    mask = values.get("standard_analog_output_mask", 0)
    for number in range(2):
        if mask >> number & 1:
            share = float(values.get(f"standard_analog_output_{number}", 0.0))
            arm.analog_outputs[number] = min(1.0, max(0.0, share))
    for name, value in values.items():
        if name.startswith("input_"):
            arm.registers[name] = value


def pack(kinds: list[str], values: list[Any]) -> bytes:
    """Return values in the layout of their types, big-endian."""
    flat: list[Any] = []
    for kind, value in zip(kinds, values, strict=True):
        if kind.startswith("VECTOR"):
            flat += value
        else:
            flat.append(value)
    return struct.pack(">" + "".join(FORMATS[kind] for kind in kinds), *flat)
