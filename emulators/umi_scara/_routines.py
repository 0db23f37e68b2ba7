"""The routines of an IP: its built-in homing (08) and the soak test (09, 0A).

No source documents how the boards home; this follows the host's procedure of umi_rtx.md 4.1 for
the motors of one IP, as umi_rtx.md 7 proposes. A routine is resumed once per step of the arm and
yields while it waits.
"""

from collections.abc import Iterator
from typing import Final

from ._axes import FACTS, Axis
from ._model import ArmModel
from ._motor import Motor, Parameter

YAW_ERROR_LIMIT: Final = 1500  # lets the elbow take the yaw along at its stop; umi_rtx.md 4.1
GRIPPER_OPEN_COUNTS: Final = 30  # gripper 0 lies this far off its closed stop; umi_rtx.md 5.5


def home(model: ArmModel, ip: int) -> Iterator[None]:
    """Home the motors of one IP, label their stops (umi_rtx.md 4.2) and move them to 0."""
    axes = model.axes
    if ip == 0:
        for w2_direction in (+1, -1, +1, -1):
            axes[Axis.WRIST1].go_on(-1)
            axes[Axis.WRIST2].go_on(w2_direction)
            yield from _rest(axes[Axis.WRIST1], axes[Axis.WRIST2])
    else:
        yield from _drive(axes[Axis.ZED], +1)
        gripper, yaw = axes[Axis.GRIPPER], axes[Axis.YAW]
        yield from _drive(gripper, -1)
        gripper.zero_counter()
        gripper.go_to(GRIPPER_OPEN_COUNTS)
        yield from _rest(gripper)
        yield from _drive(axes[Axis.SHOULDER], +1)
        error_limit = yaw.parameters[Parameter.ERROR_LIMIT]
        yaw.parameters[Parameter.ERROR_LIMIT] = YAW_ERROR_LIMIT
        try:
            axes[Axis.ELBOW].go_on(-1)
            yaw.go_on(-1)
            yield from _rest(axes[Axis.ELBOW], yaw)
        finally:  # a stop command ends the routine here as well
            yaw.parameters[Parameter.ERROR_LIMIT] = error_limit
    own = [axis for axis in Axis if FACTS[axis].ip == ip]
    for axis in own:
        axes[axis].label(FACTS[axis].home_counts)
        axes[axis].go_to(0)
    yield from _rest(*(axes[axis] for axis in own))


def soak(model: ArmModel, ip: int, home_first: bool) -> Iterator[None]:
    """Drive one motor after the other from stop to stop, until the routine is ended.

    Parameters
    ----------
    model : the arm
    ip : the board whose motors are driven, 0 or 1
    home_first : home that board's motors before
    """
    if home_first:
        yield from home(model, ip)
    own = [model.axes[axis] for axis in Axis if FACTS[axis].ip == ip]
    while True:
        for motor in own:
            yield from _drive(motor, +1)
            yield from _drive(motor, -1)


def _drive(motor: Motor, direction: int) -> Iterator[None]:
    motor.go_on(direction)
    yield from _rest(motor)


def _rest(*motors: Motor) -> Iterator[None]:
    yield
    while any(motor.is_busy for motor in motors):
        yield
