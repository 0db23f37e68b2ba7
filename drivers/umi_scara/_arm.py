"""The UMI RTX arm as the cell uses it: connect, power, home, move, grasp, stop.

It does not know its load, plans no path and avoids no obstacle. Targets are checked against the
joint limits of §5.2 before any byte goes out. Soak tests, built-in INIT and interpolation exist in
the codec alone. Sections (§) are those of umi_rtx.md.
"""

import logging
from collections.abc import Callable, Mapping
from math import ceil
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.clock import REAL_TIME, CellClock
from drivers.errors import PositionLostError
from drivers.kinds import Confirm, JawReading, MotorTry, Stop
from drivers.supervisor import BlindStop
from drivers.wires import LineTap
from messages import key, say

from ._config import ArmConfig, check_speeds
from ._jaws import Jaws
from ._mover import Mover
from ._session import ArmIdentity, ArmSession
from .line import Trace, Transport
from .model import kinematics
from .model.limits import COUNTS_ORDER
from .motion import (
    Axes,
    Homing,
    KeepingHoming,
    axes_in_turn,
    judge_kept_counters,
    keeping_park,
    read_registers,
    synchronised_speeds,
    try_motor,
)
from .protocol import constants as c
from .protocol.codec import encode_simple
from .protocol.constants import ADDRESSES, Axis, Ip, Parameter, Simple, StatusBits

log = logging.getLogger(__name__)

SUPPLY_LINE: Final = 0x01  # of IP1, §8.9
BLIND_STOP_COUNT = 4  # an even number, as each hands the line over once


class UmiScara:
    """One arm on one line. All verbs are coroutines of one event loop.

    The cell moves it by joints. `open_jaws`, `close_jaws`, `set_speed`, `set_force`,
    `read_parameter` and `write_parameter` are for scripts and commissioning.

    A moving verb that is cancelled or fails sends a dead stop to both IPs before it ends. Any
    answer 0E or 0F raises PositionLostError; from then on `is_homed` is False, motors have no
    power as far as this object is concerned, and no position is reported, until `connect`,
    `enable_power` and `home` have been through again (§1.5).

    Parameters
    ----------
    port : device node of the serial line, or a function that opens a transport
    config : settings of the arm, its line, homing and gripper
    clock : the cell's clock
    trace : called with every exchange on the wire; the logger ``cellctl.wire.arm`` has them, too
    tap : tap of the line, None for none
    line : path of the serial line, where a function opens it; None if it is no serial line

    Attributes
    ----------
    positions : knowledge of the axes' positions
    """

    def __init__(
        self,
        port: str | Callable[[], Transport],
        *,
        config: ArmConfig | None = None,
        clock: CellClock = REAL_TIME,
        trace: Trace | None = None,
        tap: LineTap | None = None,
        line: str | None = None,
    ) -> None:
        self._config = config or ArmConfig()
        self._line = port if isinstance(port, str) else line
        self._session = ArmSession(port, self._config.link, clock, trace, tap)
        self.positions = self._session.positions
        self._mover = Mover(self._session, self._config)
        self._jaws = Jaws(self._session, self._config)

    # ---- connection and power ------------------------------------------------------------------
    async def connect(self) -> ArmIdentity:
        """Bring both IPs to running (§1.6, steps 1-7), stop all motion; return the arm's identity.

        Raises
        ------
        LinkError : no port, or silence on it ("check power, cable, boards")
        WrongDeviceError : text instead of the protocol (§8.7), or not two different IPs
        BadReplyError : bytes that make no sense
        """
        return await self._session.connect()

    async def aclose(self) -> None:
        """Dead-stop both IPs (§8.20) and release the line; motors keep holding."""
        await self._session.aclose()

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    async def enable_power(self) -> None:
        """Allow motor power on both IPs (`27`, §1.6 step 9): only once people agree to motion."""
        await self._session.enable_power()

    async def stop(self, kind: Stop = Stop.DEAD) -> None:
        """Stop both IPs (§2.3), ahead of all other traffic; a running verb ends with an error.

        Motions that were waiting for their turn end too, before they begin.

        Raises
        ------
        LinkError, PositionLostError : one IP may not have got the stop; the other one has
        """
        await self._session.stop(kind)

    def blind_stop(self) -> BlindStop | None:
        """Return the dead stop of both IPs in bytes, for the supervisor to send.

        Stop, hand over, stop (§1.4, §2.3), several times: nobody sees whether it was understood. An
        even number, so that the line is as it was. None if the line is no serial port's.
        """
        if self._line is None:
            return None
        stop, toggle = encode_simple(Simple.DEAD_STOP), encode_simple(Simple.TOGGLE_ONCE)
        frames = (stop, toggle, stop)
        return BlindStop("arm", self._line, frames, self._config.link.spacing_s, BLIND_STOP_COUNT)

    @property
    def identity(self) -> ArmIdentity | None:
        """The result of `connect`; None when not connected or after a restart of an IP."""
        return self._session.identity

    @property
    def model(self) -> str:
        """The arm's name in messages and the journal: the ROM of each IP, once connected."""
        if self.identity is None:
            return "UMI RTX"
        versions = self.identity.rom_versions.items()
        roms = ", ".join(f"{ip.name} ROM {version[1]}.{version[0]}" for ip, version in versions)
        return f"UMI RTX, {roms}"

    @property
    def max_opening_mm(self) -> float:
        """The largest opening of the jaws [mm]."""
        return self._config.gripper.max_opening_mm

    @property
    def is_homed(self) -> bool:
        """Whether counts mean positions."""
        return self.positions.is_homed

    @property
    def is_powered(self) -> bool:
        """Whether motor power has been enabled and nothing is known to have taken it away."""
        return self._session.is_powered

    @property
    def config(self) -> ArmConfig:
        """The settings this arm was built with."""
        return self._config

    @property
    def axes(self) -> Axes:
        """The motors; nothing checks the orders sent to them here.

        Raises
        ------
        LinkError : not connected
        """
        return self._session.axes

    # ---- settings and raw registers ------------------------------------------------------------
    async def read_parameter(self, axis: Axis, parameter: Parameter) -> int:
        """Return any parameter of a motor (§2.5); a raw register, valid as a position or not."""
        return await self.axes.read(axis, parameter)

    async def read_motor_supply(self) -> bool:
        """Return whether the motors have their supply, by a user line of IP1 (§8.9)."""
        lines = await self.axes.read(Axis.SHOULDER, Parameter.USER_IO)
        return bool(lines & SUPPLY_LINE)

    async def write_parameter(self, axis: Axis, parameter: Parameter, value: int) -> None:
        """Set a parameter of a motor (§2.5).

        Parameters
        ----------
        axis : the motor
        parameter : parameter number
        value : in the parameter's own units, a signed word

        Raises
        ------
        ValueError : read-only, or CURRENT_POSITION, which only homing may label
        """
        if parameter in c.READ_ONLY or parameter is Parameter.CURRENT_POSITION:
            raise ValueError(f"{parameter.name} is not for writing")
        await self.axes.write(axis, parameter, value)

    async def set_speed(self, axis: Axis, speed: int) -> None:
        """Set SPEED of an axis: 1 to 160, 100 is "top speed" (§2.5, §5.6)."""
        check_speeds({axis: speed})
        await self.axes.write(axis, Parameter.SPEED, speed)

    async def set_force(self, axis: Axis, force: int) -> None:
        """Set MAX_FORCE of an axis; 0 makes the motor limp (§2.5), 20 to 60 have been used.

        Raises
        ------
        ValueError : the force is outside 0 to 100
        """
        if not 0 <= force <= 100:
            raise ValueError(f"{axis.name}: MAX_FORCE is 0 to 100, not {force}")
        await self.axes.write(axis, Parameter.MAX_FORCE, force)

    async def status(self, axis: Axis) -> StatusBits:
        """Return the status of one controller (§2.8)."""
        return await self.axes.status(axis)

    async def general_status(self) -> dict[Ip, StatusBits]:
        """Return the status of both IPs (§2.8)."""
        return {ip: await self.axes.general_status(ip) for ip in self.axes.ips()}

    # ---- homing, and where the arm is ----------------------------------------------------------
    async def home(self) -> None:
        """Find all end stops, label them and park (§4.1, §4.2); sweeps the whole workspace.

        Closes the gripper: whatever it holds is dropped or crushed.

        Raises
        ------
        PowerOffError : motor power is off
        HomingError : an axis found no stop in time
        AxisStalledError : an axis stalled or stopped short on the way to the park
        MotionStoppedError : `stop` was called
        """
        await self._session.until_certain(lambda: self._home(None))

    async def _home(self, confirm: Confirm | None) -> None:
        async with self._session.motion(needs_home=False) as guard:
            self.positions.begin_homing()
            await Homing(self.axes, self._config.homing, guard, confirm).run()
            await self._read_dead_bands()
            await self._mover.arrive(self._config.homing.park_counts)
            guard()
            self.positions.note_homed(self._config.homing.park_counts)
            self._mover.note_stops_and(self._config.homing.park_counts)
        log.info("arm homed")

    # ---- the first motions ever (§10) -----------------------------------------------------------
    @property
    def motors(self) -> tuple[str, ...]:
        """The names of all motors."""
        return tuple(axis.name.lower() for axis in Axis)

    async def read_registers(self) -> dict[str, dict[str, int]]:
        """Return the parameters of each motor by name (§10, step 4); nothing moves."""
        return await read_registers(self.axes)

    async def read_encoders(self) -> dict[str, int]:
        """Return each motor's encoder count, homed or not (§10, step 5); nothing moves."""
        self._session.require_connected()
        counts = await self.axes.read_actuals(Axis)
        return {axis.name.lower(): counts[axis] for axis in Axis}

    async def try_motor(self, motor: str) -> MotorTry:
        """Move one motor by 50 counts and back; return the result (§10, step 7).

        Raises
        ------
        ValueError : the arm is homed: its counters would be lost
        PowerOffError : motor power is off
        HomingError : the motor does not come to rest
        """
        if self.is_homed:
            raise ValueError("the arm is homed; a try would set its counters to zero")
        async with self._session.motion(needs_home=False) as guard:
            self.positions.begin_homing()
            homing = Homing(self.axes, self._config.homing, guard)
            return await try_motor(self.axes, homing, Axis[motor.upper()], guard)

    async def home_in_turn(self, confirm: Confirm) -> None:
        """Home as `home` does, after ``confirm`` has returned for each axis; raises as `home`."""
        await self._home(confirm)

    async def take_over_positions(self, between: ArrayLike) -> None:
        """Take over an earlier session's labels, if the counters prove them; nothing moves.

        Status bits prove no homing (§4.5). Counters do if each axis reads its last target, and one
        of each IP reads far from zero (§1.5).

        Parameters
        ----------
        between : (n, 6) joints between which the arm was last sent, in `kinematics.Q_ORDER`

        Raises
        ------
        PositionLostError : an IP has restarted, or a counter is not what it must be
        """
        self._session.require_connected()
        identity = self.identity
        if identity is None or identity.was_restarted:
            raise PositionLostError(
                key("arm: an IP has restarted: its positions are lost; home it")
            )
        ends = self._ends(between)
        counts = await self.axes.read_actuals(Axis)
        why = judge_kept_counters(ends, counts)
        if not why:
            # a request that went astray may have read another motor
            again = await self.axes.read_actuals(Axis)
            why = judge_kept_counters(ends, again)
        if why:
            raise PositionLostError(say("arm: {why}: positions are not known; home it", why=why))
        bits = await self.axes.status(Axis.GRIPPER)
        await self._read_dead_bands()
        self._mover.play.forget()
        self.positions.note_taken_over(again, grasps=bool(bits & StatusBits.STALLED))
        log.info("arm: positions taken over at %s", again)

    async def read_kept_q(self, between: ArrayLike) -> NDArray[np.float64]:
        """Return the joints (6,) as far as an earlier session's labels prove them, NaN elsewhere.

        One IP may have restarted and the other not. Nothing moves, and nothing is taken over.

        Parameters
        ----------
        between : (n, 6) joints between which the arm was last sent, in `kinematics.Q_ORDER`

        Raises
        ------
        PositionLostError : an IP has restarted since `connect`
        """
        self._session.require_connected()
        identity = self.identity
        assert identity is not None, "it is connected"
        ends = self._ends(between)
        counts = await self.axes.read_actuals(Axis)
        again = await self.axes.read_actuals(Axis)
        kept = [
            ip
            for ip in Ip
            if ip not in identity.restarted_ips
            and not judge_kept_counters(ends, counts, [ip])
            and not judge_kept_counters(ends, again, [ip])
        ]
        q = kinematics.counts_to_q([again[axis] for axis in COUNTS_ORDER])
        lost = [axis for axis in COUNTS_ORDER if ADDRESSES[axis].ip not in kept]
        q[kinematics.joints_moved_by(lost)] = np.nan
        return q

    async def home_keeping_jaws(self, q_estimate: ArrayLike, opening_mm: float | None) -> float:
        """Press the jaws, then home all other axes (§4.7); no jaw opens. Return the opening [mm].

        Begins with zed on its way up. How far the jaws have closed meanwhile, from the opening at
        which they were known to press, shows whether something is still between them.

        Parameters
        ----------
        q_estimate : (6,) joints about which the arm stands, in `kinematics.Q_ORDER`
        opening_mm : opening at which the jaws pressed on what they hold; None for empty jaws

        Raises
        ------
        ValueError : joints are not six numbers
        PositionLostError : the jaws were moved since they were last known; nothing has moved
        PowerOffError : motor power is off
        HomingError : an axis found no stop in time
        AxisStalledError : an axis stalled or stopped short between two stops
        MotionStoppedError : `stop` was called
        ValueError : not six finite numbers
        """
        row = np.asarray(q_estimate, dtype=np.float64)
        if row.shape != (6,):
            raise ValueError(f"joints are six numbers, not {row}")
        guess = dict(zip(COUNTS_ORDER, kinematics.q_to_counts(row).tolist(), strict=True))
        law = self._config.gripper
        known = None if opening_mm is None else law.counts(opening_mm)
        homing = self._config.homing
        async with self._session.motion(needs_home=False) as guard:
            self.positions.begin_homing()
            nominal, force = self._config.nominal_counts_per_s, self._config.gripper_force
            jaws = await KeepingHoming(self.axes, homing, nominal, force, guard).run(guess, known)
            await self._read_dead_bands()
            park = keeping_park(homing.park_counts)
            await self._mover.arrive(park)
            guard()
            self.positions.note_homed(park | {Axis.GRIPPER: jaws})
            self._mover.note_stops_and(park)
            self.positions.note_leaving([Axis.GRIPPER])  # its target is beyond where it presses
            self.positions.grasps = True
        log.info("arm homed with its jaws pressed at %d counts", jaws)
        return law.opening_mm(jaws)

    async def read_counts(self) -> dict[Axis, int]:
        """Return the true position of all seven motors [counts], in the order of Axis.

        Raises
        ------
        PositionLostError : not homed, or an IP has restarted
        """
        self._session.require_homed()
        counts = await self._session.read(
            lambda: self.positions.read(self.axes), lambda: self.axes.read_actuals(Axis)
        )
        self._session.require_homed()  # another request may have found the position lost meanwhile
        return counts

    async def read_q(self) -> NDArray[np.float64]:
        """Return the joints (6,) in `kinematics.Q_ORDER` [rad, mm]; raises as `read_counts`.

        The play of the gears is taken account of, where the settings have it.
        """
        counts = await self.read_counts()
        return kinematics.counts_to_q(
            [self._mover.play.meant(axis, counts[axis]) for axis in COUNTS_ORDER]
        )

    # ---- moving --------------------------------------------------------------------------------
    async def move_counts(
        self,
        targets: Mapping[Axis, int],
        deadline_s: float | None = None,
        speeds: Mapping[Axis, int] | None = None,
    ) -> dict[Axis, int]:
        """Move axes to absolute targets [counts] and wait until they are there (§2.7, §6.7).

        Axes run side by side, each at its own SPEED; nothing else coordinates them.

        Parameters
        ----------
        targets : target of each axis that moves [counts]; the others stay
        deadline_s : patience from the start on [cell s]; by default from the nominal speeds
        speeds : SPEED of axes that get a new one, whole numbers >= 1

        Returns
        -------
        true positions of the moved axes [counts]

        Raises
        ------
        OutOfRangeError : a limit of §5.2, combined ones included, would be passed
        PositionLostError : not homed, or an IP restarted
        PowerOffError : motor power is off
        AxisStalledError : an axis stalled, fell behind, stopped short or was too slow
        MotionStoppedError : `stop` was called
        """
        new_speeds = dict(speeds or {})
        check_speeds(new_speeds)
        return await self._mover.move(targets, deadline_s, lambda distances: new_speeds)

    async def move_joints(
        self,
        q: ArrayLike,
        speed: int = c.NOMINAL_SPEED,
        deadline_s: float | None = None,
        *,
        speed_share: float = 1.0,
    ) -> None:
        """Move to joints (6,) in `kinematics.Q_ORDER` [rad, mm], all axes arriving together.

        Where the settings have the play of a gear, the joint gets there: a motor that turns round
        goes so much farther. Counts of joints are those of a motor that has come from below.

        Parameters
        ----------
        q : (6,) joints in `kinematics.Q_ORDER` [rad, zed in mm]
        speed : SPEED of the axis that needs longest; the others get less (§8.13)
        deadline_s : patience from the start on [cell s]; by default from the nominal speeds
        speed_share : share of that SPEED, above 0 to 1

        Raises
        ------
        as `move_counts`
        ValueError : not six finite numbers, or a SPEED or a share outside its range
        """
        row = np.asarray(q, dtype=np.float64)
        if not 0.0 < speed_share <= 1.0:
            raise ValueError(f"a share of the speed is above 0 to 1, not {speed_share}")
        if row.shape != (6,) or not np.isfinite(row).all():
            raise ValueError(f"joints are six finite numbers, not {row}")
        targets = dict(zip(COUNTS_ORDER, kinematics.q_to_counts(row).tolist(), strict=True))
        speed = max(1, round(speed * speed_share))
        check_speeds({Axis.ELBOW: speed})
        nominal = self._config.nominal_counts_per_s
        await self._mover.move(
            targets,
            deadline_s,
            lambda far: synchronised_speeds(far, nominal, speed),
            takes_up_play=True,
        )

    # ---- gripper -------------------------------------------------------------------------------
    async def move_gripper_mm(self, opening_mm: float) -> float:
        """Move the jaws to an opening [mm] in empty air; return the one reached (§5.5).

        Raises
        ------
        OutOfRangeError : the jaws do not open so far
        AxisStalledError : something is in the way; to hold it, use `grasp`
        """
        counts = self._config.gripper.counts(opening_mm)
        forces = {Axis.GRIPPER: self._config.gripper_force}
        got = await self._mover.move({Axis.GRIPPER: counts}, None, lambda _: {}, forces)
        return self._config.gripper.opening_mm(got[Axis.GRIPPER])

    async def open_jaws(self) -> float:
        """Open the jaws fully; return the opening [mm]."""
        return await self.move_gripper_mm(self._config.gripper.max_opening_mm)

    async def close_jaws(self) -> float:
        """Close empty jaws; return the opening [mm]. Raises AxisStalledError on anything held."""
        return await self.move_gripper_mm(0.0)

    async def grasp(
        self, force: int, deadline_s: float = 10.0, *, speed_share: float = 1.0
    ) -> float:
        """Close the jaws until they stall, on something or on each other (§5.5).

        Parameters
        ----------
        force : MAX_FORCE, which stays; 20 to 60 have been used
        deadline_s : time limit for the jaws at full speed to come to rest [cell s]
        speed_share : share of the speed with which they usually close on something, above 0 to 1

        Returns
        -------
        jaw opening [mm]; near 0 means that nothing is held, which is for the caller to judge

        Raises
        ------
        AxisStalledError : the jaws have not come to rest against anything by the deadline
        ValueError : the force is outside 1 to 100, or the share outside 0 to 1
        """
        if not 1 <= force <= 100:
            raise ValueError(f"a grasp needs a force of 1 to 100, not {force}")
        if not 0.0 < speed_share <= 1.0:
            raise ValueError(f"a share of the speed is above 0 to 1, not {speed_share:g}")
        return await self._session.until_certain(
            lambda: self._jaws.close(force, deadline_s, speed_share)
        )

    async def read_opening_mm(self) -> float:
        """Return the present jaw opening [mm]; raises as `read_counts`."""
        return await self._jaws.read_opening_mm()

    async def read_jaws(self) -> JawReading:
        """Return the state of the jaws, homed or not; nothing moves."""
        return await self._jaws.read()

    async def drive_jaws(self, by_mm: float, deadline_s: float = 10.0) -> float:
        """Open (or, below 0, close) the jaws by a travel [mm]; no other axis moves.

        Homed or not: counts need not be labelled, since only their difference is used. Ends early
        where the jaws stall, on something or at an end of their range.

        Returns
        -------
        how far they went [mm], above 0 whichever way

        Raises
        ------
        PowerOffError : motor power is off
        AxisStalledError : the jaws did not come to rest by the deadline
        """
        return await self._jaws.drive(by_mm, deadline_s)

    # ---- parts of the verbs --------------------------------------------------------------------
    async def _read_dead_bands(self) -> None:
        self.positions.dead_bands = {
            axis: await self.axes.read_twice(axis, Parameter.DEAD_BAND)
            for axis in axes_in_turn(self.axes)
        }

    def _ends(self, between: ArrayLike) -> dict[Axis, tuple[int, int]]:
        """Return the range of each motor [counts] over joints (n, 6)."""
        rows = kinematics.q_to_counts(np.atleast_2d(np.asarray(between, dtype=np.float64)))
        ends = zip(COUNTS_ORDER, rows.min(axis=0), rows.max(axis=0), strict=True)
        play = self._config.play_counts
        return {axis: (int(low) - ceil(play.get(axis, 0.0)), int(high)) for axis, low, high in ends}
