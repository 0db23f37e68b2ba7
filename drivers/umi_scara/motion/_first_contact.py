"""The first motions of an arm: its registers, then one motor at a time (umi_rtx.md 10).

Sections (§) are those of umi_rtx.md.
"""

from typing import Final

from drivers.kinds import MotorTry
from messages import say

from ..line import Guard
from ..protocol import constants as c
from ..protocol.constants import ADDRESSES, Axis, Parameter, StatusBits
from ._axes import Axes
from ._homing import Homing
from ._stops import HomingError

# §10, step 7
TRY_COUNTS: Final = 50
TRY_SPEED: Final = 30
TRY_FORCE: Final = 20
TRY_TIMEOUT_S: Final = 10.0
_NEAR_ORIGIN: Final = 1  # as in homing: a write of 0 would not be visible when read back


async def read_registers(axes: Axes) -> dict[str, dict[str, int]]:
    """Return all parameters of all motors, by their names (§10, step 4); nothing moves."""
    found: dict[str, dict[str, int]] = {axis.name.lower(): {} for axis in Axis}
    for ip in axes.ips():
        for axis in Axis:
            if ADDRESSES[axis].ip is ip:
                registers = found[axis.name.lower()]
                for parameter in Parameter:
                    registers[parameter.name.lower()] = await axes.read(axis, parameter)
    return found


async def try_motor(axes: Axes, homing: Homing, axis: Axis, guard: Guard) -> MotorTry:
    """Move one motor by 50 counts and back; return how it went (§10, step 7).

    Sets all counters to 0 first, so that no other motor has anywhere to go. A motor that leans on
    its stop is tried the other way.

    Parameters
    ----------
    axes : the motors
    homing : homing of this arm; the counters mean nothing before it has run
    axis : the motor
    guard : called before every request; raises when the run must not go on

    Raises
    ------
    HomingError : it does not come to rest
    """
    await homing.prepare()
    begun_s = axes.clock.now_s()
    ordered = TRY_COUNTS
    went = await _go(axes, axis, ordered, guard)
    if went < ordered / 2:
        ordered = -TRY_COUNTS
        begun_s = axes.clock.now_s()
        went = await _go(axes, axis, ordered, guard)
    seconds = axes.clock.now_s() - begun_s
    back = await _go(axes, axis, _NEAR_ORIGIN, guard)
    await homing.prepare()
    return MotorTry(axis.name.lower(), ordered, went, back - _NEAR_ORIGIN, seconds)


async def _go(axes: Axes, axis: Axis, counts: int, guard: Guard) -> int:
    """Move a motor to a count; return its position at rest, against a stop or not."""
    await axes.write(axis, Parameter.SPEED, TRY_SPEED, guard)
    await axes.write(axis, Parameter.MAX_FORCE, TRY_FORCE, guard)
    await axes.write(axis, Parameter.NEW_POSITION, counts, guard)
    await axes.numeric_go(ADDRESSES[axis].ip, [axis], guard)
    until_s = axes.deadline_s(TRY_TIMEOUT_S)
    rest_poll_count = 0
    while rest_poll_count < 2:
        bits = await axes.status(axis)
        is_at_rest = not bits & StatusBits.MOVING or bool(bits & c.FAULT_BITS)
        rest_poll_count = rest_poll_count + 1 if is_at_rest else 0
        guard()
        if axes.clock.attended_s() > until_s:
            raise HomingError(say("arm: {name} does not come to rest", name=axis.name.lower()))
        if not rest_poll_count:
            await axes.pause()
    return await axes.read_actual_twice(axis)
