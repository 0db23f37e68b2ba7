"""One motor under its servo: set-point, profile, counter label, parameters and status bits.

The motor does not know its obstacles: the arm model limits its position and then calls `settle`,
which decides between going on, arriving, stalling and giving up. umi_rtx.md 2.5, 2.8, 7.
"""

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

ACCELERATION_S: Final = 0.25  # time from rest to the speed of the move; umi_rtx.md 7
LAG_S: Final = 0.05  # the true position trails by v * 0.05 s; umi_rtx.md 7

# No source times a stall. It is long against the lag, and short enough that at top speed the error
# stays below the default ERROR_LIMIT, so that an end stop raises bit 3 and not bit 2.
STALL_S: Final = 0.15
STANDSTILL_COUNTS_PER_S: Final = 1.0
# A manual drive that is held back does not run ahead for ever. The value lies between the default
# ERROR_LIMIT (1000) and the 1500 every driver gives the yaw before it homes yaw and elbow
# together, since that is the one place where a source shows the limit to matter.
MANUAL_LEAD_COUNTS: Final = 1200.0
ARRIVED_COUNTS: Final = 0.01
CATCH_UP_FACTOR: Final = 2.0  # a motor pulled away from its set-point returns at most this fast
FORCE_PER_COUNT: Final = 0.25  # CURRENT_FORCE over following error; no source gives one


class Parameter:
    """Numbers of the parameters; umi_rtx.md 2.5."""

    ERROR: Final = 0
    CURRENT_POSITION: Final = 1
    ERROR_LIMIT: Final = 2
    NEW_POSITION: Final = 3
    SPEED: Final = 4
    DEAD_BAND: Final = 8
    MAX_FORCE: Final = 10
    CURRENT_FORCE: Final = 11
    USER_RAM: Final = 13
    USER_IO: Final = 14
    COUNT: Final = 15


# ERROR_LIMIT, SPEED, KP, KI, KD, DEAD_BAND, OFFSET, ACCELERATION_TIME; umi_rtx.md 7, "Defaults"
DEFAULTS: Final = {2: 1000, 4: 100, 5: 1200, 6: 20, 7: 600, 8: 2, 9: 0, 12: 20}


class Drive(Enum):
    """The servo state of a motor."""

    HOLD = "hold"
    FREE = "free"  # manual go 11: unpowered
    TRIPPED = "tripped"  # the following error passed ERROR_LIMIT; it stays readable
    NUMERIC = "numeric"
    MANUAL = "manual"
    RAMP = "ramp"


@dataclass(slots=True)
class Motor:
    """State of one controller and its motor; every position is in true counts.

    Attributes
    ----------
    exists : False for controllers without a motor, which keep parameters and never move
    position, set_point : position of the axis, and set-point of the servo
    goal : target of the servo in the present step, without obstacles
    origin : true position that the counter calls 0
    barrier_low, barrier_high : obstacles in the way, infinite when there are none
    pressing : -1 or +1 while a stalled motor keeps pushing there, else 0
    """

    nominal_counts_per_s: float = 0.0
    default_max_force: int = 40
    exists: bool = True
    position: float = 0.0
    set_point: float = 0.0
    goal: float = 0.0
    origin: float = 0.0
    velocity: float = 0.0
    target: float = 0.0
    direction: int = 0
    drive: Drive = Drive.HOLD
    parameters: list[int] = field(default_factory=lambda: [0] * Parameter.COUNT)
    is_relative: bool = False
    is_force_mode: bool = False
    is_stopped: bool = False
    is_error_exceeded: bool = False
    is_stalled: bool = False
    pressing: int = 0
    blocked_s: float = 0.0
    barrier_low: float = -math.inf
    barrier_high: float = math.inf

    def __post_init__(self) -> None:
        self.restart()

    # --- counter and parameters -------------------------------------------------------------

    def restart(self) -> None:
        """Forget everything but where the axis is: the state after power-up; umi_rtx.md 7."""
        self.parameters[:] = [0] * Parameter.COUNT
        self.load_defaults()
        self.is_stopped = self.is_error_exceeded = self.is_stalled = False
        self.rest(Drive.HOLD)
        self.origin = self.position
        self.pressing = 0

    def load_defaults(self) -> None:
        """Set the control parameters and modes to their defaults (22); umi_rtx.md 7."""
        for number, value in DEFAULTS.items():
            self.parameters[number] = value
        self.parameters[Parameter.MAX_FORCE] = self.default_max_force
        self.is_relative = self.is_force_mode = False

    def zero_counter(self) -> None:
        """Call the present true position 0, with no following error (21)."""
        self.set_point = self.origin = self.position

    def label(self, counts: int) -> None:
        """Call the present set-point ``counts`` (58); the error is kept and nothing moves."""
        self.origin = self.set_point - counts

    def jump(self, counts: float) -> None:
        """Let the encoder miscount: it reads ``counts`` more than the axis has moved.

        The servo takes it for a following error and drives the axis back by as much: the counter
        ends where it was, the axis does not.
        """
        self.set_point -= counts
        self.origin -= counts
        self.target -= counts

    @property
    def counter(self) -> int:
        """CURRENT_POSITION [counts]."""
        return round(self.set_point - self.origin)

    @property
    def error(self) -> int:
        """CP_ERROR [counts]: CURRENT_POSITION minus the encoder's position; umi_rtx.md 2.5."""
        return self.counter - round(self.position - self.origin)

    @property
    def max_force(self) -> int:
        """MAX_FORCE, 0 for a motor that never drives."""
        return max(0, self.parameters[Parameter.MAX_FORCE])

    @property
    def force(self) -> int:
        """CURRENT_FORCE, signed like the direction it pushes."""
        if self.pressing:
            return self.pressing * self.max_force
        force = (self.set_point - self.position) * FORCE_PER_COUNT
        return round(max(-self.max_force, min(self.max_force, force)))

    @property
    def speed_counts_per_s(self) -> float:
        """Speed that SPEED asks for [counts/s]; umi_rtx.md 7."""
        return max(0, self.parameters[Parameter.SPEED]) / 100.0 * self.nominal_counts_per_s

    @property
    def is_busy(self) -> bool:
        """Whether a move is in progress."""
        drive = self.drive
        return drive is Drive.NUMERIC or drive is Drive.MANUAL or drive is Drive.RAMP

    def status(self, is_in_routine: bool) -> int:
        """Return the controller status byte; umi_rtx.md 2.8."""
        return (
            (self.is_busy or is_in_routine) * 0x01
            | self.is_stopped * 0x02
            | self.is_error_exceeded * 0x04
            | self.is_stalled * 0x08
            | self.is_relative * 0x10
            | self.is_force_mode * 0x20
        )

    # --- commands ---------------------------------------------------------------------------

    def rest(self, drive: Drive) -> None:
        """Stop at the present position, with no error, in a drive state that is not a move."""
        self.set_point = self.position
        self.velocity = 0.0
        self.blocked_s = 0.0
        self.drive = drive

    def _begin(self, drive: Drive) -> None:
        if self.drive in (Drive.FREE, Drive.TRIPPED):
            self.rest(Drive.HOLD)
        self.is_stopped = self.is_error_exceeded = self.is_stalled = False
        self.pressing = 0
        self.blocked_s = 0.0
        self.drive = drive

    def go_to_new_position(self) -> None:
        """Start towards NEW_POSITION, absolute or relative (A0 | mask)."""
        new_position = self.parameters[Parameter.NEW_POSITION]
        self._begin(Drive.NUMERIC)
        self.target = new_position + (self.set_point if self.is_relative else self.origin)

    def go_to(self, counts: int) -> None:
        """Start towards a counter value; used by the IP's own routines."""
        self._begin(Drive.NUMERIC)
        self.target = self.origin + counts

    def go_on(self, direction: int) -> None:
        """Drive without a target, forward (+1) or in reverse (-1), until the next command (80)."""
        self._begin(Drive.MANUAL)
        self.direction = direction

    def hold(self) -> None:
        """Make the set-point the true position at once, and hold (24, manual go 00).

        An axis that tripped has stopped already and keeps its error to be read (umi_rtx.md 3.6);
        a jaw that stalled on a part keeps pressing.
        """
        if self.is_busy:
            self.is_stopped = True
        if self.drive is not Drive.TRIPPED:
            self.rest(Drive.HOLD)

    def ramp_down(self) -> None:
        """Decelerate, then hold (25)."""
        if self.is_busy:
            self.drive = Drive.RAMP
        else:
            self.hold()

    def let_go(self, drive: Drive) -> None:
        """Stop unpowered: the axis can be moved by hand (26, manual go 11)."""
        if self.is_busy:
            self.is_stopped = True
        self.rest(drive)
        self.pressing = 0

    # --- time -------------------------------------------------------------------------------

    def step(self, dt_s: float, decay: float) -> float:
        """Advance the set-point by ``dt_s``; return where the servo takes the axis meanwhile.

        Parameters
        ----------
        dt_s : time to advance by [s]
        decay : exp(-dt_s / LAG_S), handed in because every motor needs the same one
        """
        before = self.set_point
        if self.drive is not Drive.HOLD:
            self._step_set_point(dt_s)
        now = self.set_point
        if self.drive is Drive.HOLD and abs(now - self.position) < ARRIVED_COUNTS:
            return now
        lag = (now - before) / dt_s * LAG_S  # true of a ramp once it has settled
        wanted = now - lag + (self.position - before + lag) * decay
        reach = CATCH_UP_FACTOR * max(self.nominal_counts_per_s, self.speed_counts_per_s) * dt_s
        return max(self.position - reach, min(self.position + reach, wanted))

    def _step_set_point(self, dt_s: float) -> None:
        top = self.speed_counts_per_s
        change = top / ACCELERATION_S * dt_s
        if self.drive is Drive.NUMERIC:
            rest = self.target - self.set_point
            braking = math.sqrt(2.0 * top / ACCELERATION_S * abs(rest))
            self._approach(math.copysign(min(top, braking), rest), change)
            if abs(rest) <= abs(self.velocity) * dt_s:
                self.set_point, self.velocity = self.target, 0.0
                return
        elif self.drive is Drive.MANUAL:
            self._approach(self.direction * top, change)
        else:
            self._approach(0.0, change)
        self.set_point += self.velocity * dt_s
        if self.drive is Drive.MANUAL:
            lead = self.position + self.direction * MANUAL_LEAD_COUNTS
            if (self.set_point - lead) * self.direction > 0:
                self.set_point = lead

    def _approach(self, velocity: float, change: float) -> None:
        self.velocity = max(self.velocity - change, min(self.velocity + change, velocity))

    def approach_goal(self, low: float, high: float) -> None:
        """Move to the goal, as far as stops [true counts] and obstacles let it."""
        here = self.position
        if self.goal > here:
            self.position = min(self.goal, max(here, min(high, self.barrier_high)))
        elif self.goal < here:
            self.position = max(self.goal, min(here, max(low, self.barrier_low)))

    def settle(self, dt_s: float, before: float, is_limp: bool) -> None:
        """Judge one step after the arm has limited it; umi_rtx.md 7, the rows on stalls and moves.

        Parameters
        ----------
        dt_s : length of the step [world s]
        before : position before the step
        is_limp : the motor has no power or no force
        """
        is_held_back = is_limp or abs(self.position - self.goal) > 1e-9
        if is_held_back and abs(self.position - before) < STANDSTILL_COUNTS_PER_S * dt_s:
            self.blocked_s += dt_s
        else:
            self.blocked_s = 0.0
        error = self.set_point - self.position
        dead_band = max(self.parameters[Parameter.DEAD_BAND], ARRIVED_COUNTS)
        if self.drive is Drive.HOLD and abs(error) <= dead_band:
            return  # arrived: what is left is not corrected, so it cannot stall
        if abs(error) > self.parameters[Parameter.ERROR_LIMIT]:
            self.is_stopped = self.is_error_exceeded = True
            self.velocity = self.blocked_s = 0.0
            self.drive = Drive.TRIPPED
        elif self.blocked_s >= STALL_S:
            self.is_stopped = self.is_stalled = True
            self.pressing = 0 if is_limp else (1 if error > 0 else -1)
            self.rest(Drive.HOLD)
        elif self.drive is Drive.NUMERIC:
            if self.set_point == self.target and abs(error) <= dead_band:
                self.velocity = 0.0
                self.drive = Drive.HOLD
        elif self.drive is Drive.RAMP and self.velocity == 0.0:
            self.is_stopped = True
            self.drive = Drive.HOLD
