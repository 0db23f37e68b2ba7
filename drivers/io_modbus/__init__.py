"""The cell's digital inputs and outputs over a Moxa ioLogik E1214 or E1212 (Modbus TCP).

Healthy is 1, and what is not freshly known is never OK. Not responsible for safety: that is
hard-wired, and what arrives here is a copy of it.
"""

from dataclasses import replace

from ..kinds import Change, Driver, IoBlock, NoSettings, Signal, Site
from ._config import (
    E1212_COUNT,
    E1214_COUNT,
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
    "E1212_DRIVER",
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


def _build(site: Site, model: str, channel_count: int) -> CellIo:
    polling = site.polling
    if polling is None:
        raise ValueError(f"{site.name}: the polling period of the I/O block is missing")
    inputs = tuple(
        replace(one, channel=site.inputs.get(one.name, one.channel)) for one in PLANNED_INPUTS
    )
    config = IoConfig(
        unit=site.section["unit"],
        model=model,
        channel_count=channel_count,
        inputs=inputs,
        poll_s=polling.poll_s,
        stale_s=polling.stale_s,
    )
    return CellIo(site.open_link(), config)


DRIVER: Driver[IoBlock, NoSettings] = Driver(
    NoSettings, lambda site, _: _build(site, "E1214", E1214_COUNT)
)
E1212_DRIVER: Driver[IoBlock, NoSettings] = Driver(
    NoSettings, lambda site, _: _build(site, "E1212", E1212_COUNT)
)
