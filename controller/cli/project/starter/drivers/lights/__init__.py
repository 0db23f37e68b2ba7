"""The ACME lamp unit for cellctl: `driver: acme` of the device `lights` in a cell file."""

from .driver import DRIVER, AcmeLights, Settings

__all__ = ["DRIVER", "AcmeLights", "Settings"]
