"""Homing against end stops by UMI's own procedure (umi_rtx.md 4.1, 4.2, 4.6).

The arm has no home switches: each axis is driven until it stalls, and the stop it leans on is
labelled. `21` zeroes all counters of an IP, so a homed axis stands still until the labels.

Sections (§) are those of umi_rtx.md.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.errors import DeviceError

from ..line import Guard
from ..protocol import constants as c
from ..protocol.constants import ADDRESSES, Axis, Drive, Ip, Mode, Parameter, Simple, StatusBits
from ._axes import Axes
from ._moves import MoveWatch, on_ip, start

log = logging.getLogger(__name__)

_STILL_POLL_COUNT = 3  # §9.17
_ORIGIN_COUNTS = 4  # DEAD_BAND, and two counts of reading
_NEAR_ORIGIN = 1  # below DEAD_BAND, but not the park's 0: a write of 0 must show when read back
_DITHER_COUNTS = 1  # a motor that leans on its stop may flicker between two encoder counts


class HomingError(DeviceError):
    """An axis did not find its stop; the arm is stopped and not homed."""


@dataclass(frozen=True, slots=True)
class HomingConfig:
    """What may have to be adjusted on one arm (by §4.2 the stops are factory values).

    Attributes
    ----------
    stop_counts : what each axis reads at its homing stop [counts]
    park_counts : where each axis goes afterwards [counts]
    zed_speed, zed_force : SPEED and MAX_FORCE on the way up; §3.3's, since UMI's are unknown
    zed_timeout_s, timeout_s : patience for the way to a stop [cell s] (§4.6)
    """

    stop_counts: Mapping[Axis, int] = field(default_factory=lambda: dict(c.STOP_COUNTS))
    park_counts: Mapping[Axis, int] = field(default_factory=lambda: dict(c.PARK_COUNTS))
    zed_speed: int = 30
    zed_force: int = 30
    zed_timeout_s: float = 60.0
    timeout_s: float = 30.0


class Homing:
    """One run of the procedure.

    Parameters
    ----------
    axes : the motors
    config : where the stops are, where to park, speed, force and patience
    guard : called before every request; raises when the run must not go on
    """

    def __init__(self, axes: Axes, config: HomingConfig, guard: Guard) -> None:
        self._axes = axes
        self._config = config
        self._guard = guard

    async def run(self) -> None:
        """Home all axes and park them; the caller verifies the park.

        Raises
        ------
        HomingError : an axis did not find its stop in time, or fell behind on the way
        AxisStalledError : an axis stalled on the way to the park
        """
        await self._ensure_modes()
        await self._clear()
        await self._home_zed()
        await self._home_gripper()
        await self._home_wrist()
        await self._home_shoulder()
        await self._home_elbow_and_yaw()
        await self._label()
        park = self._config.park_counts
        await start(self._axes, park, {}, self._guard, in_turn=True)
        watch = MoveWatch(self._axes, park, self._config.zed_timeout_s, self._guard)
        await watch.until_rest(in_turn=True)

    async def _clear(self) -> None:
        """Set every target to where its axis stands: a go sent by mistake moves nothing.

        Homing keeps it so: counters are 0 and targets near it whenever no axis is under way.
        """
        self._axes.forget()
        await self._reload()
        await self._origin()
        for ip in self._axes.ips():
            for axis in on_ip(Axis, ip):
                await self._write(axis, Parameter.NEW_POSITION, _NEAR_ORIGIN)

    async def _ensure_modes(self) -> None:
        """Undo relative and force mode, which an earlier program may have left (§2.4, §2.8)."""
        for ip in self._axes.ips():
            for axis in on_ip(Axis, ip):
                bits = await self._axes.status(axis)
                if bits & StatusBits.RELATIVE:
                    await self._axes.set_mode(axis, Mode.ABSOLUTE)
                if bits & StatusBits.FORCE_MODE:
                    await self._axes.set_mode(axis, Mode.POSITION)

    # ---- §4.1, steps 1 to 6 ---------------------------------------------------------------------
    async def _home_zed(self) -> None:
        await self._write(Axis.ZED, Parameter.SPEED, self._config.zed_speed)
        await self._write(Axis.ZED, Parameter.MAX_FORCE, self._config.zed_force)
        await self._drive({Axis.ZED: Drive.FORWARD}, self._config.zed_timeout_s)
        await self._origin()

    async def _home_gripper(self) -> None:
        force = await self._axes.read_twice(Axis.GRIPPER, Parameter.MAX_FORCE)
        await self._write(Axis.GRIPPER, Parameter.MAX_FORCE, max(1, force // 2))
        await self._drive({Axis.GRIPPER: Drive.REVERSE})
        await self._origin()
        await self._reload()
        # 0 is 30 counts off fully closed (§4.2)
        await self._creep(Axis.GRIPPER, 30)
        await self._origin_after(Axis.GRIPPER)
        await self._reload()

    async def _home_wrist(self) -> None:
        # the elbow swings the gripper clear of the column while a limp yaw lets itself be dragged
        await self._write(Axis.YAW, Parameter.MAX_FORCE, 0)
        await self._creep(Axis.ELBOW, 440)
        await self._origin_after(Axis.ELBOW)
        await self._reload()
        roll_negative = {Axis.WRIST1: Drive.REVERSE, Axis.WRIST2: Drive.FORWARD}
        pitch_down = {Axis.WRIST1: Drive.REVERSE, Axis.WRIST2: Drive.REVERSE}
        for drives in (roll_negative, pitch_down, roll_negative, pitch_down):
            await self._drive(drives)
        await self._origin()
        await self._reload()

    async def _home_shoulder(self) -> None:
        await self._drive({Axis.SHOULDER: Drive.FORWARD})
        await self._origin()
        await self._reload()

    async def _home_elbow_and_yaw(self) -> None:
        await self._write(Axis.ELBOW, Parameter.SPEED, 80)
        await self._write(Axis.ELBOW, Parameter.MAX_FORCE, 30)
        await self._write(Axis.YAW, Parameter.SPEED, 100)
        await self._write(Axis.YAW, Parameter.MAX_FORCE, 60)
        # the elbow drags the yaw motor along while it leans on its own stop (§4.1)
        await self._write(Axis.YAW, Parameter.ERROR_LIMIT, 1500)
        await self._drive({Axis.ELBOW: Drive.REVERSE, Axis.YAW: Drive.REVERSE})
        await self._origin()
        await self._reload()

    async def _label(self) -> None:
        for ip in (Ip.WRIST, Ip.ARM):  # as in §3.4
            for axis in on_ip(self._config.stop_counts, ip):
                await self._axes.label(axis, self._config.stop_counts[axis], self._guard)
            for axis in on_ip(self._config.stop_counts, ip):
                await self._verify_label(axis)

    async def _verify_label(self, axis: Axis) -> None:
        """Read a label back: its reply does not name the motor that got it (§2.2)."""
        wanted = self._config.stop_counts[axis]
        for _ in range(2):
            got = await self._axes.read_twice(axis, Parameter.CURRENT_POSITION)
            if abs(got - wanted) <= _DITHER_COUNTS:
                return
            await self._axes.label(axis, wanted, self._guard)
        raise HomingError(f"arm: {axis.name.lower()} does not take its label {wanted}")

    # ---- words of §4.1 --------------------------------------------------------------------------
    async def _write(self, axis: Axis, parameter: Parameter, value: int) -> None:
        await self._axes.write(axis, parameter, value, self._guard)

    async def _origin(self) -> None:
        await self._axes.send_both(Simple.DEFINE_HOME, self._guard)

    async def _reload(self) -> None:
        await self._axes.send_both(Simple.LOAD_DEFAULTS, self._guard)

    async def _drive(self, drives: Mapping[Axis, Drive], timeout_s: float | None = None) -> None:
        """Drive axes of one IP until every one of them leans on a stop; hold them there."""
        ip = ADDRESSES[next(iter(drives))].ip
        await self._axes.halt(Simple.DEAD_STOP, verifies=False)
        await self._axes.manual_go(ip.other, {}, self._guard)
        await self._axes.manual_go(ip, drives, self._guard)
        await self._lean(drives, timeout_s or self._config.timeout_s)
        await self._axes.manual_go(ip, {}, self._guard)
        log.info("stop found: %s", ", ".join(axis.name.lower() for axis in drives))

    async def _lean(self, drives: Mapping[Axis, Drive], timeout_s: float) -> None:
        """Wait for bit 3 of all axes, and none moving any more for three polls (§8.12, §9.17)."""
        until_s = self._axes.deadline_s(timeout_s)
        still_poll_count = 0
        before: list[int] = []
        while still_poll_count < _STILL_POLL_COUNT:
            self._guard()
            bits = {axis: await self._axes.status(axis) for axis in drives}
            if all(b & StatusBits.STALLED for b in bits.values()):
                now = [await self._axes.read_actual(axis) for axis in drives]
                is_still = bool(before) and all(
                    abs(a - b) <= _DITHER_COUNTS for a, b in zip(before, now, strict=True)
                )
                still_poll_count = still_poll_count + 1 if is_still else 0
                before = now
            else:
                still_poll_count, before = 0, []
                self._check(bits)
            if self._axes.clock.attended_s() > until_s:
                waiting = [axis for axis, b in bits.items() if not b & StatusBits.STALLED]
                names = ", ".join(axis.name.lower() for axis in waiting or drives)
                raise HomingError(f"arm: {names} found no stop within {timeout_s:.0f} s")
            await self._axes.pause()

    def _check(self, bits: Mapping[Axis, StatusBits]) -> None:
        ended = StatusBits.MOVING | c.FAULT_BITS
        for axis, b in bits.items():
            if b & ended == StatusBits.FOLLOWING_ERROR:
                raise HomingError(
                    f"arm: {axis.name.lower()} fell behind its error limit before its stop"
                )

    async def _creep(self, axis: Axis, counts: int) -> None:
        """Move one axis from its origin; ending against a stop is no error before homing.

        Raises
        ------
        HomingError : its counter is not at 0, or it does neither arrive nor stall
        """
        origin = await self._axes.read_twice(axis, Parameter.CURRENT_POSITION)
        if abs(origin) > _ORIGIN_COUNTS:
            raise HomingError(f"arm: {axis.name.lower()} has its origin at {origin} counts")
        await self._write(axis, Parameter.NEW_POSITION, counts)
        await self._axes.numeric_go(ADDRESSES[axis].ip, [axis], self._guard)
        until_s = self._axes.deadline_s(self._config.timeout_s)
        rest_poll_count = 0
        while rest_poll_count < 2:
            bits = await self._axes.status(axis)
            rest_poll_count = 0 if bits & StatusBits.MOVING else rest_poll_count + 1
            self._guard()
            if self._axes.clock.attended_s() > until_s:
                raise HomingError(f"arm: {axis.name.lower()} does not come to rest")
            if not rest_poll_count:
                await self._axes.pause()
        got = await self._axes.read_twice(axis, Parameter.CURRENT_POSITION)
        if abs(got - counts) > _ORIGIN_COUNTS and not bits & c.FAULT_BITS:
            raise HomingError(f"arm: {axis.name.lower()} was sent to {counts} and is at {got}")

    async def _origin_after(self, axis: Axis) -> None:
        """Set origin and target to where a creep has ended."""
        await self._origin()
        await self._write(axis, Parameter.NEW_POSITION, _NEAR_ORIGIN)
