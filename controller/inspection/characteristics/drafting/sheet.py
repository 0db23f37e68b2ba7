"""Reading order of a drawing: view by view, each row by row from its top left."""

from typing import Final

import numpy as np

from controller.arrays import FloatArray

HALF_UP_MM: Final = 1e-4  # 15.875 of a mesh may be 15.8749: such halves are rounded up
ROW_MM: Final = 1.0  # what is level to a millimetre reads as one row
AXES: Final = ((2, 1), (1, 1), (0, 1), (2, -1), (1, -1), (0, -1))  # the top view comes first


def across(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the directions right and up in the view against an axis (3,), both (3,)."""
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


def size_text(size_mm: float) -> str:
    """Return a size as on drawings, such as ``6.76 mm``."""
    return f"{round(size_mm + HALF_UP_MM, 2):g} mm"
