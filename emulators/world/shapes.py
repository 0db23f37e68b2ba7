"""Boxes in frames: what the bodies of the cell take up [mm]."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """An upright box in the frame of its owner.

    Attributes
    ----------
    low_mm, high_mm : (3,) corners
    """

    name: str
    low_mm: Array
    high_mm: Array

    @property
    def centre_mm(self) -> Array:
        """Its middle, (3,) [mm]."""
        return (self.low_mm + self.high_mm) / 2.0

    @property
    def half_mm(self) -> Array:
        """Half its edges, (3,) [mm]."""
        return (self.high_mm - self.low_mm) / 2.0


@dataclass(frozen=True, slots=True, eq=False)
class PlacedBox:
    """A box in a frame that is fixed in the world.

    Attributes
    ----------
    T_world_box : (4, 4) pose of the frame that the box's corners are given in
    """

    box: Box
    T_world_box: Array
