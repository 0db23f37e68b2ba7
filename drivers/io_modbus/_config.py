"""Which signal is on which channel of the I/O block, and how it is debounced."""

from dataclasses import dataclass
from enum import Enum
from typing import Final

E1214_COUNT: Final = 6  # inputs, and relays: modbus_devices.md 7.1
E1212_COUNT: Final = 8  # inputs, and lines that are outputs: modbus_devices.md 7.2


class Debounce(Enum):
    """Which changes need two equal polls before they count."""

    NONE = "none"
    RISING = "rising"  # bad news at once, good news twice: safety copies
    BOTH = "both"


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
PLANNED_OUTPUTS: Final = (
    OutputChannel("backlight", 0),
    OutputChannel("ring_light", 1),
    OutputChannel("bar_light", 2),
    OutputChannel("stack_red", 3),
    OutputChannel("stack_amber", 4),
    OutputChannel("stack_green", 5),
)


@dataclass(frozen=True, slots=True)
class IoConfig:
    """The I/O block and what is wired to it.

    Attributes
    ----------
    unit : unit id
    model : text that the block's own model name must contain
    channel_count : inputs of the block, and as many outputs
    inputs, outputs : named channels, numbered from 0 as on the block
    poll_s : from one reading of the inputs to the next, 20 to 50 ms [cell s]
    stale_s : a reading older than this counts as unknown [cell s]
    """

    unit: int = 1
    model: str = "E1214"
    channel_count: int = E1214_COUNT
    inputs: tuple[InputChannel, ...] = PLANNED_INPUTS
    outputs: tuple[OutputChannel, ...] = PLANNED_OUTPUTS
    poll_s: float = 0.04
    stale_s: float = 0.2

    def __post_init__(self) -> None:
        for channels in (self.inputs, self.outputs):
            for one in channels:
                _check(one.name, one.channel, self.channel_count)
            if len({channel.name for channel in channels}) != len(channels):
                raise ValueError("two channels have the same name")
            if len({channel.channel for channel in channels}) != len(channels):
                raise ValueError("two names are on the same channel")
        if not 0 < self.poll_s < self.stale_s:
            raise ValueError(
                f"poll_s must be positive and below stale_s, not {self.poll_s} and {self.stale_s}"
            )
