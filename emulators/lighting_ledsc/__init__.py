"""LedSC lamp controllers that are not there: four PWM outputs each."""

from ._controller import LedscDevice, LedscSupply

__all__ = ["LedscDevice", "LedscSupply"]
