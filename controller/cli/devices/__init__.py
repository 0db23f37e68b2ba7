"""`doctor` checks a cell's devices, `emulate` starts emulated ones for any client."""

from .commands import doctor, emulate

__all__ = ["doctor", "emulate"]
