"""One arm's session: the line, motor power, what is known of positions, and how a motion ends.

Sections (§) are those of umi_rtx.md.
"""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Final, Self

from drivers.clock import REAL_TIME, CellClock
from drivers.errors import DeviceError, LinkError, PositionLostError, SilentLineError
from drivers.kinds import Stop

from .line import (
    Guard,
    LineUncertainError,
    Link,
    LinkConfig,
    SerialTransport,
    Trace,
    Transport,
    run_to_end,
)
from .model import GripperLaw, OutOfRangeError
from .motion import (
    Axes,
    AxisStalledError,
    HomingConfig,
    Known,
    MotionStoppedError,
    judge_counters,
    on_ip,
)
from .protocol import constants as c
from .protocol.constants import Axis, Ip, Parameter, Simple, StatusBits

log = logging.getLogger(__name__)


class PowerOffError(DeviceError):
    """A motion without motor power: the arm would acknowledge it and do nothing (§8.10)."""


_STOP_COMMANDS: Final = {  # §2.3
    Stop.DEAD: Simple.DEAD_STOP,
    Stop.RAMP: Simple.RAMP_STOP,
    Stop.FREE: Simple.FREE_STOP,  # axes may sink (§8.6)
}


@dataclass(frozen=True, slots=True)
class ArmIdentity:
    """Who answered `connect`.

    Attributes
    ----------
    rom_versions : per IP, (revision, version); the order of the two bytes is a guess (§9.4)
    restarted_ips : those that had lost their positions and were given GO (§1.5)
    """

    rom_versions: Mapping[Ip, tuple[int, int]]
    restarted_ips: frozenset[Ip]

    @property
    def was_restarted(self) -> bool:
        """Whether any IP came out of a restart."""
        return bool(self.restarted_ips)


@dataclass(frozen=True, slots=True)
class ArmConfig:
    """Settings of one arm; all durations in cell seconds.

    Attributes
    ----------
    arrival_slack_counts : tolerance of arrival beyond the axis' own DEAD_BAND
    settle_s : how long an axis at rest may take to come within that tolerance
    nominal_counts_per_s : speed of each axis at SPEED 100 (7), for forecasts and speed ratios
    gripper_force : MAX_FORCE with which the jaws open and close in position moves (§5.6)
    grasp_speed : SPEED with which the jaws close on something (§5.6)
    """

    link: LinkConfig = field(default_factory=LinkConfig)
    homing: HomingConfig = field(default_factory=HomingConfig)
    gripper: GripperLaw = field(default_factory=GripperLaw)
    arrival_slack_counts: int = 2
    settle_s: float = 0.5
    nominal_counts_per_s: Mapping[Axis, float] = field(
        default_factory=lambda: dict(c.NOMINAL_COUNTS_PER_S)
    )
    gripper_force: int = 40
    grasp_speed: int = 50


def check_speeds(speeds: Mapping[Axis, int]) -> None:
    """Check that each SPEED is one that a driver has used (§2.5).

    Raises
    ------
    ValueError : not a whole number from 1 to MAX_SPEED; the message names the axis
    """
    for axis, speed in speeds.items():
        if not 1 <= speed <= c.MAX_SPEED or int(speed) != speed:
            raise ValueError(f"{axis.name}: SPEED is a whole 1 to {c.MAX_SPEED}, not {speed}")


class ArmSession:
    """Everything about an arm but its moves; `UmiScara` adds those.

    Parameters
    ----------
    port : the serial port's path, or what opens a transport
    config : settings of the arm, its line, homing and gripper
    clock : the cell's clock
    trace : called with every exchange on the wire
    """

    def __init__(
        self,
        port: str | Callable[[], Transport],
        *,
        config: ArmConfig | None = None,
        clock: CellClock = REAL_TIME,
        trace: Trace | None = None,
    ) -> None:
        self._open_transport = (lambda: SerialTransport(port)) if isinstance(port, str) else port
        self._config = config or ArmConfig()
        self._clock = clock
        self._trace = trace
        self._axes_or_none: Axes | None = None
        self._identity: ArmIdentity | None = None
        self._is_powered = False
        self._is_homed = False
        self._rest_counts: dict[Axis, int] = {}  # where axes were read to rest, at their targets
        self._dead_bands: dict[Axis, int] = {}
        self._known: Known = {}
        self._is_sure = False  # every target is where its axis stands, every parameter as written
        self._may_be_relabelled = False  # counters must be compared with `_known`
        self._may_be_zeroed = False  # counters may have been set to zero
        self._grasps = False
        self._stop_count = 0
        self._one_motion = asyncio.Lock()

    # ---- connection ----------------------------------------------------------------------------
    async def connect(self) -> ArmIdentity:
        """Open the line and bring both IPs to running (§1.6, steps 1-7); nothing moves.

        Raises
        ------
        LinkError : no port, or silence on it ("check power, cable, boards")
        WrongDeviceError : text instead of the protocol (§8.7), or not two different IPs
        BadReplyError : bytes that make no sense
        """
        await self._disconnect()
        link = Link(self._open_transport(), self._clock, self._config.link, self._trace)
        axes = Axes(link, self._clock, self._lose_position)
        try:
            restarted = await link.open()
            versions = {ip: await axes.version(ip) for ip in axes.ips()}
        except BaseException:
            await link.aclose()
            raise
        self._axes_or_none = axes
        rom_versions = {ip: (v.revision, v.version) for ip, v in sorted(versions.items())}
        self._identity = ArmIdentity(rom_versions, restarted)
        log.info("arm connected: ROM %s, restarted: %s", rom_versions, sorted(restarted))
        return self._identity

    async def aclose(self) -> None:
        """Dead-stop both IPs (§8.20) and let go of the line; motors keep holding."""
        if self._axes_or_none is not None:
            self._stop_count += 1
            await run_to_end(self._halt_quietly())
        await self._disconnect()

    async def _disconnect(self) -> None:
        axes, self._axes_or_none = self._axes_or_none, None
        self._forget_position()
        if axes is not None:
            await axes.link.aclose()

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    @property
    def identity(self) -> ArmIdentity | None:
        """What `connect` found; None when not connected or after a restart of an IP."""
        return self._identity

    @property
    def model(self) -> str:
        """What messages and the journal call it: the ROM of each IP, once connected."""
        if self._identity is None:
            return "UMI RTX"
        versions = self._identity.rom_versions.items()
        roms = ", ".join(f"{ip.name} ROM {version[1]}.{version[0]}" for ip, version in versions)
        return f"UMI RTX, {roms}"

    @property
    def max_opening_mm(self) -> float:
        """How far the jaws open [mm]."""
        return self._config.gripper.max_width_mm

    @property
    def is_homed(self) -> bool:
        """Whether counts mean positions."""
        return self._is_homed

    @property
    def is_powered(self) -> bool:
        """Whether motor power has been enabled and nothing is known to have taken it away."""
        return self._is_powered

    @property
    def config(self) -> ArmConfig:
        """The settings this arm was built with."""
        return self._config

    @property
    def _axes(self) -> Axes:
        if self._axes_or_none is None:
            raise LinkError("arm: not connected")
        return self._axes_or_none

    def _require_connected(self) -> None:
        if self._identity is None and self._axes_or_none is not None:
            raise PositionLostError("arm: an IP has restarted; connect, enable power and home")

    def _lose_position(self) -> None:
        if self._is_homed:
            log.error("arm: positions are lost")
        self._forget_position()

    def _forget_position(self) -> None:
        self._is_homed = self._is_powered = False
        self._identity = None
        self._rest_counts.clear()
        self._known.clear()
        self._is_sure = self._may_be_relabelled = self._may_be_zeroed = False

    def _require_homed(self) -> None:
        if not self._is_homed:
            raise PositionLostError("arm: not homed, so that no position of it is known")

    async def enable_power(self) -> None:
        """Allow motor power on both IPs (`27`, §1.6 step 9): only once people agree to motion."""
        self._require_connected()
        await self._axes.send_both(Simple.FREE_OFF)
        self._is_powered = True

    # ---- settings and raw registers ------------------------------------------------------------
    async def read_parameter(self, axis: Axis, parameter: Parameter) -> int:
        """Return any parameter of a motor (§2.5); a raw register, valid as a position or not."""
        return await self._axes.read(axis, parameter)

    async def write_parameter(self, axis: Axis, parameter: Parameter, value: int) -> None:
        """Set a parameter of a motor (§2.5).

        Parameters
        ----------
        axis : the motor
        parameter : which of its parameters
        value : in the parameter's own units, a signed word

        Raises
        ------
        ValueError : read-only, or CURRENT_POSITION, which only homing may label
        """
        if parameter in c.READ_ONLY or parameter is Parameter.CURRENT_POSITION:
            raise ValueError(f"{parameter.name} is not for writing")
        await self._axes.write(axis, parameter, value)

    async def set_speed(self, axis: Axis, speed: int) -> None:
        """Set SPEED of an axis: 1 to 160, 100 is "top speed" (§2.5, §5.6)."""
        check_speeds({axis: speed})
        await self._axes.write(axis, Parameter.SPEED, speed)

    async def set_force(self, axis: Axis, force: int) -> None:
        """Set MAX_FORCE of an axis; 0 makes the motor limp (§2.5), 20 to 60 have been used.

        Raises
        ------
        ValueError : the force is outside 0 to 100
        """
        if not 0 <= force <= 100:
            raise ValueError(f"{axis.name}: MAX_FORCE is 0 to 100, not {force}")
        await self._axes.write(axis, Parameter.MAX_FORCE, force)

    async def status(self, axis: Axis) -> StatusBits:
        """Return the status of one controller (§2.8)."""
        return await self._axes.status(axis)

    async def general_status(self) -> dict[Ip, StatusBits]:
        """Return the status of both IPs (§2.8)."""
        return {ip: await self._axes.general_status(ip) for ip in self._axes.ips()}

    # ---- how a motion ends ---------------------------------------------------------------------
    async def stop(self, kind: Stop = Stop.DEAD) -> None:
        """Stop both IPs (§2.3), ahead of all other traffic; a running verb ends with an error.

        Motions that were waiting for their turn end too, before they begin.

        Raises
        ------
        LinkError, PositionLostError : one IP may not have got the stop; the other one has
        """
        self._stop_count += 1
        self._rest_counts.clear()
        self._is_sure = False
        if kind is Stop.FREE:
            self._is_powered = False
            self._known.clear()  # axes may be moved by hand
        if kind is Stop.RAMP:
            self._may_be_relabelled = True  # one wrong bit turns `25` into `21`, define home
        await run_to_end(self._axes.halt(_STOP_COMMANDS[kind]))

    @asynccontextmanager
    async def _motion(self, *, needs_home: bool = True) -> AsyncIterator[Guard]:
        """Hold the arm for one motion; if it fails or is cancelled, both IPs are stopped.

        A refusal before any byte has gone out needs no stop. Yields a guard that raises once `stop`
        has been called, which also ends those motions that were still waiting for the arm.
        """
        stop_count = self._stop_count

        def guard() -> None:
            if self._stop_count != stop_count:
                raise MotionStoppedError("arm: the motion was stopped on request")

        async with self._one_motion:
            guard()
            if not self._is_powered:
                self._require_connected()
                raise PowerOffError("arm: motor power is off: enable it first")
            if needs_home:
                self._require_homed()
            try:
                yield guard
            except OutOfRangeError:
                raise  # nothing has been sent
            except (
                MotionStoppedError,
                AxisStalledError,
                LineUncertainError,
                SilentLineError,
            ) as error:
                self._unsettle(error)
                raise  # both IPs have been stopped already
            except BaseException as error:
                self._unsettle(error)
                await run_to_end(self._halt_quietly())
                raise

    def _unsettle(self, error: BaseException) -> None:
        """Trust no register until it has been read again."""
        self._is_sure = False
        self._rest_counts.clear()
        if isinstance(error, LineUncertainError):
            self._may_be_relabelled = True
            self._may_be_zeroed = self._may_be_zeroed or error.may_have_zeroed

    async def _make_sure(self, guard: Guard) -> None:
        """Read the registers of an arm at rest, and set every target to where its axis is.

        From then on, a go that reaches the wrong axis leaves that axis where it is.

        Raises
        ------
        PositionLostError : the counters are not what they must be, or may have been made zero
        """
        if self._is_sure:
            return
        force = self._axes.written(Axis.GRIPPER, Parameter.MAX_FORCE)
        self._axes.forget()
        if self._may_be_relabelled:
            await self._axes.send_both(Simple.LOAD_DEFAULTS, guard)
            if force is not None:
                await self._axes.write(Axis.GRIPPER, Parameter.MAX_FORCE, force, guard)
        counts = await self._read_all()
        for axis in self._in_turn():
            if not (axis is Axis.GRIPPER and self._grasps):
                await self._axes.write(axis, Parameter.NEW_POSITION, counts[axis], guard)
        self._rest_counts.update(counts)
        self._known = {axis: (n, n) for axis, n in counts.items()}
        self._is_sure = True

    def _in_turn(self) -> list[Axis]:
        return [axis for ip in self._axes.ips() for axis in on_ip(Axis, ip)]

    async def _read_all(self) -> dict[Axis, int]:
        """Return where all axes are [counts]; check their labels first where these may be wrong."""
        found = {axis: await self._axes.read_actual_twice(axis) for axis in self._in_turn()}
        counts = {axis: found[axis] for axis in Axis}
        if self._may_be_relabelled:
            if why := judge_counters(self._known, counts, self._may_be_zeroed):
                self._lose_position()
                raise PositionLostError(
                    f"arm: {why} after a fault on its line: positions are no longer known; "
                    "connect and home again"
                )
            self._may_be_relabelled = self._may_be_zeroed = False
        return counts

    async def _halt_quietly(self) -> None:
        """Dead-stop both IPs while an earlier error is being raised: log a failure only."""
        try:
            await self._axes.halt(Simple.DEAD_STOP)
        except DeviceError as error:
            log.error("arm: the dead stop failed too: %s", error)
