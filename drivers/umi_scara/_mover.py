"""Moves of the axes: targets checked, play taken up, the move watched, its end proven.

Sections (§) are those of umi_rtx.md.
"""

from collections.abc import Callable, Iterable, Mapping

from ._config import ArmConfig
from ._session import ArmSession
from .model import OutOfRangeError
from .model.limits import COUNTS_ORDER, check_limits
from .motion import GearPlay, MoveWatch, forecast_s, start, verify_arrival
from .protocol import constants as c
from .protocol.constants import Axis, Parameter

# limits that tie axes together (§5.2): to check one, the other must be known
_PARTNERS = {
    Axis.ELBOW: Axis.YAW,
    Axis.YAW: Axis.ELBOW,
    Axis.WRIST1: Axis.WRIST2,
    Axis.WRIST2: Axis.WRIST1,
}


class Mover:
    """Moves one arm's axes to targets.

    Parameters
    ----------
    session : the arm's connection and power
    config : settings of the arm

    Attributes
    ----------
    play : the play of the gears, as it is taken up now
    """

    def __init__(self, session: ArmSession, config: ArmConfig) -> None:
        self._session, self._config = session, config
        self._positions = session.positions
        self.play = GearPlay(config.play_counts)

    async def move(
        self,
        targets: Mapping[Axis, int],
        deadline_s: float | None,
        speeds_for: Callable[[Mapping[Axis, int]], Mapping[Axis, int]],
        forces: Mapping[Axis, int] | None = None,
        *,
        takes_up_play: bool = False,
    ) -> dict[Axis, int]:
        """Move axes to absolute targets and return their true positions [counts].

        A move that ended because a request may have been garbled is begun again from where the arm
        stands, if its counters can be trusted.

        Parameters
        ----------
        targets : target of each axis that moves [counts]; the others stay
        deadline_s : patience from the start on [cell s]; None: by the nominal speeds
        speeds_for : SPEED of axes that get a new one, by the distances [counts]
        forces : MAX_FORCE of axes that get a new one
        takes_up_play : the joint gets to the target, and the motor as much farther as its gear has
            play

        Raises
        ------
        as `UmiScara.move_counts`
        """
        wanted = {axis: int(counts) for axis, counts in targets.items()}
        return await self._session.until_certain(
            lambda: self._move_once(wanted, deadline_s, speeds_for, forces, takes_up_play)
        )

    async def _move_once(
        self,
        wanted: dict[Axis, int],
        deadline_s: float | None,
        speeds_for: Callable[[Mapping[Axis, int]], Mapping[Axis, int]],
        forces: Mapping[Axis, int] | None,
        takes_up_play: bool,
    ) -> dict[Axis, int]:
        async with self._session.motion() as guard:
            await self._positions.make_sure(self._session.axes, guard)
            starts = await self._starts(wanted)
            self.play.note(starts)
            if takes_up_play:
                wanted = self._with_play(wanted, starts)
            moved = {axis: n for axis, n in wanted.items() if self._positions.at_rest(axis) != n}
            self._check_targets(starts | moved, moved)
            if not moved:
                return wanted
            distances = {axis: moved[axis] - starts[axis] for axis in moved}
            new_speeds = speeds_for(distances)
            if deadline_s is None:
                nominal = self._config.nominal_counts_per_s
                speeds = {axis: self._speed(axis, new_speeds) for axis in moved}
                deadline_s = 2 * forecast_s(distances, speeds, nominal) + 2.0
            self._positions.note_leaving(moved)
            if Axis.GRIPPER in moved:
                self._positions.grasps = False
            for axis, force in (forces or {}).items():
                await self._session.axes.write(axis, Parameter.MAX_FORCE, force, guard)

            def on_go() -> None:
                for axis, target in moved.items():
                    self._positions.note_range(axis, starts[axis], target)

            await start(self._session.axes, moved, new_speeds, guard, on_go=on_go)
            await MoveWatch(self._session.axes, moved, deadline_s, guard).until_rest()
            guard()
            got = await self.arrive(moved)
            guard()
            self._positions.note_rest(moved)
            self.play.note(moved)
        return {axis: got.get(axis, wanted[axis]) for axis in wanted}

    def _with_play(self, joints: Mapping[Axis, int], motors: Mapping[Axis, int]) -> dict[Axis, int]:
        """Return the motor targets for joints; near a limit, without the motors' play."""
        targets = self.play.targets(joints, motors)
        try:
            self._check_targets({**motors, **targets}, targets)
        except OutOfRangeError:
            return dict(joints)
        return targets

    def note_stops_and(self, park: Mapping[Axis, int]) -> None:
        """Note that all motors have gone from their stops to the park."""
        self.play.forget()
        self.play.note(self._config.homing.stop_counts)
        self.play.note(park)

    def _speed(self, axis: Axis, new_speeds: Mapping[Axis, int]) -> int:
        known = new_speeds.get(axis) or self._session.axes.written(axis, Parameter.SPEED)
        return known or c.NOMINAL_SPEED

    async def _starts(self, targets: Iterable[Axis]) -> dict[Axis, int]:
        """Return the positions of the axes of a move, and of those that share a limit with them."""
        needed = {*targets, *(_PARTNERS[axis] for axis in targets if axis in _PARTNERS)}
        at_rest = {axis: self._positions.at_rest(axis) for axis in needed}
        read = await self._session.axes.read_actuals(
            axis for axis in Axis if axis in needed and at_rest[axis] is None
        )
        return {axis: read[axis] if counts is None else counts for axis, counts in at_rest.items()}

    def _check_targets(self, counts: Mapping[Axis, int], moved: Iterable[Axis]) -> None:
        changed = set(moved)
        if Axis.GRIPPER in changed:
            low, high = c.GRIPPER_RANGE
            asked = counts[Axis.GRIPPER]
            if not low <= asked <= high:
                raise OutOfRangeError("gripper", asked, low if asked < low else high)
        # axes outside the move share no limit with it: any value does for them
        check_limits([counts.get(axis, 0) for axis in COUNTS_ORDER], changed)

    async def arrive(self, targets: Mapping[Axis, int]) -> dict[Axis, int]:
        """Return the positions of axes once they are at their targets [counts].

        Raises
        ------
        AxisStalledError : one is not, and has come to rest
        """
        slack = self._config.arrival_slack_counts
        tolerances = {axis: self._positions.dead_bands.get(axis, 0) + slack for axis in targets}
        return await verify_arrival(self._session.axes, targets, tolerances, self._config.settle_s)
