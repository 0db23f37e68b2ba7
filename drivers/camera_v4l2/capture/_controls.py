"""Locks the camera's automatic controls, and lists its controls.

An automatic is switched to manual before its value is set, since a camera refuses the value
(EACCES) or ignores it otherwise; values out of range are clamped without a word, so each is read
back and compared. One control that fails does not hide the others.
"""

import errno
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from messages import key, say

from ..kernel import GONE, Device, abi
from ..kernel.abi import ControlFlag, ControlId, ControlType

_READABLE: Final = frozenset(
    {
        ControlType.INTEGER,
        ControlType.BOOLEAN,
        ControlType.MENU,
        ControlType.BITMASK,
        ControlType.INTEGER_MENU,
    }
)


@dataclass(frozen=True, slots=True)
class ControlSetting:
    """The result for one control that was to be set, in the control's own units.

    Attributes
    ----------
    control, name : control and its name
    wanted : the value to be set
    got : value read back; None if there is no such control or it cannot be read
    problem : reason why ``got`` is not ``wanted``; empty if it is, or if there was nothing to lock
    code : the errno behind ``problem``, 0 if there is none
    has_changed : whether the value is another than before
    """

    control: ControlId
    name: str
    wanted: int
    got: int | None
    problem: str = ""
    code: int = 0
    has_changed: bool = False


@dataclass(frozen=True, slots=True)
class ControlInfo:
    """One control of the camera, in the control's own units.

    Attributes
    ----------
    control : V4L2 control id
    name : the driver's name for it
    kind : ``ControlType`` name, or the number of one unknown here
    minimum, maximum, step, default : its range
    value : now; None if it cannot be read
    is_inactive : an automatic has it at present
    menu : number -> text of a menu's items
    problem : reason why it could not be read
    """

    control: int
    name: str
    kind: str
    minimum: int
    maximum: int
    step: int
    default: int
    value: int | None
    is_inactive: bool
    menu: Mapping[int, str] = field(default_factory=dict)
    problem: str = ""


def exposure_counts(exposure_s: float) -> int:
    """Return an exposure [s] in the control's units of 100 µs."""
    return round(exposure_s / abi.EXPOSURE_UNIT_S)


def lock_controls(
    device: Device, exposure_s: float | None, gain: int | None, white_balance_k: int | None
) -> tuple[ControlSetting, ...]:
    """Switch automatics off, set the values that are not None; return the result of each.

    Parameters
    ----------
    device : the open camera
    exposure_s : exposure to set [s]; rounded to 100 µs
    gain : gain to set, in the camera's own units
    white_balance_k : colour temperature to set [K]

    Raises
    ------
    OSError : the camera is gone; any other failure is in the settings returned
    """
    values = {
        ControlId.AUTO_EXPOSURE: abi.EXPOSURE_MANUAL,
        ControlId.EXPOSURE_AUTO_PRIORITY: 0,
        ControlId.EXPOSURE_TIME_ABSOLUTE: None
        if exposure_s is None
        else exposure_counts(exposure_s),
        ControlId.GAIN_AUTOMATIC: 0,
        ControlId.GAIN: gain,
        ControlId.WHITE_BALANCE_AUTOMATIC: 0,
        ControlId.WHITE_BALANCE_TEMPERATURE: white_balance_k,
        ControlId.FOCUS_AUTOMATIC: 0,
    }
    is_value = {
        ControlId.EXPOSURE_TIME_ABSOLUTE,
        ControlId.GAIN,
        ControlId.WHITE_BALANCE_TEMPERATURE,
    }
    return tuple(
        set_and_compare(device, control, value, is_needed=control in is_value)
        for control, value in values.items()
        if value is not None
    )


def set_and_compare(
    device: Device, control: ControlId, wanted: int, *, is_needed: bool = True
) -> ControlSetting:
    """Set a control, read it back and return the result.

    Parameters
    ----------
    device : the open camera
    control : control to set
    wanted : in the control's own units
    is_needed : whether a camera without this control has a problem (an automatic that is not
        there needs no switching off)

    Raises
    ------
    OSError : the camera is gone
    """
    name, before = control.name.lower(), None
    try:
        found = device.query_control(control)
        if found is None:
            problem = say("{name}: the camera has no such control", name=name) if is_needed else ""
            return ControlSetting(control, name, wanted, None, problem)
        name = found.name or name
        before = device.get_control(control)
        device.set_control(control, wanted)
        got = device.get_control(control)
    except OSError as error:
        if error.errno in GONE:
            raise
        problem = say("{name}: {wanted} {why}", name=name, wanted=wanted, why=_why(error))
        return ControlSetting(control, name, wanted, before, problem, error.errno or 0)
    problem = ""
    if abs(got - wanted) > max(found.step, 1) // 2:  # off the camera's raster is not a lie
        problem = say(
            "{name}: {wanted} required, the camera took {got} (range "
            "{minimum}..{maximum}, step {step})",
            name=name,
            wanted=wanted,
            got=got,
            minimum=found.minimum,
            maximum=found.maximum,
            step=found.step,
        )
    return ControlSetting(control, name, wanted, got, problem, has_changed=got != before)


def list_controls(device: Device) -> tuple[ControlInfo, ...]:
    """Return every control with its value; an unreadable one has the reason.

    Raises
    ------
    OSError : the list itself cannot be read
    """
    return tuple(
        _describe(device, found)
        for found in device.list_controls()
        if found.type != ControlType.CTRL_CLASS
    )


def _describe(device: Device, found: abi.QueryCtrl) -> ControlInfo:
    value, menu, problem = None, {}, ""
    is_readable = found.type in _READABLE and not found.flags & ControlFlag.WRITE_ONLY
    try:
        if found.type in (ControlType.MENU, ControlType.INTEGER_MENU):
            menu = dict(device.menu_items(found))
        if is_readable:
            value = device.get_control(found.control)
    except OSError as error:
        if error.errno in GONE:
            raise
        problem = say("cannot be read: {get}", get=errno.errorcode.get(error.errno or 0, "?"))
    known = found.type in ControlType.__members__.values()
    return ControlInfo(
        control=found.control,
        name=found.name,
        kind=ControlType(found.type).name.lower() if known else str(found.type),
        minimum=found.minimum,
        maximum=found.maximum,
        step=found.step,
        default=found.default,
        value=value,
        is_inactive=bool(found.flags & ControlFlag.INACTIVE),
        menu=menu,
        problem=problem,
    )


def _why(error: OSError) -> str:
    match error.errno:
        case errno.EACCES:
            return key("refused: an automatic still has this control, or it is read-only (EACCES)")
        case errno.ERANGE | errno.EINVAL:
            return key("refused: outside what the camera offers")
        case errno.EBUSY:
            return key("refused: another program holds this control (EBUSY)")
    code = error.errno or 0
    return say(
        "failed: {get} ({strerror})", get=errno.errorcode.get(code, code), strerror=error.strerror
    )
