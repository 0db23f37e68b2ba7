"""An emulated OnRobot RG2 or RG6 and its Compute Box (modbus_devices.md 3)."""

from ._rg import RG2, RG6, ComputeBoxDevice, RgDevice, RgType

__all__ = ["RG2", "RG6", "ComputeBoxDevice", "RgDevice", "RgType"]
