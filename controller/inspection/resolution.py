"""Pixels that a face needs for its surface to be compared, and not its edges alone."""

from collections.abc import Sequence

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import Recess, Solid, inner_mm

from .limits import MIN_FACE_SHARE, strip_px
from .lit import DISC_OFF, MIN_WIDTH_PX


def is_narrow(
    solid: Solid, smallest_mm: float, pixel_mm: float, cosine: float | FloatArray
) -> BoolArray:
    """Return a mask (f,) of faces on which no smallest defect is clear of the strips beside edges.

    Parameters
    ----------
    solid : the part
    smallest_mm : size of the smallest defect
    pixel_mm : size of a pixel at the part
    cosine : (f,) of the incidence at which a view shows each face; or one for all
    """
    return np.asarray(inner_mm(solid) < 0.5 * smallest_mm + _strip_mm(pixel_mm, cosine))


def is_deep(
    solid: Solid,
    recesses: Sequence[Recess],
    smallest_mm: float,
    pixel_mm: float,
    slope: float,
) -> BoolArray:
    """Return a mask (f,) of floors that lie too deep for a square view to compare enough of them.

    The mouth of a blind recess shades a strip along the border of its floor, beside the strip that
    shows no defect. What is left has to hold the centres of smallest defects on the share of the
    face that a PASS asks for.

    Parameters
    ----------
    solid : the part
    recesses : its recesses
    smallest_mm : size of the smallest defect
    pixel_mm : size of a pixel at the part
    slope : least tangent of the angle between the lines from the part to the camera and to a lamp
    """
    out = np.zeros(len(solid.faces), dtype=bool)
    room_mm = inner_mm(solid, MIN_FACE_SHARE) - DISC_OFF * 0.5 * smallest_mm
    for recess in recesses:
        if not recess.is_through:
            floor = list(recess.bottom(solid))
            out[floor] = room_mm[floor] < _strip_mm(pixel_mm, 1.0) + recess.depth_mm * slope
    return out


def _strip_mm(pixel_mm: float, cosine: float | FloatArray) -> float | FloatArray:
    """Return the width on a face of the strip beside an edge in which no defect shows."""
    return pixel_mm * strip_px(pixel_mm) / cosine


def needed_px_per_mm(solid: Solid, smallest_mm: float, pixel_mm: float) -> FloatArray:
    """Return the pixels to the millimetre (f,), foreshortened, by which a face can be compared.

    The smallest defect has to be as wide in the picture as the filters need. And since a strip
    beside an edge is wider on a surface seen aslant, strips must leave of a face's inner radius the
    share that has to be compared. Where that takes more than a square view has, or where a square
    view leaves no room for a defect, the face's edges have to verify it.

    Parameters
    ----------
    solid : the part
    smallest_mm : size of the smallest defect
    pixel_mm : size of a pixel at the part
    """
    usual = MIN_WIDTH_PX / smallest_mm
    cosine = _strip_mm(pixel_mm, (1.0 - MIN_FACE_SHARE) * inner_mm(solid))
    by_edges = is_narrow(solid, smallest_mm, pixel_mm, 1.0) | (cosine > 1.0)
    return np.where(by_edges, usual, np.maximum(usual, cosine / pixel_mm))
