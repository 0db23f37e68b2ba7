"""Search for another edge between the place where an edge was found and its nominal place.

Under a lamp what is found need not be the edge: light inside a bore begins where its wall is lit, a
rounding or a shadow beside an edge makes a line with two sides. Where the edge was found beside its
nominal place, and more of its rays than chance would have it cross another step on one shape in
between, either may be the edge, and the picture does not say which.
"""

from typing import Final

import numpy as np

from controller.arrays import FloatArray, Grey, IndexArray
from controller.imaging import step_heights

from ._features import Feature
from ._rays import Rays

APART_PX: Final = 1.5  # distance below which blur merges two steps into one
BESIDE_PX: Final = 1.0  # distance beyond the edge that was found, as seen from its nominal place
NEAR_PX: Final = 0.75  # distance of a step from a shape within which it is on it
# Least height as a share of the found edge, most of which is within two pixels.
MIN_HEIGHT: Final = 0.15
MIN_NOISE: Final = 6.0  # least height in noises of a pixel
MIN_SHARE: Final = 0.2  # least share of the rays
MIN_RAYS: Final = 8
SHAPES: Final = np.linspace(-1.0, 1.0, 41)  # between nominal and found: 0 and 1


def rival_px(
    picture: Grey,
    feature: Feature,
    rays: Rays,
    curve: IndexArray,
    noise: float,
    values_mm: FloatArray,
    contrast: float,
) -> float:
    """Return the distance from a fitted shape to the farthest other edge; 0 where there is none.

    Parameters
    ----------
    picture : (height, width)
    feature : that was fitted
    rays, curve : (n,) all that must show it, at its nominal place
    noise : rms of a pixel [grey]
    values_mm : (p,) where it was found, from nominal
    contrast : of what was found [grey]
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
