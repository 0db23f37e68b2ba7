"""Comparison of a lit picture with its fitted light, for wrong light or shadow.

Only differences that no finish explains are wrong: a surface that must be lit is less than half as
bright as its face's light predicts, or one in full shadow is nearly as bright as its face in the
open; through a hole, the wall behind must be visible. The uncertainty of the light is the error of
the fit; where it allows such a difference, nothing is compared, and the reason is recorded.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, Float32Array

from .._types import InspectionLimits, Unjudged
from .brightness import FACE_COUNT, Brightness
from .light import Light
from .surface import Surface

SHADED: Final = 0.02  # share of the open light below which a shadow is full
STEEPEST: Final = 0.15  # cosine of incidence below which a surface has too few nodes
FITTED_LIGHT: Final = 0.25  # least light of a node used to fit a gain
FITTED_COUNT: Final = 150
# Error, as a share of the brightness, above which the fit does not explain the picture.
WORST_TYPICAL: Final = 0.3
SCATTERS: Final = 3.0
MIN_SPREAD: Final = 0.05  # least spread of a prediction, from lens and beam
HALVED: Final = 0.5  # change of brightness to detect: to half of the prediction, or to `TWICE`
TWICE: Final = 2.0
UNLIT_GREY: Final = 25.0
PENUMBRA_SHARE: Final = 0.25
BURNT_GREY: Final = 252
MAX_BURNT: Final = 0.5  # largest burnt-out share of the lit surface; the rest is still compared
# Share of a face's nodes that are wrong together, from which its light is not understood.
WHOLE_FACE: Final = 0.6


@dataclass(frozen=True, eq=False, slots=True)
class Compared:
    """Comparison of a lit picture on a grid; (h, w) each.

    Attributes
    ----------
    wrong : mask of nodes brighter or darker than any prediction
    compared : mask of nodes where half or twice the brightness would stand out
    reason : reason why other nodes on the part were not compared, as a number of `Unjudged` from 1;
        0 for none
    """

    wrong: BoolArray
    compared: BoolArray
    reason: NDArray[np.uint8]


def in_penumbra(light: Light) -> BoolArray:
    """Return a mask (h, w) of nodes on which a shadow's border may fall."""
    return np.asarray(light.most - light.least >= PENUMBRA_SHARE * light.open)


def fitted_nodes(surface: Surface, light: Light, valid: BoolArray) -> BoolArray:
    """Return a mask (h, w) of nodes with light certain enough to fit a picture's brightness.

    Parameters
    ----------
    surface : surface seen by the nodes
    light : bounds on the lamp's light
    valid : mask inside the outline, and not beside the gripper
    """
    out: BoolArray = surface.seen & valid & ~in_penumbra(light)
    return out & (light.least > FITTED_LIGHT) & (surface.cosine > STEEPEST)


def compare(
    observed: Float32Array,
    surface: Surface,
    light: Light,
    brightness: Brightness,
    mirrored: Float32Array,
    valid: BoolArray,
    ground: float,
    limits: InspectionLimits,
    flattest: float,
) -> Compared:
    """Return the differences of a lit picture from the predicted light.

    Parameters
    ----------
    observed : (h, w) grey, hardly smoothed
    surface : surface of the part seen by the nodes
    light : bounds on the lamp's light on it
    brightness : brightness fitted to the picture
    mirrored : (h, w) upper bound on the light that the finish mirrors
    valid : mask inside the outline, not beside the gripper or in its shadow
    ground : brightness of the wall behind the part
    limits : limits of the differences
    flattest : least cosine at which a surface is compared
    """
    seen = surface.seen
    play, play_open = (
        SCATTERS * np.maximum(spread, MIN_SPREAD)
        for spread in (brightness.spread, brightness.spread_open)
    )
    middle = brightness.predicted * brightness.tone
    unshaded = brightness.unshaded * brightness.tone
    scale = middle / np.maximum(0.5 * (light.least + light.most), 1e-3)
    # Effects of a shadow's border, and of a surface turned by a degree, in grey levels.
    half_width = 0.5 * (light.most - light.least)
    width = np.where(light.most > 0.02, scale * half_width, 0.0)
    low = np.maximum(middle - width, 0.0) * (1 - np.minimum(play, 1.0))
    from_others = np.maximum(light.bounced.most, mirrored)
    bounced = unshaded * np.minimum(from_others, 1.0)
    own = (middle + width) * (1 + play)
    beyond = unshaded * np.minimum(_beyond_tone(from_others, surface, light, valid), 1.0)
    high = own + beyond
    penumbra = in_penumbra(light)
    high = np.where(penumbra, np.maximum(high, unshaded * (1 + play) + bounced), high)
    kernel = np.ones((3, 3), np.uint8)
    # The pose may be off by a node, so the neighbourhood of a pixel may lie in it.
    brightest = cv2.dilate(np.where(seen, high, np.float32(ground)).astype(np.float32), kernel)
    darkest = cv2.erode(np.where(seen, low, np.float32(0)).astype(np.float32), kernel)
    bare = cv2.dilate(np.where(seen, own, np.float32(ground)).astype(np.float32), kernel)
    floor = np.float32(limits.grey_levels / 2)
    top, bottom = brightest + floor, darkest - floor
    stands_out = (bottom >= HALVED * middle) & (top <= TWICE * middle)
    lit = (middle >= UNLIT_GREY) & (light.most >= 0.5 * FITTED_LIGHT)
    # Where a shadow is absent, its surface is as bright as in the open.
    shaded = ((light.most < SHADED * light.open) | ~seen).astype(np.uint8)
    dark: BoolArray = seen & (cv2.erode(shaded, kernel) > 0) & (light.open > FITTED_LIGHT)
    dark &= (bounced < HALVED * unshaded) & (play_open < HALVED)
    behind = ~seen
    wrong = valid & (
        (lit & stands_out & (observed < bottom))
        | (lit & stands_out & (observed > top))
        | (dark & (observed > (1 - play_open) * unshaded + floor))
        | (behind & (observed > top))
    )
    odd = _odd_faces(wrong & seen, surface, valid)
    wrong &= ~odd
    burnt = observed >= BURNT_GREY
    compared = seen & valid & lit & stands_out & ~odd & ~burnt & (surface.cosine > flattest)
    reason = np.where(seen & ~compared, Unjudged.EDGE.number, 0).astype(np.uint8)
    for which, why in (
        (odd | (play > HALVED), Unjudged.LIGHT),
        (burnt, Unjudged.HIGHLIGHT),
        (beyond > 0.4 * middle, Unjudged.BOUNCE),
        # Light from neighbours alone may double the brightness.
        ((top > TWICE * middle) & (bare + floor <= TWICE * middle), Unjudged.BOUNCE),
        (penumbra, Unjudged.PENUMBRA),
        (~lit, Unjudged.UNLIT),
        (surface.cosine <= flattest, Unjudged.FLAT),
        (~valid, Unjudged.HOLDER),
    ):
        reason[seen & ~compared & which] = why.number
    return Compared(wrong, compared, reason)


def _beyond_tone(
    from_others: Float32Array, surface: Surface, light: Light, valid: BoolArray
) -> Float32Array:
    """Return by how much light from neighbours (h, w) may exceed what a face's tone has of it.

    A face's tone is the median of its lit nodes, so it holds the light that these have alike.
    """
    lit = fitted_nodes(surface, light, valid)
    out = from_others.copy()
    for face in np.flatnonzero(np.bincount(surface.face[lit], minlength=1) >= FACE_COUNT).tolist():
        mine = lit & (surface.face == face)
        out[mine] = np.maximum(out[mine] - np.median(out[mine]), 0.0)
    return out


def _odd_faces(wrong: BoolArray, surface: Surface, valid: BoolArray) -> BoolArray:
    """Return a mask (h, w) of faces that are wrong as a whole: their light is not understood."""
    judged = surface.seen & valid
    count = int(surface.face.max()) + 2
    all_of = np.bincount(surface.face[judged], minlength=count)
    off_of = np.bincount(surface.face[wrong & judged], minlength=count)
    odd = off_of > WHOLE_FACE * np.maximum(all_of, 1)
    odd[-1] = False  # no face
    return np.asarray(odd[surface.face])
