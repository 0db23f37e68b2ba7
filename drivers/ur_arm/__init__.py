"""Universal Robots arm (e-Series, and CB3's UR5): moves its joints; knows nothing of their load.

Source of all facts: ur.md. `model` has joints, poses, links, limits and timing, without any device.
"""

from typing import Final

from ..kinds import Arm, ArmDriver, NoSettings, Site
from .model import MODELS, LinkBox, UrModel, UrShape, UrTiming, describe

__all__ = [
    "DRIVER",
    "MODELS",
    "LinkBox",
    "UrModel",
    "UrShape",
    "UrTiming",
    "describe",
]


def _build(site: Site, settings: NoSettings) -> Arm:
    raise ValueError("this version plans for the arm and has no wire to it")


DRIVER: Final[ArmDriver[NoSettings, UrShape, UrModel]] = ArmDriver(
    NoSettings, _build, UrShape, describe
)
