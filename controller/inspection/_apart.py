"""Independence of two views: one error cannot explain both."""

from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import rotation_angle

OTHER_LOOK_RAD: Final = float(np.radians(15.0))  # the part turned by less: the same look again
SAME_PIXELS_PX: Final = 4.0  # nearer in two pictures it may be dirt on the lens


def is_turned(T_world_part: FloatArray, T_other: FloatArray) -> bool:
    """Return True if the part is turned so far between two views that light errs independently.

    Parameters
    ----------
    T_world_part, T_other : (4, 4) poses of the part in both views
    """
    return rotation_angle(T_world_part[:3, :3] @ T_other[:3, :3].T) >= OTHER_LOOK_RAD
