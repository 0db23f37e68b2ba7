"""The arm as a body: seven motors, their stops, and time as an input.

Knows no byte. The wire passes on the bytes sent to the IPs; the world sets the obstacles and reads
the joints. umi_rtx.md 5 and 7.
"""

import math
import random
from collections.abc import Iterator
from typing import Final

from ._axes import (
    CONTROLLER_COUNT,
    FACTS,
    IP_COUNT,
    PITCH_LIMITS_COUNTS,
    ROLL_LIMITS_COUNTS,
    YAW_COUNTS_PER_ELBOW_COUNT,
    YAW_TO_ELBOW_LIMIT_COUNTS,
    ArmJoints,
    Axis,
    gripper_mm_to_counts,
    joints_of,
)
from ._errors import PERFECT, ArmErrors
from ._motor import LAG_S, Drive, Motor

MAX_STEP_S: Final = 1.0 / 240.0  # longer steps are cut, so that a test may hand in seconds
# A cold arm stands anywhere, but high enough and folded little enough to home without a crash:
# fractions of each range, [true counts] for zed
START_ZED_COUNTS: Final = (-600.0, -50.0)
START_FRACTION: Final = 0.5
ZED_LIMITS, SHOULDER_LIMITS, ELBOW_LIMITS, GRIPPER_LIMITS = (
    (FACTS[axis].lower_counts, FACTS[axis].upper_counts)
    for axis in (Axis.ZED, Axis.SHOULDER, Axis.ELBOW, Axis.GRIPPER)
)
ESTOP: Final = "emergency stop"
JAW_FORCE_N: Final = 150.0  # at MAX_FORCE 100; our choice, umi_rtx.md gives none
YAW_IP, GRIPPER_IP = FACTS[Axis.YAW].ip, FACTS[Axis.GRIPPER].ip


class ArmModel:
    """Motors, stops and couplings of one arm.

    Parameters
    ----------
    seed : seed of the true positions at power-up, which nobody but the world can know
    errors : differences of this arm from its description
    """

    def __init__(self, seed: int = 0, errors: ArmErrors = PERFECT) -> None:
        self.errors, self._is_perfect = errors, errors == PERFECT
        self.motors: list[list[Motor]] = [
            [Motor(exists=False) for _ in range(CONTROLLER_COUNT)] for _ in range(IP_COUNT)
        ]
        self.axes: dict[Axis, Motor] = {}
        for axis, facts in FACTS.items():
            motor = Motor(facts.nominal_counts_per_s, facts.max_force)
            self.motors[facts.ip][facts.ctl] = self.axes[axis] = motor
        self._by_ip = [[m for m in ip if m.exists] for ip in self.motors]
        self._all = [(self.axes[axis], FACTS[axis].ip) for axis in Axis]
        # looked up once: an Enum's hash is too slow for every step of a world
        self._zed, self._shoulder = self.axes[Axis.ZED], self.axes[Axis.SHOULDER]
        self._elbow, self._yaw = self.axes[Axis.ELBOW], self.axes[Axis.YAW]
        self._gripper = self.axes[Axis.GRIPPER]
        self._w1, self._w2 = self.axes[Axis.WRIST1], self.axes[Axis.WRIST2]
        self.power_on: list[bool] = [False] * IP_COUNT
        self.grasp_limit_mm: float | None = None
        """Opening [mm] below which an object keeps the jaws from closing; None when empty."""
        self._open_contacts: set[str] = set()
        self.supply_change_count: int = 0
        self._routines: list[Iterator[None] | None] = [None] * IP_COUNT
        self._decay = (0.0, 1.0)
        self._driven: dict[Axis, float] = {}  # far sides of gears that have play [true counts]
        self._place_at_random(random.Random(seed))
        for motor in self.axes.values():
            motor.restart()

    def _place_at_random(self, rng: random.Random) -> None:
        place: dict[Axis, float] = {Axis.ZED: rng.uniform(*START_ZED_COUNTS)}
        for axis in (Axis.SHOULDER, Axis.ELBOW):
            facts = FACTS[axis]
            place[axis] = START_FRACTION * rng.uniform(facts.lower_counts, facts.upper_counts)
        hand = START_FRACTION * YAW_TO_ELBOW_LIMIT_COUNTS * rng.uniform(-1.0, 1.0)
        place[Axis.YAW] = place[Axis.ELBOW] * YAW_COUNTS_PER_ELBOW_COUNT + hand
        pitch = START_FRACTION * rng.uniform(*PITCH_LIMITS_COUNTS)
        roll = START_FRACTION * rng.uniform(*ROLL_LIMITS_COUNTS)
        place[Axis.WRIST1], place[Axis.WRIST2] = (pitch + roll) / 2.0, (pitch - roll) / 2.0
        place[Axis.GRIPPER] = rng.uniform(100.0, 1100.0)
        self.place(place)

    def become(self, errors: ArmErrors) -> None:
        """Differ from the description otherwise from now on, by wear or repair."""
        self.errors, self._is_perfect = errors, errors == PERFECT
        self._take_up_play()

    # --- what the world does and sees -------------------------------------------------------

    def joints(self) -> ArmJoints:
        """Return the true joints."""
        counts = {axis: motor.position for axis, motor in self.axes.items()}
        if self._is_perfect:
            return joints_of(counts)
        return self.errors.joints(joints_of(counts | self._driven))

    def place(self, true_counts: dict[Axis, float]) -> None:
        """Move axes by hand, motors at rest; the counters do not notice.

        Parameters
        ----------
        true_counts : position of each axis to be moved [true counts]
        """
        for axis, counts in true_counts.items():
            motor = self.axes[axis]
            motor.origin += counts - motor.position
            motor.position = counts
            motor.rest(Drive.HOLD)
        self._take_up_play()

    def push(self, axis: Axis, counts: float) -> None:
        """Push an axis by hand, as far as its stops let it; a motor with drive does not yield.

        The encoder notices: CURRENT_POSITION stays, CP_ERROR takes the rest. umi_rtx.md 2.3 (26).
        """
        motor = self.axes[axis]
        if self._is_limp(motor, FACTS[axis].ip):
            for other, _ in self._all:
                other.goal = other.position
            motor.goal = motor.position + counts
            self._move()
            self._take_up_play()

    def jump(self, axis: Axis, counts: float) -> None:
        """Make the encoder of an axis miscount.

        Parameters
        ----------
        axis : the axis
        counts : excess of its reading over the axis's motion [counts]
        """
        self.axes[axis].jump(counts)

    def reference(self) -> None:
        """Set every counter to the truth, as after a perfect homing."""
        for motor in self.axes.values():
            motor.rest(Drive.HOLD)
            motor.origin = 0.0

    def obstruct(self, axis: Axis, direction: int, blocked: bool) -> None:
        """Put an obstacle where an axis is now, or take it away.

        Parameters
        ----------
        axis : the axis
        direction : +1 or -1 [sign of counts], which direction is blocked
        blocked : an obstacle that is there already stays where it is
        """
        motor = self.axes[axis]
        if direction > 0:
            if not blocked:
                motor.barrier_high = math.inf
            elif motor.barrier_high == math.inf:
                motor.barrier_high = motor.position
        elif not blocked:
            motor.barrier_low = -math.inf
        elif motor.barrier_low == -math.inf:
            motor.barrier_low = motor.position

    def jam(self, axis: Axis, jammed: bool = True) -> None:
        """Block an axis in both directions, or free it."""
        self.obstruct(axis, +1, jammed)
        self.obstruct(axis, -1, jammed)

    @property
    def jaw_force_fraction(self) -> float:
        """The jaws' force on an object, 0 to 1: MAX_FORCE / 100, or 0 when limp."""
        motor = self._gripper
        if self._is_limp(motor, GRIPPER_IP):
            return 0.0
        is_blocked = motor.blocked_s > 0.0 and motor.set_point < motor.position
        if motor.pressing >= 0 and not is_blocked:
            return 0.0
        return min(1.0, motor.max_force / 100.0)

    @property
    def jaw_force_n(self) -> float:
        """The same in newtons."""
        return JAW_FORCE_N * self.jaw_force_fraction

    @property
    def has_supply(self) -> bool:
        """Whether the motors have their supply: all contacts in it are closed."""
        return not self._open_contacts

    def switch_supply(self, contact: str, is_closed: bool) -> None:
        """Close or open one of the contacts in series in the motors' supply.

        Without it the IPs live on. Motion needs `27` once it is back; one sent meanwhile does not
        count.

        Parameters
        ----------
        contact : its name
        is_closed : open, the motors have no supply, however the others stand
        """
        had_supply = self.has_supply
        if is_closed:
            self._open_contacts.discard(contact)
        else:
            self._open_contacts.add(contact)
        if self.has_supply != had_supply:
            self.supply_change_count += 1
            self.power_on[:] = [False] * IP_COUNT

    def press_estop(self) -> None:
        """Open the contact of the emergency stop in the motors' supply."""
        self.switch_supply(ESTOP, False)

    def release_estop(self) -> None:
        """Close it again."""
        self.switch_supply(ESTOP, True)

    # --- what the IPs do --------------------------------------------------------------------

    def restart_ip(self, ip: int) -> None:
        """Let an IP lose its memory and its motors their power; the axes stay where they are."""
        self._routines[ip] = None
        self.power_on[ip] = False
        for motor in self.motors[ip]:
            motor.restart()

    def set_power(self, ip: int, on: bool) -> None:
        """Free the motors of an IP (26) or allow them power again (27)."""
        if on:
            for motor in self._by_ip[ip]:
                if not self.power_on[ip] or motor.drive is Drive.FREE:
                    motor.rest(Drive.HOLD)
        else:
            self._routines[ip] = None
            for motor in self._by_ip[ip]:
                motor.let_go(Drive.HOLD)
                motor.is_stopped = True
        self.power_on[ip] = on

    def stop(self, ip: int, ramp: bool) -> None:
        """Stop the motors of an IP at once or by a ramp, and hold them (24, 25)."""
        self._routines[ip] = None
        for motor in self._by_ip[ip]:
            if ramp and motor.is_busy:
                motor.ramp_down()
            else:
                motor.hold()
                motor.is_stopped = True

    def is_busy(self, ip: int, ctl: int) -> bool:
        """Return whether a controller has a move in progress."""
        motor = self.motors[ip][ctl]
        return motor.exists and (motor.is_busy or self._routines[ip] is not None)

    def status(self, ip: int, ctl: int) -> int:
        """Return the status byte of a controller; umi_rtx.md 2.8."""
        motor = self.motors[ip][ctl]
        return motor.status(motor.exists and self._routines[ip] is not None)

    def go_numeric(self, ip: int, ctls: list[int]) -> bool:
        """Start the selected axes to NEW_POSITION; if one is busy start none and return False."""
        if any(self.is_busy(ip, ctl) for ctl in ctls):
            return False
        for ctl in ctls:
            motor = self.motors[ip][ctl]
            if self._may_go(motor, ip):
                motor.go_to_new_position()
        return True

    def go_manual(self, ip: int, actions: list[int]) -> None:
        """Rewrite what all controllers of an IP do; umi_rtx.md 2.6.

        Parameters
        ----------
        ip : its number
        actions : (5,) per controller 0 hold, 1 forward, 2 reverse, 3 free
        """
        self._routines[ip] = None
        for motor, action in zip(self.motors[ip], actions, strict=True):
            if action == 0:
                motor.hold()
            elif action == 3:
                motor.let_go(Drive.FREE)
            elif self._may_go(motor, ip):
                motor.go_on(+1 if action == 1 else -1)

    def _may_go(self, motor: Motor, ip: int) -> bool:
        if motor.exists and not self.power_on[ip]:
            motor.is_stopped = True  # acknowledged, and nothing happens; umi_rtx.md 8.10
        return motor.exists and self.power_on[ip]

    def nudge(self, ip: int, increments: list[int]) -> None:
        """Add interpolation increments [counts] to the set-points of an IP; umi_rtx.md 2.7."""
        if self.power_on[ip]:
            for motor, increment in zip(self.motors[ip], increments, strict=True):
                if motor.exists and motor.drive is not Drive.FREE:
                    motor.set_point += increment

    def run_routine(self, ip: int, routine: Iterator[None]) -> None:
        """Let an IP exercise its motors by itself; without power nothing happens."""
        self.stop(ip, ramp=False)
        if self.power_on[ip]:
            self._routines[ip] = routine

    # --- time -------------------------------------------------------------------------------

    def advance(self, dt_s: float) -> None:
        """Let ``dt_s`` of world time [s] pass."""
        if dt_s <= 0.0:
            return
        step_count = max(1, math.ceil(dt_s / MAX_STEP_S - 1e-6))
        step_s = dt_s / step_count
        if step_s != self._decay[0]:
            self._decay = (step_s, math.exp(-step_s / LAG_S))
        for _ in range(step_count):
            for ip in range(IP_COUNT):
                routine = self._routines[ip]
                if routine is not None and next(routine, self) is self:
                    self._routines[ip] = None
            active = [(motor, ip) for motor, ip in self._all if self._is_active(motor, ip)]
            if not active and self._routines[0] is None and self._routines[1] is None:
                return
            self._step(active, step_s, self._decay[1])

    def _is_limp(self, motor: Motor, ip: int) -> bool:
        return (
            not self.power_on[ip]
            or not self.has_supply
            or motor.drive is Drive.FREE
            or motor.max_force == 0
        )

    def _is_active(self, motor: Motor, ip: int) -> bool:
        if motor.drive is Drive.HOLD:
            return motor.set_point != motor.position and not self._is_limp(motor, ip)
        return motor.is_busy

    def _step(self, active: list[tuple[Motor, int]], dt_s: float, decay: float) -> None:
        for motor, _ in self._all:
            motor.goal = motor.position
        steps = []
        for motor, ip in active:
            is_limp = self._is_limp(motor, ip)
            goal = motor.step(dt_s, decay)
            if not is_limp:
                motor.goal = goal
            steps.append((motor, motor.position, is_limp))
        self._move()
        self._take_up_play()
        for motor, before, is_limp in steps:
            motor.settle(dt_s, before, is_limp)

    def _take_up_play(self) -> None:
        """Let each gear's far side follow its motor, once the play between them is used up."""
        for axis, play in self.errors.play_counts.items():
            at = self.axes[axis].position
            before = self._driven.get(axis, at)
            self._driven[axis] = min(max(before, at - play / 2.0), at + play / 2.0)

    def _move(self) -> None:
        self._zed.approach_goal(*ZED_LIMITS)
        self._shoulder.approach_goal(*SHOULDER_LIMITS)
        closed, opened = GRIPPER_LIMITS
        limit_mm = (self.grasp_limit_mm or 0.0) - self.errors.jaw_zero_mm
        if self.grasp_limit_mm and limit_mm > 0.0:
            closed = max(closed, gripper_mm_to_counts(limit_mm))
        self._gripper.approach_goal(closed, opened)
        # Two motors that share a stop yield to each other within one step: the first moves,
        # the second moves, and what the second has freed the first may use.
        self._move_yaw_and_elbow(self._yaw, self._elbow)
        w1, w2 = self._w1, self._w2
        if w1.goal != w1.position or w2.goal != w2.position:
            for _ in range(2):
                p, q = PITCH_LIMITS_COUNTS, ROLL_LIMITS_COUNTS
                at = w2.position
                w1.approach_goal(max(p[0] - at, q[0] + at), min(p[1] - at, q[1] + at))
                at = w1.position
                w2.approach_goal(max(p[0] - at, at - q[1]), min(p[1] - at, at - q[0]))

    def _move_yaw_and_elbow(self, yaw: Motor, elbow: Motor) -> None:
        if yaw.goal == yaw.position and elbow.goal == elbow.position:
            return
        limit, ratio = YAW_TO_ELBOW_LIMIT_COUNTS, YAW_COUNTS_PER_ELBOW_COUNT
        if self._is_limp(yaw, YAW_IP):  # the forearm drags the gripper along
            elbow.approach_goal(*ELBOW_LIMITS)
            middle = elbow.position * ratio
            yaw.approach_goal(middle - limit, middle + limit)
            yaw.position = max(middle - limit, min(middle + limit, yaw.position))
            return
        for _ in range(2):
            middle = elbow.position * ratio
            yaw.approach_goal(middle - limit, middle + limit)
            low, high = (yaw.position - limit) / ratio, (yaw.position + limit) / ratio
            elbow.approach_goal(max(ELBOW_LIMITS[0], low), min(ELBOW_LIMITS[1], high))
