"""All alarms, and the look-up of one by code or error."""

import re
from collections.abc import Mapping
from typing import Final

from messages import key

from .alarm import Alarm
from .cell import CELL
from .devices import DEVICES
from .parts import PARTS

ALARMS: Final[tuple[Alarm, ...]] = tuple(sorted((*CELL, *DEVICES, *PARTS), key=lambda a: a.number))
BY_CODE: Final[Mapping[str, Alarm]] = {alarm.code: alarm for alarm in ALARMS}
BY_NUMBER: Final[Mapping[int, Alarm]] = {alarm.number: alarm for alarm in ALARMS}
INTERNAL: Final = BY_CODE["internal"]
# Names whose code is not made of the words of the class.
CODES: Final = {"OSError": "file", "ArmStalledError": "stall"}
# How messages name a device, the more particular ones first.
NAMES: Final = ("overhead", "inspection", "camera", key(
    "fixed gripper"
), "gripper", "arm", key("I/O block"),
                "lights", "analog", "relay")  # fmt: skip


def code_of(error: BaseException) -> str:
    """Return the code of an error: its own, or that of its class or the nearest one above it."""
    own = getattr(error, "code", None)
    if isinstance(own, str) and own in BY_CODE:
        return own
    for kind in type(error).__mro__:
        if (code := class_code(kind.__name__)) in BY_CODE:
            return code
    return INTERNAL.code


def class_code(name: str) -> str:
    """Return the code of a class of errors: its name in small letters, without ``Error``."""
    if name in CODES:
        return CODES[name]
    words = re.findall(r"[A-Z][a-z0-9]*", name.removesuffix("Error"))
    return "_".join(word.lower() for word in words)


def alarm_of(code: str) -> Alarm:
    """Return the alarm of a code; that of a bug if no catalogue has the code."""
    return BY_CODE.get(code, INTERNAL)


def device_named(alarm: Alarm, message: str) -> str:
    """Return the device of an alarm; for an alarm of any device, the one in the message."""
    if alarm.device != "device":
        return alarm.device
    head = message.partition(":")[0] or message
    return next((n for n in NAMES if re.search(rf"\b{n}\b", head)), alarm.device)
