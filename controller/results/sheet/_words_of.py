"""Directions and positions in words."""

import numpy as np

from controller.arrays import FloatArray


def vector(direction: FloatArray, decimals: int = 4) -> str:
    """Return a direction in brackets, without trailing zeros and without -0."""
    return "(" + ", ".join(f"{v + 0.0:g}" for v in np.round(direction, decimals)) + ")"
