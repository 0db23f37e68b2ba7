"""The jaws of the arm: closed until they stall, driven by a travel, read.

Sections (§) are those of umi_rtx.md.
"""

from typing import Final

from drivers.kinds import JawReading
from messages import key, say

from ._config import ArmConfig
from ._session import ArmSession
from .line import Guard
from .motion import AxisStalledError
from .protocol import constants as c
from .protocol.constants import ADDRESSES, Axis, Drive, Parameter, StatusBits

_STILL_POLL_COUNT: Final = 3  # §9.17


class Jaws:
    """The jaws of one arm.

    Parameters
    ----------
    session : the arm's connection and power
    config : settings of the arm
    """

    def __init__(self, session: ArmSession, config: ArmConfig) -> None:
        self._session, self._config = session, config
        self._positions = session.positions

    async def close(self, force: int, deadline_s: float, speed_share: float) -> float:
        """Close the jaws once until they stall; return the opening [mm].

        Parameters
        ----------
        force : MAX_FORCE, which stays
        deadline_s : time limit at full speed [cell s]
        speed_share : share of that speed

        Raises
        ------
        AxisStalledError : the jaws have not come to rest against anything by the deadline
        """
        gripper = Axis.GRIPPER
        async with self._session.motion() as guard:
            axes = self._session.axes
            await self._positions.make_sure(axes, guard)
            self._positions.note_leaving([gripper])
            self._positions.grasps = True
            speed = max(1, round(self._config.grasp_speed * speed_share))
            await axes.write(gripper, Parameter.SPEED, speed, guard)
            await axes.write(gripper, Parameter.MAX_FORCE, force, guard)
            await axes.write(gripper, Parameter.NEW_POSITION, c.GRASP_COUNTS, guard)
            self._positions.note_closing(c.GRIPPER_RANGE[0])
            await axes.numeric_go(ADDRESSES[gripper].ip, [gripper], guard)
            counts = await self._until_held(deadline_s / speed_share, guard)
            self._positions.note_range(gripper, counts, counts)
        return self._config.gripper.opening_mm(counts)

    async def read_opening_mm(self) -> float:
        """Return the present jaw opening [mm]; raises as `read_counts`."""
        self._session.require_homed()
        axes = self._session.axes
        counts = await self._session.read(
            lambda: axes.read_actual_twice(Axis.GRIPPER), lambda: axes.read_actual(Axis.GRIPPER)
        )
        self._session.require_homed()
        return self._config.gripper.opening_mm(counts)

    async def read(self) -> JawReading:
        """Return the state of the jaws, homed or not; nothing moves."""
        self._session.require_connected()
        bits = await self._session.axes.status(Axis.GRIPPER)
        # a status has no checksum: a bit seen once counts
        bits |= await self._session.axes.status(Axis.GRIPPER)
        # the stop on opening the line may have cleared it
        bits |= self._session.jaws_found
        counts = await self._session.axes.read_actual_twice(Axis.GRIPPER)
        return JawReading(bool(bits & StatusBits.STALLED), self._config.gripper.opening_mm(counts))

    async def drive(self, by_mm: float, deadline_s: float) -> float:
        """Return how far the jaws went [mm], as `UmiScara.drive_jaws` does.

        Raises
        ------
        AxisStalledError : they did not come to rest by the deadline
        """
        gripper, ip = Axis.GRIPPER, ADDRESSES[Axis.GRIPPER].ip
        mm_per_count = self._config.gripper.linear_mm
        async with self._session.motion(needs_home=False) as guard:
            axes = self._session.axes
            self._positions.note_jaws_driven()
            before = await axes.read_actual(gripper)
            await axes.write(gripper, Parameter.SPEED, self._config.grasp_speed, guard)
            await axes.write(gripper, Parameter.MAX_FORCE, self._config.gripper_force, guard)
            drive = Drive.FORWARD if by_mm > 0 else Drive.REVERSE
            await axes.manual_go(ip, {gripper: drive}, guard)
            until_s = axes.deadline_s(deadline_s)
            while True:
                guard()
                bits = await axes.status(gripper)
                counts = await axes.read_actual(gripper)
                went_mm = abs(counts - before) * mm_per_count
                if went_mm >= abs(by_mm) or bits & c.FAULT_BITS:
                    break
                if axes.clock.attended_s() > until_s:
                    await self._session.halt_quietly()
                    raise AxisStalledError(gripper, before, counts, key("does not come to rest"))
                await axes.pause()
            await axes.manual_go(ip, {}, guard)
        return went_mm

    async def _until_held(self, deadline_s: float, guard: Guard) -> int:
        """Return the counts of the gripper once it rests against something (§2.8, §9.17)."""
        axes = self._session.axes
        until_s = axes.deadline_s(deadline_s)
        still_poll_count, before = 0, None
        while True:
            guard()
            bits = await axes.status(Axis.GRIPPER)
            counts = await axes.read_actual(Axis.GRIPPER)
            still_poll_count = still_poll_count + 1 if counts == before else 0
            before = counts
            if still_poll_count >= _STILL_POLL_COUNT and not bits & StatusBits.MOVING:
                if bits & c.FAULT_BITS:
                    return counts
                why = key("rests against nothing (is motor power on?)")
                break
            if axes.clock.attended_s() > until_s:
                why = say("still closes after {deadline_s:.1f} s", deadline_s=deadline_s)
                break
            await axes.pause()
        await self._session.halt_quietly()
        raise AxisStalledError(Axis.GRIPPER, c.GRASP_COUNTS, counts, why)
