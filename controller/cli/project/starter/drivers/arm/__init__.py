"""The ACME arm for cellctl: `driver: acme` of the device `arm` in a cell file."""

from .driver import DRIVER, AcmeArm, Settings, Shape
from .model import SixAxis

__all__ = ["DRIVER", "AcmeArm", "Settings", "Shape", "SixAxis"]
