"""Rules for a difference between two pictures of a part that is held nearly as planned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class DisambiguationRules:
    """Uncertainty of the hold, and the difference required of a picture; each with its reason."""

    shift_mm: float = 1.0  # a part moves this much when the jaws close on it
    turn_rad: float = float(np.radians(2.0))  # and turns this much about any axis
    edge_px: float = 1.5  # error of lit edges and outlines, either way
    min_area_px: float = 100.0  # ten pixels square; dust and glare make smaller patches
    min_edge_px: float = 40.0  # a lit edge a quarter as long may be a scratch or a reflection
    gripper_px: float = (
        9.0  # nothing is compared this near to the arm gripper (inspection/_scene.py)
    )
    crease_rad: float = float(np.radians(20.0))  # a blunter edge may not show under a ring lamp
    step_mm: float = 0.5  # a lower step may not show if its wall is hidden
    coarse_px: int = 4  # pictures of all views are predicted on every fourth pixel
    fine_px: int = 2
    fine_count: int = 3  # the cheapest and the clearest views of a pair, again on a finer grid
    max_view_count: int = 60  # largest number of views examined, spread evenly over those offered
