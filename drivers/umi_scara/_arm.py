"""The UMI RTX arm as the cell uses it: connect, power, home, move, grip, stop.

It does not know what it holds, plans no path and avoids no obstacle. Targets are checked against
the joint limits of §5.2 before any byte goes out. Soak tests, built-in INIT and interpolation exist
in the codec alone. Sections (§) are those of umi_rtx.md.
"""

import logging
from collections.abc import Callable, Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..kinds import JawReading
from ._session import ArmSession, check_speeds
from .line import Guard, LineUncertainError
from .model import OutOfRangeError, kinematics
from .model.limits import COUNTS_ORDER, check_limits
from .motion import (
    AxisStalledError,
    Homing,
    Watch,
    forecast_s,
    on_ip,
    start,
    synchronised_speeds,
    verify_arrival,
)
from .protocol import constants as c
from .protocol.constants import ADDRESSES, Axis, Drive, Parameter, StatusBits

log = logging.getLogger(__name__)

# limits that tie axes together (§5.2): to check one, the other must be known
_PARTNERS = {
    Axis.ELBOW: Axis.YAW,
    Axis.YAW: Axis.ELBOW,
    Axis.WRIST1: Axis.WRIST2,
    Axis.WRIST2: Axis.WRIST1,
}
_STILL_POLL_COUNT = 3  # §9.17


class UmiScara(ArmSession):
    """One arm on one line. All verbs are coroutines of one event loop.

    A moving verb that is cancelled or fails sends a dead stop to both IPs before it ends. Any
    answer 0E or 0F raises PositionLostError; from then on `is_homed` is False, motors have no
    power as far as this object is concerned, and no position is reported, until `connect`,
    `enable_power` and `home` have been through again (§1.5).

    Parameters
    ----------
    port : device node of the serial line, or a function that opens a transport
    trace : called with every exchange on the wire; the logger ``cellctl.wire.arm`` has them, too
    """

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
        async with self._motion(needs_home=False) as guard:
            self._is_homed = False
            self._rest_counts.clear()
            await Homing(self._axes, self._config.homing, guard).run()
            self._dead_bands = {
                axis: await self._axes.read_twice(axis, Parameter.DEAD_BAND)
                for ip in self._axes.ips()
                for axis in on_ip(Axis, ip)
            }
            await self._arrive(self._config.homing.park_counts)
            guard()
            self._rest_counts.update(self._config.homing.park_counts)
            self._known = {axis: (n, n) for axis, n in self._config.homing.park_counts.items()}
            self._may_be_relabelled = self._may_be_zeroed = self._grasps = False
            self._is_homed = self._is_sure = True
        log.info("arm homed")

    async def read_counts(self) -> dict[Axis, int]:
        """Return the true position of all seven motors [counts], in the order of Axis.

        Raises
        ------
        PositionLostError : not homed, or an IP has restarted
        """
        self._require_homed()
        if self._one_motion.locked():
            counts = await self._axes.read_actuals(Axis)
        else:
            counts = await self._read_all()
        self._require_homed()  # another request may have found the position lost meanwhile
        return counts

    async def read_q(self) -> NDArray[np.float64]:
        """Return the joints (6,) in `kinematics.Q_ORDER` [rad, mm]; raises as `read_counts`."""
        counts = await self.read_counts()
        return kinematics.counts_to_q([counts[axis] for axis in COUNTS_ORDER])

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
        targets : where each axis that moves is to stand [counts]; the others stay
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
        return await self._move(targets, deadline_s, lambda distances: new_speeds)

    async def move_joints(
        self, q: ArrayLike, speed: int = c.NOMINAL_SPEED, deadline_s: float | None = None
    ) -> None:
        """Move to joints (6,) in `kinematics.Q_ORDER` [rad, mm], all axes arriving together.

        Parameters
        ----------
        q : (6,) joints in `kinematics.Q_ORDER` [rad, zed in mm]
        speed : SPEED of the axis that needs longest; the others get less (§8.13)
        deadline_s : patience from the start on [cell s]; by default from the nominal speeds

        Raises
        ------
        as `move_counts`
        ValueError : not six finite numbers, or a SPEED outside its range
        """
        row = np.asarray(q, dtype=np.float64)
        if row.shape != (6,) or not np.isfinite(row).all():
            raise ValueError(f"joints are six finite numbers, not {row}")
        targets = dict(zip(COUNTS_ORDER, kinematics.q_to_counts(row).tolist(), strict=True))
        check_speeds({Axis.ELBOW: speed})
        nominal = self._config.nominal_counts_per_s
        await self._move(targets, deadline_s, lambda far: synchronised_speeds(far, nominal, speed))

    # ---- gripper -------------------------------------------------------------------------------
    async def move_gripper_mm(self, width_mm: float) -> float:
        """Open or close the jaws to a width [mm] in empty air; return the width reached (§5.5).

        Raises
        ------
        OutOfRangeError : the jaws do not open so far
        AxisStalledError : something is in the way; to hold it, use `grasp`
        """
        counts = self._config.gripper.counts(width_mm)
        forces = {Axis.GRIPPER: self._config.gripper_force}
        got = await self._move({Axis.GRIPPER: counts}, None, lambda _: {}, forces)
        return self._config.gripper.width_mm(got[Axis.GRIPPER])

    async def open_jaws(self) -> float:
        """Open the jaws as far as they go; return the width [mm]."""
        return await self.move_gripper_mm(self._config.gripper.max_width_mm)

    async def close_jaws(self) -> float:
        """Close empty jaws; return the width [mm]. Raises AxisStalledError on anything held."""
        return await self.move_gripper_mm(0.0)

    async def grasp(self, force: int, deadline_s: float = 10.0) -> float:
        """Close the jaws until they stall, on something or on each other (§5.5).

        Parameters
        ----------
        force : MAX_FORCE, which stays; 20 to 60 have been used
        deadline_s : how long the jaws may take to come to rest [cell s]

        Returns
        -------
        jaw opening [mm]; near 0 means that nothing is held, which is for the caller to judge

        Raises
        ------
        AxisStalledError : the jaws have not come to rest against anything by the deadline
        ValueError : the force is below 1
        """
        if force < 1:
            raise ValueError(f"a grasp needs a force above 0, not {force}")
        gripper = Axis.GRIPPER
        async with self._motion() as guard:
            await self._make_sure(guard)
            self._rest_counts.pop(gripper, None)
            self._grasps = True
            await self._axes.write(gripper, Parameter.SPEED, self._config.grasp_speed, guard)
            await self._axes.write(gripper, Parameter.MAX_FORCE, force, guard)
            await self._axes.write(gripper, Parameter.NEW_POSITION, c.GRASP_COUNTS, guard)
            if gripper in self._known:
                self._known[gripper] = c.GRIPPER_RANGE[0], self._known[gripper][1]
            await self._axes.numeric_go(ADDRESSES[gripper].ip, [gripper], guard)
            counts = await self._until_held(deadline_s, guard)
            self._known[gripper] = (counts, counts)
        return self._config.gripper.width_mm(counts)

    async def read_opening_mm(self) -> float:
        """Return the jaw opening [mm] as it is now; raises as `read_counts`."""
        self._require_homed()
        if self._one_motion.locked():
            counts = await self._axes.read_actual(Axis.GRIPPER)
        else:
            counts = await self._axes.read_actual_twice(Axis.GRIPPER)
        self._require_homed()
        return self._config.gripper.width_mm(counts)

    async def read_jaws(self) -> JawReading:
        """Return how the jaws stand, homed or not; nothing moves."""
        self._require_connected()
        bits = await self._axes.status(Axis.GRIPPER)
        bits |= await self._axes.status(
            Axis.GRIPPER
        )  # a status has no checksum: a bit seen once counts
        counts = await self._axes.read_actual_twice(Axis.GRIPPER)
        return JawReading(bool(bits & StatusBits.STALLED), self._config.gripper.width_mm(counts))

    async def drive_jaws(self, by_mm: float, deadline_s: float = 10.0) -> float:
        """Open (or, below 0, close) the jaws by about so much [mm]; no other axis moves.

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
        gripper, ip = Axis.GRIPPER, ADDRESSES[Axis.GRIPPER].ip
        mm_per_count = self._config.gripper.linear_mm
        async with self._motion(needs_home=False) as guard:
            self._rest_counts.pop(gripper, None)
            self._known.pop(gripper, None)
            self._is_sure = self._grasps = False
            before = await self._axes.read_actual(gripper)
            await self._axes.write(gripper, Parameter.SPEED, self._config.grasp_speed, guard)
            await self._axes.write(gripper, Parameter.MAX_FORCE, self._config.gripper_force, guard)
            drive = Drive.FORWARD if by_mm > 0 else Drive.REVERSE
            await self._axes.manual_go(ip, {gripper: drive}, guard)
            until_s = self._axes.deadline_s(deadline_s)
            while True:
                guard()
                bits = await self._axes.status(gripper)
                counts = await self._axes.read_actual(gripper)
                went_mm = abs(counts - before) * mm_per_count
                if went_mm >= abs(by_mm) or bits & c.FAULT_BITS:
                    break
                if self._axes.clock.attended_s() > until_s:
                    await self._halt_quietly()
                    raise AxisStalledError(gripper, before, counts, "does not come to rest")
                await self._axes.pause()
            await self._axes.manual_go(ip, {}, guard)
        return went_mm

    # ---- parts of the verbs --------------------------------------------------------------------
    async def _move(
        self,
        targets: Mapping[Axis, int],
        deadline_s: float | None,
        speeds_for: Callable[[Mapping[Axis, int]], Mapping[Axis, int]],
        forces: Mapping[Axis, int] | None = None,
    ) -> dict[Axis, int]:
        """Move as `move_counts` does, with speeds that follow from the distances [counts].

        A move that ended because a request may have been garbled is started once more from where
        the arm stands, if its counters can be trusted.
        """
        wanted = {axis: int(counts) for axis, counts in targets.items()}
        try:
            return await self._move_once(wanted, deadline_s, speeds_for, forces)
        except LineUncertainError as error:
            log.warning("the move is begun again: %s", error)
            return await self._move_once(wanted, deadline_s, speeds_for, forces)

    async def _move_once(
        self,
        wanted: dict[Axis, int],
        deadline_s: float | None,
        speeds_for: Callable[[Mapping[Axis, int]], Mapping[Axis, int]],
        forces: Mapping[Axis, int] | None,
    ) -> dict[Axis, int]:
        async with self._motion() as guard:
            await self._make_sure(guard)
            starts = await self._starts(wanted)
            moved = {axis: n for axis, n in wanted.items() if self._rest_counts.get(axis) != n}
            self._check_targets(starts | moved, moved)
            if not moved:
                return wanted
            distances = {axis: moved[axis] - starts[axis] for axis in moved}
            new_speeds = speeds_for(distances)
            if deadline_s is None:
                nominal = self._config.nominal_counts_per_s
                speeds = {axis: self._speed(axis, new_speeds) for axis in moved}
                deadline_s = 2 * forecast_s(distances, speeds, nominal) + 2.0
            for axis in moved:
                self._rest_counts.pop(axis, None)
            if Axis.GRIPPER in moved:
                self._grasps = False
            for axis, force in (forces or {}).items():
                await self._axes.write(axis, Parameter.MAX_FORCE, force, guard)

            def on_go() -> None:
                for axis, target in moved.items():
                    self._known[axis] = min(starts[axis], target), max(starts[axis], target)

            await start(self._axes, moved, new_speeds, guard, on_go=on_go)
            await Watch(self._axes, moved, deadline_s, guard).until_rest()
            guard()
            got = await self._arrive(moved)
            guard()
            self._rest_counts.update(moved)
            self._known.update({axis: (n, n) for axis, n in moved.items()})
        return {axis: got.get(axis, wanted[axis]) for axis in wanted}

    def _speed(self, axis: Axis, new_speeds: Mapping[Axis, int]) -> int:
        known = new_speeds.get(axis) or self._axes.written(axis, Parameter.SPEED)
        return known or c.NOMINAL_SPEED

    async def _starts(self, targets: Iterable[Axis]) -> dict[Axis, int]:
        """Return where the axes of a move are now, and those that share a limit with them."""
        needed = {*targets, *(_PARTNERS[axis] for axis in targets if axis in _PARTNERS)}
        unknown = [axis for axis in Axis if axis in needed and axis not in self._rest_counts]
        read = await self._axes.read_actuals(unknown)
        return {axis: self._rest_counts.get(axis, read.get(axis, 0)) for axis in needed}

    def _check_targets(self, counts: Mapping[Axis, int], moved: Iterable[Axis]) -> None:
        changed = set(moved)
        if Axis.GRIPPER in changed:
            low, high = c.GRIPPER_RANGE
            asked = counts[Axis.GRIPPER]
            if not low <= asked <= high:
                raise OutOfRangeError("gripper", asked, low if asked < low else high)
        # axes outside the move share no limit with it: any value does for them
        check_limits([counts.get(axis, 0) for axis in COUNTS_ORDER], changed)

    async def _arrive(self, targets: Mapping[Axis, int]) -> dict[Axis, int]:
        slack = self._config.arrival_slack_counts
        tolerances = {axis: self._dead_bands.get(axis, 0) + slack for axis in targets}
        return await verify_arrival(self._axes, targets, tolerances, self._config.settle_s)

    async def _until_held(self, deadline_s: float, guard: Guard) -> int:
        """Return the counts of the gripper once it rests against something (§2.8, §9.17)."""
        until_s = self._axes.deadline_s(deadline_s)
        still_poll_count, before = 0, None
        while True:
            guard()
            bits = await self._axes.status(Axis.GRIPPER)
            counts = await self._axes.read_actual(Axis.GRIPPER)
            still_poll_count = still_poll_count + 1 if counts == before else 0
            before = counts
            if still_poll_count >= _STILL_POLL_COUNT and not bits & StatusBits.MOVING:
                if bits & c.FAULT_BITS:
                    return counts
                why = "rests against nothing (is motor power on?)"
                break
            if self._axes.clock.attended_s() > until_s:
                why = f"still closes after {deadline_s:.1f} s"
                break
            await self._axes.pause()
        await self._halt_quietly()
        raise AxisStalledError(Axis.GRIPPER, c.GRASP_COUNTS, counts, why)
