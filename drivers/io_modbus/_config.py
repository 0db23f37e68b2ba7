"""The channel of each signal on the I/O block, and its debouncing."""

from dataclasses import dataclass
from enum import Enum
from typing import Final

E1214_COUNT: Final = 6  # inputs, and relays: modbus_devices.md 7.1
E1212_COUNT: Final = 8  # inputs, and lines that are outputs: modbus_devices.md 7.2


class Debounce(Enum):
    """The changes that need two equal polls before they count."""

    NONE = "none"
    RISING = "rising"  # bad news at once, good news twice: safety copies
    BOTH = "both"


@dataclass(frozen=True, slots=True)
class MoxaSettings:
    """The keys allowed under ``settings:`` of the I/O block in the cell file.

    Attributes
    ----------
    motor_relay : output, counted from 0, whose contact is in the supply of the arm's motors and
        opens when the block's watchdog trips; None: the cell has none
    watchdog_s : silence after which it trips, as set in the block's web console, which takes whole
        seconds; 1 is the least [s]
    """

    motor_relay: int | None = None
    watchdog_s: float = 1.0

    def __post_init__(self) -> None:
        if not 0.5 <= self.watchdog_s <= 60.0:
            raise ValueError(f"watchdog_s: 0.5 to 60 s, not {self.watchdog_s:g}")


MOTOR_RELAY: Final = "motor_relay"
# An emulated clock may ask for few polls in a cell second; the watchdog needs several.
POLLS_PER_WATCHDOG: Final = 5


def _check(name: str, channel: int, count: int) -> None:
    if not 0 <= channel < count:
        raise ValueError(f"channel {name!r}: 0..{count - 1}, not {channel}")


@dataclass(frozen=True, slots=True)
class InputChannel:
    """One input; 1 on the wire is healthy, so a broken wire is not."""

    name: str
    channel: int
    debounce: Debounce = Debounce.RISING


@dataclass(frozen=True, slots=True)
class OutputChannel:
    """One relay."""

    name: str
    channel: int


PLANNED_INPUTS: Final = (  # the channel plan of modbus_devices.md 7.4
    InputChannel("estop_ok", 0),
    InputChannel("guard_closed", 1),
    InputChannel("part_in_nest", 2, Debounce.BOTH),
    InputChannel("part_in_gripper", 3, Debounce.BOTH),
    InputChannel("supply_ok", 4),
    InputChannel("acknowledge", 5, Debounce.BOTH),
)


@dataclass(frozen=True, slots=True)
class IoConfig:
    """The I/O block and its wiring.

    Attributes
    ----------
    unit : unit id
    model : text that the block's own model name must contain
    channel_count : inputs of the block, and as many outputs
    inputs, outputs : named channels, numbered from 0 as on the block
    poll_s : from one reading of the inputs to the next, 20 to 50 ms [cell s]
    stale_s : a reading older than this counts as unknown [cell s]
    watchdog_s : silence after which the block opens all its outputs; None: nothing depends on its
        watchdog [cell s]
    """

    unit: int = 1
    model: str = "E1214"
    channel_count: int = E1214_COUNT
    inputs: tuple[InputChannel, ...] = PLANNED_INPUTS
    outputs: tuple[OutputChannel, ...] = ()
    poll_s: float = 0.04
    stale_s: float = 0.2
    watchdog_s: float | None = None

    def __post_init__(self) -> None:
        for channels in (self.inputs, self.outputs):
            for one in channels:
                _check(one.name, one.channel, self.channel_count)
            if len({channel.name for channel in channels}) != len(channels):
                raise ValueError("two channels have the same name")
            if len({channel.channel for channel in channels}) != len(channels):
                raise ValueError("two names are on the same channel")
        if self.watchdog_s is not None and not self.outputs:
            raise ValueError("a watchdog needs an output")
        if not 0 < self.poll_s < self.stale_s:
            raise ValueError(
                f"poll_s must be positive and below stale_s, not {self.poll_s} and {self.stale_s}"
            )
