"""An I/O block's option beside its inputs: outputs that tell a PLC what is so, at 24 V."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable


@runtime_checkable
class SignalOutputs(Protocol):
    """An I/O block with outputs, by the names that the cell file gives them.

    All of them are off when `IoBlock.connect` and, where the block is a `MotorWatchdog`,
    `prove_watchdog` have returned, and off again by the block itself once it hears nothing more.
    """

    async def set_outputs(self, outputs: Mapping[str, bool]) -> None:
        """Switch outputs on (True) or off by name; the others stay as they are.

        Raises
        ------
        ValueError : no such output
        LinkError : done or not; calling it again decides
        """
        ...
