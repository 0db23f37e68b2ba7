"""Finding the stops of the arm: drive axes until they lean, then label the stops (§4.1, §4.2).

Building blocks of every homing procedure. Sections (§) are those of umi_rtx.md.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.errors import DeviceError
from messages import say

from ..line import Guard
from ..protocol import constants as c
from ..protocol.constants import ADDRESSES, Axis, Drive, Mode, Parameter, Simple, StatusBits
from ._axes import Axes
from ._moves import on_ip

log = logging.getLogger(__name__)

_STILL_POLL_COUNT = 3  # §9.17
_DITHER_COUNTS = 1  # a motor that leans on its stop may flicker between two encoder counts


class HomingError(DeviceError):
    """An axis did not find its stop; the arm is stopped and not homed."""


@dataclass(frozen=True, slots=True)
class HomingConfig:
    """The values that may need adjusting on one arm (by §4.2 the stops are factory values).

    Attributes
    ----------
    stop_counts : reading of each axis at its homing stop [counts]
    park_counts : final position of each axis [counts]
    zed_speed, zed_force : SPEED and MAX_FORCE on the way up; §3.3's, since UMI's are unknown
    zed_timeout_s, timeout_s : patience for the way to a stop [cell s] (§4.6)
    """

    stop_counts: Mapping[Axis, int] = field(default_factory=lambda: dict(c.STOP_COUNTS))
    park_counts: Mapping[Axis, int] = field(default_factory=lambda: dict(c.PARK_COUNTS))
    zed_speed: int = 30
    zed_force: int = 30
    zed_timeout_s: float = 60.0
    timeout_s: float = 30.0


class Stops:
    """Drives axes to their stops and labels them.

    Parameters
    ----------
    axes : the motors
    config : patience
    guard : called before every request; raises when the run must not go on
    """

    def __init__(self, axes: Axes, config: HomingConfig, guard: Guard) -> None:
        self._axes = axes
        self._config = config
        self._guard = guard

    async def ensure_modes(self) -> None:
        """Undo relative and force mode, which an earlier program may have left (§2.4, §2.8)."""
        for ip in self._axes.ips():
            for axis in on_ip(Axis, ip):
                bits = await self._axes.status(axis)
                if bits & StatusBits.RELATIVE:
                    await self._axes.set_mode(axis, Mode.ABSOLUTE)
                if bits & StatusBits.FORCE_MODE:
                    await self._axes.set_mode(axis, Mode.POSITION)

    async def write(self, axis: Axis, parameter: Parameter, value: int) -> None:
        """Write a parameter of a motor.

        Parameters
        ----------
        axis : the motor
        parameter : parameter number
        value : in the parameter's own units, a signed word
        """
        await self._axes.write(axis, parameter, value, self._guard)

    async def drive(self, drives: Mapping[Axis, Drive], timeout_s: float | None = None) -> None:
        """Drive axes of one IP until every one of them leans on a stop; hold them there.

        Parameters
        ----------
        drives : direction of each axis
        timeout_s : patience, that of the settings if None [cell s]

        Raises
        ------
        HomingError : one found no stop in time, or fell behind before it
        """
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
                raise HomingError(
                    say(
                        "arm: {names} found no stop within {timeout_s:.0f} s",
                        names=names,
                        timeout_s=timeout_s,
                    )
                )
            await self._axes.pause()

    def _check(self, bits: Mapping[Axis, StatusBits]) -> None:
        ended = StatusBits.MOVING | c.FAULT_BITS
        for axis, b in bits.items():
            if b & ended == StatusBits.FOLLOWING_ERROR:
                raise HomingError(
                    say(
                        "arm: {name} fell behind its error limit before its stop",
                        name=axis.name.lower(),
                    )
                )

    async def verify_label(self, axis: Axis, wanted: int) -> None:
        """Read a label back: its reply does not name the motor that got it (§2.2).

        Parameters
        ----------
        axis : labelled
        wanted : its label [counts]

        Raises
        ------
        HomingError : it does not take the label
        """
        for _ in range(2):
            got = await self._axes.read_twice(axis, Parameter.CURRENT_POSITION)
            if abs(got - wanted) <= _DITHER_COUNTS:
                return
            await self._axes.label(axis, wanted, self._guard)
        raise HomingError(
            say(
                "arm: {name} does not take its label {wanted}",
                name=axis.name.lower(),
                wanted=wanted,
            )
        )
