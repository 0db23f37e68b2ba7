"""Moves that reach their targets, or raise which axis did not (umi_rtx.md 2.7, 2.8, 6.7).

Sections (§) are those of umi_rtx.md.
"""

from collections.abc import Callable, Iterable, Mapping
from math import ceil

from drivers.errors import ArmStalledError
from messages import key, say

from ..line import Guard
from ..protocol import constants as c
from ..protocol.constants import ADDRESSES, Axis, Ip, Parameter, Simple, StatusBits
from ._axes import Axes


class AxisStalledError(ArmStalledError):
    """An axis did not reach its target; both IPs have had a dead stop.

    Attributes
    ----------
    axis : the axis
    required_counts, got_counts : expected and actual position
    """

    def __init__(self, axis: Axis, required_counts: int, got_counts: int, why: str) -> None:
        super().__init__(
            say(
                "arm: {name} {why}: {required_counts} counts required, it is at {got_counts}",
                name=axis.name.lower(),
                why=why,
                required_counts=required_counts,
                got_counts=got_counts,
            )
        )
        self.axis = axis
        self.required_counts = required_counts
        self.got_counts = got_counts


def synchronised_speeds(
    distances: Mapping[Axis, int], nominal: Mapping[Axis, float], speed: int = c.NOMINAL_SPEED
) -> dict[Axis, int]:
    """Return the SPEED of each axis with which all arrive together (§8.13).

    Parameters
    ----------
    distances : counts to go, of either sign; axes with 0 are left out of the answer
    nominal : counts per second at SPEED 100
    speed : SPEED of the axis that needs longest

    Returns
    -------
    whole SPEEDs >= 1, rounded up: a short axis may arrive earlier, none later than the longest
    """
    shares = {axis: abs(far) / nominal[axis] for axis, far in distances.items() if far}
    longest = max(shares.values(), default=1.0)
    return {axis: max(1, ceil(speed * share / longest - 1e-9)) for axis, share in shares.items()}


def forecast_s(
    distances: Mapping[Axis, int], speeds: Mapping[Axis, int], nominal: Mapping[Axis, float]
) -> float:
    """Return the duration of a move [s], by nominal speeds, which no source confirms (§5.7, 7).

    Parameters
    ----------
    distances : distance of each axis [counts, signed]
    speeds : SPEED of each of these axes
    nominal : speed of each axis at NOMINAL_SPEED [counts/s]
    """
    times_s = [
        abs(far) / (nominal[axis] * speeds[axis] / c.NOMINAL_SPEED)
        for axis, far in distances.items()
        if far
    ]
    return max(times_s, default=0.0) + c.RAMP_S


async def start(
    axes: Axes,
    targets: Mapping[Axis, int],
    speeds: Mapping[Axis, int],
    guard: Guard,
    *,
    in_turn: bool = False,
    on_go: Callable[[], None] = lambda: None,
) -> None:
    """Set targets and go, all motors within a few requests of each other.

    With `in_turn` the first IP starts before the second gets its targets (§3.4): one hand-over
    less. Without, `on_go` is called once all is set and nothing moves yet.

    Parameters
    ----------
    axes : the motors
    targets : NEW_POSITION of each motor that moves [counts]
    speeds : SPEED of those that get a new one
    guard : called before every request; raises once the motion has been stopped
    in_turn : start the first IP before the second has its targets
    on_go : called when all is set, right before the first go; not with ``in_turn``
    """
    order = axes.ips(targets)
    for ip in order:
        mine = on_ip(targets, ip)
        for axis in mine:
            if axis in speeds:
                await axes.write(axis, Parameter.SPEED, speeds[axis], guard)
            await axes.write(axis, Parameter.NEW_POSITION, targets[axis], guard)
        if in_turn:
            await axes.numeric_go(ip, mine, guard)
    if not in_turn:
        on_go()
        for ip in reversed(order):  # the IP set last is the one that listens
            await axes.numeric_go(ip, on_ip(targets, ip), guard)


def on_ip(axes: Iterable[Axis], ip: Ip) -> list[Axis]:
    """Return the axes of one IP, by controller number."""
    mine = [axis for axis in axes if ADDRESSES[axis].ip is ip]
    return sorted(mine, key=lambda axis: ADDRESSES[axis].ctl)


class MoveWatch:
    """Watches started axes until all rest.

    Of one axis on an IP its own status is read (§3.5), of several the IP's general status (§3.4),
    which shows them all in one request. But a motor that is not part of the move may have left its
    mark in that, as a gripper that holds something does (§5.5): from then on the axes of that IP
    are asked one by one.

    Parameters
    ----------
    axes : the motors
    targets : target of each started axis [counts]
    deadline_s : patience from now on [cell s of attended time]
    guard : called while it watches; raises once the motion has been stopped
    """

    def __init__(
        self, axes: Axes, targets: Mapping[Axis, int], deadline_s: float, guard: Guard
    ) -> None:
        self._axes = axes
        self._targets = targets
        self._until_s = axes.deadline_s(deadline_s)
        self._deadline_s = deadline_s
        self._guard = guard
        self._marked: set[Ip] = set()

    async def until_rest(self, *, in_turn: bool = False) -> None:
        """Wait until no axis moves; `in_turn` watches one IP to its rest, then the other (§3.4).

        Raises
        ------
        AxisStalledError : bit 2 or 3 of a moved axis, or not at rest by the deadline
        """
        moving = {ADDRESSES[axis].ip for axis in self._targets}
        while moving:
            for ip in self._axes.ips(
                axis for axis in self._targets if ADDRESSES[axis].ip in moving
            ):
                if await self._rests(ip):
                    moving.discard(ip)
                elif in_turn:
                    break
            if moving:
                if self._axes.clock.attended_s() > self._until_s:
                    await self._give_up(moving)
                await self._axes.pause()

    async def _rests(self, ip: Ip) -> bool:
        """Return whether the axes of an IP rest, seen twice: a status has no checksum."""
        return await self._rest_now(ip) and await self._rest_now(ip)

    async def _rest_now(self, ip: Ip) -> bool:
        self._guard()
        mine = on_ip(self._targets, ip)
        if len(mine) > 1 and ip not in self._marked:
            bits = await self._axes.general_status(ip)
            if not bits & c.FAULT_BITS:
                return not bits & StatusBits.MOVING
            self._marked.add(ip)
        any_moving = False
        for axis in mine:
            bits = await self._axes.status(axis)
            if bits & c.FAULT_BITS:
                bits = await self._axes.status(axis)
            if bits & c.FAULT_BITS:
                await self._stalled(axis, bits)
            any_moving = any_moving or bool(bits & StatusBits.MOVING)
        return not any_moving

    async def _stalled(self, axis: Axis, bits: StatusBits) -> None:
        self._guard()  # after a requested stop these bits mean nothing
        await self._axes.halt(Simple.DEAD_STOP)
        error = await self._axes.read(axis, Parameter.CP_ERROR)  # read first, as in §3.6
        got = await self._axes.read(axis, Parameter.CURRENT_POSITION) - error
        if bits & StatusBits.STALLED:
            why = "stalled"
        else:
            why = say("fell behind its error limit, by {error} counts", error=error)
        raise AxisStalledError(axis, self._targets[axis], got, why)

    async def _give_up(self, moving: set[Ip]) -> None:
        await self._axes.halt(Simple.DEAD_STOP)
        late = [axis for axis in self._targets if ADDRESSES[axis].ip in moving]
        got = await self._axes.read_actuals(late)
        worst = max(late, key=lambda axis: abs(got[axis] - self._targets[axis]))
        raise AxisStalledError(
            worst,
            self._targets[worst],
            got[worst],
            say("moves after {deadline_s:.1f} s", deadline_s=self._deadline_s),
        )


async def verify_arrival(
    axes: Axes, targets: Mapping[Axis, int], tolerances: Mapping[Axis, int], settle_s: float
) -> dict[Axis, int]:
    """Read the positions of resting axes; return them if all are within tolerance [counts].

    Parameters
    ----------
    axes : the motors, at rest
    targets : target of each axis [counts]
    tolerances : tolerance of each at rest [counts]
    settle_s : time limit until all are at rest [cell s of attended time]

    Raises
    ------
    AxisStalledError : one is not, `settle_s` later either
    """
    until_s = axes.deadline_s(settle_s)
    for ip in axes.ips(targets):
        await axes.prove(ip)
    while True:
        got = await axes.read_actuals(targets)
        worst = max(targets, key=lambda axis: abs(got[axis] - targets[axis]) - tolerances[axis])
        if abs(got[worst] - targets[worst]) <= tolerances[worst]:
            return got
        if axes.clock.attended_s() > until_s:
            await axes.halt(Simple.DEAD_STOP)
            why = key("rests off its target (is motor power on?)")
            raise AxisStalledError(worst, targets[worst], got[worst], why)
        await axes.pause()
