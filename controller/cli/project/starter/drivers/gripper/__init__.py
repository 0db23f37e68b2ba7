"""The ACME gripper for cellctl: `driver: acme` of the device `gripper` in a cell file."""

from .driver import DRIVER, AcmeGripper, Settings

__all__ = ["DRIVER", "AcmeGripper", "Settings"]
