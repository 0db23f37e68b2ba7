"""Errors of this driver, sorted as those of `drivers.errors`."""

from ..errors import DeviceError, FaultError


class OutOfRangeError(DeviceError, ValueError):
    """A target that the arm cannot or may not reach; no byte has gone out."""


class SafetyStopError(FaultError):
    """The robot's own safety system holds it; ``code`` is the safety mode's number."""


class PowerOffError(DeviceError):
    """The arm is not ready to move: no power, brakes on, or not enabled here."""


class LocalControlError(PowerOffError):
    """The pendant has the arm: it takes no orders from here."""
