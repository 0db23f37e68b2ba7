"""The arm and its controller: joints, power, safety, one program, inputs and outputs.

Knows no byte. The wires hand over programs, and see what is here; time is an input, in control
cycles of 2 ms (universal_robots.md 3 and 5). Currents, forces and temperatures are not emulated:
they read as of an arm that carries nothing.

Sections (§) are those of universal_robots.md.
"""

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from emulators.gripper_modbus import RobotiqDevice

from ._facts import CYCLE_S, JOINT_COUNT, JOINTS, UR5E, Joints6, UrFacts
from ._kinematics import flange_pose, inverse, jacobian, pose_of, pose_vector
from ._modes import EMERGENCY, RobotMode, RuntimeState, SafetyMode
from ._motion import LARGEST_ACCELERATION_RAD_PER_S2, ZERO, JointMove, Sample, Trajectory
from ._script import (
    Freedrive,
    MoveJ,
    Pose,
    Program,
    SetOutput,
    SetPayload,
    SetTcp,
    Sleep,
    Statement,
    StopJ,
    TextMessage,
)

# Typical of an e-Series arm; the guides give none of these.
BOOT_S: Final = 5.0  # from power on to idle
BRAKE_RELEASE_S: Final = 1.0  # from idle to running
SERVO_LAG_S: Final = 0.010  # time constant with which joints follow their set-points
REST_RAD: Final = 1e-6  # a smaller following error is friction's
SLIDER_RATE_PER_S: Final = 2.0  # how fast speed scaling follows the slider
STOP_RAD_PER_S2: Final = 8.0  # ramp of pause, stop, and of a program that another one replaces
PROTECTIVE_RAD_PER_S2: Final = LARGEST_ACCELERATION_RAD_PER_S2

DIGITAL_COUNT: Final = 18  # 8 standard, 8 configurable, 2 of the tool; §2.3
UNLOCK_S: Final = 5.0  # from a protective stop until it may be unlocked, §3.2
ESTOP: Final = "emergency stop"
START_RAD: Final[Joints6] = (0.0, -math.pi / 2, math.pi / 2, -math.pi / 2, -math.pi / 2, 0.0)
START_SPREAD_RAD: Final = 0.1  # a cold arm stands within this of the pose above, by the seed
_EPSILON_S: Final = 1e-9


@dataclass(frozen=True, slots=True)
class JointErrors:
    """Differences of the true joints from what the encoders read.

    Attributes
    ----------
    offset_rad : (6,) true joint minus reading
    """

    offset_rad: Joints6 = ZERO


PERFECT: Final = JointErrors()


@dataclass(frozen=True, slots=True)
class UrJoints:
    """The true joints.

    Attributes
    ----------
    q : base, shoulder, elbow, wrist 1, 2, 3 [rad]
    jaw_opening_mm : between the jaws of the gripper on the flange; 0 without one
    """

    q: Joints6
    jaw_opening_mm: float


@dataclass(frozen=True, slots=True)
class Message:
    """What the controller tells its clients about a program.

    Attributes
    ----------
    text : the message
    line, column : where in the program, from 1; 0 for a text of no program's line
    code : number of an error code, 0 for none
    """

    text: str
    line: int = 0
    column: int = 0
    code: int = 0


class UrArm:
    """One arm with its controller and the gripper on its flange.

    Parameters
    ----------
    facts : which model
    seed : seed of where it stands when it is switched on
    gripper : on the flange and supplied by it; None for none
    errors : true joints against encoders

    Attributes
    ----------
    q_rad, qd_rad_per_s : (6,) what the encoders read, which follows the set-points with a lag
    digital_inputs, digital_outputs : bits as on the wires: 0 to 7 standard, 8 to 15 configurable,
        16 and 17 the tool's
    analog_outputs : fractions of their range
    registers : input registers by name, as RTDE clients have set them
    line : of the program, the last one begun
    slider : fraction that the speed slider asks for
    is_remote : remote control is on; in local mode programs and most of the dashboard are refused
    on_cycle : called after every control cycle
    on_message : called with every message
    """

    def __init__(
        self,
        facts: UrFacts = UR5E,
        seed: int = 0,
        gripper: RobotiqDevice | None = None,
        errors: JointErrors = PERFECT,
    ) -> None:
        self.facts, self.gripper, self.errors = facts, gripper, errors
        rng = random.Random(seed)
        drawn = [q + rng.uniform(-START_SPREAD_RAD, START_SPREAD_RAD) for q in START_RAD]
        self._path = Trajectory(_six(drawn))
        self.q_rad: Joints6 = self._path.target.q
        self.qd_rad_per_s: Joints6 = ZERO
        self.robot_mode = RobotMode.POWER_OFF
        self.safety_mode = SafetyMode.NORMAL
        self.is_remote = True
        self.slider = 1.0
        self.speed_scaling = 1.0
        self.digital_inputs = 0
        self.digital_outputs = 0
        self.analog_outputs = [0.0, 0.0]
        self.registers: dict[str, Any] = {}
        self.payload_kg = 0.0
        self.payload_centre_m = (0.0, 0.0, 0.0)
        self.payload_inertia_kg_m2: Joints6 = ZERO
        self.tcp = Pose(ZERO)
        self.T_flange_tcp = np.eye(4)
        self.program_name = ""
        self.cycle_count = 0
        self.supply_change_count = 0
        self.stop_cause = ""
        self.on_cycle: list[Callable[[], None]] = []
        self.on_message: list[Callable[[Message], None]] = []
        self._state = RuntimeState.STOPPED
        self._left: list[tuple[int, Statement]] = []
        self._given_move: MoveJ | None = None
        self._is_freed = False
        self.line = 0
        self._wakes_in_s = 0.0
        self._mode_in_s = 0.0
        self._mode_goal = RobotMode.POWER_OFF
        self._stopped_s = 0.0
        self._owed_s = 0.0
        self._barriers: dict[tuple[int, int], float] = {}
        self._open_contacts: set[str] = set()
        self._power_gripper()

    @property
    def target(self) -> Sample:
        """The set-points of the joints."""
        return self._path.target

    # --- the world's side -----------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """Time since the controller was started [world s]."""
        return self.cycle_count * CYCLE_S

    @property
    def grasp_limit_mm(self) -> float | None:
        """Opening below which an object keeps the jaws from closing; None when empty."""
        return None if self.gripper is None else self.gripper.jaws.grasp_limit_mm

    @grasp_limit_mm.setter
    def grasp_limit_mm(self, limit_mm: float | None) -> None:
        if self.gripper is not None:
            self.gripper.jaws.grasp_limit_mm = limit_mm

    @property
    def jaw_force_n(self) -> float:
        """The jaws' force on an object."""
        return 0.0 if self.gripper is None else self.gripper.jaws.force_n

    def joints(self) -> UrJoints:
        """Return the true joints."""
        offset = self.errors.offset_rad
        q_rad = self.q_rad
        if any(offset):
            q_rad = _six([q + one for q, one in zip(q_rad, offset, strict=True)])
        return UrJoints(q_rad, 0.0 if self.gripper is None else self.gripper.jaws.opening_mm)

    def advance(self, dt_s: float) -> None:
        """Let time pass [world s], in whole control cycles; the rest is kept for the next call."""
        self._owed_s += dt_s
        while self._owed_s >= CYCLE_S - _EPSILON_S:
            self._owed_s -= CYCLE_S
            self._cycle()

    def place(self, q_rad: Sequence[float]) -> None:
        """Move the joints by hand, motors at rest; absolute encoders know it (6,) [rad]."""
        self._path.rest_at(_six(q_rad))
        self.q_rad, self.qd_rad_per_s = self.target.q, ZERO

    @property
    def yields(self) -> bool:
        """Whether the arm can be led by hand."""
        return self._is_freed and self._state is RuntimeState.PLAYING

    def lead(self, step_rad: Sequence[float]) -> None:
        """Turn the joints by hand, as far as their limits let them; an arm that holds stays.

        Parameters
        ----------
        step_rad : (6,) turn of each joint
        """
        if not self.yields:
            return
        limits = self.facts.limits_rad
        turned = [
            max(-limit, min(limit, q + step))
            for q, step, limit in zip(self.q_rad, step_rad, limits, strict=True)
        ]
        self._path.rest_at(_six(turned))
        self.q_rad, self.qd_rad_per_s = self.target.q, ZERO

    def obstruct(self, joint: int | str, direction: int, blocked: bool) -> None:
        """Put an obstacle where a joint is now, or take it away.

        A joint that drives into it stops the arm: a protective stop.

        Parameters
        ----------
        joint : number from 0, or name
        direction : +1 or -1, which direction is blocked
        blocked : an obstacle that is there already stays where it is

        Raises
        ------
        ValueError : there is no such joint
        """
        if joint not in JOINTS and joint not in range(JOINT_COUNT):
            raise ValueError(f"joint {joint}: none of {', '.join(JOINTS)}")
        number = JOINTS.index(joint) if isinstance(joint, str) else joint
        if blocked:
            self._barriers.setdefault((number, direction), self.q_rad[number])
        else:
            self._barriers.pop((number, direction), None)

    @property
    def has_supply(self) -> bool:
        """Whether all contacts of the safety chain are closed."""
        return not self._open_contacts

    def switch_supply(self, contact: str, is_closed: bool) -> None:
        """Close or open one of the contacts of the safety chain.

        An open one is an emergency stop: `ESTOP` the robot's own, any other the system's.
        """
        had_supply = self.has_supply
        if is_closed:
            self._open_contacts.discard(contact)
        else:
            self._open_contacts.add(contact)
        if self.has_supply != had_supply:
            self.supply_change_count += 1
        if self.has_supply:
            if self.safety_mode in EMERGENCY:
                self.safety_mode = SafetyMode.NORMAL
            return
        is_own = ESTOP in self._open_contacts
        self.safety_mode = (
            SafetyMode.ROBOT_EMERGENCY_STOP if is_own else SafetyMode.SYSTEM_EMERGENCY_STOP
        )
        self._end_program()
        self._path.slow_down(PROTECTIVE_RAD_PER_S2)

    def press_estop(self) -> None:
        """Push the emergency stop in."""
        self.switch_supply(ESTOP, False)

    def release_estop(self) -> None:
        """Pull it out; the arm stays without power until it is powered on."""
        self.switch_supply(ESTOP, True)

    def protective_stop(self, cause: str = "contact") -> None:
        """Stop as after a collision: at once, program paused, until it is unlocked."""
        if self.safety_mode is not SafetyMode.NORMAL:
            return
        self.safety_mode = SafetyMode.PROTECTIVE_STOP
        self.stop_cause, self._stopped_s = cause, 0.0
        self._pause()
        self._path.slow_down(PROTECTIVE_RAD_PER_S2)

    def safeguard_stop(self, *, is_open: bool) -> None:
        """Open or close the safeguard input; the program stays paused when it is closed again."""
        if is_open and self.safety_mode is SafetyMode.NORMAL:
            self.safety_mode = SafetyMode.SAFEGUARD_STOP
            self._pause()
            self._path.slow_down(STOP_RAD_PER_S2)
        elif not is_open and self.safety_mode is SafetyMode.SAFEGUARD_STOP:
            self.safety_mode = SafetyMode.NORMAL

    def restart(self) -> None:
        """Let the controller start anew, as after a loss of its supply; the brakes hold."""
        self._end_program()
        self._drop_power()
        self.cycle_count = 0
        self.digital_outputs, self.analog_outputs, self.registers = 0, [0.0, 0.0], {}
        self.slider = self.speed_scaling = 1.0
        self.payload_kg, self.payload_centre_m = 0.0, (0.0, 0.0, 0.0)
        self.payload_inertia_kg_m2 = ZERO
        self.tcp, self.T_flange_tcp = Pose(ZERO), np.eye(4)
        if self.safety_mode is SafetyMode.PROTECTIVE_STOP:
            self.safety_mode, self.stop_cause = SafetyMode.NORMAL, ""

    def start_running(self) -> None:
        """Be powered and without brakes at once."""
        self._go_to_mode(RobotMode.RUNNING, RobotMode.RUNNING, 0.0)
        self._power_gripper()

    def set_input(self, number: int, *, is_on: bool) -> None:
        """Switch a digital input, by its number in `digital_inputs`.

        Raises
        ------
        ValueError : there is no such input
        """
        if not 0 <= number < DIGITAL_COUNT:
            raise ValueError(f"digital input {number}: 0 to {DIGITAL_COUNT - 1}")
        bit = 1 << number
        self.digital_inputs = self.digital_inputs | bit if is_on else self.digital_inputs & ~bit

    # --- the panel and the dashboard --------------------------------------------------------------

    def set_remote(self, *, is_remote: bool) -> None:
        """Switch between remote and local control; a running program ends."""
        if is_remote != self.is_remote:
            self.is_remote = is_remote
            self.stop_program()

    def power_on(self) -> bool:
        """Begin to power the arm, and return whether it can be."""
        if self.safety_mode is not SafetyMode.NORMAL or not self.has_supply:
            return False
        if self.robot_mode is RobotMode.POWER_OFF:
            self._go_to_mode(RobotMode.BOOTING, RobotMode.IDLE, BOOT_S)
        return True

    def release_brakes(self) -> bool:
        """Begin to release the brakes, after power; return whether they can be."""
        if not self.power_on():
            return False
        if self.robot_mode is RobotMode.IDLE:
            self._go_to_mode(RobotMode.IDLE, RobotMode.RUNNING, BRAKE_RELEASE_S)
        elif self.robot_mode is not RobotMode.RUNNING:
            self._mode_goal = RobotMode.RUNNING
        return True

    def power_off(self) -> None:
        """Take the arm's power away; the brakes hold it."""
        self._end_program()
        self._drop_power()

    def unlock_protective_stop(self) -> bool:
        """End a protective stop; return whether it is long enough ago."""
        if self.safety_mode is not SafetyMode.PROTECTIVE_STOP:
            return True
        if self._stopped_s < UNLOCK_S - _EPSILON_S:
            return False
        self.safety_mode, self.stop_cause = SafetyMode.NORMAL, ""
        return True

    # --- programs -------------------------------------------------------------------------------

    @property
    def runtime_state(self) -> RuntimeState:
        """The state of the program."""
        if self._state is RuntimeState.PAUSED and self._path.is_ramping:
            return RuntimeState.PAUSING
        if self._state is RuntimeState.STOPPED and self._path.is_ramping:
            return RuntimeState.STOPPING
        return self._state

    @property
    def is_program_running(self) -> bool:
        """Whether a program runs or is paused."""
        return self._state is not RuntimeState.STOPPED

    def start(self, program: Program) -> str:
        """Run a program in place of the present one; beside it, if it is a secondary one.

        Returns
        -------
        why it is refused, empty where it runs
        """
        if self.robot_mode is not RobotMode.RUNNING:
            return f"program refused: robot mode is {self.robot_mode.name}"
        if self.safety_mode not in (SafetyMode.NORMAL, SafetyMode.REDUCED):
            return f"program refused: safety mode is {self.safety_mode.name}"
        if program.is_secondary:
            for step in program.steps:
                self._begin(step)
            return ""
        self._left, self._is_freed = list(program.steps), False
        self.program_name = program.name
        self._wakes_in_s = 0.0
        self._state = RuntimeState.PLAYING
        if self._left and isinstance(self._left[0][1], StopJ):
            self._begin(self._left.pop(0))
        else:
            self._path.slow_down(STOP_RAD_PER_S2)
        return ""

    def play(self) -> bool:
        """Go on with a paused program; return whether there is one and the arm may move."""
        is_free = self.robot_mode is RobotMode.RUNNING and self.safety_mode is SafetyMode.NORMAL
        if self._state is not RuntimeState.PAUSED or not is_free:
            return False
        self._state = RuntimeState.PLAYING
        return True

    def pause(self) -> bool:
        """Slow down and keep the program; return whether one runs."""
        if self._state is not RuntimeState.PLAYING:
            return False
        self._pause()
        self._path.slow_down(STOP_RAD_PER_S2)
        return True

    def stop_program(self) -> bool:
        """Slow down and drop the program; return whether there is one."""
        if self._state is RuntimeState.STOPPED:
            return False
        self._end_program()
        self._path.slow_down(STOP_RAD_PER_S2)
        return True

    def say(self, message: Message) -> None:
        """Tell all clients that read messages."""
        for listener in self.on_message:
            listener(message)

    def _pause(self) -> None:
        if self._state is not RuntimeState.PLAYING:
            return
        self._state = RuntimeState.PAUSED
        if self._path.is_moving and self._given_move is not None:  # its rest begins at rest
            rest = replace(self._given_move, goal=self._path.goal)
            self._left.insert(0, (self.line, rest))

    def _end_program(self) -> None:
        self._state, self._is_freed = RuntimeState.STOPPED, False
        self._left, self._wakes_in_s = [], 0.0

    def _fail(self, text: str) -> None:
        """End the program by an error of its own."""
        self._end_program()
        self._path.slow_down(STOP_RAD_PER_S2)
        self.say(Message(text, line=self.line, column=1))

    # --- one control cycle ------------------------------------------------------------------------

    def _cycle(self) -> None:
        self.cycle_count += 1
        if self.gripper is not None:
            self.gripper.advance(CYCLE_S)
        self._pass_mode()
        if self.safety_mode is SafetyMode.PROTECTIVE_STOP:
            self._stopped_s += CYCLE_S
        if self.speed_scaling != self.slider:
            step = SLIDER_RATE_PER_S * CYCLE_S
            change = max(-step, min(step, self.slider - self.speed_scaling))
            self.speed_scaling += change
        if self._path.is_ramping:
            self._take(self._path.step(CYCLE_S, 1.0))
        elif self._state is RuntimeState.PLAYING:
            self._run_program()
        if self.q_rad != self.target.q or any(self.qd_rad_per_s):
            self._follow()
        for listener in self.on_cycle:
            listener()

    def _pass_mode(self) -> None:
        if self.safety_mode in EMERGENCY and not self._path.is_ramping:
            self._drop_power()
        if self._mode_in_s <= 0.0:
            return
        self._mode_in_s -= CYCLE_S
        if self._mode_in_s > _EPSILON_S:
            return
        self._mode_in_s = 0.0
        if self.robot_mode is RobotMode.BOOTING:
            self.robot_mode = RobotMode.IDLE
            self._power_gripper()
            if self._mode_goal is RobotMode.RUNNING:
                self._mode_in_s = BRAKE_RELEASE_S
        else:
            self.robot_mode = self._mode_goal

    def _go_to_mode(self, now: RobotMode, goal: RobotMode, in_s: float) -> None:
        self.robot_mode, self._mode_goal, self._mode_in_s = now, goal, in_s

    def _drop_power(self) -> None:
        if self.robot_mode is not RobotMode.POWER_OFF or self._mode_in_s:
            self._go_to_mode(RobotMode.POWER_OFF, RobotMode.POWER_OFF, 0.0)
            self._path.rest_at(self.q_rad)  # the brakes fall in
            self.qd_rad_per_s = ZERO
            self._power_gripper()

    def _power_gripper(self) -> None:
        """Supply the gripper by the tool connector, which has 24 V while the arm is powered."""
        if self.gripper is not None:
            self.gripper.is_powered = self.robot_mode in (RobotMode.IDLE, RobotMode.RUNNING)

    def _run_program(self) -> None:
        if self._path.is_moving:
            self._take(self._path.step(CYCLE_S, self.speed_scaling))
            if self._state is not RuntimeState.PLAYING:
                return  # stopped by an obstacle
            if self._path.is_moving:
                self._blend()
                return
        elif self._wakes_in_s > 0.0:
            self._wakes_in_s -= CYCLE_S
            return
        if self._left:
            self._begin(self._left.pop(0))
        else:
            self._end_program()

    def _blend(self) -> None:
        """Begin the next move within the blend radius of the present one's goal."""
        radius_m = 0.0 if self._given_move is None else self._given_move.blend_m
        if radius_m == 0.0 or not self._left:
            return
        line, following = self._left[0]
        if not isinstance(following, MoveJ):
            return
        here, there = (self.tcp_pose(q)[:3] for q in (self.target.q, self._path.goal))
        if math.dist(here, there) > radius_m:
            return
        goal = self._goal_of(following, self._path.goal)
        if isinstance(goal, str):
            return  # fails when its turn comes
        move = self._joint_move(following, self._path.goal, goal)
        if self._path.may_blend_into(move):
            self._left.pop(0)
            self.line, self._given_move = line, following
            self._path.begin(move)

    def _begin(self, step: tuple[int, Statement]) -> None:
        self.line, statement = step
        match statement:
            case MoveJ():
                self._begin_move(statement)
            case StopJ(deceleration_rad_per_s2=deceleration):
                self._path.slow_down(min(deceleration, LARGEST_ACCELERATION_RAD_PER_S2))
            case Sleep(duration_s=duration_s):
                self._wakes_in_s = duration_s
            case SetOutput(number=number, is_on=is_on):
                self.set_output(number, is_on=is_on)
            case SetPayload():
                self._set_payload(statement)
            case SetTcp(pose=pose):
                self.tcp, self.T_flange_tcp = pose, pose_of(pose.values)
            case Freedrive(is_on=is_on):
                self._is_freed = is_on
            case TextMessage(text=text):
                self.say(Message(text))

    def _begin_move(self, move: MoveJ) -> None:
        if self._is_freed:
            self._fail("move_in_freedrive_mode:")
            return
        goal = self._goal_of(move, self.target.q)
        if isinstance(goal, str):
            self._fail(goal)
            return
        self._given_move = move
        self._path.begin(self._joint_move(move, self.target.q, goal))

    def _goal_of(self, move: MoveJ, near_rad: Joints6) -> Joints6 | str:
        """Return the joints at a move's goal, or why there are none."""
        goal = move.goal
        if isinstance(goal, Pose):
            T_base_flange = pose_of(goal.values) @ np.linalg.inv(self.T_flange_tcp)
            reached = inverse(self.facts, T_base_flange, near_rad)
            if not reached:
                return f"inverse_kinematics_no_solution:p{list(goal.values)}:"
            return reached[0]
        for name, q, limit in zip(JOINTS, goal, self.facts.limits_rad, strict=True):
            if abs(q) > limit:
                return f"joint_position_out_of_limits:{name}={q:.4f}:"
        return goal

    def _joint_move(self, move: MoveJ, start: Joints6, goal: Joints6) -> JointMove:
        return JointMove(
            start,
            goal,
            move.speed_rad_per_s,
            min(move.acceleration_rad_per_s2, LARGEST_ACCELERATION_RAD_PER_S2),
            self.facts.speed_limits_rad_per_s,
            move.duration_s,
        )

    def _set_payload(self, given: SetPayload) -> None:
        if given.mass_kg > self.facts.payload_max_kg:
            self._fail(f"payload_out_of_range:{given.mass_kg:g}:")
            return
        self.payload_kg = given.mass_kg
        if given.centre_m is not None:
            self.payload_centre_m = given.centre_m
        if given.inertia_kg_m2 is not None:
            self.payload_inertia_kg_m2 = given.inertia_kg_m2

    def set_output(self, number: int, *, is_on: bool) -> None:
        """Switch a digital output, by its number in `digital_outputs`."""
        bit = 1 << number
        self.digital_outputs = self.digital_outputs | bit if is_on else self.digital_outputs & ~bit

    def _take(self, sample: Sample) -> None:
        """Take over set-points, unless one lies behind an obstacle."""
        for (joint, direction), at in self._barriers.items():
            if (sample.q[joint] - at) * direction > 0.0 and sample.qd[joint] * direction > 0.0:
                self.protective_stop(f"contact of {JOINTS[joint]}")
                self._path.rest_at(self.q_rad)
                return
        self._path.target = sample

    def _follow(self) -> None:
        """Let the joints follow their set-points with the servo's lag."""
        share = 1.0 - math.exp(-CYCLE_S / SERVO_LAG_S)
        after = []
        for q, goal, barred in zip(self.q_rad, self.target.q, range(JOINT_COUNT), strict=True):
            left = goal - q
            step = left if abs(left) < REST_RAD else left * share
            direction = 1 if step > 0.0 else -1
            barrier = self._barriers.get((barred, direction))
            if barrier is not None and (q + step - barrier) * direction > 0.0:
                step = 0.0
            after.append(q + step)
        self.qd_rad_per_s = _six(
            [(b - a) / CYCLE_S for a, b in zip(self.q_rad, after, strict=True)]
        )
        self.q_rad = _six(after)

    # --- the TCP ----------------------------------------------------------------------------------

    def tcp_pose(self, q_rad: Joints6) -> Joints6:
        """Return the pose vector of the TCP in the base's frame (m, rad)."""
        return pose_vector(flange_pose(self.facts, q_rad) @ self.T_flange_tcp)

    def tcp_speed(self, q_rad: Joints6, qd_rad_per_s: Joints6) -> Joints6:
        """Return the speed of the TCP in the base's frame (m/s, rad/s)."""
        if not any(qd_rad_per_s):
            return ZERO
        twist = jacobian(self.facts, q_rad, self.T_flange_tcp) @ np.array(qd_rad_per_s)
        twist[:3] /= 1000.0
        return _six([float(value) for value in twist])


def _six(values: Sequence[float]) -> Joints6:
    one, two, three, four, five, six = values
    return one, two, three, four, five, six
