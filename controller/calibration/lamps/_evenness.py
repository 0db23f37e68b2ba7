"""Evenness of a panel's light, and the share of a picture that is too bright to be measured."""

from typing import Final

import numpy as np

from controller.arrays import BoolArray, Grey

FIELD_PX: Final = 64  # noise and dust average out over such a field
WHITE: Final = 254  # a pixel at this level may have been brighter


def evenness(lit: Grey, dark: Grey, inside: BoolArray) -> float:
    """Return the least light as a share of the most, over fields wholly on the panel.

    Parameters
    ----------
    lit, dark : (height, width) with the panel on, and with all lamps off
    inside : (height, width) mask of the visible panel

    Raises
    ------
    ValueError : no field is wholly on the panel
    """
    light = lit.astype(np.float64) - dark
    height, width = lit.shape
    means = [
        light[y : y + FIELD_PX, x : x + FIELD_PX].mean()
        for y in range(0, height - FIELD_PX + 1, FIELD_PX)
        for x in range(0, width - FIELD_PX + 1, FIELD_PX)
        if inside[y : y + FIELD_PX, x : x + FIELD_PX].all()
    ]
    if not means:
        raise ValueError("no field of the picture is wholly on the panel")
    return float(max(0.0, min(means)) / max(means)) if max(means) > 0 else 0.0


def saturated_share(picture: Grey) -> float:
    """Return the share of a picture's pixels that are saturated."""
    return float((picture >= WHITE).mean())
