"""Homing against end stops by UMI's own procedure (umi_rtx.md 4.1, 4.2, 4.6).

The arm has no home switches: each axis is driven until it stalls, and the stop it leans on is
labelled. `21` zeroes all counters of an IP, so a homed axis stands still until the labels.

Sections (§) are those of umi_rtx.md.
"""

import logging

from drivers.kinds import Confirm
from messages import key, say

from ..line import Guard
from ..protocol import constants as c
from ..protocol.constants import ADDRESSES, Axis, Drive, Ip, Parameter, Simple, StatusBits
from ._axes import Axes
from ._moves import MoveWatch, on_ip, start
from ._stops import HomingConfig, HomingError, Stops

log = logging.getLogger(__name__)

_ORIGIN_COUNTS = 4  # DEAD_BAND, and two counts of reading
_SHOULDER_TRIES = 3
# below DEAD_BAND, but not the park's 0: a write of 0 must be visible when read back
_NEAR_ORIGIN = 1


class Homing:
    """One run of the procedure.

    Parameters
    ----------
    axes : the motors
    config : positions of the stops, park position, speed, force and patience
    guard : called before every request; raises when the run must not go on
    confirm : awaited with what moves next, before it does; None to home in one go
    """

    def __init__(
        self, axes: Axes, config: HomingConfig, guard: Guard, confirm: Confirm | None = None
    ) -> None:
        self._axes = axes
        self._config = config
        self._guard = guard
        self._confirm = confirm
        self._stops = Stops(axes, config, guard)

    async def run(self) -> None:
        """Home all axes and park them; the caller verifies the park.

        Raises
        ------
        HomingError : an axis did not find its stop in time, or fell behind on the way
        AxisStalledError : an axis stalled on the way to the park
        """
        await self.prepare()
        for what, home in (
            (key("zed goes up to its stop"), self._home_zed),
            ("the jaws close", self._home_gripper),
            ("the elbow turns a little, then the wrist turns to its stops", self._home_wrist),
            ("the shoulder turns to its stop", self._home_shoulder),
            ("elbow and yaw turn to their stops", self._home_elbow_and_yaw),
            ("the shoulder turns on, if the folded arm held it back", self._home_shoulder_again),
        ):
            await self._confirmed(what)
            await home()
        await self._label()
        await self._confirmed("all joints go from their stops to the park")
        park = self._config.park_counts
        await start(self._axes, park, {}, self._guard, in_turn=True)
        watch = MoveWatch(self._axes, park, self._config.zed_timeout_s, self._guard)
        await watch.until_rest(in_turn=True)

    async def prepare(self) -> None:
        """Set modes and targets so that a go sent by mistake moves nothing; nothing moves."""
        await self._stops.ensure_modes()
        await self._clear()

    async def _confirmed(self, what: str) -> None:
        if self._confirm is not None:
            await self._confirm(what)
            self._guard()

    async def _clear(self) -> None:
        """Set every target to its axis's position: a go sent by mistake moves nothing.

        Homing keeps it so: counters are 0 and targets near it whenever no axis is under way.
        """
        self._axes.forget()
        await self._reload()
        await self._origin()
        for ip in self._axes.ips():
            for axis in on_ip(Axis, ip):
                await self._stops.write(axis, Parameter.NEW_POSITION, _NEAR_ORIGIN)

    # ---- §4.1, steps 1 to 6 ---------------------------------------------------------------------
    async def _home_zed(self) -> None:
        await self._stops.write(Axis.ZED, Parameter.SPEED, self._config.zed_speed)
        await self._stops.write(Axis.ZED, Parameter.MAX_FORCE, self._config.zed_force)
        await self._stops.drive({Axis.ZED: Drive.FORWARD}, self._config.zed_timeout_s)
        await self._origin()

    async def _home_gripper(self) -> None:
        force = await self._axes.read_twice(Axis.GRIPPER, Parameter.MAX_FORCE)
        await self._stops.write(Axis.GRIPPER, Parameter.MAX_FORCE, max(1, force // 2))
        await self._stops.drive({Axis.GRIPPER: Drive.REVERSE})
        await self._origin()
        await self._reload()
        # 0 is 30 counts off fully closed (§4.2)
        await self._creep(Axis.GRIPPER, 30)
        await self._origin_after(Axis.GRIPPER)
        await self._reload()

    async def _home_wrist(self) -> None:
        # the elbow swings the gripper clear of the column while a limp yaw lets itself be dragged
        await self._stops.write(Axis.YAW, Parameter.MAX_FORCE, 0)
        await self._creep(Axis.ELBOW, c.HOMING_CREEP_COUNTS)
        await self._origin_after(Axis.ELBOW)
        await self._reload()
        roll_negative = {Axis.WRIST1: Drive.REVERSE, Axis.WRIST2: Drive.FORWARD}
        pitch_down = {Axis.WRIST1: Drive.REVERSE, Axis.WRIST2: Drive.REVERSE}
        for drives in (roll_negative, pitch_down, roll_negative, pitch_down):
            await self._stops.drive(drives)
        await self._origin()
        await self._reload()

    async def _home_shoulder(self) -> None:
        await self._stops.drive({Axis.SHOULDER: Drive.FORWARD})
        await self._origin()
        await self._reload()

    async def _home_shoulder_again(self) -> None:
        """Prove the shoulder's stop now that the elbow is at its own.

        With the elbow folded beyond 92 degrees the palm meets the column first, and the shoulder
        stalls up to 16 degrees early: a stall alone does not identify the obstacle.

        Raises
        ------
        HomingError : the shoulder goes on and on; something is in its way
        """
        for _ in range(_SHOULDER_TRIES):
            await self._stops.drive({Axis.SHOULDER: Drive.FORWARD})
            further = await self._axes.read_actual_twice(Axis.SHOULDER)
            await self._origin()
            await self._reload()
            if abs(further) <= _ORIGIN_COUNTS:
                return
            log.info("the shoulder was %d counts short of its stop", further)
            await self._home_elbow_and_yaw()
        raise HomingError(
            key("arm: the shoulder stalls elsewhere each time; clear what is in its way")
        )

    async def _home_elbow_and_yaw(self) -> None:
        await self._stops.write(Axis.ELBOW, Parameter.SPEED, 80)
        await self._stops.write(Axis.ELBOW, Parameter.MAX_FORCE, 30)
        await self._stops.write(Axis.YAW, Parameter.SPEED, 100)
        await self._stops.write(Axis.YAW, Parameter.MAX_FORCE, 60)
        # the elbow drags the yaw motor along while it leans on its own stop (§4.1)
        await self._stops.write(Axis.YAW, Parameter.ERROR_LIMIT, 1500)
        await self._stops.drive({Axis.ELBOW: Drive.REVERSE, Axis.YAW: Drive.REVERSE})
        await self._origin()
        await self._reload()

    async def _label(self) -> None:
        for ip in (Ip.WRIST, Ip.ARM):  # as in §3.4
            for axis in on_ip(self._config.stop_counts, ip):
                await self._axes.label(axis, self._config.stop_counts[axis], self._guard)
            for axis in on_ip(self._config.stop_counts, ip):
                await self._stops.verify_label(axis, self._config.stop_counts[axis])

    # ---- words of §4.1 --------------------------------------------------------------------------
    async def _origin(self) -> None:
        await self._axes.send_both(Simple.DEFINE_HOME, self._guard)

    async def _reload(self) -> None:
        await self._axes.send_both(Simple.LOAD_DEFAULTS, self._guard)

    async def _creep(self, axis: Axis, counts: int) -> None:
        """Move one axis from its origin; ending against a stop is no error before homing.

        Raises
        ------
        HomingError : its counter is not at 0, or it does neither arrive nor stall
        """
        origin = await self._axes.read_twice(axis, Parameter.CURRENT_POSITION)
        if abs(origin) > _ORIGIN_COUNTS:
            raise HomingError(
                say(
                    "arm: {name} has its origin at {origin} counts",
                    name=axis.name.lower(),
                    origin=origin,
                )
            )
        await self._stops.write(axis, Parameter.NEW_POSITION, counts)
        await self._axes.numeric_go(ADDRESSES[axis].ip, [axis], self._guard)
        until_s = self._axes.deadline_s(self._config.timeout_s)
        rest_poll_count = 0
        while rest_poll_count < 2:
            bits = await self._axes.status(axis)
            rest_poll_count = 0 if bits & StatusBits.MOVING else rest_poll_count + 1
            self._guard()
            if self._axes.clock.attended_s() > until_s:
                raise HomingError(say("arm: {name} does not come to rest", name=axis.name.lower()))
            if not rest_poll_count:
                await self._axes.pause()
        got = await self._axes.read_twice(axis, Parameter.CURRENT_POSITION)
        if abs(got - counts) > _ORIGIN_COUNTS and not bits & c.FAULT_BITS:
            raise HomingError(
                say(
                    "arm: {name} was sent to {counts} and is at {got}",
                    name=axis.name.lower(),
                    counts=counts,
                    got=got,
                )
            )

    async def _origin_after(self, axis: Axis) -> None:
        """Set origin and target to the end of a creep."""
        await self._origin()
        await self._stops.write(axis, Parameter.NEW_POSITION, _NEAR_ORIGIN)
