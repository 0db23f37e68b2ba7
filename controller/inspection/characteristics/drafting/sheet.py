"""Reading order of a drawing: view by view, and in each row by row from the top left."""

from typing import Final

import numpy as np

from controller.arrays import FloatArray
from messages import say

# Amount added before rounding, since a nominal 15.875 may be 15.8749 in a mesh.
HALF_UP_MM: Final = 1e-4
ROW_MM: Final = 1.0  # height of a row; features level within it form one row
AXES: Final = ((2, 1), (1, 1), (0, 1), (2, -1), (1, -1), (0, -1))  # the top view comes first


def across(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the right and up directions (3,) of the view against an axis (3,)."""
    main = int(np.abs(axis).argmax())
    up = np.eye(3)[1 if main == 2 else 2]
    up = up - (up @ axis) * axis
    up = up / np.linalg.norm(up)
    return np.cross(up, axis), up


def reading_order(axis: FloatArray, p_mm: FloatArray) -> tuple[int, int, int, int]:
    """Return a key that sorts features in the reading order of their views.

    Parameters
    ----------
    axis : (3,) unit, against the line of sight of the view
    p_mm : (3,) position in the CAD frame
    """
    main = int(np.abs(axis).argmax())
    view = AXES.index((main, 1 if axis[main] > 0 else -1))
    right, up = across(axis)
    row = -round(float(p_mm @ up) / ROW_MM)
    return view, row, round(float(p_mm @ right) / ROW_MM), round(float(p_mm @ axis) / ROW_MM)


def drawn_mm(size_mm: float) -> float:
    """Return a size as drawings have it, to a hundredth of a millimetre [mm]."""
    return round(size_mm + HALF_UP_MM, 2)


def size_text(size_mm: float) -> str:
    """Return a size as written on drawings, such as ``6.76 mm``."""
    return say("{n:g} mm", n=drawn_mm(size_mm))
