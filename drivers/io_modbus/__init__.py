"""The cell's digital inputs and outputs over a Moxa ioLogik E1214 or E1212 (Modbus TCP).

Healthy is 1, and without a fresh reading an input is never OK. Not responsible for safety: that is
hard-wired, and these inputs are a copy of it.
"""

from dataclasses import replace

from ..kinds import Change, Driver, IoBlock, Signal, Site
from ._config import (
    E1212_COUNT,
    E1214_COUNT,
    MOTOR_RELAY,
    PLANNED_INPUTS,
    POLLS_PER_WATCHDOG,
    Debounce,
    InputChannel,
    IoConfig,
    MoxaSettings,
    OutputChannel,
)
from ._io import CellIo, Watch
from .signals import Snapshot

__all__ = [
    "DRIVER",
    "E1212_DRIVER",
    "PLANNED_INPUTS",
    "CellIo",
    "Change",
    "Debounce",
    "InputChannel",
    "IoConfig",
    "MoxaSettings",
    "OutputChannel",
    "Signal",
    "Snapshot",
    "Watch",
]


def _build(site: Site, settings: MoxaSettings, model: str, channel_count: int) -> CellIo:
    polling = site.polling
    if polling is None:
        raise ValueError(f"{site.name}: the polling period of the I/O block is missing")
    inputs = tuple(
        replace(one, channel=site.inputs.get(one.name, one.channel)) for one in PLANNED_INPUTS
    )
    poll_s, watchdog_s = polling.poll_s, None
    outputs = tuple(OutputChannel(name, channel) for name, channel in site.outputs.items())
    if (relay := settings.motor_relay) is not None:
        outputs = (*outputs, OutputChannel(MOTOR_RELAY, relay))
    if outputs:
        watchdog_s = settings.watchdog_s
        poll_s = min(poll_s, watchdog_s / POLLS_PER_WATCHDOG)
    config = IoConfig(
        unit=site.section["unit"],
        model=model,
        channel_count=channel_count,
        inputs=inputs,
        outputs=outputs,
        poll_s=poll_s,
        stale_s=polling.stale_s,
        watchdog_s=watchdog_s,
    )
    return CellIo(site.open_link(), config)


DRIVER: Driver[IoBlock, MoxaSettings] = Driver(
    MoxaSettings,
    lambda site, settings: _build(site, settings, "E1214", E1214_COUNT),
    node_group="dialout",
)
E1212_DRIVER: Driver[IoBlock, MoxaSettings] = Driver(
    MoxaSettings,
    lambda site, settings: _build(site, settings, "E1212", E1212_COUNT),
    node_group="dialout",
)
