"""Independence of two views: one error cannot explain both."""

from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import rotation_angle

# Smallest turn of the part between two views that count as two looks.
OTHER_LOOK_RAD: Final = float(np.radians(15.0))
# Distance between two marks in the pixels of their pictures, below which both may be one speck of
# dirt on the lens.
SAME_PIXELS_PX: Final = 4.0


def is_turned(T_world_part: FloatArray, T_other: FloatArray) -> bool:
    """Return True if the part's turn between two views makes their lighting errors independent.

    Parameters
    ----------
    T_world_part, T_other : (4, 4) poses of the part in the two views
    """
    return rotation_angle(T_world_part[:3, :3] @ T_other[:3, :3].T) >= OTHER_LOOK_RAD
