"""How numbers are written on the page."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def vector(direction: Array, decimals: int = 4) -> str:
    """Return a direction as people write it; no needless zeros, no minus before one."""
    return "(" + ", ".join(f"{v + 0.0:g}" for v in np.round(direction, decimals)) + ")"
