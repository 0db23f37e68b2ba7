"""Independence of two views: one error cannot explain both."""

from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import rotation_angle

# Turn of the part below which two views are the same look.
OTHER_LOOK_RAD: Final = float(np.radians(15.0))
SAME_PIXELS_PX: Final = 4.0  # distance in two pictures below which a mark may be dirt on the lens


def is_turned(T_world_part: FloatArray, T_other: FloatArray) -> bool:
    """Return True if the part is turned so far between two views that light errs independently.

    Parameters
    ----------
    T_world_part, T_other : (4, 4) poses of the part in both views
    """
    return rotation_angle(T_world_part[:3, :3] @ T_other[:3, :3].T) >= OTHER_LOOK_RAD
