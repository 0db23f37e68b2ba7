"""OnRobot RG2 and RG6 behind a Compute Box, over Modbus TCP (modbus_devices.md 3)."""

from dataclasses import dataclass
from typing import Literal

from ..kinds import Driver, FixedGripper, Site
from ._gripper import RgGrasp, RgGripper, RgReading
from ._registers import MODELS, decode_state

__all__ = [
    "DRIVER",
    "MODELS",
    "RgGrasp",
    "RgGripper",
    "RgReading",
    "RgSettings",
    "decode_state",
]


@dataclass(frozen=True, slots=True)
class RgSettings:
    """The keys allowed under `settings`.

    Attributes
    ----------
    model : model, one of two
    """

    model: Literal["rg2", "rg6"] = "rg2"


def _build(site: Site, settings: RgSettings) -> RgGripper:
    return RgGripper(site.open_link(), MODELS[settings.model], site.section["unit"])


def _max_force_n(settings: RgSettings) -> float:
    return MODELS[settings.model].max_force_n


DRIVER: Driver[FixedGripper, RgSettings] = Driver(
    RgSettings, _build, max_force_n=_max_force_n, node_group="dialout"
)
