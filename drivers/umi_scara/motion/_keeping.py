"""Homing with an object in the jaws, which are pressed and never opened (umi_rtx.md 4.7).

Beside UMI's procedure it needs a rough idea of where the axes stand: the labels of a rough guess
let it straighten the arm, and stand aside from the column, before it drives to stops. Each stop is
labelled at once, since counters that were made zero anew would lose it. `model.homing_sweep` says
where this takes the joints; the two have to agree.

Sections (§) are those of umi_rtx.md.
"""

from collections.abc import Mapping

from drivers.errors import PositionLostError
from messages import say

from ..line import Guard
from ..protocol import constants as c
from ..protocol.constants import Axis, Drive, Parameter
from ._axes import Axes
from ._moves import MoveWatch, start, synchronised_speeds
from ._positions import axes_in_turn
from ._stops import HomingConfig, Stops

# Largest motion of jaws since they last pressed on the thing between them [counts]: half a
# millimetre, a little more than the reading.
JAWS_SLACK_COUNTS = 8
_SAME_COUNTS = 2
# of the arm with something in its jaws, beside a nominal 100 (§5.6)
_SPEED = 30
_LEAN_FORCE = 40
_ROLL_NEGATIVE = {Axis.WRIST1: Drive.REVERSE, Axis.WRIST2: Drive.FORWARD}
_PITCH_DOWN = {Axis.WRIST1: Drive.REVERSE, Axis.WRIST2: Drive.REVERSE}


def keeping_park(park: Mapping[Axis, int]) -> dict[Axis, int]:
    """Return the final position of all axes but the gripper after this homing [counts].

    Parameters
    ----------
    park : park of UMI's procedure
    """
    places = dict(park) | {Axis.ZED: c.KEEPING_ZED_COUNTS}
    places.pop(Axis.GRIPPER, None)
    return places


class KeepingHoming:
    """One run of the procedure.

    Parameters
    ----------
    axes : the motors
    config : positions of the stops, park position, patience
    nominal : speed of each axis at SPEED 100 [counts/s]
    press_force : MAX_FORCE with which the jaws press
    guard : called before every request; raises when the run must not go on
    """

    def __init__(
        self,
        axes: Axes,
        config: HomingConfig,
        nominal: Mapping[Axis, float],
        press_force: int,
        guard: Guard,
    ) -> None:
        self._axes = axes
        self._config = config
        self._nominal = nominal
        self._force = press_force
        self._guard = guard
        self._stops = Stops(axes, config, guard)

    async def run(self, estimate: Mapping[Axis, int], jaws_counts: int | None) -> int:
        """Press the jaws, home all other axes and park them; return the jaws' position [counts].

        Parameters
        ----------
        estimate : rough position of each axis but the gripper [counts]
        jaws_counts : position at which the jaws were known to press on something; None for empty
            jaws, which the press closes

        Raises
        ------
        PositionLostError : the jaws have moved since; nothing else has
        HomingError : an axis did not find its stop in time, or fell behind on the way
        AxisStalledError : an axis stalled on the way between two stops
        """
        await self._stops.ensure_modes()
        self._axes.forget()
        jaws = await self._press(jaws_counts)
        for axis in axes_in_turn(self._axes):
            if axis in estimate:
                await self._guess(axis, estimate[axis])
        await self._find_stops()
        await self._go(keeping_park(self._config.park_counts))
        return jaws

    async def _find_stops(self) -> None:
        stop = self._config.stop_counts
        await self._to_stop({Axis.ZED: Drive.FORWARD}, {Axis.ZED: stop[Axis.ZED]}, is_slow=True)
        await self._go({Axis.ELBOW: 0, Axis.YAW: 0})
        await self._go({Axis.SHOULDER: c.KEEPING_SHOULDER_COUNTS})
        # its forward stop: at the other one the hand would hang between column and upper arm
        await self._to_stop({Axis.ELBOW: Drive.FORWARD}, {Axis.ELBOW: c.ELBOW_RANGE[1]})
        await self._go({Axis.ELBOW: 0})
        # the yaw's stop is one against the forearm: the belt's share goes with the elbow (§4.2)
        yaw = round(stop[Axis.YAW] - float(c.YAW_ELBOW_RATIO) * stop[Axis.ELBOW])
        await self._to_stop({Axis.YAW: Drive.REVERSE}, {Axis.YAW: yaw})
        await self._go({Axis.YAW: 0})
        await self._to_stop({Axis.SHOULDER: Drive.FORWARD}, {Axis.SHOULDER: stop[Axis.SHOULDER]})
        await self._go({Axis.SHOULDER: 0})
        wrist = {axis: stop[axis] for axis in _PITCH_DOWN}
        for drives in (_ROLL_NEGATIVE, _PITCH_DOWN, _ROLL_NEGATIVE):
            await self._to_stop(drives, {})
        await self._to_stop(_PITCH_DOWN, wrist)

    # ---- the jaws ------------------------------------------------------------------------------
    async def _press(self, known: int | None) -> int:
        """Close the jaws until they stall; label their position, by their travel.

        A restart makes the counter zero (§1.5), and jaws without power stay where they are. So it
        reads zero, or what it was labelled, as long as nobody has moved them.
        """
        gripper = Axis.GRIPPER
        before = await self._axes.read_actual_twice(gripper)
        origin = 0
        if known is not None:
            origin = min((0, known), key=lambda counts: abs(before - counts))
            if abs(before - origin) > JAWS_SLACK_COUNTS:
                raise PositionLostError(
                    say(
                        "arm: its jaws were moved by {count} counts while their opening "
                        "was not known; take out what they hold",
                        count=before - origin,
                    )
                )
        await self._stops.write(gripper, Parameter.SPEED, _SPEED)
        await self._stops.write(gripper, Parameter.MAX_FORCE, self._force)
        await self._stops.drive({gripper: Drive.REVERSE})
        after = await self._axes.read_actual_twice(gripper)
        closed = c.GRIPPER_RANGE[0]
        counts = closed if known is None else max(closed, known + after - origin)
        await self._label({gripper: counts})
        # a go sent by mistake presses once more
        await self._stops.write(gripper, Parameter.NEW_POSITION, c.GRASP_COUNTS)
        return counts

    # ---- the other axes ------------------------------------------------------------------------
    async def _guess(self, axis: Axis, counts: int) -> None:
        """Label an axis with a guess, unless it reads so; its target is its present position."""
        if abs(await self._axes.read_actual_twice(axis) - counts) > _SAME_COUNTS:
            await self._label({axis: counts})
        await self._stops.write(axis, Parameter.NEW_POSITION, counts)

    async def _to_stop(
        self, drives: Mapping[Axis, Drive], labels: Mapping[Axis, int], *, is_slow: bool = False
    ) -> None:
        """Drive axes of one IP to their stops, and label those."""
        config = self._config
        for axis in drives:
            speed, force = (
                (config.zed_speed, config.zed_force) if is_slow else (_SPEED, _LEAN_FORCE)
            )
            await self._stops.write(axis, Parameter.SPEED, speed)
            await self._stops.write(axis, Parameter.MAX_FORCE, force)
        await self._stops.drive(drives, config.zed_timeout_s if is_slow else None)
        await self._label(labels)

    async def _label(self, labels: Mapping[Axis, int]) -> None:
        for axis, counts in labels.items():
            await self._axes.label(axis, counts, self._guard)
        for axis, counts in labels.items():
            await self._stops.verify_label(axis, counts)
            if axis is not Axis.GRIPPER:
                await self._stops.write(axis, Parameter.NEW_POSITION, counts)

    async def _go(self, targets: Mapping[Axis, int]) -> None:
        """Move axes to targets [counts], all of them arriving together."""
        now = await self._axes.read_actuals(targets)
        distances = {axis: targets[axis] - now[axis] for axis in targets}
        speeds = synchronised_speeds(distances, self._nominal, _SPEED)
        await start(self._axes, targets, speeds, self._guard)
        watch = MoveWatch(self._axes, targets, self._config.zed_timeout_s, self._guard)
        await watch.until_rest()
