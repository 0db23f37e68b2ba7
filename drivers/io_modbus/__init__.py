"""The cell's digital inputs and outputs over a Moxa ioLogik E1214 (Modbus TCP).

Healthy is 1, and what is not freshly known is never OK. Not responsible for safety: that is
hard-wired, and what arrives here is a copy of it.
"""

from ..kinds import Change, Driver, IoBlock, NoSettings, Signal, Site
from ._config import (
    PLANNED_INPUTS,
    PLANNED_OUTPUTS,
    Debounce,
    InputChannel,
    IoConfig,
    OutputChannel,
)
from ._io import CellIo, Watch
from .signals import Snapshot

__all__ = [
    "DRIVER",
    "PLANNED_INPUTS",
    "PLANNED_OUTPUTS",
    "CellIo",
    "Change",
    "Debounce",
    "InputChannel",
    "IoConfig",
    "OutputChannel",
    "Signal",
    "Snapshot",
    "Watch",
]


def _build(site: Site, _: NoSettings) -> CellIo:
    polling = site.polling
    if polling is None:
        raise ValueError(f"{site.name}: the polling period of the I/O block is missing")
    config = IoConfig(unit=site.section["unit"], poll_s=polling.poll_s, stale_s=polling.stale_s)
    return CellIo(site.open_link(), config)


DRIVER: Driver[IoBlock, NoSettings] = Driver(NoSettings, _build)
