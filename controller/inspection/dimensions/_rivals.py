"""Search for rival edges between a found edge and its nominal place.

Under a lamp, a found step need not be the edge: light inside a bore begins where its wall is lit,
and a rounding or a shadow beside an edge makes a line with two sides. If an edge was found beside
its nominal place, and more of its rays than by chance cross another step on one shape in between,
either step may be the edge, and the picture cannot decide.
"""

from typing import Final

import numpy as np

from controller.arrays import FloatArray, Grey, IndexArray
from controller.imaging import step_heights

from ._features import Feature
from ._foreseen import APART_PX
from ._rays import Rays

# Distance searched beyond the found edge, as seen from its nominal place.
BESIDE_PX: Final = 1.0
NEAR_PX: Final = 0.75  # largest distance of a step from a shape that it lies on
# Least height of a step, as a share of the found edge's; most of it rises within two pixels.
MIN_HEIGHT: Final = 0.15
MIN_NOISE: Final = 6.0  # least height of a step, in standard deviations of a pixel's noise
MIN_SHARE: Final = 0.2  # least share of the rays
MIN_RAYS: Final = 8
SHAPES: Final = np.linspace(-1.0, 1.0, 41)  # tested places: 0 is nominal, 1 is the found one


def rival_px(
    picture: Grey,
    feature: Feature,
    rays: Rays,
    curve: IndexArray,
    noise: float,
    values_mm: FloatArray,
    contrast: float,
) -> float:
    """Return the distance from a fitted shape to the farthest rival edge; 0 where there is none.

    Parameters
    ----------
    picture : (height, width)
    feature : fitted feature
    rays, curve : (n,) all rays that must show it, at its nominal place, and their edges
    noise : rms noise of a pixel [grey]
    values_mm : (p,) fitted unknowns, as deviations from nominal
    contrast : contrast of the found edge [grey]
    """
    place = feature.design(rays, curve.astype(np.float64)) @ values_mm
    far = float(np.abs(place).max())
    if far < APART_PX:
        return 0.0
    least = max(MIN_HEIGHT * contrast, MIN_NOISE * noise)
    offsets, heights = step_heights(picture, rays.pixels, rays.normals, far + BESIDE_PX)
    is_step = np.abs(heights) >= least
    is_step &= np.abs(offsets) <= np.abs(place)[:, None] + BESIDE_PX
    is_step &= np.abs(offsets - place[:, None]) > APART_PX
    farthest = 0.0
    for share in SHAPES:
        away = np.abs((1.0 - share) * place)
        testable = away > APART_PX
        if testable.sum() < MIN_RAYS:
            continue
        on_shape = is_step & (np.abs(offsets - share * place[:, None]) <= NEAR_PX)
        if on_shape.any(axis=1)[testable].mean() >= MIN_SHARE:
            farthest = max(farthest, float(np.median(away[testable])))
    return farthest
