"""How numbers are written on the page."""

import numpy as np

from controller.arrays import FloatArray


def vector(direction: FloatArray, decimals: int = 4) -> str:
    """Return a direction as people write it; no needless zeros, no minus before one."""
    return "(" + ", ".join(f"{v + 0.0:g}" for v in np.round(direction, decimals)) + ")"
