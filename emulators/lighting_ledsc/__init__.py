"""Emulated LedSC lamp controllers: four PWM outputs each."""

from ._controller import LedscDevice, LedscSupply

__all__ = ["LedscDevice", "LedscSupply"]
