"""Numbers by which several modules of the inspection decide, each once.

Each says what it limits, and the figure or formula that gave it. A number that one module alone
decides by stands in that module. `tests/unit/test_inspection_numbers.py` finds copies.
"""

from typing import Final

import numpy as np

# Pose of a part.
PLANNED_HOLD: Final = (1.5, 0.03)  # [mm, rad] deviation of a fresh grasp from the planned one
MEASURED_HOLD: Final = (0.3, 0.005)  # [mm, rad] the same once a view has measured it
# Standard deviations of a pose, and of a gripper's place, that a margin covers: 95 %.
POSE_SPREADS: Final = 2.0
# Largest offset of the outline at the expected pose; a slip of 4 mm is 21 px at 0.19 mm a pixel.
FARTHEST_PX: Final = 25.0

# Outline before the panel.
PANEL_HALF: Final = 0.5  # level of an edge between part and panel: blur does not move the middle
OUTLINE_PX: Final = 0.4  # assumed noise of an outline point, where the picture's is not asked
OUTLINE_POINTS: Final = 20  # least number of points of an outline, observed or predicted
SLIT_PX: Final = 1.0  # width of a slit below which light through it is not compared: one pixel
COMPARED_PX: Final = 6.25  # reach of the search for the observed outline round the fitted one
PAIRED_PX: Final = 2.0  # distance below which a point of the outline counts as found
LOST_PX: Final = 6.0  # offset counted for a point without a partner: none within `COMPARED_PX`

# Edges and what is beside them.
EDGE_PLAY_MM: Final = 0.3  # tolerance for broken edges and for features out of place
EDGE_PLAY_PX: Final = 2.0  # blur of an edge and of the filters, three standard deviations
CORNER_PX: Final = 5.0  # distance from a corner below which a ray sees what lies round it
SURE_SIGMAS: Final = 3.0  # standard deviations of an edge's place that are no chance


def strip_px(pixel_mm: float) -> float:
    """Return the width in a picture [px] of the strip beside an edge in which no defect shows.

    Parameters
    ----------
    pixel_mm : size of a pixel at the part
    """
    return EDGE_PLAY_PX + EDGE_PLAY_MM / pixel_mm


# Surfaces and what is found on them.
FLATTEST_COS: Final = float(np.cos(np.radians(75.0)))  # a surface seen flatter is not in sight
DUST_SIZES: Final = 2.0  # extent of a finding, in sizes of dust, above which it is no dust
MIN_FACE_SHARE: Final = 0.5  # least share of a face that must have been compared
